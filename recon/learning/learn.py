"""Learns a class model from part-labelled views (section 3.2) with poses known only up to the view bin."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.class_model import ClassModel, ClassPart
from recon.errors import RescoreError
from recon.learning.class_phase import BoundaryPair, best_primitive, fitted_normal, heaviest, primitive_costs
from recon.learning.generic_phase import primitive_library
from recon.learning.observations import Observations
from recon.learning.primitives import PrimitiveLibrary, lift
from recon.learning.structure import Structure, solve_structure
from recon.outlines import fill_polygon, largest_outline
from recon.part_views import PartView, PartViews
from recon.shapes.shape_matching import ShapeContextConfig
from recon.view_bins import ViewBins


@dataclass(frozen=True)
class LearnConfig:
    """Settings of learning."""

    bins: ViewBins = field(default_factory=ViewBins)
    boundary_points: int = 48
    """Points on each part boundary."""
    max_pairs: int = 60
    """Pairs of views at most, for each part: more of them add time and little else."""
    min_part_share: float = 0.004
    """Regions smaller than this share of the labelled pixels do not count as seeing the part."""
    max_bin_step: int = 3
    """Boundaries are compared between views at most this many bins apart."""
    candidates: int = 4
    """Primitives that are looked at closely: their transforms are compared with those that shape contexts
    find, and each is turned to fit."""
    refine_rounds: int = 3
    """Rounds that turn the plane of the primitive to fit the boundaries; 0 keeps the primitive."""
    outlier: float = 0.15
    """Residuals beyond this share of the part's size count no more than this."""
    shape_context: ShapeContextConfig = field(default_factory=lambda: ShapeContextConfig(position_weight=4.0))


@dataclass(frozen=True, eq=False)
class PartCosts:
    """How well each primitive explains each part that two views show."""

    labels: tuple[int, ...]
    cost: FloatArray
    """Shape (parts, primitives): mean squared distances in part sizes (see ``primitive_costs``)."""


def learn_class_model(
    views: PartViews | Sequence[PartView],
    class_name: str,
    part_names: Sequence[str],
    config: LearnConfig | None = None,
    library: PrimitiveLibrary | None = None,
) -> ClassModel:
    """The class model of part-labelled views, of which at least two must show one instance.

    Args:
        views: the labelled views; ``PartViews`` bring their own view bins.
        class_name: name of the class.
        part_names: name of each label, from 1 on.
        config: settings; None for the defaults.
        library: what the generic phase learned for these view bins; None for that of the package.

    Raises:
        RescoreError: too few views, views that fix no depth, bins that contradict each other, or a library
            for other view bins.
    """
    phase = _ClassPhase(views, part_names, config, library)
    parts = tuple(
        part for label in range(1, len(part_names) + 1) if (part := phase.learn_part(label)) is not None
    )
    return ClassModel(
        class_name,
        tuple(part_names),
        phase.config.bins,
        _in_model_units(parts),
        _canonical_views(phase.views),
    )


def part_costs(
    views: PartViews, config: LearnConfig | None = None, library: PrimitiveLibrary | None = None
) -> PartCosts:
    """The cost of every primitive for every part: what the choice of a small set of primitives goes by.

    Raises:
        RescoreError: as ``learn_class_model``.
    """
    phase = _ClassPhase(views, views.part_names, config, library)
    pairs = {label: phase.pairs(label) for label in range(1, len(views.part_names) + 1)}
    labels = tuple(label for label, found in pairs.items() if found)
    return PartCosts(labels, np.stack([phase.costs(pairs[label]) for label in labels]))


