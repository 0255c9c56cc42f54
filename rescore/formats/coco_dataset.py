"""Our own data sets: ``annotations.json`` in COCO's form, with what COCO has no place for beside it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Required

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, FiniteFloat, PositiveInt, TypeAdapter
from typing_extensions import TypedDict

from recon.boxes import xyxy_from_xywh
from recon.camera import DepthCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.stores import beside
from rescore.data.boxes3d import Boxes3D
from rescore.data.depth_files import MeasuredFile, Quantity
from rescore.data.frames import (
    MAX_FRAME_NAME_BYTES,
    DataSet,
    FrameRecord,
    Truth,
    refuse_split,
    refuse_twice,
)
from rescore.files import refuse_unsafe_name
from rescore.formats.checked_json import Box, Box3D, Number, Rows, read_checked
from rescore.formats.labels import UNKNOWN_OCCLUSION, ClassMap, flat_note, has_size, refuse_other_truth


class _Camera(BaseModel):
    fx: FiniteFloat
    fy: FiniteFloat
    cx: FiniteFloat
    cy: FiniteFloat
    baseline_m: FiniteFloat | None = None
    height_m: FiniteFloat | None = None
    pitch_rad: FiniteFloat | None = None
    roll_rad: FiniteFloat | None = None
    disparity_offset_px: FiniteFloat = 0.0


class _Measured(BaseModel):
    file_name: str
    quantity: Quantity
    factor: FiniteFloat = 1.0


class _Instance(BaseModel):
    id: Number
    kind: str


class _Image(TypedDict, total=False):
    """One of perhaps very many: a dictionary takes half the time and memory of a model."""

    id: Required[Number]
    name: str | None
    file_name: Required[str]
    width: Required[PositiveInt]
    height: Required[PositiveInt]
    right_file_name: str | None
    disparity_file_name: str | None
    measured: _Measured | None
    instance_file_name: str | None
    instances: list[_Instance]
    split: str
    camera: _Camera | None


class _Annotation(TypedDict, total=False):
    """As ``_Image``."""

    id: Required[Number]
    image_id: Required[Number]
    category_id: Required[Number]
    bbox: Required[Box]
    iscrowd: bool
    ignore: bool
    visibility: FiniteFloat | None
    shape_id: str | None
    azimuth_deg: FiniteFloat | None
    truncated: FiniteFloat | None
    occluded: Number | None
    bbox3d: Box3D | None


class _Category(BaseModel):
    id: Number
    name: str


class _DataSet(BaseModel):
    images: Rows[_Image]
    annotations: Rows[_Annotation]
    categories: Rows[_Category]


_DATA_SET = TypeAdapter(_DataSet)


def read_dataset(path: Path, category: str = "car", classes: ClassMap | None = None) -> DataSet:
    """The data set of a folder with ``annotations.json`` (or of that file itself); no picture is opened yet.

    The class is every category named ``category``, in capitals or not, and those that ``classes`` maps to it;
    where there is none, the only one of the file. Annotations of other classes, and boxes of no size, are
    left out and counted. An image without ``split`` is in split "test".

    Raises:
        RescoreError: the file is missing, has another shape, or contradicts itself.
    """
    file = path / "annotations.json" if path.is_dir() or not path.suffix else path
    parsed = read_checked(file, _DATA_SET, "a data set in COCO's form")
    classes = classes or ClassMap(category)
    name, class_ids = _class(file, parsed.categories, classes)
    names = {c.id: c.name for c in parsed.categories}
    counts = Counter(dict.fromkeys(names.values(), 0))
    flat = 0
    refuse_twice(file, "category id", [c.id for c in parsed.categories])
    refuse_twice(file, "image id", [i["id"] for i in parsed.images])
    refuse_twice(file, "annotation id", [a["id"] for a in parsed.annotations])
    cars: dict[int, list[_Annotation]] = {image["id"]: [] for image in parsed.images}
    root = file.parent
    for a in parsed.annotations:
        number, image_id, category_id = a["id"], a["image_id"], a["category_id"]
        if image_id not in cars:
            raise RescoreError(
                f"{file}: annotation {number}: expected a listed image, got image_id {image_id}; mend it"
            )
        if category_id not in names:
            raise RescoreError(
                f"{file}: annotation {number}: expected a listed category, got category_id {category_id}; "
                "add it to categories"
            )
        if not has_size(file, f"annotation {number}", a["bbox"], counts=category_id in class_ids):
            flat += 1
            continue
        counts[names[category_id]] += 1
        if category_id in class_ids:
            cars[image_id].append(a)
    frames, truth = tuple(_frame(file, root, image) for image in parsed.images), _truths(cars)
    refuse_other_truth(file, frames, truth)
    return DataSet(
        root=root,
        category_id=class_ids[0],
        category=name,
        frames=frames,
        truth=truth,
        notes=(*flat_note(file, flat), *replace(classes, target=name).notes(file, counts)),
        category_names=names,
        class_ids=frozenset(class_ids),
    )


def _class(file: Path, categories: list[_Category], classes: ClassMap) -> tuple[str, list[int]]:
    """The name of the class and the numbers of its categories, that of its own name first.

    Where no category is the class, the only name is.
    """
    own = [c for c in categories if c.name.casefold() == classes.target.casefold()]
    own.sort(key=lambda c: c.name != classes.target)
    mapped = [c for c in categories if c not in own and classes.takes(c.name)]
    taken = own + mapped
    if not taken and len({c.name.casefold() for c in categories}) == 1:
        return categories[0].name, [c.id for c in categories]
    if not taken:
        names = sorted({c.name for c in categories})
        raise RescoreError(
            f"{file}: expected a category named {classes.target!r}, got {names}; add or rename it, "
            f"choose another (--class), or take one for it (--map NAME={classes.target})"
        )
    return own[0].name if own else classes.target, [c.id for c in taken]


def _frame(file: Path, root: Path, image: _Image) -> FrameRecord:
    number, split, given = image["id"], image.get("split", "test"), image.get("camera")
    refuse_split(file, number, split)
    name = image.get("name") or ""
    if name:
        refuse_unsafe_name(file, f"a name of image {number}", name, MAX_FRAME_NAME_BYTES)

    def place(name: str | None) -> Path | None:
        return beside(root, name) if name else None

    camera: StereoCamera | DepthCamera | None = None
    ground = None
    if given is not None:
        c = given
        try:
            left = PinholeCamera(c.fx, c.fy, c.cx, c.cy, image["width"], image["height"])
            camera = DepthCamera(left) if c.baseline_m is None else StereoCamera(left, c.baseline_m)
            if c.height_m is not None:
                ground = GroundPlane.stated(c.height_m, c.pitch_rad, c.roll_rad)
        except RescoreError as error:
            raise RescoreError(f"{file}: image {number}: {error}") from error
    m = image.get("measured")
    if isinstance(camera, DepthCamera) and (m is None or m.quantity is not Quantity.DEPTH):
        raise RescoreError(
            f"{file}: image {number}: expected baseline_m in the camera of a pair, got none; add the "
            "metres from left to right, which measured depth alone can do without"
        )
    return FrameRecord(
        image_id=number,
        left_path=beside(root, image["file_name"]),
        right_path=place(image.get("right_file_name")),
        disparity_path=place(image.get("disparity_file_name")),
        split=split,
        width_px=image["width"],
        height_px=image["height"],
        camera=camera,
        ground=ground,
        instance_path=place(image.get("instance_file_name")),
        instance_kinds={i.id: i.kind for i in image.get("instances", ())},
        measured=MeasuredFile(beside(root, m.file_name), m.quantity, m.factor) if m else None,
        disparity_offset_px=given.disparity_offset_px if given else 0.0,
        name=name,
    )


def _truths(cars: dict[int, list[_Annotation]]) -> dict[int, Truth]:
    """The annotated objects of every image, cut from those of all: to make arrays is slow, to cut is not."""
    whole, found, end = _truth([a for own in cars.values() for a in own]), {}, 0
    none = _truth([])
    for image_id, own in cars.items():
        if not own:
            found[image_id] = none
            continue
        start, end = end, end + len(own)
        found[image_id] = Truth(
            annotation_id=whole.annotation_id[start:end],
            xyxy_px=whole.xyxy_px[start:end],
            ignore=whole.ignore[start:end],
            visibility=whole.visibility[start:end],
            shape_id=whole.shape_id[start:end],
            azimuth_deg=_told(whole.azimuth_deg, own, "azimuth_deg", start),
            truncated=_told(whole.truncated, own, "truncated", start),
            occluded=_told(whole.occluded, own, "occluded", start),
            boxes3d=None if whole.boxes3d is None else Boxes3D.of_rows([a.get("bbox3d") for a in own]),
        )
    return found


def _told(
    column: NDArray[Any] | None, own: Sequence[_Annotation], name: str, start: int
) -> NDArray[Any] | None:
    """The part of a column that an image has, from a row on; None where no object of the image has one."""
    if column is None or all(a.get(name) is None for a in own):
        return None
    return column[start : start + len(own)]


def _truth(annotations: list[_Annotation]) -> Truth:
    boxes = np.array([a["bbox"] for a in annotations], dtype=float).reshape(-1, 4)
    return Truth(
        annotation_id=np.array([a["id"] for a in annotations], dtype=np.int64),
        xyxy_px=xyxy_from_xywh(boxes),
        ignore=np.array([a.get("iscrowd") or a.get("ignore") for a in annotations], dtype=bool),
        visibility=_or(np.nan, [a.get("visibility") for a in annotations]),
        shape_id=tuple(a.get("shape_id") or "" for a in annotations),
        azimuth_deg=_known([a.get("azimuth_deg") for a in annotations]),
        truncated=_known([a.get("truncated") for a in annotations]),
        occluded=_known([a.get("occluded") for a in annotations], UNKNOWN_OCCLUSION),
        boxes3d=Boxes3D.of_rows([a.get("bbox3d") for a in annotations]),
    )


def _known(values: list[Any], unknown: float = np.nan) -> NDArray[Any] | None:
    """Shape (n,) with ``unknown`` for None; None where all are."""
    return None if all(v is None for v in values) else _or(unknown, values)


def _or(unknown: float, values: list[Any]) -> NDArray[Any]:
    """Shape (n,), of the type of ``unknown``."""
    return np.array([unknown if v is None else v for v in values], dtype=type(unknown))
