"""The view bin of an object by the class model itself, where no detector says it (section 4).

Each bin is tried: the level set starts from its labelled outline, its parts are registered, and a cost says
how well both went. The level set starts on the outline that it is judged by and finds some edge nearby for
any of them; so the cost looks first at the box's shape, at whether all borders of the labelled image, the
inner ones too, meet edges of their direction, and at how the class looks from each side where the class model
knows it. Since these say most, boxes of a whole frame are registered to their two likeliest bins alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.reconstruction.border_evidence import (
    BorderEvidenceConfig,
    agreement,
    border_channels,
    edge_channels,
)
from recon.reconstruction.canonical_window import canonical_windows
from recon.reconstruction.part_registration import (
    CanonicalGrid,
    PreparedView,
    canonical_grid,
    prepare_view,
)
from recon.reconstruction.reconstruct import (
    ReconstructConfig,
    RegisteredOutline,
    check_aspect,
    check_extent,
    register,
    segment,
)

COST_TERMS = ("aspect", "borders", "registration", "looks")
"""Columns of ``ViewChoice.terms``."""
_ASPECT_STEP = 0.1
"""Steps of the logarithm of the aspect of the grids on which borders are drawn and remembered."""

_THINNED = 2
"""Every second pixel tells what borders and edges do, since they are blurred by as much."""


@dataclass(frozen=True)
class ViewSelectionConfig:
    """Weights of the cost, and settings of what it is made of.

    The weights are those of a conditional logit (softmax of minus the cost over the bins) fitted to rendered
    cars, chairs and bicycles of training shapes, and rounded; that of looks, to cars of rendered streets. So
    costs are in nats.
    """

    aspect_weight: float = 5.5
    """Weight of the absolute logarithm of the box's width to height over that of the labelled outline."""
    borders_weight: float = 22.0
    """Weight of 1 minus the correlation of labelled borders and edges."""
    registration_weight: float = 2.5
    """Weight of the mean chi-squared cost of matching the labelled outline to the outline of the level set.
    It is small because the level set starts on the labelled outline, and stays like it in wrong bins too."""
    known_registration_weight: float = 22.0
    """Weight of the mean chi-squared cost of matching the labelled outline to an outline that was known
    before."""
    looks_weight: float = 2.0
    """Weight of minus the log probability of the bin by how the box looks (``ClassModel.looks``)."""
    registered: int = 2
    """Bins of least cost without registration that ``likely_views`` registers."""
    borders: BorderEvidenceConfig = field(default_factory=BorderEvidenceConfig)
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)

    def weights(self, outline_known: bool) -> FloatArray:
        """The weight of each of ``COST_TERMS``."""
        registration = self.known_registration_weight if outline_known else self.registration_weight
        return np.array([self.aspect_weight, self.borders_weight, registration, self.looks_weight])


@dataclass(frozen=True, eq=False)
class ViewChoice:
    """The view bin of least cost."""

    view_bin: int
    cost: FloatArray
    """Shape (k,), one a bin, nats; NaN for bins that fail."""
    terms: FloatArray
    """What the cost is made of, unweighted, shape (k, 4), columns ``COST_TERMS``; NaN for bins that fail."""
    failures: dict[int, Failure]
    """Why each bin with no cost has none."""

    def __post_init__(self) -> None:
        known = np.isfinite(self.cost)
        if self.terms.shape != (len(self.cost), len(COST_TERMS)) or not known[self.view_bin]:
            raise ValueError(f"view choice: bin {self.view_bin}, {self.cost}, terms {self.terms.shape}")
        if sorted(self.failures) != np.nonzero(~known)[0].tolist():
            raise ValueError(f"view choice: costs {self.cost}, failures of bins {sorted(self.failures)}")

    @property
    def order(self) -> NDArray[np.intp]:
        """The bins that have a cost, best first."""
        return np.argsort(self.cost, kind="stable")[: int(np.isfinite(self.cost).sum())]

    @property
    def margin(self) -> float:
        """Cost of the second best bin less the cost of the best, in nats; infinite where all other bins
        fail."""
        order = self.order
        return float(self.cost[order[1]] - self.cost[order[0]]) if len(order) > 1 else float("inf")

    @property
    def probability(self) -> FloatArray:
        """Softmax of minus the cost, shape (k,), 0 for bins that fail."""
        share = np.exp(self.cost[self.view_bin] - np.where(np.isfinite(self.cost), self.cost, np.inf))
        return np.asarray(share / share.sum())


