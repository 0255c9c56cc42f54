"""Plain folders: left and right pictures, or left pictures with measured depth, and a calibration."""

import filecmp
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from recon.errors import RescoreError
from recon.stereo.sgbm import PNG_SCALE
from rescore.data.depth_files import SUFFIXES, TUM_DEPTH_FACTOR, MeasuredFile, Quantity, has_whole_numbers
from rescore.data.frames import DataSet
from rescore.data.pictures import PICTURES, file_named, files_in, picture_size, pictures_in
from rescore.formats.box_files import YoloClasses, chosen, is_kitti_text, read_voc, read_yolo, yolo_classes
from rescore.formats.calibrations.in_folder import FolderCalibration, calibration_in
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.folders import Layout, Pictures, box_files_in, data_set, files_of_frames, splits_of
from rescore.formats.kitti import kitti_labels
from rescore.formats.labels import ClassMap, LabelRow, with_size
from rescore.formats.name_pairs import Side, paired

PAIRS = (
    ("left", "right"),
    ("image_0", "image_1"),
    ("image_2", "image_3"),
    ("im0", "im1"),
    ("cam0/data", "cam1/data"),
)
"""Names of the folders of left and right pictures; of the pictures themselves in folders of scenes."""
LEFT_ALONE = (*(left for left, _ in PAIRS), "rgb", "images")
MEASURED = (
    ("disparity", Quantity.DISPARITY),
    ("disp", Quantity.DISPARITY),
    ("disp0", Quantity.DISPARITY),
    ("depth", Quantity.DEPTH),
)
"""Names of the folders of measured files, and what they hold."""
MOST_NOTES = 5
"""Notes on the calibrations of scenes that the user is to see."""


def is_plain(root: Path) -> bool:
    """Whether a folder is one that ``read_plain`` knows."""
    return _folders(root) is not None or bool(_scenes(root))


def read_plain(root: Path, classes: ClassMap) -> DataSet:
    """The data set of plain folders.

    Boxes are those of label_2 (KITTI), Annotations (VOC) or labels (YOLO or KITTI), if there are any.

    Raises:
        RescoreError: something is missing, damaged, or does not fit the rest.
    """
    folders = _folders(root)
    pictures, notes = _of_folders(root, folders) if folders else _of_scenes(root)
    return _with_boxes(root, pictures, notes, classes)


def read_as_taken(root: Path, classes: ClassMap) -> tuple[DataSet, RawPair, Path]:
    """The data set of folders of pairs as the cameras took them, its cameras, and their calibration's path.

    The frames have no camera, since theirs is not of a rectified pair.

    Raises:
        RescoreError: there are no such folders, or no calibration of two cameras as they stand.
    """
    # EuRoC keeps its sensors in a folder of this name
    root = next((place for place in (root, root / "mav0") if place.is_dir() and _folders(place)), root)
    # annotations.json goes before folders wherever a data set is read
    folders = None if (root / "annotations.json").exists() else _folders(root)
    if folders is None or folders.right is None or folders.measured is not None:
        raise RescoreError(
            f"{root}: expected folders of left and right pictures alone to rectify, got another layout; give "
            "left, right and their calibration"
        )
    lefts = pictures_in(folders.left)
    found = calibration_in(root, folders.left, folders.right, picture_size(lefts[0]), as_taken=True)
    if found.raw is None or found.path is None:
        raise RescoreError(
            f"{found.path or root}: expected two cameras as they stand (K1, D1, K2, D2, R, T) to rectify by, "
            "got no such calibration; add it as calib.yaml"
        )
    pairs, notes = _pairs(folders.right, folders.left, lefts, pictures_in(folders.right), Side.RIGHT)
    pictures = [Pictures(a.stem, a, b, None, None, None) for a, b in pairs]
    return _with_boxes(root, pictures, notes, classes), found.raw, found.path


def _with_boxes(
    root: Path, pictures: Sequence[Pictures], notes: tuple[str, ...], classes: ClassMap
) -> DataSet:
    layout = Layout(root, pictures)
    split, left_out = splits_of(root, [p.stem for p in pictures])
    rows, label_notes = _labels(layout, classes)
    return data_set(layout, classes, split, rows, (*notes, *left_out, *label_notes))


@dataclass(frozen=True)
class _Folders:
    """The folders of pictures and of measured files, each None where there is none."""

    left: Path
    right: Path | None
    measured: Path | None
    quantity: Quantity


