"""What the calibration files of other tools say, by the names that OpenCV gives to the parts of a pair.

K1, D1, K2, D2 are matrices and distortions of the cameras as they stand, R and T take the left camera's
coordinates to the right one's, R1, P1, R2, P2 are of rectified pictures. K, D, P are of a single camera.
"""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.formats.calibrations.file_forms import Named
from rescore.formats.calibrations.numbers import Values, matrix_of, number_of, numbers_of, pinhole, short

FISHEYE = "fisheye"
"""Name of a value that is there where distortions are those of OpenCV's fisheye camera."""
_FISHEYES = ("equidistant", "fisheye", "kannalabrandt8")
_DISTORTION = ("distortion_coeffs", "distortion_coefficients")
ZED_SIZES = {
    (2208, 1242): "2K",
    (1920, 1080): "FHD",
    (1920, 1200): "FHD1200",
    (1280, 720): "HD",
    (960, 600): "SVGA",
    (672, 376): "VGA",
}
"""Names of ZED's sections by the size of its pictures in pixels."""


def rotation(path: Path, name: str, matrix: FloatArray) -> FloatArray:
    """A rotation matrix (3, 3) as it stands in a file.

    Raises:
        RescoreError: it is none.
    """
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 0.01 or np.linalg.det(matrix) < 0:
        raise RescoreError(f"{path}: {name}: expected a rotation, got another matrix; mend it")
    return matrix


def is_fisheye(model: object) -> bool:
    """Whether a camera model of a file is OpenCV's fisheye."""
    return str(model).casefold() in _FISHEYES


def of_kalibr(path: Path, blocks: Mapping[str, Named]) -> Values:
    """The two cameras of Kalibr's blocks cam0 and cam1, or K and D of cam0 alone, and their size.

    Raises:
        RescoreError: the blocks are not as Kalibr writes them.
    """
    if "cam0" not in blocks:
        raise RescoreError(f"{path}: expected Kalibr's block cam0, got cam1 alone; add it")
    first = _kalibr_camera(path, "cam0", blocks["cam0"])
    if "cam1" not in blocks:
        return first
    second = _kalibr_camera(path, "cam1", blocks["cam1"])
    move = matrix_of(path, second, "cam1: T_cn_cnm1", 4, 4)
    if any(second.get(k, first[k]) != first[k] for k in ("width", "height") if k in first):
        raise RescoreError(
            f"{path}: cam1: expected pictures of one size, got two sizes; calibrate such pictures"
        )
    if (FISHEYE in first) != (FISHEYE in second):
        raise RescoreError(
            f"{path}: cam1: expected the distortion model of cam0, got another; calibrate with one"
        )
    kept = {k: v for k, v in first.items() if k in ("width", "height", FISHEYE)}
    pair = {"K1": first["K"], "D1": first["D"], "K2": second["K"], "D2": second["D"]}
    return kept | pair | {"R": move[:3, :3], "T": move[:3, 3]}


def _kalibr_camera(path: Path, name: str, block: Named) -> Values:
    """K, D, width and height of a block, and how it stands to the one before."""
    read = ("intrinsics", "resolution", "T_cn_cnm1", *_DISTORTION)
    values = {f"{name}: {k}": numbers_of(path, f"{name}: {k}", block[k]) for k in read if block.get(k)}
    model, bent = block.get("camera_model", "pinhole"), str(block.get("distortion_model", "radtan"))
    if model != "pinhole" or bent not in ("radtan", "radial-tangential", "plumb_bob", "none", *_FISHEYES):
        raise RescoreError(
            f"{path}: {name}: expected a pinhole camera with radtan or equidistant distortion, got the "
            f"camera model {short(model)} with {short(bent)}; rectify with the tool and write P1 and P2"
        )
    values["K"] = pinhole(*matrix_of(path, values, f"{name}: intrinsics", 1, 4)[0])
    found = next((values[f"{name}: {k}"] for k in _DISTORTION if f"{name}: {k}" in values), np.zeros(4))
    values["D"] = found.ravel()
    if f"{name}: resolution" in values:
        values["width"], values["height"] = matrix_of(path, values, f"{name}: resolution", 2, 1)
    return values | ({FISHEYE: np.ones(1)} if is_fisheye(bent) else {})


