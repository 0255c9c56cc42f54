"""KITTI's object layout: image_2, image_3, calib and label_2, a file a frame; its text of boxes both ways.

Geiger, Lenz, Urtasun 2012, and the benchmark's devkit. Cars alone count; vans and DontCare regions are
neither hits nor false alarms, as in KITTI's own evaluation.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.data.boxes3d import Boxes3D, BoxValues
from rescore.data.frames import DataSet, frame_names
from rescore.data.pictures import PICTURES, pictures_in
from rescore.evidence.candidates import CandidateTable
from rescore.formats.calibration_files import read_calibration
from rescore.formats.folders import Layout, Pictures, data_set, files_of_frames, splits_of
from rescore.formats.labels import (
    UNKNOWN_OCCLUSION,
    ClassMap,
    LabelRow,
    checked_box,
    number,
    read_lines,
    with_size,
)

DONT_CARE = "DontCare"
NEIGHBOURS = {"car": ("van",), "pedestrian": ("person_sitting",)}
"""Classes whose boxes are ignored in KITTI's evaluation of a class."""
UNKNOWN_ALPHA = -10.0
BOX_COLUMNS = ("left", "top", "right", "bottom")
BOX3D_COLUMNS = ("height", "width", "length", "x", "y", "z", "rotation_y")
UNKNOWN_PLACE = -1000
"""Coordinate of a location that is not known."""
UNKNOWN_BOX3D = (-1, -1, -1, UNKNOWN_PLACE, UNKNOWN_PLACE, UNKNOWN_PLACE, -10)
"""What KITTI writes in the columns of a 3D box where there is none."""


def azimuth_of_alpha(alpha_rad: float) -> float:
    """Azimuth in [0, 360) degrees of KITTI's observation angle; NaN where unknown.

    Alpha 0 is a car that faces right, whose right side is seen (270); pi / 2 faces the camera (0).
    """
    return math.nan if abs(alpha_rad) > 2 * math.pi else (math.degrees(alpha_rad) - 90) % 360


def alpha_of_azimuth(azimuth_deg: float) -> float:
    """The inverse of ``azimuth_of_alpha``, in (-pi, pi]; -10 where unknown."""
    if math.isnan(azimuth_deg):
        return UNKNOWN_ALPHA
    return math.radians(180 - (90 - azimuth_deg) % 360)


def read_rows(path: Path) -> list[LabelRow]:
    """The boxes of a label or result file, all classes; DontCare rows are ``ignore``.

    Raises:
        RescoreError: a line has another shape; it is named.
    """
    return [_row(where, words) for where, words in read_lines(path)]


def _row(where: str, words: list[str]) -> LabelRow:
    if len(words) not in (15, 16):
        raise RescoreError(
            f"{where}: expected 15 columns of KITTI (16 with a score), got {len(words)}; mend the line"
        )
    truncated, occluded, alpha, *box = (
        number(where, what, word)
        for what, word in zip(("truncated", "occluded", "alpha", *BOX_COLUMNS), words[1:8], strict=True)
    )
    score = number(where, "the score", words[15]) if len(words) == 16 else None
    if truncated > 1 or occluded not in (-1, 0, 1, 2, 3):
        raise RescoreError(
            f"{where}: expected truncated up to 1 and occluded in -1 to 3, got {words[1]} and {words[2]}; "
            "mend the line"
        )
    return LabelRow(
        name=words[0],
        xyxy_px=checked_box(where, box),
        ignore=words[0].casefold() == DONT_CARE.casefold(),
        azimuth_deg=azimuth_of_alpha(alpha),
        truncated=truncated if truncated >= 0 else math.nan,
        occluded=int(occluded) if occluded >= 0 else UNKNOWN_OCCLUSION,
        score=score,
        bbox3d=_read_box3d(where, words[8:15]),
    )


