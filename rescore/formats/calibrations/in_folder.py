"""The calibration of a folder of pictures: which files hold it, and what they say besides the camera."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from recon.errors import RescoreError
from rescore.formats.calibration_files import (
    Calibration,
    calibration_of,
    notes_of,
    refuse_other_size,
    size_of,
)
from rescore.formats.calibrations.file_forms import FORMS
from rescore.formats.calibrations.numbers import Values, number_of
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.calibrations.values import UNITS, calibration_values

_NAMED = re.compile(
    r"((left|right)[_-]?)?(calib|cam_?info|camera|intrinsic|extrinsic|camchain|stereo|sensor|sn\d+|orb)",
    re.IGNORECASE,
)
"""Beginnings of names by which text, XML and JSON are taken for a calibration."""
_OTHER_YAML = ("data", "dataset")
"""Names of YAML files that are none."""
_SENSOR = "sensor.yaml"
"""EuRoC's file of one camera, beside its folder of pictures."""


@dataclass(frozen=True, eq=False)
class FolderCalibration:
    """What the calibration files of a folder say."""

    path: Path | None = None
    """The file, that of the left camera where there are two; None where there is none."""
    calibration: Calibration | None = None
    """None where no file says the camera."""
    raw: RawPair | None = None
    """The cameras as they stand; None where no file says."""
    depth_factor: float | None = None
    """Value of files of depth for one metre; None where no file says."""
    disparity_factor: float | None = None
    """Value of files of disparity for one pixel; None where no file says."""
    notes: tuple[str, ...] = ()
    """What the user is to see."""


def calibration_in(
    root: Path, left: Path, right: Path | None, size_px: tuple[int, int], *, as_taken: bool = False
) -> FolderCalibration:
    """The calibration of a folder.

    Args:
        root: The folder.
        left: The folder of left pictures.
        right: That of right pictures, if there is one.
        size_px: Width and height of the pictures.
        as_taken: Whether the pictures are as the cameras took them, so that only ``raw`` is asked for.

    Raises:
        RescoreError: several files, none of which is to be preferred, or one that is damaged or of pictures
            that are not rectified.
    """
    files = _files(root, left, right)
    if not files:
        return FolderCalibration(notes=_unread(root))
    path, *second = files
    values = calibration_values(path, second[0] if second else None, size_px)
    if as_taken:
        refuse_other_size(path, size_of(path, values), size_px)
        return FolderCalibration(path, None, RawPair.of(path, values))
    pair = ("P0", "P1") if left.name == "image_0" else ("P2", "P3")
    return FolderCalibration(
        path,
        None if set(values) <= set(UNITS) and values else calibration_of(path, values, pair),
        RawPair.of(path, values),
        _factor(path, values, "depth_factor", "DepthMapFactor"),
        _factor(path, values, "disparity_factor"),
        notes_of(path, values),
    )


def _factor(path: Path, values: Values, *names: str) -> float | None:
    name = next((n for n in names if n in values), None)
    if name is None:
        return None
    factor = number_of(path, values, name)
    if not factor > 0:
        raise RescoreError(
            f"{path}: {name}: expected a positive number, got {factor:g}; KITTI has 256, TUM depth 5000, "
            "millimetres 1000"
        )
    return factor


def _files(root: Path, left: Path, right: Path | None) -> Sequence[Path]:
    """The file of the calibration, or the two of its cameras; none where there is none."""
    sensors = [] if right is None else [_sensor(left), _sensor(right)]
    if sensors and all(p is not None for p in sensors):
        return [p for p in sensors if p is not None]
    found = [p for p in sorted(root.iterdir()) if _may_be(p)]
    for first, second in (("left", "right"), ("intrinsic", "extrinsic")):
        halves = [[p for p in found if side in p.stem.lower()] for side in (first, second)]
        if len(found) == 2 and all(len(paths) == 1 for paths in halves):
            return [paths[0] for paths in halves]
    preferred = [p for p in found if p.stem.lower().startswith("calib")]
    for chosen in (preferred, found):
        if len(chosen) == 1:
            return chosen
    if found:
        raise RescoreError(
            f"{root}: expected one calibration, or left.yaml and right.yaml, found "
            f"{', '.join(p.name for p in found)}; name the right one calib.yaml and move the others"
        )
    return []


def _sensor(pictures: Path) -> Path | None:
    places = [folder / _SENSOR for folder in (pictures, pictures.parent)]
    return next((p for p in places if p.is_file()), None)


def _may_be(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix not in FORMS or path.name.startswith(".") or not path.is_file():
        return False
    if suffix in (".yaml", ".yml"):
        return path.stem not in _OTHER_YAML
    one_side = suffix != ".txt" and path.stem.lower() in ("left", "right")
    return one_side or _NAMED.match(path.stem) is not None


def _unread(root: Path) -> tuple[str, ...]:
    """A line on files that bear the name of a calibration in a form that is not read."""
    found = [p.name for p in sorted(root.iterdir()) if p.is_file() and _NAMED.match(p.stem)]
    if not found:
        return ()
    return (
        f"{root}: {', '.join(found)[:80]} may be a calibration, and is not read ({', '.join(FORMS)} are); "
        "write calib.yaml",
    )
