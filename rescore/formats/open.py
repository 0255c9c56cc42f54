"""Any data set and any detections that are known here, by what their folders hold."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from recon.arrays import FloatArray
from recon.boxes import xywh_from_xyxy
from recon.errors import RescoreError
from recon.reading import reading
from rescore.data.frames import DataSet, frame_names
from rescore.data.pictures import by_stem
from rescore.formats import coco, coco_dataset
from rescore.formats.bags.reader import is_bag
from rescore.formats.box_files import is_kitti_text, read_yolo, refuse_track_numbers, yolo_classes
from rescore.formats.checked_json import first_difference
from rescore.formats.folders import box_files_in, calibration_notes
from rescore.formats.kitti import is_kitti, read_kitti, read_rows
from rescore.formats.labels import ClassMap, LabelRow, with_size
from rescore.formats.pairs.plain import is_plain, read_plain
from rescore.formats.pairs.sequences import has_sequences, read_sequences
from rescore.formats.parts.manifest import is_parts


@dataclass(frozen=True)
class DataLayout:
    """A layout of folders that a data set may have."""

    sign: str
    """What it is recognised by, for the error where nothing is found."""
    is_in: Callable[[Path], bool]
    """Whether a folder has this layout."""
    read: Callable[[Path, ClassMap], DataSet]
    """The data set of such a folder; no picture is decoded yet."""


def _has_annotations(root: Path) -> bool:
    return (root / "annotations.json").is_file()


def _read_annotations(root: Path, classes: ClassMap) -> DataSet:
    data = coco_dataset.read_dataset(root, classes.target, classes)
    return replace(data, notes=(*data.notes, *calibration_notes(data.frames, root)))


def _read_in_parts(root: Path, classes: ClassMap) -> DataSet:
    from rescore.formats.parts.frames import read_frame_parts  # noqa: PLC0415 (a tenth of a second)

    return read_frame_parts(root, classes)


LAYOUTS: list[DataLayout] = [
    DataLayout("annotations.json", _has_annotations, _read_annotations),
    DataLayout("parts.json (`rescore import --parts`)", is_parts, _read_in_parts),
    DataLayout("image_2, image_3 and calib (KITTI)", is_kitti, read_kitti),
    DataLayout(
        "folders or names of pictures that differ in left and right alone, image_0 and image_1; left, rgb or "
        "color with disparity or depth; scenes with im0 and im1 (Middlebury)",
        is_plain,
        read_plain,
    ),
    DataLayout("or folders of several of these", has_sequences, read_sequences),
]
"""The layouts of data sets; the first that a folder has is read. A new one is a reader and an entry here."""


def read_dataset(path: Path, class_name: str = "car", classes: ClassMap | None = None) -> DataSet:
    """The data set of a folder of any known layout, or of a file in COCO's form; no picture is decoded yet.

    Args:
        path: Folder or file.
        class_name: The class whose boxes are the truth.
        classes: Other names of it, if there are any.

    Raises:
        RescoreError: there is no such layout, or its reader finds something missing, damaged or
            contradictory.
    """
    classes = classes or ClassMap(class_name)
    return replace(_read(path, classes), renamed=classes.renamed)


def _read(path: Path, classes: ClassMap) -> DataSet:
    if not path.is_dir() and not is_bag(path):
        return _read_annotations(path, classes)
    # KITTI keeps its two halves in folders of these names, EuRoC its sensors
    roots = [root for root in (path, path / "training", path / "mav0") if root.is_dir()]
    for layout in LAYOUTS:
        for root in roots:
            if layout.is_in(root):
                # what no reader of a single file has told
                with reading(root, "a data set", "mend its files"):
                    return layout.read(root, classes)
    if is_bag(path):
        raise RescoreError(
            f"{path}: expected a data set, got a recording of ROS; unpack it by "
            f"`rescore import {path} --out MY_FOLDER`"
        )
    inside = sorted(p.name for p in path.iterdir())[:6]
    looked_for = "; ".join(layout.sign for layout in LAYOUTS)
    raise RescoreError(
        f"{path}: expected a data set, looked for {looked_for}; found {', '.join(inside) or 'nothing'}; see "
        "docs/own-data.md"
    )


def read_detections(
    path: Path,
    data: DataSet,
    max_candidates: int | None = coco.MAX_CANDIDATES,
    classes: ClassMap | None = None,
) -> coco.DetectionFile:
    """Detections of a COCO results file, of a table in parts, or of a folder of KITTI's or YOLO's text.

    Those of every category that the truth takes are read, and those that ``classes`` maps to the class, by
    default as for the truth. Frames without a file have no detections; ``notes`` of the result counts them.

    Raises:
        RescoreError: something is missing or damaged, or names an unknown image.
    """
    classes = classes or ClassMap(data.category, data.renamed, of_several=True)
    if is_parts(path):
        from rescore.formats.parts.candidates import read_part_detections  # noqa: PLC0415 (as above)

        return read_part_detections(path, data, max_candidates)
    if not path.is_dir():
        return coco.read_detections(path, data, max_candidates, classes)
    names = {name: image_id for image_id, name in frame_names(data).items()}
    files = list(by_stem(box_files_in(path, ".txt")).values())
    if not files:
        raise RescoreError(f"{path}: expected detections, a .txt a frame, found none; check the folder")
    strangers = [p for p in files if p.stem not in names]
    if strangers:
        raise RescoreError(
            f"{strangers[0]}: expected the name of a frame, as {next(iter(names), '')!r}; use the detections "
            "of this data set and split"
        )
    read, told = _rows(path, files, names, data, classes)
    read, flat = with_size(path, read)
    rows = {names[p.stem]: own for p, own in zip(files, read, strict=True)}
    counts = Counter(r.name for own in rows.values() for r in own)
    found = [d for image_id, own in rows.items() for d in _detections(path, image_id, own, classes, data)]
    missing = len(names) - len(files)
    notes = (f"{path}: {missing} of {len(names)} frames have no file, so no detections",) if missing else ()
    file = coco.detection_file(path, [found], data, max_candidates, classes)
    return replace(file, notes=(*notes, *told, *flat, *classes.notes(path, counts)))


def _rows(
    folder: Path, files: Sequence[Path], names: dict[str, int], data: DataSet, classes: ClassMap
) -> tuple[list[list[LabelRow]], tuple[str, ...]]:
    """The boxes of each file, and what to say of their classes."""
    if is_kitti_text(files):
        return [read_rows(p) for p in files], ()
    sizes = {f.image_id: (f.width_px, f.height_px) for f in data.frames}
    known, notes = yolo_classes(folder, files, classes)
    rows = [read_yolo(p, *sizes[names[p.stem]], known) for p in files]
    refuse_track_numbers(folder, [r for own in rows for r in own])
    return rows, notes


def _detections(
    path: Path, image_id: int, rows: Sequence[LabelRow], classes: ClassMap, data: DataSet
) -> list[coco.Detection]:
    kept = [r for r in rows if classes.takes(r.name)]
    unscored = [r for r in kept if r.score is None]
    if unscored:
        raise RescoreError(
            f"{path}: image {image_id}: expected a score in the last column, got a box without; labels are "
            "no detections"
        )
    boxes: FloatArray = xywh_from_xyxy(np.array([r.xyxy_px for r in kept], dtype=float).reshape(-1, 4))
    try:
        return coco.checked_detections(_as_coco(image_id, kept, boxes, data))
    except ValidationError as error:
        raise RescoreError(
            f"{path}: image {image_id}: expected detections, got {first_difference(error)}; mend the file"
        ) from error


def _as_coco(
    image_id: int, rows: Sequence[LabelRow], boxes: FloatArray, data: DataSet
) -> list[coco.Detection]:
    return [
        coco.Detection(
            image_id=image_id,
            category_id=data.category_id,
            bbox=tuple(box),
            score=r.score or 0.0,
            azimuth_deg=None if np.isnan(r.azimuth_deg) else r.azimuth_deg,
            bbox3d=r.bbox3d,
        )
        for r, box in zip(rows, boxes.tolist(), strict=True)
    ]
