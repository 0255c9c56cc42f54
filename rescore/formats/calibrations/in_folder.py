"""The calibration of a folder of pictures: which files hold it, and what they say besides the camera."""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from recon.errors import RescoreError
from recon.stores import remote
from rescore.data.pictures import by_stem
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
from rescore.formats.calibrations.values import UNITS, USUAL_DEPTH, ZERO, calibration_values
from rescore.formats.pairs.places import folders_in, has_pictures

_NAMED = re.compile(
    r"((left|right|vehicle)[_-]?)?(calib|cam_?info|camera|intr|extr|realsense|camchain|stereo|sensor|sn\d+|orb)",
    re.IGNORECASE,
)
"""Beginnings of names by which text, XML and JSON are taken for a calibration."""
_FOLDER = re.compile(r"calib|camera|intrinsic", re.IGNORECASE)
"""Beginnings of names of folders of calibrations."""
_OTHER_YAML = ("data", "dataset")
"""Names of YAML files that are none."""
_SENSOR = "sensor.yaml"
"""EuRoC's file of one camera, beside its folder of pictures."""
_RAW = "calib_cam_to_cam"
"""KITTI's file of the cameras of a date, beside those of its other sensors and above the date's drives."""


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
    form: str = ""
    """The tool or data set of whose form the file is, where that has one value for one metre."""
    usual_factor: float | None = None
    """Value for one metre that this tool or data set documents; None where there is none."""
    disparity_factor: float | None = None
    """Value of files of disparity for one pixel; None where no file says."""
    disparity_zero: float = 0.0
    """Value of files of disparity for no disparity."""
    notes: tuple[str, ...] = ()
    """What the user is to see."""


def calibration_in(
    root: Path,
    left: Path,
    right: Path | None,
    size_px: tuple[int, int],
    *,
    as_taken: bool = False,
    top: Path | None = None,
) -> FolderCalibration:
    """The calibration of a folder.

    Args:
        root: The folder.
        left: The folder of left pictures.
        right: That of right pictures, if there is one.
        size_px: Width and height of the pictures.
        as_taken: Whether the pictures are as the cameras took them, so that only ``raw`` is asked for.
        top: A folder above it: the nearest calibration up to there counts.

    Raises:
        RescoreError: several files, none of which is to be preferred, or one that is damaged or of pictures
            that are not rectified.
    """
    files = next((f for place in _upward(root, top or root) if (f := _files(place, left, right))), [])
    return (
        _read(files, left.name, size_px, as_taken=as_taken)
        if files
        else FolderCalibration(notes=_unread(root))
    )


def _upward(root: Path, top: Path) -> Iterator[Path]:
    """A folder and those above it, up to one; for a drive of KITTI's raw data its date, too."""
    yield root
    if top in root.parents:
        yield from root.parents[: root.parents.index(top) + 1]
    elif root.name.startswith(root.parent.name or "/") and (root.parent / f"{_RAW}.txt").is_file():
        yield root.parent


def calibrations_of_frames(
    root: Path, sub: Sequence[str], lefts: Sequence[Path], size_px: tuple[int, int]
) -> dict[Path, FolderCalibration]:
    """The calibration of each left picture that has its own, or one of its folder; empty where none has.

    Args:
        root: The folder of the data set, with a folder such as calib or camera.
        sub: Names of the folders between that of a side and its pictures.
        lefts: The pictures.
        size_px: Their width and height.

    Raises:
        RescoreError: a file is damaged, or of pictures that are not rectified.
    """
    folders = [p for p in folders_in(root) if _FOLDER.match(p.name)] if remote(root) is None else []
    for folder in (p for p in folders if not has_pictures(p)):
        files = _own_files(folder.joinpath(*sub), lefts) or _file_of_folder(folder, sub, lefts, size_px)
        if files:
            side = lefts[0].parent.name
            read = {path: _read([path], side, size_px) for path in set(files.values())}
            return {left: read[path] for left, path in files.items()}
    return {}


def _own_files(folder: Path, lefts: Sequence[Path]) -> dict[Path, Path]:
    """The file of each picture by its name, or by its name less the last word (KITTI 2015, Cityscapes)."""
    if not folder.is_dir():
        return {}
    there = by_stem(sorted(p for p in folder.iterdir() if _is_calibration(p)))
    found = {}
    for left in lefts:
        head = left.stem.rpartition("_")[0]
        name = next((n for n in (left.stem, head, f"{head}_camera") if n in there), None)
        if name is not None:
            found[left] = there[name]
    return found