def _folders(root: Path) -> _Folders | None:
    """Left, right and measured folder, None where there are no left ones or nothing else."""
    measured, quantity = next(
        ((root / n, q) for n, q in MEASURED if (root / n).is_dir()), (None, Quantity.DISPARITY)
    )
    for left, right in PAIRS:
        if (root / left).is_dir() and (root / right).is_dir():
            return _Folders(root / left, root / right, measured, quantity)
    left_alone = next((root / n for n in LEFT_ALONE if (root / n).is_dir()), None)
    return _Folders(left_alone, None, measured, quantity) if left_alone and measured else None


def _pairs(
    partner: Path, left: Path, lefts: Sequence[Path], others: Sequence[Path], side: Side
) -> tuple[list[tuple[Path, Path]], tuple[str, ...]]:
    """Left pictures with their partners, and what to say of those without.

    Raises:
        RescoreError: none has one, a file belongs to two others, or both folders hold the same pictures.
    """
    pairs = paired(lefts, others, side)
    alone = len(lefts) - len(pairs)
    if not pairs:
        raise RescoreError(
            f"{partner}: expected files of the names in {left.name}, as {lefts[0].stem!r}, got "
            f"{others[0].stem!r}; rename them"
        )
    # of the first pair alone: pictures without packing are all of one size, and reading them takes long
    if side is Side.RIGHT and filecmp.cmp(*pairs[0], shallow=False):
        raise RescoreError(
            f"{pairs[0][1]}: expected the right picture of {pairs[0][0]}, got the same picture; give each "
            "camera's pictures in a folder of their own"
        )
    told = f"{partner}: left out {alone} of {len(lefts)} left pictures without a partner"
    return pairs, (told,) if alone else ()


def _of_folders(root: Path, folders: _Folders) -> tuple[list[Pictures], tuple[str, ...]]:
    """The frames of folders that lie side by side. Measured files go before right pictures."""
    lefts = pictures_in(folders.left)
    found = calibration_in(root, folders.left, folders.right, picture_size(lefts[0]))
    if folders.measured is not None:
        return _with_measured(root, folders, folders.measured, lefts, found)
    assert folders.right is not None
    pairs, notes = _pairs(folders.right, folders.left, lefts, pictures_in(folders.right), Side.RIGHT)
    pictures = [Pictures(a.stem, a, b, None, found.calibration, found.path) for a, b in pairs]
    return pictures, (*notes, *found.notes)


def _with_measured(
    root: Path, folders: _Folders, measured: Path, lefts: Sequence[Path], found: FolderCalibration
) -> tuple[list[Pictures], tuple[str, ...]]:
    """The frames of left pictures and measured files."""
    files = files_in(measured, SUFFIXES, "files")
    pairs, notes = _pairs(measured, folders.left, lefts, files, Side.LEFT)
    unused = [n for n, _ in MEASURED if (root / n).is_dir() and n != measured.name]
    if unused:
        notes = (*notes, f"{measured}: taken in place of {', '.join(unused)}")
    if folders.right is not None:
        told = f"{measured}: taken in place of matching {folders.left.name} with {folders.right.name}"
        notes = (*notes, told)
    if folders.quantity is Quantity.DEPTH and found.calibration is None:
        raise RescoreError(
            f"{root}: expected a calibration to use depth in metres, found none; add calib.yaml with "
            f"cameraMatrix{'; ' * bool(found.notes)}{found.notes[0] if found.notes else ''}"
        )
    pictures = [
        Pictures(
            a.stem,
            a,
            None,
            MeasuredFile(b, folders.quantity, _factor_of(b, folders, found)),
            found.calibration,
            found.path,
        )
        for a, b in pairs
    ]
    return pictures, (*notes, *found.notes)


def _factor_of(path: Path, folders: _Folders, found: FolderCalibration) -> float:
    """Value of a file for one pixel or metre: as the calibration says, else what the form has.

    Raises:
        RescoreError: whole numbers of depth whose factor nothing tells.
    """
    whole = has_whole_numbers(path)
    if folders.quantity is Quantity.DISPARITY:
        return found.disparity_factor or (PNG_SCALE if path.suffix.lower() == ".png" else 1.0)
    if found.depth_factor:
        return found.depth_factor
    if not whole:
        return 1.0
    root = folders.left.parent
    if folders.left.name == "rgb" and (root / "rgb.txt").is_file() and (root / "depth.txt").is_file():
        return TUM_DEPTH_FACTOR
    raise RescoreError(
        f"{path.parent}: expected to be told the value of one metre, found nothing; add the line "
        "'depth_factor: 5000' (TUM), 1000 (millimetres) or 256 (KITTI) to the calibration"
    )


