"""Part-labelled views: what a class model is learned from (section 3.2), and their files."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import reading, refuse_large_picture
from recon.view_bins import ViewBins

LABELS_FILE = "part_views.json"
FORMAT = "part-views 1"


@dataclass(frozen=True, eq=False)
class PartView:
    """A part-labelled image of one instance, seen from one view bin."""

    view_bin: int
    labels: UInt8Array
    """Shape (h, w): 0 for none, i for part ``part_names[i - 1]``."""
    instance_id: str
    """Name of the object that the view shows; views with the same id show the same object."""

    def __post_init__(self) -> None:
        if self.labels.ndim != 2 or self.labels.dtype != np.uint8:
            raise ValueError(f"labels must be (h, w) uint8, got {self.labels.shape} {self.labels.dtype}")
        if not self.labels.any():
            raise RescoreError(
                f"labelled view of {self.instance_id!r}, bin {self.view_bin}: expected at least one labelled "
                "part, got an empty image; label it or leave it out"
            )


@dataclass(frozen=True, eq=False)
class PartViews:
    """Labelled views of one class with the names of its parts."""

    part_names: tuple[str, ...]
    bins: ViewBins
    views: tuple[PartView, ...]
    sizes_m: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    """Length, width without mirrors and height of instances by their id, where they are known."""

    def __post_init__(self) -> None:
        for view in self.views:
            self.bins.check(view.view_bin)
            if view.labels.max() > len(self.part_names):
                raise RescoreError(
                    f"labelled view of {view.instance_id!r}, bin {view.view_bin}: expected labels 0 to "
                    f"{len(self.part_names)}, got {view.labels.max()}; part_names must name every label"
                )


def save_part_views(directory: Path, part_views: PartViews) -> None:
    """Write each view as a PNG of labels, and ``part_views.json`` that says what they are."""
    directory.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, object]] = []
    for i, view in enumerate(part_views.views):
        name = f"{i:04d}_{view.instance_id}_bin{view.view_bin:02d}.png"
        _, png = cv2.imencode(".png", view.labels)
        with atomic_path(directory / name) as beside:
            beside.write_bytes(png.tobytes())
        rows.append({"file_name": name, "view_bin": view.view_bin, "instance_id": view.instance_id})
    head = {
        "format": FORMAT,
        "part_names": list(part_views.part_names),
        "view_bins": part_views.bins.count,
        "elevation_rad": part_views.bins.elevation_rad,
        "views": rows,
    }
    if part_views.sizes_m:
        head["sizes_m"] = {name: list(size) for name, size in part_views.sizes_m.items()}
    with atomic_path(directory / LABELS_FILE) as beside:
        beside.write_text(json.dumps(head, indent=1) + "\n")


def load_part_views(directory: Path) -> PartViews:
    """The labelled views of a folder.

    Raises:
        RescoreError: no such folder, another format, a missing picture.
    """
    path = directory / LABELS_FILE
    if not path.is_file():
        raise RescoreError(f"{path}: expected labelled views, found no file; write them with `rescore synth`")
    with reading(path, repr(FORMAT), "write the views again"):
        head = json.loads(path.read_bytes())
        if head["format"] != FORMAT:
            raise RescoreError(
                f"{path}: expected format {FORMAT!r}, got {head['format']!r}; write the views again"
            )
        bins = ViewBins(int(head["view_bins"]), float(head["elevation_rad"]))
        views = tuple(_load_view(directory, row) for row in head["views"])
        sizes = {str(name): _size(size) for name, size in head.get("sizes_m", {}).items()}
        return PartViews(tuple(head["part_names"]), bins, views, sizes)


def _size(value: Sequence[float]) -> tuple[float, float, float]:
    length, width, height = (float(v) for v in value)
    if not min(length, width, height) > 0:
        raise ValueError(f"sizes must be positive metres, got {value}")
    return length, width, height


def _load_view(directory: Path, row: dict[str, str]) -> PartView:
    path = directory / row["file_name"]
    if not path.is_file():
        raise RescoreError(
            f"{path}: expected a PNG of part labels, found no file; check file_name in {LABELS_FILE}"
        )
    data = path.read_bytes()
    with reading(path, "an 8-bit PNG of one channel", "write the views again"):
        refuse_large_picture(path, data)
        # Pillow, since OpenCV gives the first rows of a damaged PNG, and prints lines of its own
        labels = np.asarray(Image.open(io.BytesIO(data), formats=("PNG",)))
    if labels.ndim != 2 or labels.dtype != np.uint8:
        raise RescoreError(
            f"{path}: expected an 8-bit PNG of one channel, got something else; write the views again"
        )
    return PartView(int(row["view_bin"]), np.asarray(labels, np.uint8), str(row["instance_id"]))
