"""Part registration (section 4.2): the parts of an instance from its outline and the part-labelled image.

Everything that depends only on the model and the view bin is prepared once (``PreparedView``). Its canonical
grid is a small picture in which the box of any candidate has the same place; canonical coordinates are
those of its pixel centres.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray, UInt8Array
from recon.class_model import ClassModel
from recon.errors import Failure, Reason, RescoreError
from recon.outlines import fill_polygon, largest_outline, mask_rings, resample
from recon.reconstruction.segment import signed_distance
from recon.shapes.shape_matching import ShapeContextConfig, match, shape_contexts, thin_plate_operator


@dataclass(frozen=True)
class RegistrationConfig:
    """Settings of the canonical grid and of part registration."""

    box_area_px: float = 3072.0
    """Area of the box on the canonical grid: 32 x 96 for a box three times as wide as high."""
    margin: float = 0.25
    """Margin around the box on the canonical grid, in box heights."""
    outline_points: int = 80
    """Points on the labelled outline."""
    instance_points: int = 160
    """Points on the outline of an instance. With no more than on the labelled one, one-to-one matching has to
    pair points far apart wherever one outline has a longer stretch than the other."""
    regularisation: float = 0.02
    """Regularisation of the thin-plate spline (see ``thin_plate_operator``)."""
    max_cost: float = 0.35
    """A larger mean chi-squared cost of the match is a failure."""
    max_jump: float = 0.1
    """A partner farther than this from where the neighbours on the outline lead, in roots of the box area, is
    a false match."""
    shape_context: ShapeContextConfig = field(default_factory=ShapeContextConfig)


@dataclass(frozen=True)
class CanonicalGrid:
    """A small picture with a margin around a box."""

    height_px: int
    width_px: int
    box_height_px: int
    box_width_px: int
    margin_px: int

    def image_from_grid(self, xyxy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scale (n, 2) and shift (n, 2): image pixel centres = scale * grid pixel centres + shift."""
        size = xyxy_px[:, 2:] - xyxy_px[:, :2]
        scale = size / np.array([self.box_width_px, self.box_height_px])
        # edges map linearly: image_edge = x0 + scale * (grid_edge - margin); centre = edge - 0.5
        shift = xyxy_px[:, :2] + scale * (0.5 - self.margin_px) - 0.5
        return scale, shift


@dataclass(frozen=True, eq=False)
class PreparedView:
    """The model side of segmentation and registration for one view bin."""

    model: ClassModel
    view_bin: int
    grid: CanonicalGrid
    phi: Float32Array
    """Shape (h, w): signed distance of the labelled outline on the canonical grid, negative inside."""
    outline: FloatArray
    """Shape (m, 2): points on the labelled outline, canonical coordinates."""
    context: Float32Array
    """Shape contexts of the outline, shape (m, k)."""
    rings: tuple[tuple[int, slice], ...]
    """Label and rows of ``warp`` of each region of the labelled image; larger regions first."""
    region_points: FloatArray
    """Shape (p, 2): points on the outlines of all regions, pixels of the labelled image."""
    warp: FloatArray
    """Thin-plate operator (p, m): from targets of the outline points to the warped points of all regions."""