def _scenes(root: Path) -> list[Path]:
    """Folders with im0 and im1 (or disp0): the folder itself, else those in it."""
    if file_named(root, "im0", PICTURES):
        return [root]
    return sorted(
        p
        for p in root.iterdir()
        if p.is_dir() and not p.name.startswith(".") and file_named(p, "im0", PICTURES)
    )


def _of_scenes(root: Path) -> tuple[list[Pictures], tuple[str, ...]]:
    scenes = [_scene(root, folder) for folder in _scenes(root)]
    # a line a kind of note, not a line a scene
    notes = dict.fromkeys(note for _, own in scenes for note in own)
    return [pictures for pictures, _ in scenes], tuple(notes)[:MOST_NOTES]


def _scene(root: Path, folder: Path) -> tuple[Pictures, tuple[str, ...]]:
    left, right = (file_named(folder, stem, PICTURES) for stem in ("im0", "im1"))
    assert left is not None
    size = picture_size(left)
    found = calibration_in(folder, folder, None, size)
    if found.path is None and folder != root:
        found = calibration_in(root, folder, None, size)
    measured = None
    if right is None:
        file = file_named(folder, "disp0", SUFFIXES)
        if file is None:
            raise RescoreError(f"{folder}: expected im1 or disp0 beside {left.name}, found neither; add one")
        folders = _Folders(folder, None, folder, Quantity.DISPARITY)
        measured = MeasuredFile(file, Quantity.DISPARITY, _factor_of(file, folders, found))
    return Pictures(folder.name, left, right, measured, found.calibration, found.path), found.notes


def _labels(layout: Layout, classes: ClassMap) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    """The boxes of every frame, from the first kind of labels that is there; others are told."""
    root = layout.root
    texts = box_files_in(root / "labels", ".txt")
    voc, kitti = _voc_folder(root), root / "label_2"
    there = [root / "labels"] if texts else []
    there += [folder for folder in (voc, kitti) if folder is not None and folder.is_dir()]
    if not there:
        places = "labels (YOLO), label_2 (KITTI) or Annotations (VOC)"
        return [[] for _ in layout.pictures], (f"{root}: no boxes in {places}, so no frame has a car",)
    unused = tuple(f"{there[0]}: taken in place of the boxes in {p.name}" for p in there[1:])
    if texts and not is_kitti_text(texts):
        names, notes = yolo_classes(root / "labels", texts, classes)
        return _each(layout, root / "labels", ".txt", classes, names, (*unused, *notes))
    if voc is not None and not texts:
        return _each(layout, voc, ".xml", classes, None, unused)
    folder = root / "labels" if texts else kitti
    rows, counts, notes = kitti_labels(folder, layout, classes)
    return rows, (*unused, *notes, *classes.notes(folder, counts))


def _voc_folder(root: Path) -> Path | None:
    """The folder of VOC's boxes, Annotations in capitals or not; COCO's folder of that name has no XML."""
    found = [p for p in sorted(root.iterdir()) if p.name.casefold() == "annotations" and p.is_dir()]
    return next((p for p in found if box_files_in(p, ".xml")), None)


def _each(
    layout: Layout,
    folder: Path,
    suffix: str,
    classes: ClassMap,
    names: YoloClasses | None,
    notes: tuple[str, ...],
) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    """The boxes of YOLO's files, or VOC's where there are no class numbers, a file a frame."""
    paths, missing = files_of_frames(folder, suffix, layout)
    rows: list[list[LabelRow]] = []
    for pictures, path in zip(layout.pictures, paths, strict=True):
        size = picture_size(pictures.left)
        if path is None:
            rows.append([])
        elif names is None:
            rows.append(read_voc(path, *size))
        else:
            rows.append([replace(r, score=None) for r in read_yolo(path, *size, names)])
    sized, flat = with_size(folder, rows)
    kept, counts = chosen(sized, classes)
    return kept, (*notes, *missing, *flat, *classes.notes(folder, counts))
