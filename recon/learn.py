"""Learning a class model from part-labelled views (section 3.2). Of the cameras it knows the view bins."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from recon.class_model import ClassModel, ClassPart
from recon.errors import RescoreError
from recon.outlines import fill_polygon, largest_outline, resample
from recon.part_views import PartView, PartViews
from recon.primitives import cross_view_transforms, lift, primitive_normals
from recon.shape_context import ShapeContextConfig, match, shape_contexts
from recon.structure import Structure, solve_structure
from recon.view_bins import ViewBins

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LearnConfig:
    """Settings of learning."""

    bins: ViewBins = field(default_factory=ViewBins)
    boundary_points: int = 48
    """Points on each part boundary."""
    min_part_share: float = 0.004
    """Regions smaller than this share of the labelled pixels do not count as seeing the part."""
    max_bin_step: int = 3
    """Boundaries are compared between views at most this many bins apart."""
    min_facing: float = 0.1
    """A primitive may not explain a part in a view to which it is turned by less than this cosine."""
    refine_rounds: int = 3
    """Rounds that match boundaries by shape contexts and turn the primitive to fit; 0 keeps the primitive."""
    outlier: float = 0.15
    """Residuals beyond this share of the part's size count no more than this."""
    shape_context: ShapeContextConfig = field(default_factory=lambda: ShapeContextConfig(position_weight=4.0))


def learn_class_model(
    views: PartViews | Sequence[PartView],
    class_name: str,
    part_names: Sequence[str],
    config: LearnConfig | None = None,
) -> ClassModel:
    """The class model of part-labelled views, of which at least two must show one instance.

    Raises:
        RescoreError: too few views, views that fix no depth, or bins that contradict each other.
    """
    config = config or LearnConfig()
    if isinstance(views, PartViews):
        config = replace(config, bins=views.bins)
        views = views.views
    checked = PartViews(tuple(part_names), config.bins, tuple(views)).views
    _check_instances(checked)
    observed = _Observations(checked, len(part_names), config)
    structure = solve_structure(observed.centroid, observed.rotation)
    parts = tuple(
        part
        for label in range(1, len(part_names) + 1)
        if (part := _learn_part(label, observed, structure, config)) is not None
    )
    return ClassModel(
        class_name, tuple(part_names), config.bins, _in_model_units(parts), _canonical_views(checked)
    )


def _check_instances(views: Sequence[PartView]) -> None:
    bins_of: dict[str, set[int]] = {}
    for view in views:
        bins_of.setdefault(view.instance_id, set()).add(view.view_bin)
    if not any(len(bins) >= 2 for bins in bins_of.values()):
        raise RescoreError(
            "learning: expected at least two views of one instance from different bins, got "
            f"{len(views)} views of {len(bins_of)} instances; label another view of an instance"
        )


class _Observations:
    """What the labelled views show of each part, in units of the larger side of the object in each view."""

    def __init__(self, views: Sequence[PartView], part_count: int, config: LearnConfig) -> None:
        self.views = views
        self.rotation = np.stack([config.bins.view_from_object(v.view_bin) for v in views])
        self.centroid = np.full((len(views), part_count, 2), np.nan)
        self.boundary: dict[tuple[int, int], FloatArray] = {}
        """By (view, label): points (m, 2) evenly spaced along the boundary of the part's largest region."""
        for i, view in enumerate(views):
            self._observe(i, view, config)

    def _observe(self, i: int, view: PartView, config: LearnConfig) -> None:
        rows, cols = np.nonzero(view.labels)
        size = max(np.ptp(rows), np.ptp(cols)) + 1
        for label in (int(x) for x in np.unique(view.labels) if x):
            mask = view.labels == label
            ring = largest_outline(mask)
            if mask.sum() < max(20, config.min_part_share * len(rows)) or ring is None or len(ring) < 12:
                continue
            part_rows, part_cols = np.nonzero(mask)
            self.centroid[i, label - 1] = part_cols.mean() / size, part_rows.mean() / size
            self.boundary[i, label] = resample(ring, config.boundary_points) / size

    def views_of(self, label: int) -> list[int]:
        """Indices of the views that show a part."""
        return [i for i in range(len(self.views)) if (i, label) in self.boundary]

    def pairs_of(self, label: int, config: LearnConfig) -> list[tuple[int, int]]:
        """Pairs of views of one instance, not too far apart, that both show a part."""
        shown = self.views_of(label)
        count = config.bins.count
        pairs = []
        for a in shown:
            for b in shown[shown.index(a) + 1 :]:
                apart = (self.views[a].view_bin - self.views[b].view_bin) % count
                near = 0 < min(apart, count - apart) <= config.max_bin_step
                if near and self.views[a].instance_id == self.views[b].instance_id:
                    pairs.append((a, b))
        return pairs