def best_view_bin(
    rgb: UInt8Array,
    xyxy_px: FloatArray,
    model: ClassModel,
    config: ViewSelectionConfig | None = None,
    outline_px: FloatArray | None = None,
) -> ViewChoice | Failure:
    """The view bin that explains the object in a box best, or why none does; all bins are registered.

    Args:
        rgb: the picture, shape (h, w, 3).
        xyxy_px: the box, shape (4,), pixel edges.
        model: the class model; bins without a labelled view fail.
        config: settings; None for the defaults.
        outline_px: the object's outline (m, 2), pixel centres, where it is known; it replaces the level set.
    """
    config = config or ViewSelectionConfig()
    box = np.asarray(xyxy_px, float).reshape(4)
    views, failures = _views_for_box(rgb, box, model, config.reconstruct)
    if outline_px is None:
        outlines = _outlines(rgb, [(box, view) for view in views.values()], config)
    else:
        outlines = tuple(_to_grid(outline_px, box, view) for view in views.values())
    terms = _first_terms(rgb, box, views, _looks_cost(rgb, box[None], model)[0], config)
    for (view_bin, view), outline in zip(views.items(), outlines, strict=True):
        found = register(outline, view, config.reconstruct.registration)
        if isinstance(found, Failure):
            failures[view_bin] = found
            terms[view_bin] = np.nan
        else:
            terms[view_bin, 2] = found.parts.cost
    if np.isnan(terms[:, 2]).all():
        return _no_bin(failures)
    cost = terms @ config.weights(outline_px is not None)
    return ViewChoice(int(np.nanargmin(cost)), cost, terms, dict(sorted(failures.items())))


@dataclass(frozen=True, eq=False)
class LikelyView:
    """The view bin that explains the object in a box best."""

    view_bin: int
    registered: RegisteredOutline | None
    """What ``reconstruct`` would find on its way; None where it goes by colours too."""


def likely_views(
    rgb: UInt8Array, xyxy_px: FloatArray, model: ClassModel, config: ViewSelectionConfig | None = None
) -> tuple[LikelyView | Failure, ...]:
    """The view bin that explains the object in each box best, or why none does, from coarse to fine.

    The cost is that of ``best_view_bin``, but only some bins of each box, those that cost least without it,
    are registered; where they all fail, the next ones are.

    Args:
        rgb: the picture, shape (h, w, 3).
        xyxy_px: the boxes, shape (n, 4), pixel edges.
        model: the class model; bins without a labelled view fail.
        config: settings; None for the defaults.
    """
    config = config or ViewSelectionConfig()
    boxes = np.asarray(xyxy_px, float).reshape(-1, 4)
    looks, weights = _looks_cost(rgb, boxes, model), config.weights(outline_known=False)
    tried = [_views_for_box(rgb, box, model, config.reconstruct) for box in boxes]
    first = [
        np.delete(_first_terms(rgb, box, views, look, config), 2, axis=1) @ np.delete(weights, 2)
        for box, (views, _), look in zip(boxes, tried, looks, strict=True)
    ]
    left = {i: sorted(views, key=first[i].__getitem__) for i, (views, _) in enumerate(tried)}
    found: dict[int, LikelyView | Failure] = {}
    same = config.reconstruct.segment.region_weight == 0
    while left:
        pairs = [(i, b) for i, order in left.items() for b in order[: config.registered]]
        costs = dict[int, dict[int, float]]()
        registered = dict[tuple[int, int], RegisteredOutline]()
        shown = [(boxes[i], tried[i][0][b]) for i, b in pairs]
        for (i, b), (_, view), outline in zip(pairs, shown, _outlines(rgb, shown, config), strict=True):
            one = register(outline, view, config.reconstruct.registration)
            if isinstance(one, Failure):
                tried[i][1][b] = one
            else:
                registered[i, b] = one
                costs.setdefault(i, {})[b] = float(first[i][b] + weights[2] * one.parts.cost)
        best = {i: min(of_box, key=of_box.__getitem__) for i, of_box in costs.items()}
        found |= {i: LikelyView(b, registered[i, b] if same else None) for i, b in best.items()}
        left = {i: order[config.registered :] for i, order in left.items() if i not in costs}
        found |= {i: _no_bin(tried[i][1]) for i, order in left.items() if not order}
        left = {i: order for i, order in left.items() if order}
    return tuple(found[i] for i in range(len(boxes)))