def _read_box3d(where: str, words: list[str]) -> BoxValues | None:
    """Centre, length, width, height and turn; None where the columns say that there is no box."""
    columns = [number(where, what, word) for what, word in zip(BOX3D_COLUMNS, words, strict=True)]
    size, place = np.array([columns[:3]]), np.array([columns[3:6]])
    if (size <= 0).any() or (place == UNKNOWN_PLACE).any():
        return None
    x, y, z, length, width, height, turn = Boxes3D.of_kitti(place, size, np.array(columns[6:])).values[0]
    return (x, y, z, length, width, height, turn)


def of_class(
    rows: Sequence[Sequence[LabelRow]], classes: ClassMap
) -> tuple[list[list[LabelRow]], Counter[str]]:
    """The boxes that matter for a class, of each file, and how many boxes each class has in all.

    Boxes of DontCare and of the class's neighbours are kept as ``ignore``.
    """
    counts = Counter(r.name for own in rows for r in own)
    return [[r for r in (_for_class(r, classes) for r in own) if r] for own in rows], counts


def _for_class(row: LabelRow, classes: ClassMap) -> LabelRow | None:
    if row.ignore or classes.takes(row.name):
        return row
    if row.name.casefold() in NEIGHBOURS.get(classes.target.casefold(), ()):
        return replace(row, ignore=True)
    return None


def is_kitti(root: Path) -> bool:
    """Whether a folder has KITTI's object layout."""
    return (root / "image_2").is_dir() and (root / "calib").is_dir()


def read_kitti(root: Path, classes: ClassMap) -> DataSet:
    """The data set of a folder in KITTI's object layout, each frame with its own calibration.

    The camera's height is unknown to the files. Frames are in split "test" unless ImageSets/<split>.txt says
    otherwise.

    Raises:
        RescoreError: a picture or calibration is missing or damaged, or a label is.
    """
    left = pictures_in(root / "image_2")
    if not (root / "image_3").is_dir():
        raise RescoreError(
            f"{root}: expected KITTI's right pictures in image_3, found no folder; download it too"
        )
    layout = Layout(root, [_pictures(root, path) for path in left])
    split, left_out = splits_of(root, [p.stem for p in left])
    rows, counts, notes = kitti_labels(root / "label_2", layout, classes)
    return data_set(layout, classes, split, rows, (*left_out, *notes, *_class_notes(root, classes, counts)))


def _pictures(root: Path, left: Path) -> Pictures:
    right = root / "image_3" / left.name
    if not right.is_file():
        raise RescoreError(f"{right}: expected the right picture of {left.name}, found no file; add it")
    calibration = root / "calib" / f"{left.stem}.txt"
    return Pictures(left.stem, left, right, None, read_calibration(calibration), calibration)


def kitti_labels(
    folder: Path, layout: Layout, classes: ClassMap
) -> tuple[list[list[LabelRow]], Counter[str], tuple[str, ...]]:
    """The boxes of every frame of a layout, the counts of all classes, and what to say of missing files."""
    if not folder.is_dir():
        return [[] for _ in layout.pictures], Counter(), (f"{folder}: no labels, so no frame has a car",)
    paths, notes = files_of_frames(folder, ".txt", layout)
    read, flat = with_size(folder, [read_rows(path) if path else [] for path in paths])
    rows, counts = of_class(read, classes)
    return rows, counts, (*notes, *flat)


def _class_notes(root: Path, classes: ClassMap, counts: Counter[str]) -> tuple[str, ...]:
    """What became of each class; ignored ones apart from those left out."""
    neighbours = NEIGHBOURS.get(classes.target.casefold(), ())
    ignored = {
        n: c
        for n, c in counts.items()
        if not classes.takes(n) and n.casefold() in (*neighbours, DONT_CARE.casefold())
    }
    rest = Counter({n: c for n, c in counts.items() if n not in ignored})
    said = ", ".join(f"{c} {n}" for n, c in sorted(ignored.items()))
    notes = (f"{root / 'label_2'}: ignore regions: {said}",) if said else ()
    return (*notes, *classes.notes(root / "label_2", rest))