def of_zed(path: Path, sections: Mapping[str, Named], size_px: tuple[int, int] | None) -> Values:
    """The two cameras of ZED's SN.conf for pictures of a size, with lengths in metres.

    Raises:
        RescoreError: the size is none of ZED's, or its sections are not there.
    """
    name = ZED_SIZES.get(size_px or (0, 0))
    if name is None or f"LEFT_CAM_{name}" not in sections:
        got = "no size" if size_px is None else f"{size_px[0]} x {size_px[1]}"
        known = ", ".join(f"{w} x {h}" for (w, h), n in ZED_SIZES.items() if f"LEFT_CAM_{n}" in sections)
        raise RescoreError(
            f"{path}: expected pictures of {known or 'a size of ZED'} pixels, got {got}; keep ZED's size"
        )
    values: Values = {}
    for number, side in ((1, "LEFT"), (2, "RIGHT")):
        section = f"{side}_CAM_{name}"
        own = _section(path, sections, section)
        fx, fy, cx, cy = (number_of(path, own, f"{section}: {k}") for k in ("fx", "fy", "cx", "cy"))
        values[f"K{number}"] = pinhole(fx, fy, cx, cy)
        order = [f"{section}: {k}" for k in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]
        last = 8 if order[5] in own else 5
        values[f"D{number}"] = np.array([number_of(path, own, k) if k in own else 0.0 for k in order[:last]])
    stereo = _section(path, sections, "STEREO")
    turn = [number_of(path, stereo, f"STEREO: {k}_{name}") for k in ("RX", "CV", "RZ")]
    aside = [
        number_of(path, stereo, f"STEREO: {k}") if f"STEREO: {k}" in stereo else 0.0 for k in ("TY", "TZ")
    ]
    # ZED has the place of the right camera, in millimetres, where OpenCV has the move of points
    move = -np.array([number_of(path, stereo, "STEREO: Baseline"), *aside]) / 1000
    return values | {"R": np.asarray(cv2.Rodrigues(np.array(turn))[0], float), "T": move}


def _section(path: Path, sections: Mapping[str, Named], name: str) -> Values:
    if name not in sections:
        raise RescoreError(f"{path}: expected ZED's section [{name}], got none; fetch the file again")
    return {f"{name}: {k}": numbers_of(path, f"{name}: {k}", v) for k, v in sections[name].items()}


def of_euroc(path: Path, left: Values, right_path: Path, right: Values) -> Values:
    """The two cameras of EuRoC's sensor files, each of which has its place on the body."""
    values: Values = {}
    for number, file, own in ((1, path, left), (2, right_path, right)):
        values[f"K{number}"] = matrix_of(file, own, "K", 3, 3)
        values[f"D{number}"] = own.get("D", np.zeros(4))
    body = matrix_of(path, left, "T_BS", 4, 4), matrix_of(right_path, right, "T_BS", 4, 4)
    move = _inverse(right_path, "T_BS", body[1]) @ body[0]
    kept = {k: v for k, v in left.items() if k in ("width", "height", FISHEYE)}
    return values | kept | {"R": move[:3, :3], "T": move[:3, 3]}


def _inverse(path: Path, name: str, move: FloatArray) -> FloatArray:
    """The move back of a 4 x 4 matrix that turns and moves points.

    Raises:
        RescoreError: it is no such matrix.
    """
    turn = rotation(path, name, move[:3, :3])
    return np.vstack([np.column_stack([turn.T, -turn.T @ move[:3, 3]]), [0, 0, 0, 1]])


