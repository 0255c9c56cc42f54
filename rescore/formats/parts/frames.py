"""Data sets in parts: a row a frame, with its objects; read as a data set, or part by part.

Files of a frame are named as in ``annotations.json``: relative to the folder, or by a URL.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from recon.arrays import FloatArray, IntArray
from recon.camera import DepthCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.reading import reading
from recon.stores import beside, name_from
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
from rescore.formats.labels import UNKNOWN_OCCLUSION, ClassMap
from rescore.formats.parts.candidates import arrays_of_table, refuse_kind
from rescore.formats.parts.forms import (
    BOXES3D,
    CAMERA,
    CORNERS,
    FILES,
    FRAME_SCHEMA,
    FRAMES,
    OBJECT_SCHEMA,
    OBJECTS,
)
from rescore.formats.parts.manifest import refuse_data_set
from rescore.formats.parts.table import Part, PartTable, write_part
from rescore.metrics.matching import TruthTable

FRAMES_A_PART = 1000
"""Frames in a part of a data set: a part is some 200 kB."""

_FIELDS = ("left_path", "right_path", "disparity_path")
"""Fields of ``FrameRecord`` of the columns ``FILES``."""


def write_frame_parts(root: Path, data: DataSet) -> PartTable:
    """Write a data set in parts; pictures stay where they are.

    Raises:
        RescoreError: the folder holds a data set already, or cannot be written.
    """
    refuse_data_set(root)
    parts = []
    for first in range(0, len(data.frames), FRAMES_A_PART):
        frames = data.frames[first : first + FRAMES_A_PART]
        name = f"{first // FRAMES_A_PART:06d}"
        n_bytes = write_part(root, name, [frame_rows(root, frames, data)])
        parts.append(Part(name=name, rows=len(frames), bytes=n_bytes, frames=len(frames)))
    about = {"class": data.category, "category_id": data.category_id, "renamed": dict(data.renamed)}
    table = PartTable(root, FRAMES, about, tuple(parts))
    table.write()
    return table


def frame_rows(root: Path, frames: Sequence[FrameRecord], data: DataSet) -> pa.Table:
    """The rows of frames with their objects; files are named as seen from a folder."""
    return pa.Table.from_pylist([_row(root, f, data.truth[f.image_id]) for f in frames], schema=FRAME_SCHEMA)


def _row(root: Path, f: FrameRecord, truth: Truth) -> dict[str, Any]:
    row: dict[str, Any] = {name: getattr(f, name) for name in ("image_id", "split", "width_px", "height_px")}
    row |= {name: _name(root, getattr(f, field)) for name, field in zip(FILES, _FIELDS, strict=True)}
    row |= {
        "name": f.name or None,
        "instance_file": _name(root, f.instance_path),
        "disparity_offset_px": f.disparity_offset_px or None,
    }
    if f.instance_kinds:
        row["instance_kinds"] = json.dumps({str(i): kind for i, kind in f.instance_kinds.items()})
    if f.measured is not None:
        row |= {"measured_file": _name(root, f.measured.path), "quantity": f.measured.quantity.value}
        row["factor"] = f.measured.factor
    if f.camera is not None:
        left = f.camera.left
        row |= {"fx": left.fx_px, "fy": left.fy_px, "cx": left.cx_px, "cy": left.cy_px}
        row["baseline_m"] = f.pair.baseline_m if f.pair is not None else None
    if f.ground is not None:
        row |= {name: getattr(f.ground, name) for name in ("height_m", "pitch_rad", "roll_rad")}
    return row | {"objects": _objects(truth)}


def _objects(truth: Truth) -> list[dict[str, Any]]:
    n = len(truth.annotation_id)
    solid = Boxes3D.filled(truth.boxes3d, n).values
    columns: dict[str, Any] = {
        "annotation_id": truth.annotation_id,
        **dict(zip(CORNERS, truth.xyxy_px.T, strict=True)),
        "ignore": truth.ignore,
        "visibility": truth.visibility,
        "azimuth_deg": truth.azimuth_deg,
        "truncated": truth.truncated,
        "occluded": truth.occluded,
        **dict(zip(BOXES3D, solid.T, strict=True)),
    }
    known = {name: column.tolist() for name, column in columns.items() if column is not None}
    rows = [dict(zip(known, values, strict=True)) for values in zip(*known.values(), strict=True)]
    return [
        {name: v for name, v in row.items() if not _is_nan(v)} | {"shape_id": shape or None}
        for row, shape in zip(rows, truth.shape_id, strict=True)
    ]


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and np.isnan(value)


def _name(root: Path, path: Path | None) -> str | None:
    return None if path is None else name_from(root, path)


def read_frame_parts(root: Path, classes: ClassMap) -> DataSet:
    """The data set of a folder in parts, all of it in memory.

    Raises:
        RescoreError: it is damaged, or of another class.
    """
    table = frame_table(root, classes.target)
    parts = list(data_parts(table))
    frames = [f for p in parts for f in p.frames]
    refuse_twice(root, "image id", [f.image_id for f in frames])
    return data_of(table, frames, {i: t for p in parts for i, t in p.truth.items()})


def count_part_frames(table: PartTable, split: str) -> int:
    """Frames of a split of a data set in parts ("all" for every frame).

    Raises:
        RescoreError: two frames have one image id.
    """
    rows = [table.columns(part, ["image_id", "split"]) for part in table.parts]
    refuse_twice(table.root, "image id", (i for r in rows for i in r["image_id"].to_pylist()))
    return sum(len(r) if split == "all" else r["split"].to_pylist().count(split) for r in rows)


def frame_table(root: Path, class_name: str) -> PartTable:
    """The table of a data set in parts.

    Raises:
        RescoreError: there is none, or it is of another class.
    """
    table = PartTable.read(root)
    refuse_kind(table, (FRAMES,))
    if str(table.said("class")).casefold() != class_name.casefold():
        raise RescoreError(
            f"{root}: expected objects of the class {class_name!r}, got {table.about['class']!r}; name that "
            "class, or import the data set again"
        )
    return table


def data_of(table: PartTable, frames: Sequence[FrameRecord], truth: dict[int, Truth]) -> DataSet:
    """A data set of some frames of a table."""
    return DataSet(
        table.root,
        table.said("category_id"),
        table.said("class"),
        tuple(frames),
        truth,
        renamed=table.said("renamed"),
    )


def data_parts(table: PartTable, image_id: IntArray | None = None) -> Iterator[DataSet]:
    """The frames of each part as a data set, one after another.

    Args:
        table: of the data set.
        image_id: the frames that are wanted, shape (k,); parts without one are left out. None for all.
    """
    for part in table.parts:
        if image_id is not None:
            wanted = np.isin(table.columns(part, ["image_id"])["image_id"].to_numpy(), image_id)
            if not wanted.any():
                continue
        rows = table.columns(part, _frame_columns(table))
        rows = rows if image_id is None else rows.filter(pa.array(wanted))
        records = _records(table, part, rows.drop_columns(["objects"]))
        with reading(table.file(part), *_OBJECTS_READ):
            truths = _truths(rows["objects"].combine_chunks())
        found = {f.image_id: t for f, t in zip(records, truths, strict=True)}
        yield data_of(table, records, found)


def records_of_part(table: PartTable, part: Part) -> list[FrameRecord]:
    """The records of the frames of a part, read without their objects."""
    names = _frame_columns(table)
    names.remove("objects")
    return _records(table, part, table.columns(part, names))


def _frame_columns(table: PartTable) -> list[str]:
    """Columns of the frames of a table; those of earlier versions have no names."""
    return [name for name in FRAME_SCHEMA.names if name != "name" or name in table.schema.names]


_AGAIN = "import the data set again"
_OBJECTS_READ = ("the objects of frames", _AGAIN)


def _records(table: PartTable, part: Part, rows: pa.Table) -> list[FrameRecord]:
    with reading(table.file(part), "the frames of a data set", _AGAIN):
        return [_record(table.root, row) for row in rows.to_pylist()]


def frame_of_each_camera(table: PartTable, split: str) -> IntArray:
    """Image id of the first frame of each camera in a split ("all" for every frame), shape (k,)."""
    first: dict[tuple[Any, ...], int] = {}
    names = ["width_px", "height_px", *CAMERA, "disparity_offset_px"]
    for part in table.parts:
        rows = table.columns(part, ["image_id", "split", *names])
        if split != "all":
            rows = rows.filter(pc.equal(rows["split"], split))
        kinds = rows.group_by(names, use_threads=False).aggregate([("image_id", "first")])
        for row in kinds.to_pylist():
            first.setdefault(tuple(row[name] for name in names), row["image_id_first"])
    return np.array(list(first.values()), np.int64)


@dataclass(frozen=True, eq=False)
class ObjectColumns:
    """What is known of all objects of a data set beside their boxes, m in all; NaN where unknown, as in
    ``Truth``."""

    visibility: FloatArray
    """Shape (m,), as the next three."""
    azimuth_deg: FloatArray
    """Azimuth from which each is seen."""
    truncated: FloatArray
    """Share outside the picture."""
    occluded: IntArray
    """KITTI's level, 3 where unknown."""
    boxes3d: Boxes3D