def _refuse_pictures(folder: Path) -> None:
    """Raises RescoreError where a folder holds pictures: a file of boxes beside each would mix with them."""
    held = folder.iterdir() if folder.is_dir() else ()
    first = next((p for p in held if p.suffix.casefold() in PICTURES), None)
    if first is not None:
        raise RescoreError(
            f"{folder}: expected a folder for files of boxes, got one of pictures, as {first.name}; name "
            "another"
        )


def write_kitti_labels(folder: Path, data: DataSet) -> None:
    """Write the boxes of a data set, a file a frame; what is ignored is written as DontCare.

    Sizes and places in 3D are written as unknown where the data set does not state them.
    """
    _refuse_pictures(folder)
    names = frame_names(data)
    for image_id, truth in data.truth.items():
        n = len(truth.annotation_id)
        azimuth = np.full(n, np.nan) if truth.azimuth_deg is None else truth.azimuth_deg
        truncated = np.full(n, np.nan) if truth.truncated is None else truth.truncated
        occluded = np.full(n, UNKNOWN_OCCLUSION) if truth.occluded is None else truth.occluded
        columns = _box3d_columns(Boxes3D.filled(truth.boxes3d, n))
        lines = [
            _line(
                DONT_CARE if truth.ignore[i] else _kitti_name(data.category),
                truth.xyxy_px[i],
                alpha=alpha_of_azimuth(float(azimuth[i])),
                truncated=-1.0 if np.isnan(truncated[i]) else float(truncated[i]),
                occluded=int(occluded[i]),
                box3d=columns[i],
            )
            for i in range(n)
        ]
        _write(folder / f"{names[image_id]}.txt", lines)


def write_kitti_detections(folder: Path, table: CandidateTable, score: FloatArray, data: DataSet) -> None:
    """Write detections with a score each (n,), a file a frame, empty where nothing was found.

    Alpha is that of the 3D box, where there is one, so that the two agree; else that of the azimuth.
    """
    _refuse_pictures(folder)
    names = frame_names(data)
    lines: dict[int, list[str]] = {image_id: [] for image_id in names}
    boxes3d = Boxes3D.filled(table.boxes3d, len(table))
    columns, known, alpha = _box3d_columns(boxes3d), boxes3d.known, boxes3d.alpha_rad
    for i, image_id in enumerate(table.image_id.tolist()):
        seen = alpha_of_azimuth(float(table.azimuth_deg[i]))
        line = _line(
            _kitti_name(data.category),
            table.xyxy_px[i],
            alpha=float(alpha[i]) if known[i] else seen,
            truncated=-1.0,
            occluded=-1,
            box3d=columns[i],
        )
        lines[image_id].append(f"{line} {float(score[i])!r}")
    for image_id, own in lines.items():
        _write(folder / f"{names[image_id]}.txt", own)


def _box3d_columns(boxes3d: Boxes3D) -> list[str]:
    """The seven columns of each box as text."""
    numbers = [boxes3d.kitti_size_m, boxes3d.kitti_location_m(), boxes3d.rotation_y_rad]
    unknown = " ".join(map(str, UNKNOWN_BOX3D))
    return [
        " ".join(map(repr, row)) if known else unknown
        for row, known in zip(np.column_stack(numbers).tolist(), boxes3d.known, strict=True)
    ]


def _line(
    name: str, xyxy_px: FloatArray, *, alpha: float, truncated: float, occluded: int, box3d: str
) -> str:
    box = " ".join(repr(float(v)) for v in xyxy_px)
    return f"{name} {truncated!r} {occluded} {alpha!r} {box} {box3d}"


def _kitti_name(category: str) -> str:
    # columns are split at blanks
    return "_".join(category.split()).capitalize()


def _write(path: Path, lines: list[str]) -> None:
    with atomic_path(path) as beside:
        beside.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