@dataclass(frozen=True, eq=False)
class _Pair:
    """Boundaries of one part in two views, as offsets from their means in object units."""

    a: FloatArray
    b: FloatArray
    rotation_a: FloatArray
    rotation_b: FloatArray
    size: float
    """Root-mean-square radius in b, object units."""


def _learn_part(
    label: int, seen: _Observations, structure: Structure, config: LearnConfig
) -> ClassPart | None:
    """Plane and outline of a part in the frame of the structure; None where no view shows it."""
    shown = [i for i in seen.views_of(label) if np.isfinite(structure.scale[i])]
    if not shown:
        return None
    pairs = [_pair(label, a, b, seen, structure) for a, b in seen.pairs_of(label, config)]
    if pairs:
        primitive, normal = _best_primitive(pairs, config)
        centroid = structure.points[label - 1]
    else:
        primitive, normal = -1, _facing_normal(seen.rotation[shown[0]])
        centroid = structure.points[label - 1]
        if not np.isfinite(centroid).all():
            centroid = _centroid_from_one_view(label, shown[0], seen, structure)
    # the bounding polygon comes from the view that the part faces most
    best = min(shown, key=lambda i: float(normal @ seen.rotation[i][2]))
    offsets = _offsets(label, best, seen, structure)
    outline = centroid + offsets @ lift(normal[None], seen.rotation[best])[0].T
    plane = np.append(normal, -normal @ centroid)
    return ClassPart(label, centroid, plane, outline, primitive, len(shown))


def _offsets(label: int, view: int, seen: _Observations, structure: Structure) -> FloatArray:
    """Boundary of a part in a view as offsets (m, 2) from its centroid, in object units."""
    return np.asarray((seen.boundary[view, label] - seen.centroid[view, label - 1]) * structure.scale[view])


def _pair(label: int, a: int, b: int, seen: _Observations, structure: Structure) -> _Pair:
    pa, pb = _offsets(label, a, seen, structure), _offsets(label, b, seen, structure)
    pa, pb = pa - pa.mean(axis=0), pb - pb.mean(axis=0)
    return _Pair(pa, pb, seen.rotation[a], seen.rotation[b], float(np.sqrt((pb**2).sum(axis=1).mean())))


def _carried(normals: FloatArray, pair: _Pair) -> FloatArray:
    """Boundary of view a as each primitive carries it to view b, shape (k, m, 2), mean 0."""
    return np.asarray(
        np.einsum("kij,mj->kmi", cross_view_transforms(normals, pair.rotation_a, pair.rotation_b), pair.a)
    )


def _shows(normals: FloatArray, pair: _Pair, config: LearnConfig) -> NDArray[np.bool_]:
    """Whether a plane with each normal (k, 3) faces both views."""
    return np.asarray(
        -np.maximum(normals @ pair.rotation_a[2], normals @ pair.rotation_b[2]) >= config.min_facing
    )


def _library_cost(normals: FloatArray, pair: _Pair, config: LearnConfig) -> FloatArray:
    """How badly each primitive explains a pair, shape (k,).

    Mean squared distance of the carried boundary to the seen one and back, in part sizes, capped. It is for
    the whole library at once, so by nearest points; shape contexts match the points for the chosen one.
    """
    cost = np.full(len(normals), config.outlier**2)
    use = _shows(normals, pair, config)
    carried = _carried(normals[use], pair)
    squared = ((carried[:, :, None, :] - pair.b[None, None]) ** 2).sum(axis=3) / pair.size**2
    cap = config.outlier**2
    there, back = np.minimum(squared.min(axis=2), cap), np.minimum(squared.min(axis=1), cap)
    cost[use] = (there.mean(axis=1) + back.mean(axis=1)) / 2
    return cost


