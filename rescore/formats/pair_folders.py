"""Plain folders: left and right pictures, or left pictures with measured depth, and a calibration."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from recon.errors import RescoreError
from recon.stereo.sgbm import PNG_SCALE
from rescore.data.depth_files import SUFFIXES, TUM_DEPTH_FACTOR, MeasuredFile, Quantity
from rescore.data.frames import DataSet
from rescore.data.pictures import PICTURES, file_named, files_in, picture_size, pictures_in
from rescore.formats.box_files import YoloClasses, chosen, is_kitti_text, read_voc, read_yolo, yolo_classes
from rescore.formats.calibration_files import Calibration, read_calibration
from rescore.formats.folders import NAME_FILES, Layout, Pictures, data_set, files_of_frames, splits_of
from rescore.formats.kitti import kitti_labels
from rescore.formats.labels import ClassMap, LabelRow
from rescore.formats.name_pairs import Side, paired

PAIRS = (("left", "right"), ("image_0", "image_1"), ("image_2", "image_3"), ("im0", "im1"))
"""Names of the folders of left and right pictures; of the pictures themselves in folders of scenes."""
LEFT_ALONE = (*(left for left, _ in PAIRS), "rgb", "images")
MEASURED = (
    ("disparity", Quantity.DISPARITY),
    ("disp", Quantity.DISPARITY),
    ("disp0", Quantity.DISPARITY),
    ("depth", Quantity.DEPTH),
)
"""Names of the folders of measured files, and what they hold."""


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
    pictures, notes = _of_folders(root, *folders) if folders else (_of_scenes(root), ())
    layout = Layout(root, pictures)
    split, left_out = splits_of(root, [p.stem for p in pictures])
    rows, label_notes = _labels(layout, classes)
    return data_set(layout, classes, split, rows, (*notes, *left_out, *label_notes))


def _folders(root: Path) -> tuple[Path, Path | None, tuple[Path, Quantity] | None] | None:
    """Left, right and measured folder, None where there are no left ones or nothing else."""
    measured = next(((root / n, q) for n, q in MEASURED if (root / n).is_dir()), None)
    for left, right in PAIRS:
        if (root / left).is_dir() and (root / right).is_dir():
            return root / left, root / right, measured
    left_alone = next((root / n for n in LEFT_ALONE if (root / n).is_dir()), None)
    return (left_alone, None, measured) if left_alone and measured else None


def _of_folders(
    root: Path, left: Path, right: Path | None, measured: tuple[Path, Quantity] | None
) -> tuple[list[Pictures], tuple[str, ...]]:
    """The frames of folders that lie side by side. Measured files go before right pictures."""
    calibration, path = _calibration(root, left.name)
    lefts = pictures_in(left)
    partner = measured[0] if measured else right
    assert partner is not None
    others = files_in(partner, SUFFIXES, "files") if measured else pictures_in(partner)
    pairs = paired(lefts, others, Side.LEFT if measured else Side.RIGHT)
    alone = len(lefts) - len(pairs)
    if not pairs:
        raise RescoreError(
            f"{partner}: expected files of the names in {left.name}, as {lefts[0].stem!r}, got "
            f"{others[0].stem!r}; rename them"
        )
    notes = (f"{partner}: left out {alone} of {len(lefts)} left pictures without a partner",) if alone else ()
    if measured and right:
        notes = (*notes, f"{partner}: taken in place of matching {left.name} with {right.name}")
    unused = [n for n, _ in MEASURED if measured and (root / n).is_dir() and n != partner.name]
    if unused:
        notes = (*notes, f"{partner}: taken in place of {', '.join(unused)}")
    factor = _factor(root, measured[1], others, calibration, left.name) if measured else 1.0
    found = [
        Pictures(
            stem=a.stem,
            left=a,
            right=None if measured else b,
            measured=MeasuredFile(b, measured[1], _factor_of(b, factor)) if measured else None,
            calibration=calibration,
            calibration_path=path,
        )
        for a, b in pairs
    ]
    if measured and measured[1] is Quantity.DEPTH and calibration is None:
        raise RescoreError(
            f"{root}: expected a calibration to use depth in metres, found none; add calib.yaml with "
            "cameraMatrix"
        )
    return found, notes


def _factor_of(path: Path, png_factor: float) -> float:
    """Factor of the values of a file: that of PNGs, else 1, since other forms hold pixels or metres."""
    return png_factor if path.suffix.lower() == ".png" else 1.0


def _factor(
    root: Path, quantity: Quantity, files: Sequence[Path], calibration: Calibration | None, left: str
) -> float:
    """Value of a PNG for one pixel or metre.

    Raises:
        RescoreError: depth whose factor nothing tells.
    """
    if quantity is Quantity.DISPARITY or all(p.suffix.lower() != ".png" for p in files):
        return PNG_SCALE if quantity is Quantity.DISPARITY else 1.0
    if calibration and calibration.depth_factor:
        return calibration.depth_factor
    if left == "rgb" and (root / "rgb.txt").is_file() and (root / "depth.txt").is_file():
        return TUM_DEPTH_FACTOR
    raise RescoreError(
        f"{root / 'depth'}: expected to be told the value of one metre, found nothing; add the line "
        "'depth_factor: 5000' (TUM), 1000 (millimetres) or 256 (KITTI) to the calibration"
    )


def _calibration(root: Path, left: str) -> tuple[Calibration | None, Path | None]:
    """The calibration of a folder: one YAML, a ROS pair of them, or calib.txt; None where there is none.

    Raises:
        RescoreError: several files, none of which is to be preferred.
    """
    found = sorted(
        p for p in root.iterdir() if p.suffix in (".yaml", ".yml") and p.stem not in ("data", "dataset")
    )
    text = root / "calib.txt"
    if len(found) == 2:
        sides = {side: [p for p in found if side in p.stem.lower()] for side in ("left", "right")}
        if all(len(paths) == 1 for paths in sides.values()):
            first, second = sides["left"][0], sides["right"][0]
            return read_calibration(first, second), first
    preferred = [p for p in found if p.stem.startswith("calib")]
    if len(preferred) == 1 or len(found) == 1:
        path = (preferred or found)[0]
        return read_calibration(path), path
    if found:
        raise RescoreError(
            f"{root}: expected one calibration, or left.yaml and right.yaml, found "
            f"{', '.join(p.name for p in found)}; name the right one calib.yaml"
        )
    if not text.is_file():
        return None, None
    pair = ("P0", "P1") if left == "image_0" else ("P2", "P3")
    return read_calibration(text, kitti_pair=pair), text


def _scenes(root: Path) -> list[Path]:
    """Folders with im0 and im1 (or disp0): the folder itself, else those in it."""
    if file_named(root, "im0", PICTURES):
        return [root]
    return sorted(
        p
        for p in root.iterdir()
        if p.is_dir() and not p.name.startswith(".") and file_named(p, "im0", PICTURES)
    )


def _of_scenes(root: Path) -> list[Pictures]:
    return [_scene(root, folder) for folder in _scenes(root)]


def _scene(root: Path, folder: Path) -> Pictures:
    left, right = (file_named(folder, stem, PICTURES) for stem in ("im0", "im1"))
    assert left is not None
    calibration, path = _calibration(folder, "im0")
    if calibration is None and folder != root:
        calibration, path = _calibration(root, "im0")
    measured = None
    if right is None:
        file = file_named(folder, "disp0", SUFFIXES)
        if file is None:
            raise RescoreError(f"{folder}: expected im1 or disp0 beside {left.name}, found neither; add one")
        measured = MeasuredFile(file, Quantity.DISPARITY, _factor_of(file, PNG_SCALE))
    return Pictures(folder.name, left, right, measured, calibration, path)


def _labels(layout: Layout, classes: ClassMap) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    """The boxes of every frame, from the first kind of labels that is there."""
    root = layout.root
    texts = [p for p in sorted((root / "labels").glob("*.[tT][xX][tT]")) if p.name not in NAME_FILES]
    folder = root / "label_2"
    if texts and is_kitti_text(texts):
        folder = root / "labels"
    elif texts:
        names, notes = yolo_classes(root / "labels", texts, classes)
        return _each(layout, root / "labels", ".txt", classes, names, notes)
    elif (voc := _voc_folder(root)) is not None:
        return _each(layout, voc, ".xml", classes, None, ())
    rows, counts, notes = kitti_labels(folder, layout, classes)
    return rows, (*notes, *classes.notes(folder, counts))


def _voc_folder(root: Path) -> Path | None:
    """The folder of VOC's boxes, Annotations in capitals or not; COCO's folder of that name has no XML."""
    found = [p for p in sorted(root.iterdir()) if p.name.casefold() == "annotations" and p.is_dir()]
    return next((p for p in found if any(f.suffix.lower() == ".xml" for f in p.iterdir())), None)


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
    kept, counts = chosen(rows, classes)
    return kept, (*notes, *missing, *classes.notes(folder, counts))
