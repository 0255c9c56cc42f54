"""Data sets of plain folders: left and right pictures, or left pictures with measured depth, and boxes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.data.pictures import picture_size
from rescore.formats.box_files import YoloClasses, chosen, is_kitti_text, read_voc, read_yolo, yolo_classes
from rescore.formats.calibrations.in_folder import calibration_in
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.folders import Layout, Pictures, box_files_in, data_set, files_of_frames, splits_of
from rescore.formats.kitti import kitti_labels
from rescore.formats.labels import ClassMap, LabelRow, with_size
from rescore.formats.pairs import cityscapes
from rescore.formats.pairs.frames import frames_of_places, frames_of_scenes, paired_pictures, scenes_in
from rescore.formats.pairs.names import Side
from rescore.formats.pairs.places import places_in


def is_plain(root: Path) -> bool:
    """Whether a folder is one that ``read_plain`` knows."""
    return bool(places_in(root)) or next(scenes_in(root), None) is not None


def read_plain(root: Path, classes: ClassMap, top: Path | None = None) -> DataSet:
    """The data set of plain folders.

    Boxes are those of label_2 (KITTI), Annotations (VOC) or labels (YOLO or KITTI), if there are any.

    Args:
        root: The folder.
        classes: The class whose boxes count.
        top: The folder above up to which a calibration is looked for; None for ``root`` itself.

    Raises:
        RescoreError: something is missing, damaged, or does not fit the rest.
    """
    places = places_in(root)
    read = frames_of_places(root, places, top or root) if places else frames_of_scenes(root, top or root)
    return _with_boxes(root, *read, classes)


def read_as_taken(root: Path, classes: ClassMap) -> tuple[DataSet, RawPair, Path]:
    """The data set of folders of pairs as the cameras took them, its cameras, and their calibration's path.

    The frames have no camera, since theirs is not of a rectified pair.

    Raises:
        RescoreError: there are no such folders, or no calibration of two cameras as they stand.
    """
    # EuRoC keeps its sensors in a folder of this name
    root = next((place for place in (root, root / "mav0") if place.is_dir() and places_in(place)), root)
    # annotations.json goes before folders wherever a data set is read
    places = [] if (root / "annotations.json").exists() else places_in(root)
    if len(places) != 1 or places[0].right is None or places[0].measured is not None:
        raise RescoreError(
            f"{root}: expected folders of left and right pictures alone to rectify, got another layout; give "
            "left, right and their calibration"
        )
    place, right = places[0], places[0].right
    lefts = place.lefts()
    found = calibration_in(root, place.left, right, picture_size(lefts[0]), as_taken=True)
    if found.raw is None or found.path is None:
        raise RescoreError(
            f"{found.path or root}: expected two cameras as they stand (K1, D1, K2, D2, R, T) to rectify by, "
            "got no such calibration; add it as calib.yaml"
        )
    pairs, notes = paired_pictures(right, place.left, lefts, place.rights(), Side.RIGHT)
    pictures = [Pictures(a.stem, a, b, None, None, None) for a, b in pairs]
    return _with_boxes(root, pictures, notes, classes), found.raw, found.path


def _with_boxes(
    root: Path, pictures: Sequence[Pictures], notes: tuple[str, ...], classes: ClassMap
) -> DataSet:
    layout = Layout(root, pictures)
    split, left_out = splits_of(root, [p.stem for p in pictures])
    rows, label_notes = _labels(layout, classes)
    return data_set(layout, classes, split, rows, (*notes, *left_out, *label_notes))


def _labels(layout: Layout, classes: ClassMap) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    """The boxes of every frame, from the first kind of labels that is there; others are told."""
    root = layout.root
    texts = box_files_in(root / "labels", ".txt")
    voc, kitti = _voc_folder(root), root / "label_2"
    there = [root / "labels"] if texts else []
    fine = root / cityscapes.FOLDER
    there += [folder for folder in (voc, kitti, fine) if folder is not None and folder.is_dir()]
    if not there:
        places = "labels (YOLO), label_2 (KITTI), Annotations (VOC) or gtFine (Cityscapes)"
        return [[] for _ in layout.pictures], (f"{root}: no boxes in {places}, so no frame has a car",)
    unused = tuple(f"{there[0]}: taken in place of the boxes in {p.name}" for p in there[1:])
    if texts and not is_kitti_text(texts):
        names, notes = yolo_classes(root / "labels", texts, classes)
        return _each(layout, root / "labels", ".txt", classes, names, (*unused, *notes))
    if voc is not None and not texts:
        return _each(layout, voc, ".xml", classes, None, unused)
    if there[0] == fine:
        return _of_polygons(layout, fine, classes, unused)
    folder = root / "labels" if texts else kitti
    rows, counts, notes = kitti_labels(folder, layout, classes)
    return rows, (*unused, *notes, *classes.notes(folder, counts))


def _of_polygons(
    layout: Layout, folder: Path, classes: ClassMap, notes: tuple[str, ...]
) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    paths, missing = cityscapes.polygon_files(layout)
    read = [
        cityscapes.read_polygons(path, *picture_size(pictures.left)) if path else []
        for pictures, path in zip(layout.pictures, paths, strict=True)
    ]
    sized, flat = with_size(folder, read)
    kept, counts = chosen(sized, classes)
    return kept, (*notes, *missing, *flat, *classes.notes(folder, counts))


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