def _best_primitive(pairs: Sequence[_Pair], config: LearnConfig) -> tuple[int, FloatArray]:
    """Index and normal of the primitive that explains the boundaries best, refined where asked."""
    library = primitive_normals()
    cost = np.sum([_library_cost(library, pair, config) for pair in pairs], axis=0)
    primitive = int(np.argmin(cost))
    normal = library[primitive]
    for _ in range(config.refine_rounds):
        normal = _refined(normal, [(p, _correspondences(normal, p, config)) for p in pairs], config)
    return primitive, normal


def _correspondences(normal: FloatArray, pair: _Pair, config: LearnConfig) -> FloatArray:
    """Partner in b of every boundary point of a, shape (m, 2), by shape contexts after carrying a to b."""
    carried = _carried(normal[None], pair)[0]
    if not np.isfinite(carried).all():
        return pair.b
    sc = config.shape_context
    partner, _ = match(carried, shape_contexts(carried, sc), pair.b, shape_contexts(pair.b, sc), sc)
    return np.asarray(pair.b[partner])


def _refined(
    normal: FloatArray, matched: Sequence[tuple[_Pair, FloatArray]], config: LearnConfig
) -> FloatArray:
    """The normal near a given one whose cross-view transforms fit the correspondences best."""
    across = np.linalg.svd(normal[None])[2][1:]

    def turned(turn: FloatArray) -> FloatArray:
        n = normal + turn @ across
        return np.asarray(n / np.linalg.norm(n))

    def residual(turn: FloatArray) -> FloatArray:
        n = turned(turn)[None]
        rows = [
            ((_carried(n, pair)[0] - target) / pair.size).ravel()
            if _shows(n, pair, config)[0]
            else np.full(target.size, config.outlier)
            for pair, target in matched
        ]
        return np.concatenate(rows)

    fit = least_squares(residual, np.zeros(2), loss="soft_l1", f_scale=config.outlier / 3, bounds=(-0.4, 0.4))
    return turned(fit.x)


def _facing_normal(rotation: FloatArray) -> FloatArray:
    """The upright plane that faces a view: all that is known of a part that one view shows."""
    normal = -rotation[2] * np.array([1.0, 1.0, 0.0])
    return np.asarray(normal / np.linalg.norm(normal))


def _centroid_from_one_view(label: int, view: int, seen: _Observations, structure: Structure) -> FloatArray:
    """Centroid of a part that one view shows: on its ray, at the mean depth of the parts shown with it."""
    rotation = seen.rotation[view]
    shown = np.isfinite(seen.centroid[view, :, 0]) & np.isfinite(structure.points[:, 0])
    depth = float((structure.points[shown] @ rotation[2]).mean()) if shown.any() else 0.0
    xy = seen.centroid[view, label - 1] * structure.scale[view] - structure.shift[view]
    return np.asarray(np.append(xy, depth) @ rotation)


def _in_model_units(parts: Sequence[ClassPart]) -> tuple[ClassPart, ...]:
    """Parts scaled so that outlines span length 1 along x, the origin in the middle of the centroids."""
    points = np.concatenate([p.outline for p in parts])
    scale = 1.0 / max(float(np.ptp(points[:, 0])), 1e-9)
    origin = np.mean([p.centroid for p in parts], axis=0)

    def moved(part: ClassPart) -> ClassPart:
        centroid = (part.centroid - origin) * scale
        plane = np.append(part.plane[:3], -part.plane[:3] @ centroid)
        return replace(part, centroid=centroid, plane=plane, outline=(part.outline - origin) * scale)

    return tuple(moved(p) for p in parts)


def _canonical_views(views: Sequence[PartView]) -> tuple[PartView, ...]:
    """For each bin the view whose outline agrees best with the others of the bin (the medoid)."""
    chosen = []
    for view_bin in sorted({v.view_bin for v in views}):
        members = [v for v in views if v.view_bin == view_bin]
        masks = np.stack([_box_mask(v) for v in members]).reshape(len(members), -1).astype(np.float32)
        both = masks @ masks.T
        area = np.diag(both)
        iou = both / (area[:, None] + area[None, :] - both)
        chosen.append(members[int(np.argmax(iou.sum(axis=1)))])
    return tuple(chosen)


def _box_mask(view: PartView) -> NDArray[np.bool_]:
    """The object's mask with its box stretched to 64 x 64."""
    ring = largest_outline(view.labels > 0)
    if ring is None:
        raise ValueError("an empty view")
    low, high = ring.min(axis=0), ring.max(axis=0)
    return fill_polygon((ring - low) / np.maximum(high - low, 1) * 63, 64, 64)
