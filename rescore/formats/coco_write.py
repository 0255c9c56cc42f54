"""Writing data sets of any layout as our own: ``annotations.json``, pictures referred to or copied."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from recon.boxes import xywh_from_xyxy
from recon.camera import StereoCamera
from recon.files import copy_file
from recon.stores import name_from
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet, FrameRecord, Truth, frame_names
from rescore.files import write_json
from rescore.formats.parts.manifest import refuse_data_set


def write_dataset(out: Path, data: DataSet, *, copy: bool) -> Path:
    """Write a data set to a folder and return its ``annotations.json``.

    Args:
        out: The folder.
        data: What to write.
        copy: Whether pictures are copied into the folder; else they are referred to where they are, by paths
            relative to the folder.

    Raises:
        RescoreError: the folder holds a data set already, or cannot be written.
    """
    file = out / "annotations.json"
    refuse_data_set(out)
    overwrite_dataset(out, data, copy=copy)
    return file


def overwrite_dataset(out: Path, data: DataSet, *, copy: bool) -> None:
    """Write a data set to a folder as ``write_dataset`` does, in place of one that may be there."""
    names = frame_names(data)
    images = [_image(f, _Placing(out, names[f.image_id], copy)) for f in data.frames]
    annotations = [a for f in data.frames for a in _annotations(f.image_id, data.truth[f.image_id], data)]
    # numbers that other files may have for the class stay known
    numbers = sorted({data.category_id, *data.class_ids})
    categories = [{"id": number, "name": data.category} for number in numbers]
    content = {"images": images, "annotations": annotations, "categories": categories}
    write_json(out / "annotations.json", content)


class _Placing:
    """Where the files of one frame go."""

    def __init__(self, out: Path, name: str, copy: bool) -> None:
        self._out, self._name, self._copy = out, name, copy

    def __call__(self, path: Path | None, kind: str) -> str | None:
        """The name to write for a file, which is copied first where that is asked for."""
        if path is None:
            return None
        if not self._copy:
            return name_from(self._out, path)
        name = f"{kind}/{self._name}{path.suffix}"
        copy_file(path, self._out / name)
        return name


def _image(frame: FrameRecord, place: Callable[[Path | None, str], str | None]) -> dict[str, Any]:
    measured = frame.measured and {
        "file_name": place(frame.measured.path, frame.measured.quantity.value),
        "quantity": frame.measured.quantity.value,
        "factor": frame.measured.factor,
    }
    values = {
        "id": frame.image_id,
        "name": frame.name or None,
        "file_name": place(frame.left_path, "left"),
        "width": frame.width_px,
        "height": frame.height_px,
        "split": frame.split,
        "right_file_name": place(frame.right_path, "right"),
        "disparity_file_name": place(frame.disparity_path, "disparity"),
        "measured": measured,
        "instance_file_name": place(frame.instance_path, "instances"),
        "instances": [{"id": i, "kind": k} for i, k in frame.instance_kinds.items()] or None,
        "camera": _camera(frame),
    }
    return {name: value for name, value in values.items() if value is not None}


def _camera(frame: FrameRecord) -> dict[str, float] | None:
    if frame.camera is None:
        return None
    c = frame.camera.left
    camera = {"fx": c.fx_px, "fy": c.fy_px, "cx": c.cx_px, "cy": c.cy_px}
    if isinstance(frame.camera, StereoCamera):
        camera["baseline_m"] = frame.camera.baseline_m
    if frame.ground is not None:
        camera |= {"height_m": frame.ground.height_m, "pitch_rad": frame.ground.pitch_rad}
        camera |= {"roll_rad": frame.ground.roll_rad} if frame.ground.roll_rad else {}
    if frame.disparity_offset_px:
        camera["disparity_offset_px"] = frame.disparity_offset_px
    return camera


def _annotations(image_id: int, truth: Truth, data: DataSet) -> list[dict[str, Any]]:
    boxes = xywh_from_xyxy(truth.xyxy_px).tolist()
    columns = {
        "visibility": truth.visibility,
        "azimuth_deg": truth.azimuth_deg,
        "truncated": truth.truncated,
        "occluded": truth.occluded,
    }
    rows, boxes3d = [], _boxes3d(truth)
    for i, box in enumerate(boxes):
        row = {
            "id": int(truth.annotation_id[i]),
            "image_id": image_id,
            "category_id": data.category_id,
            "bbox": box,
            "ignore": bool(truth.ignore[i]),
        }
        known = {k: v[i].item() for k, v in columns.items() if v is not None and not np.isnan(v[i])}
        shape = {"shape_id": truth.shape_id[i]} if truth.shape_id[i] else {}
        rows.append(row | known | shape | boxes3d[i])
    return rows


def _boxes3d(truth: Truth) -> list[dict[str, list[float]]]:
    """The 3D box of each object as its row has it; nothing where it is not known."""
    values = Boxes3D.filled(truth.boxes3d, len(truth.annotation_id)).values
    return [{} if np.isnan(row).any() else {"bbox3d": row.tolist()} for row in values]
