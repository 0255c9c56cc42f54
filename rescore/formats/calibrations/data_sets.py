"""What the calibration files of data sets say that nest their numbers in a way of their own."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.formats.calibrations.file_forms import Named
from rescore.formats.calibrations.numbers import Values, matrix_of, number_of, numbers_of, pinhole

TABLE = "table"
"""Name of a value that is there where a file is a table of Virtual KITTI."""


def of_data_set(path: Path, found: Named) -> Values | None:
    """The values of a file of Cityscapes, Argoverse or Virtual KITTI, by the names that OpenCV gives them.

    None where it is of none of them.

    Raises:
        RescoreError: it is of one, and lacks a part.
    """
    sections = {k: v for k, v in found.items() if isinstance(v, dict)}
    if "baseline" in sections.get("extrinsic", ()) and "u0" in sections.get("intrinsic", ()):
        return _of_cityscapes(path, sections)
    if isinstance(cameras := found.get("camera_data_"), list):
        return _of_argoverse(path, cameras)
    return _of_virtual_kitti(path, sections) if "camera0" in sections else None


def _of_cityscapes(path: Path, sections: Mapping[str, Named]) -> Values:
    """The pair of Cityscapes' camera file, the ground under it, and the value of no disparity in its files.

    Height and angles are those of the left camera on the vehicle, whose origin lies on the ground: turns
    about the axes to the left (pitch, positive down) and ahead (roll, positive to the right), in this order.
    """
    inside, outside = (
        {k: number_of(path, {k: numbers_of(path, k, v)}, k) for k, v in sections[name].items() if k in wanted}
        for name, wanted in (
            ("intrinsic", ("fx", "fy", "u0", "v0")),
            ("extrinsic", ("baseline", "z", "pitch", "roll")),
        )
    )
    missing = [k for k in ("fx", "fy", "u0", "v0") if k not in inside]
    if missing:
        raise RescoreError(f"{path}: intrinsic: expected fx, fy, u0 and v0, got no {missing[0]}; mend it")
    told = {"baseline_m": outside["baseline"], "disparity_factor": 256.0, "disparity_zero": 1.0}
    if "z" in outside:
        pitch, roll = outside.get("pitch", 0.0), outside.get("roll", 0.0)
        told |= {
            "height_m": outside["z"],
            "pitch_rad": np.arctan2(np.sin(pitch), np.cos(pitch) * np.cos(roll)),
        }
        told["roll_rad"] = np.arcsin(np.cos(pitch) * np.sin(roll))
    values = {name: np.array([value], dtype=float) for name, value in told.items()}
    return values | {"K": pinhole(*(inside[k] for k in ("fx", "fy", "u0", "v0")))}


def _of_argoverse(path: Path, cameras: list[object]) -> Values:
    """The rectified pair of Argoverse, whose baseline is the distance of the cameras' places on the vehicle.

    Raises:
        RescoreError: the file has no rectified pair.
    """
    named = {c.get("key", ""): c.get("value") for c in cameras if isinstance(c, dict)}
    found = [
        next((v for k, v in named.items() if str(k).endswith(f"stereo_front_{side}_rect")), None)
        for side in ("left", "right")
    ]
    left, right = (v if isinstance(v, dict) else None for v in found)
    if left is None or right is None:
        raise RescoreError(
            f"{path}: expected the cameras stereo_front_left_rect and stereo_front_right_rect, got "
            f"{', '.join(map(str, named))[:80] or 'none'}; write calib.yaml"
        )
    names = [f"focal_{k}_{axis}_px_" for k in ("length", "center") for axis in "xy"]
    numbers = [number_of(path, {k: numbers_of(path, k, left.get(k))}, k) for k in names]
    places = [_place_on_vehicle(path, camera) for camera in (left, right)]
    apart = np.array([np.linalg.norm(places[1] - places[0])])
    return {"K": pinhole(*numbers), "baseline_m": apart}


def _place_on_vehicle(path: Path, camera: Named) -> FloatArray:
    moved = camera.get("vehicle_SE3_camera_")
    name, told = "translation", moved.get("translation") if isinstance(moved, dict) else None
    return matrix_of(path, {name: numbers_of(path, name, told)}, name, 1, 3)


def _of_virtual_kitti(path: Path, cameras: Mapping[str, Named]) -> Values:
    """K of Virtual KITTI's table of intrinsics, or the baseline of its table of extrinsics.

    Raises:
        RescoreError: it is another table.
    """
    read = ("K[0,0]", "K[1,1]", "K[0,2]", "K[1,2]", "t1")
    first, second = (
        {k: numbers_of(path, k, v) for k, v in cameras.get(name, {}).items() if k in read}
        for name in ("camera0", "camera1")
    )
    if read[0] in first:
        return {"K": pinhole(*(number_of(path, first, k) for k in read[:4])), TABLE: np.ones(1)}
    # both cameras are turned alike, and points of the world move to the left in the right one
    return {"baseline_m": np.array([number_of(path, first, "t1") - number_of(path, second, "t1")])}