def truth_of_parts(table: PartTable, split: str) -> tuple[TruthTable, ObjectColumns]:
    """The objects of all frames of a split ("all" for every frame), and what is known of them, read without
    anything else of the frames."""
    ids, counts, objects = [], [], []
    for part in table.parts:
        rows = table.columns(part, ["image_id", "split", "objects"])
        if split != "all":
            rows = rows.filter(pc.equal(rows["split"], split))
        listed = rows["objects"].combine_chunks()
        ids.append(rows["image_id"].to_numpy())
        counts.append(np.diff(listed.offsets.to_numpy()))
        with reading(table.file(part), *_OBJECTS_READ):
            objects.append(_object_columns(listed, _JUDGED))

    def joined(name: str) -> FloatArray:
        return np.concatenate([np.zeros(0), *(o.pop(name) for o in objects)])

    n = np.concatenate([np.zeros(0, np.int64), *counts])
    truth = TruthTable(
        np.concatenate([np.zeros(0, np.int64), *ids]),
        np.repeat(np.arange(len(n)), n),
        np.concatenate([np.zeros(0, np.int64), *(o.pop("annotation_id") for o in objects)]),
        np.stack([joined(name) for name in CORNERS], axis=1),
        joined("ignore").astype(np.bool_),
    )
    occluded = joined("occluded")
    known = ObjectColumns(
        visibility=joined("visibility"),
        azimuth_deg=joined("azimuth_deg"),
        truncated=joined("truncated"),
        occluded=np.where(np.isnan(occluded), UNKNOWN_OCCLUSION, occluded).astype(np.int64),
        boxes3d=Boxes3D.of_values(np.stack([joined(name) for name in BOXES3D], axis=1)),
    )
    return truth, known