def of_ros(path: Path, left: Values, right_path: Path, right: Values) -> Values:
    """The two cameras of ROS's files, each with its rectified camera.

    Raises:
        RescoreError: one of them has no projection matrix.
    """
    names = {
        "K": ("camera_matrix", "K"),
        "D": ("distortion_coefficients", "D"),
        "R": ("rectification_matrix",),
        "P": ("projection_matrix", "P"),
    }
    values = {k: v for k, v in left.items() if k not in sum(names.values(), ())}
    for number, file, own in ((1, path, left), (2, right_path, right)):
        for name, told in names.items():
            found = next((n for n in told if n in own), told[0])
            if found in own or name == "P":
                shape = {"K": (3, 3), "R": (3, 3), "P": (3, 4)}.get(name)
                values[f"{name}{number}"] = (
                    matrix_of(file, own, found, *shape) if shape else own[found].ravel()
                )
    return values


def of_orb_slam(path: Path, values: Values) -> Values:
    """The camera, or the two, of ORB-SLAM's settings; the values as they are where they are of another tool.

    Raises:
        RescoreError: settings are missing.
    """
    for prefix, number in (("Camera.", ""), ("Camera1.", "1"), ("Camera2.", "2")):
        if f"{prefix}fx" not in values or f"K{number}" in values:
            continue
        parts = [number_of(path, values, prefix + k) for k in ("fx", "fy", "cx", "cy")]
        values[f"K{number}"] = pinhole(*parts)
        order = ("k1", "k2", "k3", "k4") if FISHEYE in values else ("k1", "k2", "p1", "p2", "k3")
        bent = [values[prefix + k].flat[0] if prefix + k in values else 0.0 for k in order]
        values[f"D{number}"] = np.array(bent)
    if "Camera.bf" in values and "K" in values and values["K"][0, 0] > 0:
        values["baseline_m"] = values["Camera.bf"] / values["K"][0, 0]
    if "Stereo.b" in values:
        values["baseline_m"] = values["Stereo.b"]
    if "Stereo.T_c1_c2" in values:
        name = "Stereo.T_c1_c2"
        move = _inverse(path, name, matrix_of(path, values, name, 4, 4))
        values |= {"R": move[:3, :3], "T": move[:3, 3]}
    for side, name in (("width", "Camera.width"), ("height", "Camera.height")):
        if name in values:
            values[side] = values[name]
    return values


def of_driving_stereo(path: Path, values: Values) -> Values:
    """The pair of DrivingStereo's cameras 101 and 103, whose pictures are rectified, the left one first.

    The baseline is that of their places: pictures of half the size come with projections whose last column
    is of the full size.
    """
    p = [matrix_of(path, values, f"P_rect_{n}", 3, 4).copy() for n in (101, 103)]
    kept = {k: v for k, v in values.items() if not k.endswith(("_101", "_103"))}
    if not all(one[0, 0] > 0 for one in p):
        return kept | {"P1": p[0], "P2": p[1]}
    apart = p[1][0, 3] / p[1][0, 0] - p[0][0, 3] / p[0][0, 0]
    if all(f"{name}_{n}" in values for name in ("R", "T") for n in (101, 103)):
        places = [_place(path, values, n) for n in (101, 103)]
        apart = np.copysign(float(np.linalg.norm(places[1] - places[0])), apart)
    first, second = (p[0], p[1]) if apart < 0 else (p[1], p[0])
    first[0, 3], second[0, 3] = 0.0, -abs(apart) * second[0, 0]
    size = values.get("S_rect_101")
    if size is not None and size.size == 2:
        kept |= {"width": size[:1], "height": size[1:]}
    return kept | {"P1": first, "P2": second}


def _place(path: Path, values: Values, number: int) -> FloatArray:
    turn = matrix_of(path, values, f"R_{number}", 3, 3)
    return np.asarray(-turn.T @ matrix_of(path, values, f"T_{number}", 3, 1)[:, 0])


def open3d_matrix(path: Path, values: Values) -> FloatArray:
    """The matrix (3, 3) of a camera of Open3D, which lists it column by column.

    Raises:
        RescoreError: it is no such matrix.
    """
    matrix = matrix_of(path, values, "intrinsic_matrix", 3, 3)
    bottom = np.array([0.0, 0.0, 1.0])
    for found in (matrix.T, matrix):
        if (found[2] == bottom).all():
            return found
    raise RescoreError(
        f"{path}: intrinsic_matrix: expected fx, 0, 0, 0, fy, 0, cx, cy, 1, got other numbers; mend it"
    )
