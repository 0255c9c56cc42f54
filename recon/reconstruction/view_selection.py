"""The view bin of an object by the class model itself, where no detector says it (section 4).

Each bin is tried: the level set starts from its labelled outline, its parts are registered, and a cost says
how well both went. The level set starts on the outline that it is judged by and finds some edge nearby for
any of them; so the cost looks first at the box's shape and at whether all borders of the labelled image, the
inner ones too, meet edges of their direction.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, UInt8Array
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.reconstruction.border_evidence import (
    BorderEvidenceConfig,
    agreement,
    border_channels,
    edge_channels,
)
from recon.reconstruction.canonical_window import canonical_windows, zero_level
from recon.reconstruction.part_registration import PreparedView, canonical_grid, prepare_view, register_parts
from recon.reconstruction.reconstruct import ReconstructConfig, check_box
from recon.reconstruction.segment import edge_indicator, evolve

COST_TERMS = ("aspect", "borders", "registration")
"""Columns of ``ViewChoice.terms``."""


@dataclass(frozen=True)
class ViewSelectionConfig:
    """Weights of the cost, and settings of what it is made of.

    The weights are those of a conditional logit (softmax of minus the cost over the bins) fitted to rendered
    cars, chairs and bicycles of training shapes, and rounded. So costs are in nats.
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
    borders: BorderEvidenceConfig = field(default_factory=BorderEvidenceConfig)
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)


@dataclass(frozen=True, eq=False)
class ViewChoice:
    """The view bin of least cost."""

    view_bin: int
    cost: FloatArray
    """Shape (k,), one a bin, nats; NaN for bins that fail."""
    terms: FloatArray
    """What the cost is made of, unweighted, shape (k, 3), columns ``COST_TERMS``; NaN for bins that fail."""
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
    """The view bin that explains the object in a box best, or why none does.

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
        outlines = _segment_views(rgb, box, views, config.reconstruct)
        registration_weight = config.registration_weight
    else:
        outlines = {b: _to_grid(outline_px, box, view) for b, view in views.items()}
        registration_weight = config.known_registration_weight
    terms = np.full((model.bins.count, len(COST_TERMS)), np.nan)
    for view_bin, outline in outlines.items():
        view = views[view_bin]
        found = (
            outline
            if isinstance(outline, Failure)
            else register_parts(outline, view, config.reconstruct.registration)
        )
        if isinstance(found, Failure):
            failures[view_bin] = found
        else:
            terms[view_bin, 2] = found.cost
    good = [b for b in views if b not in failures]
    if not good:
        first = failures[min(failures)]
        return Failure(first.reason, f"a view bin that fits expected, none does; bin 0: {first.detail}")
    terms[good, 0] = [abs(np.log(_aspect(box) / _grid_aspect(views[b]))) for b in good]
    terms[good, 1] = 1 - _border_agreement(rgb, box, [views[b] for b in good], config)
    cost = terms @ np.array([config.aspect_weight, config.borders_weight, registration_weight])
    return ViewChoice(int(np.nanargmin(cost)), cost, terms, dict(sorted(failures.items())))


def _views_for_box(
    rgb: UInt8Array, box_px: FloatArray, model: ClassModel, config: ReconstructConfig
) -> tuple[dict[int, PreparedView], dict[int, Failure]]:
    """The prepared view of each bin that may be in a box, and why the other bins may not."""
    have = {v.view_bin for v in model.views}
    views: dict[int, PreparedView] = {}
    failures: dict[int, Failure] = {}
    for view_bin in range(model.bins.count):
        if view_bin not in have:
            failures[view_bin] = Failure(
                Reason.REGISTRATION_FAILED, "a labelled view of this bin expected, the class model has none"
            )
            continue
        view = prepare_view(model, view_bin, config.registration)
        wrong = check_box(box_px, view.grid, (rgb.shape[1], rgb.shape[0]), config)
        if wrong is None:
            views[view_bin] = view
        else:
            failures[view_bin] = wrong
    return views, failures


def _segment_views(
    rgb: UInt8Array, box_px: FloatArray, views: dict[int, PreparedView], config: ReconstructConfig
) -> dict[int, FloatArray | Failure]:
    """The outline in the box from the labelled outline of each view; views of one grid evolve together."""
    groups: dict[tuple[int, int], list[int]] = {}
    for view_bin, view in views.items():
        groups.setdefault((view.grid.box_height_px, view.grid.box_width_px), []).append(view_bin)
    found: dict[int, FloatArray | Failure] = {}
    for members in groups.values():
        start = np.stack([views[b].phi for b in members])
        window = canonical_windows(rgb, box_px[None], views[members[0]].grid)
        edge = np.broadcast_to(edge_indicator(window, config.segment), start.shape)
        phi = evolve(start, edge, config.segment)
        for b, after in zip(members, phi, strict=True):
            found[b] = zero_level(after, views[b].phi, config.min_outline_iou)
    return found


def _border_agreement(
    rgb: UInt8Array, box_px: FloatArray, views: list[PreparedView], config: ViewSelectionConfig
) -> FloatArray:
    """Correlation of the box's edges with the labelled borders of each view stretched to it, shape (n,)."""
    # no margin beyond the least: edges outside of the box belong to other things
    registration = config.reconstruct.registration
    grid = canonical_grid(_aspect(box_px), replace(registration, margin=0.0))
    window = canonical_windows(rgb, box_px[None], grid)[0]
    scale, shift = grid.image_from_grid(box_px[None])
    drawn = []
    for view in views:
        own_scale, own_shift = view.grid.image_from_grid(box_px[None])
        at = view.warp @ view.outline
        polygons = (view.outline, *(at[rows] for _, rows in view.rings))
        moved = tuple((p * own_scale + own_shift - shift) / scale for p in polygons)
        drawn.append(border_channels(moved, grid.height_px, grid.width_px, config.borders))
    return agreement(edge_channels(window, config.borders), np.stack(drawn))


def _to_grid(outline_px: FloatArray, box_px: FloatArray, view: PreparedView) -> FloatArray:
    scale, shift = view.grid.image_from_grid(box_px[None])
    return np.asarray((outline_px - shift) / scale)


def _aspect(box_px: FloatArray) -> float:
    return float((box_px[2] - box_px[0]) / (box_px[3] - box_px[1]))


def _grid_aspect(view: PreparedView) -> float:
    return view.grid.box_width_px / view.grid.box_height_px