_JUDGED = (
    *("annotation_id", *CORNERS, "ignore"),
    *("visibility", "azimuth_deg", "truncated", "occluded", *BOXES3D),
)


def has_instances(table: PartTable) -> bool:
    """Whether a frame has a picture of instance numbers, as rendered ones have."""
    return any(table.columns(p, ["instance_file"])["instance_file"].null_count < p.rows for p in table.parts)


def _object_columns(listed: pa.ListArray, names: Sequence[str]) -> dict[str, Any]:
    rows = listed.flatten()
    known = pa.table([rows.field(name) for name in names], names=list(names))
    return arrays_of_table(OBJECTS.shaped(known))


def _truths(listed: pa.ListArray) -> list[Truth]:
    """The objects of each frame, cut from those of all."""
    c = _object_columns(listed, OBJECT_SCHEMA.names)
    offsets: IntArray = listed.offsets.to_numpy().astype(np.int64) - listed.offsets[0].as_py()
    corners = np.stack([c[name] for name in CORNERS], axis=1)
    solid = np.stack([c[name] for name in BOXES3D], axis=1)
    occluded = np.where(np.isnan(c["occluded"].astype(float)), UNKNOWN_OCCLUSION, c["occluded"].astype(float))
    known = ~np.isnan(c["occluded"].astype(float))
    found = []
    for first, end in pairwise(offsets):
        own = slice(first, end)
        found.append(
            Truth(
                annotation_id=c["annotation_id"][own].astype(np.int64),
                xyxy_px=corners[own],
                ignore=c["ignore"][own].astype(np.bool_),
                visibility=c["visibility"][own],
                shape_id=tuple(c["shape_id"][own]),
                azimuth_deg=_or_none(c["azimuth_deg"][own]),
                truncated=_or_none(c["truncated"][own]),
                occluded=occluded[own].astype(np.int64) if known[own].any() else None,
                boxes3d=None if np.isnan(solid[own]).all() else Boxes3D.of_values(solid[own]),
            )
        )
    return found


def _or_none(column: Any) -> Any:
    return None if np.isnan(column).all() else column


def _record(root: Path, row: dict[str, Any]) -> FrameRecord:
    def place(name: str) -> Path | None:
        if row[name] is not None and "\0" in row[name]:
            raise ValueError(f"{name!r} without a zero byte, got {row[name]!r}")
        return None if row[name] is None else beside(root, row[name])

    name = row.get("name") or ""
    if name:
        refuse_unsafe_name(root, f"a name of image {row['image_id']}", name, MAX_FRAME_NAME_BYTES)
    refuse_split(root, row["image_id"], row["split"])
    left = place("left_file")
    assert left is not None, "the form of a table of frames has it filled"
    measured = place("measured_file")
    kinds = json.loads(row["instance_kinds"] or "{}")
    return FrameRecord(
        image_id=row["image_id"],
        left_path=left,
        right_path=place("right_file"),
        disparity_path=place("disparity_file"),
        split=row["split"],
        width_px=row["width_px"],
        height_px=row["height_px"],
        camera=_camera(row),
        ground=None if row["height_m"] is None else GroundPlane(*(row[name] for name in CAMERA[5:])),
        instance_path=place("instance_file"),
        instance_kinds={int(i): kind for i, kind in kinds.items()},
        measured=None
        if measured is None
        else MeasuredFile(measured, Quantity(row["quantity"]), row["factor"]),
        disparity_offset_px=row["disparity_offset_px"] or 0.0,
        name=name,
    )


def _camera(row: dict[str, Any]) -> StereoCamera | DepthCamera | None:
    if row["fx"] is None:
        return None
    fx, fy, cx, cy = (row[name] for name in CAMERA[:4])
    left = PinholeCamera(fx, fy, cx, cy, row["width_px"], row["height_px"])
    return DepthCamera(left) if row["baseline_m"] is None else StereoCamera(left, row["baseline_m"])