def _views_for_box(
    rgb: UInt8Array, box_px: FloatArray, model: ClassModel, config: ReconstructConfig
) -> tuple[dict[int, PreparedView], dict[int, Failure]]:
    """The prepared view of each bin that may be in a box, and why the other bins may not."""
    have = {v.view_bin for v in model.views}
    outside = check_extent(box_px, (rgb.shape[1], rgb.shape[0]), config.min_inside)
    views: dict[int, PreparedView] = {}
    failures: dict[int, Failure] = {}
    for view_bin in range(model.bins.count):
        if view_bin not in have:
            failures[view_bin] = Failure(
                Reason.REGISTRATION_FAILED, "a labelled view of this bin expected, the class model has none"
            )
            continue
        view = prepare_view(model, view_bin, config.registration)
        wrong = outside or check_aspect(box_px, view.grid, config)
        if wrong is None:
            views[view_bin] = view
        else:
            failures[view_bin] = wrong
    return views, failures


def _no_bin(failures: Mapping[int, Failure]) -> Failure:
    view_bin = min(failures)
    first = failures[view_bin]
    return Failure(first.reason, f"a view bin that fits expected, none does; bin {view_bin}: {first.detail}")


def _looks_cost(rgb: UInt8Array, xyxy_px: FloatArray, model: ClassModel) -> FloatArray:
    """Minus the log probability of each bin by how each box looks, shape (n, k); 0 where nothing tells."""
    if model.looks is None:
        return np.zeros((len(xyxy_px), model.bins.count))
    return -model.looks.bins_log_density(rgb, xyxy_px, model.bins)


def _first_terms(
    rgb: UInt8Array,
    box_px: FloatArray,
    views: Mapping[int, PreparedView],
    looks: FloatArray,
    config: ViewSelectionConfig,
) -> FloatArray:
    """The terms (k, 4) of the cost of each bin, that of registration and all of bins without a view NaN."""
    terms = np.full((len(looks), len(COST_TERMS)), np.nan)
    if views:
        bins = list(views)
        terms[bins, 0] = [abs(np.log(_aspect(box_px) / _grid_aspect(v))) for v in views.values()]
        terms[bins, 1] = 1 - _border_agreement(rgb, box_px, tuple(views.values()), config)
        terms[bins, 3] = looks[bins]
    return terms


def _outlines(
    rgb: UInt8Array, pairs: Sequence[tuple[FloatArray, PreparedView]], config: ViewSelectionConfig
) -> tuple[FloatArray | Failure, ...]:
    """The outline of each box (4,) by edges alone, from the labelled outline of a view on."""
    by_edges = replace(config.reconstruct, segment=replace(config.reconstruct.segment, region_weight=0.0))
    boxes = np.array([box for box, _ in pairs]).reshape(-1, 4)
    return segment(rgb, boxes, [view for _, view in pairs], by_edges)


def _border_agreement(
    rgb: UInt8Array, box_px: FloatArray, views: Sequence[PreparedView], config: ViewSelectionConfig
) -> FloatArray:
    """Correlation of the box's edges with the labelled borders of each view stretched to it, shape (n,)."""
    # no margin beyond the least: edges outside of the box belong to other things
    registration = replace(config.reconstruct.registration, margin=0.0)
    aspect = float(np.exp(np.rint(np.log(_aspect(box_px)) / _ASPECT_STEP) * _ASPECT_STEP))
    grid = canonical_grid(aspect, registration)
    edges = edge_channels(canonical_windows(rgb, box_px[None], grid)[0], config.borders)
    return agreement(
        edges[::_THINNED, ::_THINNED],
        np.stack([_drawn_borders(view, grid, config.borders) for view in views]),
    )


@lru_cache(maxsize=192)
def _drawn_borders(view: PreparedView, grid: CanonicalGrid, config: BorderEvidenceConfig) -> Float32Array:
    """The labelled borders of a view on a grid of another aspect, thinned; remembered for all pictures."""
    polygons = (view.outline, *((view.warp @ view.outline)[rows] for _, rows in view.rings))
    unit = np.array([[0.0, 0.0, 1.0, 1.0]])
    (own_scale, own_shift), (scale, shift) = (g.image_from_grid(unit) for g in (view.grid, grid))
    moved = tuple((p * own_scale + own_shift - shift) / scale for p in polygons)
    drawn = border_channels(moved, grid.height_px, grid.width_px, config)
    return drawn[::_THINNED, ::_THINNED].copy()


def _to_grid(outline_px: FloatArray, box_px: FloatArray, view: PreparedView) -> FloatArray:
    scale, shift = view.grid.image_from_grid(box_px[None])
    return np.asarray((outline_px - shift) / scale)


def _aspect(box_px: FloatArray) -> float:
    return float((box_px[2] - box_px[0]) / (box_px[3] - box_px[1]))


def _grid_aspect(view: PreparedView) -> float:
    return view.grid.box_width_px / view.grid.box_height_px