def _file_of_folder(
    folder: Path, sub: Sequence[str], lefts: Sequence[Path], size_px: tuple[int, int]
) -> dict[Path, Path]:
    """The file that is called as the folder of the pictures, for all of them (DrivingStereo, KITTI tracking).

    Of several, as for pictures in full and in half, the one of their size counts.
    """
    if not sub:
        return {}
    names = [place / f"{sub[-1]}{end}" for place in (folder, *folders_in(folder)) for end in FORMS]
    found = [path for path in names if path.is_file()]
    if len(found) > 1:
        found = [p for p in found if size_of(p, calibration_values(p, None, size_px)) == size_px]
    return dict.fromkeys(lefts, found[0]) if len(found) == 1 else {}


def _read(
    files: Sequence[Path], left: str, size_px: tuple[int, int], *, as_taken: bool = False
) -> FolderCalibration:
    """What the file of a pair, or the two of its cameras, say; ``left`` names the folder of left pictures."""
    path, *second = files
    values = calibration_values(path, second[0] if second else None, size_px)
    if as_taken:
        refuse_other_size(path, size_of(path, values), size_px)
        return FolderCalibration(path, None, RawPair.of(path, values))
    cameras = (0, 1) if left in ("image_0", "image_00") else (2, 3)
    form, usual_factor = next(((f, m) for name, f, m in USUAL_DEPTH if name in values), ("", None))
    return FolderCalibration(
        path=path,
        calibration=None if set(values) <= set(UNITS) and values else calibration_of(path, values, cameras),
        raw=RawPair.of(path, values),
        depth_factor=_depth_factor(path, values),
        form=form,
        usual_factor=usual_factor,
        disparity_factor=_factor(path, values, "disparity_factor"),
        disparity_zero=number_of(path, values, ZERO) if ZERO in values else 0.0,
        notes=notes_of(path, values),
    )


def _depth_factor(path: Path, values: Values) -> float | None:
    """Value for one metre. A scale below 1 is the metres of 1 (RealSense), others are the value (Open3D)."""
    scale = _factor(path, values, "depth_scale")
    if scale is not None:
        return 1 / scale if scale < 1 else scale
    return _factor(path, values, "depth_factor", "DepthMapFactor")


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
    found = [p for p in _entries(root) if _may_be(p)]
    for first, second in (("left", "right"), ("intrinsic", "extrinsic")):
        halves = [[p for p in found if side in p.stem.lower()] for side in (first, second)]
        if len(found) == 2 and all(len(paths) == 1 for paths in halves):
            return [paths[0] for paths in halves]
    cameras = [p for p in found if p.stem == _RAW]
    preferred = [p for p in found if p.stem.lower().startswith("calib")]
    for chosen in (cameras, preferred, found):
        if len(chosen) == 1:
            return chosen
    if found:
        raise RescoreError(
            f"{root}: expected one calibration, or left.yaml and right.yaml, found "
            f"{', '.join(p.name for p in found)}; name the right one calib.yaml and move the others"
        )
    return []


def _entries(root: Path) -> list[Path]:
    """What lies in a folder and ends as a form of calibrations; asked for each of perhaps many sequences."""
    names = [p.name for p in root.iterdir()] if remote(root) is not None else os.listdir(root)
    return [root / name for name in sorted(n for n in names if n.lower().endswith(tuple(FORMS)))]


def _sensor(pictures: Path) -> Path | None:
    places = [folder / _SENSOR for folder in (pictures, pictures.parent)]
    return next((p for p in places if p.is_file()), None)


def _may_be(path: Path) -> bool:
    if not _is_calibration(path):
        return False
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return path.stem not in _OTHER_YAML
    one_side = suffix != ".txt" and path.stem.lower() in ("left", "right")
    return one_side or _NAMED.match(path.stem) is not None


def _is_calibration(path: Path) -> bool:
    return path.suffix.lower() in FORMS and not path.name.startswith(".") and path.is_file()


def _unread(root: Path) -> tuple[str, ...]:
    """A line on files that bear the name of a calibration in a form that is not read."""
    found = [p.name for p in sorted(root.iterdir()) if _NAMED.match(p.stem) and p.is_file()]
    if not found:
        return ()
    return (
        f"{root}: {', '.join(found)[:80]} may be a calibration, and is not read ({', '.join(FORMS)} are); "
        "write calib.yaml",
    )
