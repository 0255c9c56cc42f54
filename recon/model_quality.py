"""What a study of class models finds: the types that its page is made from."""

from dataclasses import dataclass

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.primitive_selection import PrimitiveSelection


@dataclass(frozen=True, eq=False)
class SelectionStudy:
    """Greedy selection of primitives over the parts of several classes."""

    parts: tuple[tuple[str, str], ...]
    """Class and name of each part."""
    normals: FloatArray
    """The library, shape (k, 3)."""
    cost: FloatArray
    """Cost of each primitive for each part, shape (parts, k)."""
    selection: PrimitiveSelection


@dataclass(frozen=True)
class AccuracyRow:
    """Errors of learned models against the truth for one class, view space and number of views."""

    class_name: str
    elevation_deg: float
    n_views: int
    n_models: int
    n_parts: int
    """Parts that at least two of the views show, over all models."""
    normal_deg: float
    """Median angle of the normals, in degrees."""
    normal_deg_90: float
    """90th percentile."""
    centroid: float
    """Median distance of the centroids, in lengths of the object's longest side."""
    centroid_90: float
    """90th percentile."""


@dataclass(frozen=True, eq=False)
class ModelStudy:
    """All of it."""

    selection: SelectionStudy
    accuracy: tuple[AccuracyRow, ...]
    models: tuple[tuple[str, ClassModel], ...]
    """Models to look at, with what each was learned from in words."""
