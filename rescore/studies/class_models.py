"""How good learned class models are: few primitives for all parts, planes and skeletons against the truth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synth.objects.object_classes import (
    FIGURE_1_CLASSES,
    ObjectClass,
    Shape,
    labelled_views,
    object_class,
)
from datasets_synth.render.part_truth import PartTruth, part_truth
from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.learning.learn import learn_class_model, part_costs
from recon.learning.primitives import primitive_normals
from recon.part_views import PartViews
from recon.view_bins import ViewBins
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames

ELEVATION_DEG = 20.0
"""View space in which the classes are compared: high enough that level parts are not seen edge-on."""
STREET_ELEVATION_DEG = 5.0
"""Elevation in degrees of the views in the experiment with cars."""
SIZE_PX = 220
SELECTION_INSTANCES = 3
ACCURACY_INSTANCES = 3
VIEW_COUNTS = (2, 3, 4, 6)
STARTS = (1, 7)
"""First view bin of each run of neighbouring views."""
ACCURACY_CLASSES = ("car", "chair", "bicycle", "airplane")
TWO_VIEWS = {"car": (2, 4), "chair": (1, 2), "bicycle": (2, 4), "airplane": (1, 2), "basket": (1, 2)}
"""View bins that the models to look at are learned from."""
SHOWN_PRIMITIVES = 4
"""Number of primitives shown: as many as the report found to suffice."""


@dataclass(frozen=True, eq=False)
class PrimitiveSelection:
    """Primitives in the order in which they were chosen."""

    order: NDArray[np.intp]
    """Indices into the library, shape (s,)."""
    cost: FloatArray
    """Mean cost of all parts with the first 1, 2, ... chosen primitives, shape (s,); never rises."""
    full_cost: float
    """Mean cost of all parts with the whole library: the least there can be."""


def select_primitives(cost: FloatArray, count: int) -> PrimitiveSelection:
    """Greedy selection: each step adds the primitive that lowers the mean cost of the parts most.

    A part costs what the best of the chosen primitives costs it.

    Args:
        cost: cost of each primitive for each part, shape (parts, primitives), finite.
        count: primitives to choose.

    Raises:
        ValueError: no parts, costs that are not finite, or more primitives asked for than there are.
    """
    if not cost.size or not np.isfinite(cost).all() or not 1 <= count <= cost.shape[1]:
        raise ValueError(f"expected finite costs of at least {count} primitives, got shape {cost.shape}")
    best = np.full(len(cost), np.inf)
    order: list[int] = []
    mean: list[float] = []
    for _ in range(count):
        with_each = np.minimum(best[:, None], cost).mean(axis=0)
        with_each[order] = np.inf
        order.append(int(np.argmin(with_each)))
        best = np.minimum(best, cost[:, order[-1]])
        mean.append(float(best.mean()))
    return PrimitiveSelection(np.array(order), np.array(mean), float(cost.min(axis=1).mean()))


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

    def best_of_first(self, count: int) -> NDArray[np.intp]:
        """For each part, which of the first ``count`` chosen primitives costs it least, shape (parts,)."""
        return np.asarray(self.cost[:, self.selection.order[:count]].argmin(axis=1))


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
    """90th percentile of the angle of the normals, in degrees."""
    centroid: float
    """Median distance of the centroids, in lengths of the object's longest side."""
    centroid_90: float
    """90th percentile of the distance of the centroids, in lengths of the object's longest side."""


@dataclass(frozen=True, eq=False)
class ModelStudy:
    """Selection of primitives, accuracy of learned models, and models to look at."""

    selection: SelectionStudy
    accuracy: tuple[AccuracyRow, ...]
    models: tuple[tuple[str, ClassModel], ...]
    """Models to look at, with what each was learned from in words."""


def study(jobs: Workers = 1) -> ModelStudy:
    """The whole study of class models: selection, accuracy, and models to look at; always the same."""
    tasks = [(name, ELEVATION_DEG) for name in ACCURACY_CLASSES] + [("car", STREET_ELEVATION_DEG)]
    rows = list(map_frames(_accuracy, tasks, None, jobs))
    return ModelStudy(selection_study(), tuple(row for group in rows for row in group), two_view_models())


def selection_study(count: int = 8) -> SelectionStudy:
    """Costs of all primitives for all parts, and the first ``count`` that greedy selection takes."""
    bins = ViewBins(elevation_rad=float(np.deg2rad(ELEVATION_DEG)))
    parts: list[tuple[str, str]] = []
    costs = []
    for name in FIGURE_1_CLASSES:
        chosen = object_class(name)
        found = part_costs(labelled_views(chosen, chosen.train[:SELECTION_INSTANCES], bins, SIZE_PX))
        parts += [(name, chosen.part_names[label - 1]) for label in found.labels]
        costs.append(found.cost)
    cost = np.concatenate(costs)
    return SelectionStudy(tuple(parts), primitive_normals(), cost, select_primitives(cost, count))