@lru_cache(maxsize=48)
def prepare_view(model: ClassModel, view_bin: int, config: RegistrationConfig) -> PreparedView:
    """The model's side of registration to a view bin; remembered, since every candidate shares it."""
    labels = model.view(view_bin).labels
    rows, cols = np.nonzero(labels)
    corner = np.array([cols.min(), rows.min()])
    labels = labels[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    grid = canonical_grid(labels.shape[1] / labels.shape[0], config)
    scale = np.array([grid.box_width_px / labels.shape[1], grid.box_height_px / labels.shape[0]])

    def canonical(points: FloatArray) -> FloatArray:
        return np.asarray((points + 0.5) * scale + grid.margin_px - 0.5)

    ring = largest_outline(labels > 0)
    if ring is None or len(ring) < 8:
        raise RescoreError(
            f"class model {model.class_name!r}, bin {view_bin}: expected an outline of at least 8 pixels, "
            "got less; label larger pictures"
        )
    outline_polygon = canonical(_grown_half_pixel(ring))
    mask = fill_polygon(outline_polygon * 4 + 1.5, grid.height_px * 4, grid.width_px * 4)
    phi = signed_distance(mask).reshape(grid.height_px, 4, grid.width_px, 4).mean(axis=(1, 3)) / 4
    outline = resample(outline_polygon, config.outline_points)
    rings, points = _region_rings(labels)
    warp = thin_plate_operator(outline, canonical(points), config.regularisation)
    context = shape_contexts(outline, config.shape_context)
    return PreparedView(
        model, view_bin, grid, phi.astype(np.float32), outline, context, rings, points + corner, warp
    )


def canonical_grid(aspect: float, config: RegistrationConfig) -> CanonicalGrid:
    """The grid of boxes ``aspect`` times as wide as high."""
    width = max(16, round(float(np.sqrt(config.box_area_px * aspect))))
    height = max(16, round(float(np.sqrt(config.box_area_px / aspect))))
    margin = max(4, round(config.margin * height))
    return CanonicalGrid(height + 2 * margin, width + 2 * margin, height, width, margin)


def _grown_half_pixel(ring: FloatArray) -> FloatArray:
    """A ring of border pixel centres moved to the pixels' outer edges: scaled about its middle."""
    low, high = ring.min(axis=0), ring.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.5)
    return np.asarray(middle + (ring - middle) * (half + 0.5) / half)


def _region_rings(labels: UInt8Array) -> tuple[tuple[tuple[int, slice], ...], FloatArray]:
    """Outer rings of all regions with their labels, larger first, and their points (p, 2)."""
    found: list[tuple[float, int, FloatArray]] = []
    for label in (int(x) for x in np.unique(labels) if x):
        for ring in mask_rings(labels == label):
            area = float(np.prod(np.ptp(ring, axis=0) + 1))
            if len(ring) >= 3 and area >= 12:
                dense = resample(ring.astype(float), min(64, max(12, len(ring))))
                found.append((area, label, dense))
    found.sort(key=lambda r: (-r[0], r[1]))
    rings: list[tuple[int, slice]] = []
    start = 0
    for _, label, points in found:
        rings.append((label, slice(start, start + len(points))))
        start += len(points)
    return tuple(rings), np.concatenate([r[2] for r in found])


@dataclass(frozen=True, eq=False)
class RegisteredParts:
    """The labelled image deformed to one outline, in canonical coordinates."""

    points: FloatArray
    """Outlines of all regions, shape (p, 2); ``PreparedView.rings`` says whose each is."""
    cost: float
    """Mean chi-squared cost of the matched points, in [0, 1]."""


def register_parts(
    outline: FloatArray, view: PreparedView, config: RegistrationConfig
) -> RegisteredParts | Failure:
    """The parts of an instance from its closed outline (m, 2) in canonical coordinates."""
    points = resample(outline, config.instance_points)
    context = shape_contexts(points, config.shape_context)
    partner, cost = match(view.outline, view.context, points, context, config.shape_context)
    if not cost <= config.max_cost:
        return Failure(
            Reason.REGISTRATION_FAILED,
            f"mean chi-squared cost of the match at most {config.max_cost:g} expected, got {cost:.2f}",
        )
    limit = config.max_jump * float(np.sqrt(view.grid.box_width_px * view.grid.box_height_px))
    warped = view.warp @ _without_jumps(view.outline, points[partner], limit)
    return RegisteredParts(warped, cost)


def _without_jumps(outline: FloatArray, targets: FloatArray, limit_px: float) -> FloatArray:
    """Targets (m, 2) of a closed outline (m, 2); those that jump are led by their neighbours instead.

    A displacement jumps where it differs by more than the limit from the median over eleven points around it.
    The spline would follow a single false match and fold the parts over one another.
    """
    moved = targets - outline
    usual = np.sort(moved.T.take(_around(len(moved)), axis=1), axis=2)[..., 5].T
    off = moved - usual
    good = (off * off).sum(axis=1) <= limit_px**2
    if good.all() or not good.any():
        return targets
    index = np.arange(len(moved))
    known = index[good]
    led = [np.interp(index, known, moved[good, k], period=len(moved)) for k in range(2)]
    return np.asarray(outline + np.stack(led, axis=1))


@lru_cache(maxsize=4)
def _around(count: int) -> IntArray:
    """The eleven points around each of a closed outline, itself in their middle, shape (count, 11)."""
    return (np.arange(count)[:, None] + np.arange(-5, 6)) % count
