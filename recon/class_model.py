"""The 3D class model of section 3.1: view bins, labelled images, skeleton, part planes; its file."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.outlines import fill_rings, mask_rings
from recon.part_views import PartView
from recon.reading import json_of, reading
from recon.shape_space import ShapeSpace
from recon.view_bins import ViewBins
from recon.view_looks import ViewLooks

FORMAT = "class-model 1"


@dataclass(frozen=True, eq=False)
class ClassPart:
    """One part: where it is and how it is oriented, in the object frame.

    Lengths are in units of the model's length along x; the origin is the middle of the part centroids.
    """

    label: int
    """Label in the part-labelled images; ``part_names[label - 1]`` is its name."""
    centroid: FloatArray
    """S_j, shape (3,)."""
    plane: FloatArray
    """Q_j = (a, b, c, d) with a X + b Y + c Z + d = 0 (eq. 1); (a, b, c) has length 1 and points outward."""
    outline: FloatArray
    """Bounding polygon (m, 3) for pictures and extents; plays no role in the planes."""
    primitive: int
    """Index of the chosen orientation in the library of primitives; -1 where only one view shows the part."""
    view_count: int
    """Labelled views it was learned from. 1: the plane faces that view, at the mean depth of its parts."""

    def __post_init__(self) -> None:
        if self.centroid.shape != (3,) or self.plane.shape != (4,) or self.outline.shape[1:] != (3,):
            raise ValueError(f"part: {self.centroid.shape}, {self.plane.shape}, {self.outline.shape}")
        if not np.isclose(np.linalg.norm(self.plane[:3]), 1.0):
            raise ValueError(f"part: the plane normal must have length 1, got {self.plane}")


@dataclass(frozen=True, eq=False)
class ClassModel:
    """A 3D Potemkin class model."""

    class_name: str
    part_names: tuple[str, ...]
    bins: ViewBins
    parts: tuple[ClassPart, ...]
    """Sorted by label; a part that no labelled view shows is absent."""
    views: tuple[PartView, ...]
    """Sorted by bin, at most one a bin: the part-labelled images."""
    shape_space: ShapeSpace | None = None
    """How instances differ in shape and size; None where too few of known size were learned from."""

    looks: ViewLooks | None = None
    """How instances look from each side; None where no pictures of known heading were learned from."""

    def __post_init__(self) -> None:
        labels = [p.label for p in self.parts]
        bins = [v.view_bin for v in self.views]
        if labels != sorted(set(labels)) or bins != sorted(set(bins)):
            raise ValueError(f"class model: labels {labels} and bins {bins} must be sorted and differ")
        if labels and not 1 <= labels[0] <= labels[-1] <= len(self.part_names):
            raise ValueError(f"class model: labels {labels} for {len(self.part_names)} names")

    def part(self, label: int) -> ClassPart:
        """The part with a label; KeyError where there is none."""
        for part in self.parts:
            if part.label == label:
                return part
        raise KeyError(label)

    def view(self, view_bin: int) -> PartView:
        """The part-labelled image of a view bin.

        Raises:
            RescoreError: the bin does not exist, or the model was learned without a view of it.
        """
        self.bins.check(view_bin)
        for view in self.views:
            if view.view_bin == view_bin:
                return view
        have = ", ".join(str(v.view_bin) for v in self.views)
        raise RescoreError(
            f"class model {self.class_name!r}: expected a labelled view of bin {view_bin}, "
            f"has bins {have or 'none'}; learn the model with a view of it"
        )

    @property
    def extents(self) -> FloatArray:
        """Size along x, y and z of all part outlines, shape (3,), in units of the model."""
        points = np.concatenate([p.outline for p in self.parts])
        return np.asarray(np.ptp(points, axis=0))

    def save(self, path: Path) -> None:
        """Write one readable JSON file; ``load`` gives back exactly this model."""
        with atomic_path(path) as beside:
            beside.write_text(_dumps(self))

    @staticmethod
    def load(path: Path) -> "ClassModel":
        """Read a model.

        Raises:
            RescoreError: no such file, not a class model, another version.
        """
        if not path.is_file():
            raise RescoreError(f"{path}: expected a class model, found no file; learn one first")
        return ClassModel.from_json(json_of(path, "a class model", "learn the model again"), path)

    def as_json(self) -> dict[str, Any]:
        """The model as JSON values, as ``save`` writes them; ``from_json`` gives back exactly this model."""
        value: dict[str, Any] = json.loads(_dumps(self))
        return value

    @staticmethod
    def from_json(value: Any, where: Path) -> "ClassModel":
        """What ``as_json`` made; ``where`` names it in the error.

        Raises:
            RescoreError: not a class model, another version.
        """
        with reading(where, f"{FORMAT!r} JSON", "learn the model again"):
            return _parse(value, where)


def _dumps(model: ClassModel) -> str:
    """Readable JSON: one line a part, a rotation and a labelled region."""
    parts = [
        {
            "name": model.part_names[p.label - 1],
            "label": p.label,
            "centroid": p.centroid.tolist(),
            "plane": p.plane.tolist(),
            "primitive": p.primitive,
            "view_count": p.view_count,
            "outline": p.outline.tolist(),
        }
        for p in model.parts
    ]
    rotations = [model.bins.view_from_object(b).tolist() for b in range(model.bins.count)]
    head = {
        "format": FORMAT,
        "class_name": model.class_name,
        "part_names": list(model.part_names),
        "view_bins": {"count": model.bins.count, "elevation_rad": model.bins.elevation_rad},
    }
    if model.shape_space is not None:
        head["shape_space"] = model.shape_space.as_json()
    if model.looks is not None:
        head["looks"] = model.looks.as_json()
    body = ",\n".join(f"{json.dumps(k)}: {json.dumps(v)}" for k, v in head.items())
    return (
        f'{{\n{body},\n"view_from_object": [\n{_lines(rotations)}\n],\n"parts": [\n{_lines(parts)}\n],\n'
        f'"part_labelled_images": [\n{_lines([_view_row(v) for v in model.views])}\n]\n}}\n'
    )


def _lines(rows: list[Any]) -> str:
    return ",\n".join(json.dumps(row) for row in rows)


def _view_row(view: PartView) -> dict[str, Any]:
    labels = [int(x) for x in np.unique(view.labels) if x]
    return {
        "view_bin": view.view_bin,
        "instance_id": view.instance_id,
        "height_px": view.labels.shape[0],
        "width_px": view.labels.shape[1],
        "regions": {str(i): [r.tolist() for r in mask_rings(view.labels == i)] for i in labels},
    }


def _parse(data: dict[str, Any], path: Path) -> ClassModel:
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise RescoreError(
            f"{path}: expected a file of format {FORMAT!r}, got {found!r}; learn the model again"
        )
    bins = ViewBins(int(data["view_bins"]["count"]), float(data["view_bins"]["elevation_rad"]))
    parts = tuple(
        ClassPart(
            label=int(row["label"]),
            centroid=np.array(row["centroid"], float),
            plane=np.array(row["plane"], float),
            outline=np.array(row["outline"], float).reshape(-1, 3),
            primitive=int(row["primitive"]),
            view_count=int(row["view_count"]),
        )
        for row in data["parts"]
    )
    views = tuple(_parse_view(row) for row in data["part_labelled_images"])
    space = ShapeSpace.from_json(data["shape_space"]) if "shape_space" in data else None
    looks = ViewLooks.from_json(data["looks"]) if "looks" in data else None
    return ClassModel(str(data["class_name"]), tuple(data["part_names"]), bins, parts, views, space, looks)


def _parse_view(row: dict[str, Any]) -> PartView:
    height, width = int(row["height_px"]), int(row["width_px"])
    labels = np.zeros((height, width), np.uint8)
    for label, rings in row["regions"].items():
        labels[fill_rings([np.array(r, np.int32) for r in rings], height, width)] = int(label)
    return PartView(int(row["view_bin"]), labels, str(row["instance_id"]))