def _accuracy(task: tuple[str, float], _shared: None) -> list[AccuracyRow]:
    return accuracy(*task)


def accuracy(class_name: str, elevation_deg: float) -> list[AccuracyRow]:
    """Errors of the planes and skeletons of test shapes, each learned from 2, 3, ... of its own views."""
    chosen = object_class(class_name)
    bins = ViewBins(elevation_rad=float(np.deg2rad(elevation_deg)))
    # spread over the list, which goes by style
    shapes = chosen.test[:: max(1, len(chosen.test) // ACCURACY_INSTANCES)][:ACCURACY_INSTANCES]
    errors: dict[int, list[tuple[FloatArray, FloatArray]]] = {n: [] for n in VIEW_COUNTS}
    for shape in shapes:
        truth, views = _truth(chosen, shape), labelled_views(chosen, [shape], bins, SIZE_PX)
        for n in VIEW_COUNTS:
            for start in STARTS:
                wanted = {(start + i) % bins.count for i in range(n)}
                model = _learned(class_name, views, wanted)
                errors[n].append(model_errors(model, truth))
    return [_row(class_name, elevation_deg, n, found) for n, found in errors.items()]


def _truth(chosen: ObjectClass, shape: Shape) -> dict[int, PartTruth]:
    return part_truth(chosen.labelled_mesh(chosen.build(shape, np.random.default_rng(0))))


def _learned(class_name: str, views: PartViews, wanted: set[int]) -> ClassModel:
    few = tuple(v for v in views.views if v.view_bin in wanted)
    return learn_class_model(PartViews(views.part_names, views.bins, few), class_name, views.part_names)


def model_errors(model: ClassModel, truth: dict[int, PartTruth]) -> tuple[FloatArray, FloatArray]:
    """Angles of normals in degrees, and distances of centroids, of the parts that two views show.

    The model has no size and no place: both are fitted, so that the median distance does not suffer from one
    part. Centroids are in lengths of the object's longest side. Rods have no normal that means anything.
    """
    parts = [p for p in model.parts if p.view_count > 1 and p.label in truth]
    true = np.stack([truth[p.label].centroid_m for p in parts])
    length = max(float(np.ptp(true, axis=0).max()), max(t.spread_m[0] for t in truth.values()) * 2)
    distance = _fitted_distance(np.stack([p.centroid for p in parts]), true) / length
    flat = [p for p in parts if not truth[p.label].is_elongated]
    cosine = np.array([abs(p.plane[:3] @ truth[p.label].normal) for p in flat])
    return np.rad2deg(np.arccos(np.clip(cosine, 0, 1))), distance


def _fitted_distance(mine: FloatArray, true: FloatArray, rounds: int = 50) -> FloatArray:
    """Distances (n,) after the scale and shift with the least sum of distances (not of their squares)."""
    weight = np.ones(len(mine))
    distance = weight
    for _ in range(rounds):
        share = (weight / weight.sum())[:, None]
        a, b = mine - (share * mine).sum(axis=0), true - (share * true).sum(axis=0)
        scale = (share * a * b).sum() / max(float((share * a * a).sum()), 1e-12)
        distance = np.linalg.norm(scale * a - b, axis=1)
        weight = 1 / np.maximum(distance, 1e-4)
    return distance


def _row(
    class_name: str, elevation_deg: float, n_views: int, found: Sequence[tuple[FloatArray, FloatArray]]
) -> AccuracyRow:
    angle, distance = (np.concatenate([f[i] for f in found]) for i in (0, 1))
    middle = [float(np.median(e)) for e in (angle, distance)]
    high = [float(np.quantile(e, 0.9)) for e in (angle, distance)]
    return AccuracyRow(
        class_name, elevation_deg, n_views, len(found), len(distance), middle[0], high[0], middle[1], high[1]
    )


def two_view_models() -> tuple[tuple[str, ClassModel], ...]:
    """A model of each class from two labelled views of one instance, as in figures 2 and 3 of the report."""
    bins = ViewBins(elevation_rad=float(np.deg2rad(ELEVATION_DEG)))
    models = []
    for name, wanted in TWO_VIEWS.items():
        chosen = object_class(name)
        views = labelled_views(chosen, chosen.train[:1], bins, SIZE_PX)
        words = f"bins {wanted[0]} and {wanted[1]} of {chosen.train[0].shape_id}"
        models.append((words, _learned(name, views, set(wanted))))
    return tuple(models)