class _ClassPhase:
    """The views of one class with their structure, ready to learn its parts."""

    def __init__(
        self,
        views: PartViews | Sequence[PartView],
        part_names: Sequence[str],
        config: LearnConfig | None,
        library: PrimitiveLibrary | None,
    ) -> None:
        config = config or LearnConfig()
        if isinstance(views, PartViews):
            config = replace(config, bins=views.bins)
            views = views.views
        self.config = config
        self.views = PartViews(tuple(part_names), config.bins, tuple(views)).views
        _check_instances(self.views)
        self.seen = Observations(
            self.views,
            len(part_names),
            config.bins,
            boundary_points=config.boundary_points,
            min_part_share=config.min_part_share,
        )
        first = solve_structure(self.seen.centroid, self.seen.rotation)
        self.share = self.seen.shown_share(first.scale)
        # the root: parts that turn away count less, but without them nothing says how wide the object is
        self.structure: Structure = solve_structure(
            self.seen.centroid, self.seen.rotation, np.sqrt(self.share)
        )
        self.library = primitive_library(config.bins) if library is None else library
        if self.library.bins != config.bins:
            raise RescoreError(
                f"library of primitives: expected one for {config.bins}, got {self.library.bins}; "
                "learn the primitives for these view bins"
            )

    def pairs(self, label: int) -> list[BoundaryPair]:
        """The boundary of a part in the pairs of near views of one instance that show most of the part."""
        found = [self._pair(label, a, b) for a, b in self.seen.pairs_of(label, self.config.max_bin_step)]
        return heaviest(found, self.config.max_pairs)

    def costs(self, pairs: Sequence[BoundaryPair]) -> FloatArray:
        """Cost of every primitive, shape (k,)."""
        return primitive_costs(pairs, self.library, self.config.outlier)

    def learn_part(self, label: int) -> ClassPart | None:
        """Plane and outline of a part in the frame of the structure; None where no view shows it."""
        shown = [i for i in self.seen.views_of(label) if np.isfinite(self.structure.scale[i])]
        if not shown:
            return None
        rotation = self.seen.rotation
        pairs = self.pairs(label)
        centroid = self.structure.points[label - 1]
        if pairs:
            primitive, normal = self._plane(pairs)
            # a plane has no front; the part does: it is seen from there
            if sum(self.share[i, label - 1] * (normal @ rotation[i][2]) for i in shown) > 0:
                normal = -normal
        else:
            primitive, normal = -1, _facing_normal(rotation[shown[0]])
            if not np.isfinite(centroid).all():
                centroid = _centroid_from_one_view(label, shown[0], self.seen, self.structure)
        # the bounding polygon comes from the view that shows most of the part
        best = max(shown, key=lambda i: float(self.share[i, label - 1] * abs(normal @ rotation[i][2])))
        outline = centroid + self._offsets(label, best) @ lift(normal[None], rotation[best])[0].T
        plane = np.append(normal, -normal @ centroid)
        return ClassPart(label, centroid, plane, outline, primitive, len(shown))

    def _plane(self, pairs: Sequence[BoundaryPair]) -> tuple[int, FloatArray]:
        """Index of the primitive that explains the pairs best, and its normal turned to fit them."""
        config = self.config
        primitive = best_primitive(
            pairs, self.library, config.outlier, config.candidates, config.shape_context
        )
        if not config.refine_rounds:
            return primitive, self.library.normals[primitive]
        likely = np.argsort(self.costs(pairs), kind="stable")[: config.candidates]
        starts = self.library.normals[np.unique([primitive, *likely])]
        return primitive, fitted_normal(starts, pairs, config.outlier, config.refine_rounds)

    def _offsets(self, label: int, view: int) -> FloatArray:
        """Boundary of a part in a view as offsets (m, 2) from its centroid, in object units."""
        offset = self.seen.boundary[view, label] - self.seen.centroid[view, label - 1]
        return np.asarray(offset * self.structure.scale[view])

    def _pair(self, label: int, a: int, b: int) -> BoundaryPair:
        pa, pb = self._offsets(label, a), self._offsets(label, b)
        return BoundaryPair(
            self.views[a].view_bin,
            self.views[b].view_bin,
            self.seen.rotation[a],
            self.seen.rotation[b],
            pa - pa.mean(axis=0),
            pb - pb.mean(axis=0),
            float(min(self.share[a, label - 1], self.share[b, label - 1])),
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


def _facing_normal(rotation: FloatArray) -> FloatArray:
    """The upright plane that faces a view: all that is known of a part that one view shows."""
    normal = -rotation[2] * np.array([1.0, 1.0, 0.0])
    return np.asarray(normal / np.linalg.norm(normal))


def _centroid_from_one_view(label: int, view: int, seen: Observations, structure: Structure) -> FloatArray:
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
    """The medoid view of each bin: its outline agrees best with the outlines of the bin's other views."""
    chosen = []
    for view_bin in sorted({v.view_bin for v in views}):
        members = [v for v in views if v.view_bin == view_bin]
        masks = np.stack([_box_mask(v) for v in members]).reshape(len(members), -1).astype(np.float32)
        both = masks @ masks.T
        area = np.diag(both)
        iou = both / (area[:, None] + area[None, :] - both)
        chosen.append(members[int(np.argmax(iou.sum(axis=1)))])
    return tuple(chosen)


def _box_mask(view: PartView) -> BoolArray:
    """The object's mask with its box stretched to 64 x 64."""
    ring = largest_outline(view.labels > 0)
    if ring is None:
        raise ValueError("an empty view")
    low, high = ring.min(axis=0), ring.max(axis=0)
    return fill_polygon((ring - low) / np.maximum(high - low, 1) * 63, 64, 64)
