"""A linear shape space of a class, learned from part-labelled views of several instances.

The planes of the class model are flat; a silhouette is bounded by what is round. So each training instance
also gets the visual hull of its labelled views, as a function of space: the greatest, over the views, of the
signed distance to the silhouette. The functions of all instances on one grid, stretched to unit size, with
the outlines of their parts and the logarithms of their sizes give a mean and principal components.

Object frame as everywhere (x forward, y left, z up) with the origin on the ground below the middle.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.class_model import ClassModel
from recon.errors import RescoreError
from recon.learning.learn import LearnConfig, learn_class_model
from recon.learning.primitives import PrimitiveLibrary
from recon.localization.silhouette_scales import ScaledViews, scale_views
from recon.outlines import canonical_ring
from recon.part_views import PartView, PartViews
from recon.pixels import sample_bilinear
from recon.reconstruction.segment import signed_distance
from recon.shape_space import ShapeSpace
from recon.view_bins import ViewBins

_MOSTLY_SHOWN = 0.75
"""Parts that so many instances show, as a share, are parts of the space."""
_LEVEL_SINE = 1e-6
_ONE_SIDED = 0.1
"""A part is of one side of the object where the views of that side show it by so much more, as a share of
all that is seen of it."""


@dataclass(frozen=True)
class ShapeSpaceConfig:
    """Settings of learning a shape space."""

    cells: tuple[int, int, int] = (112, 40, 48)
    """Samples along x, the left half of y, and z."""
    reach: tuple[float, float, float] = (0.56, 0.68, 1.08)
    """The grid ends at these multiples of length (both ways), width (mirrors stand out) and height."""
    modes: int = 20
    """Principal components kept."""
    outline_points: int = 40
    """Points on each part outline."""
    surface_m: float = 0.25
    """Samples within about this distance of the surface count in the components."""
    size_weight: float = 40.0
    """Weight of the logarithm of a size beside a distance in metres at one sample."""
    keep_instances: bool = False
    """Whether the space keeps the coefficients of its instances, for fits to start from."""


@dataclass(frozen=True, eq=False)
class TrainingInstance:
    """Part-labelled views of one instance, and how large it is."""

    views: tuple[PartView, ...]
    bins: tuple[ViewBins, ...]
    """The ring of view bins of each view."""
    size_m: tuple[float, float, float]
    """Length, width without mirrors, height, as in a car's papers."""


@dataclass(frozen=True, eq=False)
class InstanceShape:
    """What a shape space keeps of one training instance."""

    hull: Float32Array
    """Hull function in metres, shape (nx, ny, nz)."""
    outlines: FloatArray
    """Part outlines in units of length, width and height, shape (p, m, 3); NaN for parts not shown."""
    log_size: FloatArray
    """Logarithms of length, width and height in metres, shape (3,)."""


def instance_shape(
    instance: TrainingInstance,
    part_names: Sequence[str],
    config: ShapeSpaceConfig,
    library: PrimitiveLibrary | None = None,
) -> InstanceShape:
    """The shape of one instance.

    Args:
        instance: its views and size.
        part_names: name of each label, from 1 on.
        config: settings.
        library: the primitives of the bins of its first view; None for those of the package.

    Raises:
        RescoreError: its views cannot be put together.
    """
    placed = object_views(instance, len(part_names))
    return InstanceShape(
        visual_hull(placed, np.array(instance.size_m), config),
        _part_outlines(placed, instance, part_names, config, library),
        np.log(instance.size_m),
    )


def object_views(instance: TrainingInstance, part_count: int) -> ScaledViews:
    """The views of an instance in metres, the origin on the ground below the middle."""
    rotation = np.stack(
        [b.view_from_object(v.view_bin) for v, b in zip(instance.views, instance.bins, strict=True)]
    )
    scaled = scale_views(instance.views, rotation)
    front, side = scaled.extent(np.array([1.0, 0, 0])), scaled.extent(np.array([0, 1.0, 0]))
    factor = instance.size_m[0] / float(front[1] - front[0])
    low = _lowest_z(scaled) if _level(rotation).any() else _ground_z(scaled, part_count)
    return scaled.moved(factor, np.array([front.mean(), side.mean(), low]))


def _level(rotation: FloatArray) -> BoolArray:
    """Whether views (v,) with rotations (v, 3, 3) look along the ground."""
    return np.asarray(np.abs(rotation[:, 2, 2]) < _LEVEL_SINE)


def _lowest_z(scaled: ScaledViews) -> float:
    """Lowest z that level views show."""
    return float(scaled.extent(np.array([0.0, 0.0, 1.0]))[0])


def _ground_z(scaled: ScaledViews, part_count: int) -> float:
    """Height of the ground: the mean over parts that stand on it as upright discs, as wheels do."""
    found = [_disc_foot(scaled, label) for label in range(1, part_count + 1)]
    size = float(np.ptp(scaled.extent(np.array([1.0, 0, 0]))))
    heights = [z for z, error in found if error < 0.01 * size]
    if not heights:
        raise RescoreError(
            "shape space: expected wheels (upright discs that three views show), got none; label the wheels"
        )
    return float(np.mean(heights))


def _disc_foot(scaled: ScaledViews, label: int) -> tuple[float, float]:
    """Lowest z of a part as an upright disc across y, and the greatest error of its lowest image points.

    A circle (x0 + r cos t, y0, z0 + r sin t) reaches lowest in a view with down vector d where (cos t, sin t)
    is along (d_x, d_z), so that its lowest image point is linear in x0, y0 and z0. The radius is half the
    width in the view that the disc faces most.
    """
    # seen from far aside the body hides the foot of a wheel, and that of a free one from the other side too
    side = scaled.rotation[:, 2, 1]
    shown = np.array([(view.labels == label).sum() for view in scaled.views])
    one_side = np.abs((side * shown).sum()) > _ONE_SIDED * (np.abs(side) * shown).sum()
    own = np.sign(side) == np.sign((side * shown).sum()) if one_side else np.ones(len(side), bool)
    facing = np.nonzero(own & (np.abs(side) > 0.6) & (shown >= 40))[0]
    if len(facing) < 3:
        return np.nan, np.inf
    best = max(facing, key=lambda v: abs(float(scaled.rotation[v, 2, 1])))
    columns = np.nonzero((scaled.views[best].labels == label).any(axis=0))[0]
    radius = 0.5 * (columns[-1] - columns[0] + 1) * float(scaled.scale[best])
    rows, targets = [], []
    for v in facing:
        mask = scaled.views[v].labels == label
        low = np.nonzero(mask.any(axis=1))[0][-1]
        uv = np.array([np.nonzero(mask[low])[0].mean(), low + 0.5])
        down = scaled.rotation[v, 1]
        along = np.array([down[0], 0.0, down[2]]) / np.hypot(down[0], down[2])
        rows.append(scaled.rotation[v, :2])
        targets.append(uv * scaled.scale[v] - scaled.shift[v] - radius * scaled.rotation[v, :2] @ along)
    system, target = np.concatenate(rows), np.concatenate(targets)
    centre, _, rank, _ = np.linalg.lstsq(system, target, rcond=1e-3)
    error = float(np.abs(system @ centre - target).max())
    return float(centre[2] - radius), error if rank == 3 else np.inf


def visual_hull(placed: ScaledViews, size_m: FloatArray, config: ShapeSpaceConfig) -> Float32Array:
    """The greatest signed distance to a silhouette over the views, in metres on the grid (nx, ny, nz).

    The object is taken as symmetric (the mean of both sides), on the ground and no higher than its size says.
    """
    unit = grid_points(config)
    points = unit * size_m
    out = np.full(len(points), -np.inf, np.float32)
    distances = [_padded_distance(v.labels > 0) for v in placed.views]
    for side in (1.0, -1.0):
        xyz = points * np.array([1.0, side, 1.0])
        hull = np.full(len(points), -np.inf, np.float32)
        for v, (distance, pad) in enumerate(distances):
            uv = (placed.project(v, xyz) + pad).reshape(-1, config.cells[2], 2)
            at = sample_bilinear(distance, uv, cv2.BORDER_REPLICATE)
            np.maximum(hull, at.ravel() * np.float32(placed.scale[v]), out=hull)
        out = hull if side > 0 else np.asarray((out + hull) / 2, np.float32)
    z = points[:, 2].astype(np.float32)
    out = np.maximum(out, np.maximum(-z, z - np.float32(size_m[2])))
    return np.asarray(out.reshape(config.cells), np.float32)


def grid_points(config: ShapeSpaceConfig) -> FloatArray:
    """The samples in units of length, width and height, shape (nx ny nz, 3)."""
    rx, ry, rz = config.reach
    nx, ny, nz = config.cells
    axes = (np.linspace(-rx, rx, nx), np.linspace(0, ry, ny), np.linspace(0, rz, nz))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _padded_distance(mask: BoolArray) -> tuple[Float32Array, int]:
    """Signed distance to a mask in pixels with a margin, and the margin."""
    pad = max(mask.shape) // 2
    return signed_distance(np.pad(mask, pad)), pad


def _part_outlines(
    placed: ScaledViews,
    instance: TrainingInstance,
    part_names: Sequence[str],
    config: ShapeSpaceConfig,
    library: PrimitiveLibrary | None,
) -> FloatArray:
    """Outlines in units of the size, shape (p, m, 3), NaN for parts that no view shows.

    The planes and outlines are those of section 3.2, learned from this instance alone and moved onto its
    views by their centroids.
    """
    bins = instance.bins[0]
    views = [v for v, b in zip(instance.views, instance.bins, strict=True) if b == bins]
    model = learn_class_model(
        views, "instance", part_names, LearnConfig(bins=bins, refine_rounds=0, max_bin_step=1), library
    )
    out = np.full((len(part_names), config.outline_points, 3), np.nan)
    own, seen = [], []
    for part in model.parts:
        centroid = _centroid(placed, part.label)
        if centroid is not None:
            own.append(part.centroid)
            seen.append(centroid)
    a, b = np.array(own), np.array(seen)
    a0, b0 = a - a.mean(axis=0), b - b.mean(axis=0)
    scale = float((a0 * b0).sum() / (a0**2).sum())
    for part in model.parts:
        outline = (part.outline - a.mean(axis=0)) * scale + b.mean(axis=0)
        out[part.label - 1] = canonical_ring(
            outline / np.array(instance.size_m), part.plane[:3], config.outline_points
        )
    return out


def _centroid(placed: ScaledViews, label: int) -> FloatArray | None:
    """Point (3,) that projects to the centroids of a part; None where views do not fix it."""
    rows, targets = [], []
    for v, view in enumerate(placed.views):
        y, x = np.nonzero(view.labels == label)
        if len(x) >= 40:
            rows.append(placed.rotation[v, :2])
            targets.append(np.array([x.mean(), y.mean()]) * placed.scale[v] - placed.shift[v])
    if len(rows) < 2:
        return None
    point, _, rank, _ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(targets), rcond=1e-2)
    return np.asarray(point) if rank == 3 else None


CLASS_MODEL_SPACE = ShapeSpaceConfig(cells=(56, 20, 24), modes=5)
"""The shape space of a class model: on cells of 7 to 10 cm for a car, a few hundred kilobytes."""
CLASS_MODEL_SPACE_THIN = ShapeSpaceConfig(
    reach=(0.54, 0.54, 1.06), modes=6, surface_m=0.05, size_weight=8.0, keep_instances=True
)
"""The shape space of a class with thin parts; lengths and weights are for a diagonal of 1 m."""
_THIN_CELLS = 110
"""Cells along the diagonal: 11 mm for a chair."""


def with_shape_space(
    model: ClassModel,
    part_views: PartViews,
    library: PrimitiveLibrary | None = None,
    level: PartViews | None = None,
) -> ClassModel:
    """The class model with a shape space of the labelled instances whose size is known.

    The model is left as it is where these are too few for the space.

    Args:
        model: Learned from ``part_views``.
        part_views: Each instance of known size is shown from all sides.
        library: The primitives of the view bins; None for those of the package.
        level: The same instances seen by level cameras, which see under seats and how thin wings are; the
            space is then fine enough for legs. None for none.

    Raises:
        RescoreError: views of an instance that cannot be put together.
    """
    names = part_views.sizes_m
    config = CLASS_MODEL_SPACE if level is None else thin_space(part_views)
    if len(names) < config.modes + 2:
        return model
    rings = [part_views] if level is None else [part_views, level]
    shapes = []
    for name, size_m in names.items():
        pairs = [(v, ring.bins) for ring in rings for v in ring.views if v.instance_id == name]
        views, bins = zip(*pairs, strict=True)
        instance = TrainingInstance(views, bins, size_m)
        shapes.append(instance_shape(instance, part_views.part_names, config, library))
    return replace(model, shape_space=principal_shapes(shapes, config))


def thin_space(part_views: PartViews) -> ShapeSpaceConfig:
    """Settings for a class with thin parts: cubic cells, so many along the diagonal of the mean size."""
    size = np.mean(list(part_views.sizes_m.values()), axis=0)
    diagonal_m = float(np.linalg.norm(size))
    reach = CLASS_MODEL_SPACE_THIN.reach
    along = np.array([2 * reach[0], reach[1], reach[2]]) * size / diagonal_m * _THIN_CELLS
    nx, ny, nz = np.ceil(along).astype(int).tolist()
    return replace(
        CLASS_MODEL_SPACE_THIN,
        cells=(nx, ny, nz),
        modes=max(1, min(CLASS_MODEL_SPACE_THIN.modes, len(part_views.sizes_m) - 2)),
        surface_m=CLASS_MODEL_SPACE_THIN.surface_m * diagonal_m,
        size_weight=CLASS_MODEL_SPACE_THIN.size_weight * diagonal_m,
    )


def principal_shapes(shapes: Sequence[InstanceShape], config: ShapeSpaceConfig) -> ShapeSpace:
    """Mean and principal components of hulls near the surface with the sizes; outlines follow them.

    Raises:
        RescoreError: too few instances for the modes.
    """
    if len(shapes) < config.modes + 2:
        raise RescoreError(
            f"shape space: expected at least {config.modes + 2} training instances for {config.modes} modes, "
            f"got {len(shapes)}; label more instances or ask for fewer modes"
        )
    hulls = np.stack([s.hull for s in shapes])
    outlines = np.stack([s.outlines for s in shapes])
    sizes = np.stack([s.log_size for s in shapes])
    n, k = len(hulls), config.modes
    mean = hulls.mean(axis=0)
    weight = np.exp(-0.5 * (mean / config.surface_m) ** 2)
    rows = ((hulls - mean) * weight).reshape(n, -1)
    size_rows = (sizes - sizes.mean(axis=0)) * config.size_weight
    data = np.concatenate([rows, size_rows], axis=1).astype(float)
    u, _, _ = np.linalg.svd(data @ data.T)
    scores = u[:, :k] * np.sqrt(n - 1)  # standard normal over the instances
    back = scores / (n - 1)
    modes = np.einsum("nxyz,nk->xyzk", hulls - mean, back)
    log_modes = (sizes - sizes.mean(axis=0)).T @ back
    rest = sizes - sizes.mean(axis=0) - scores @ log_modes.T
    kept = np.isfinite(outlines).all(axis=(2, 3)).mean(axis=0) >= _MOSTLY_SHOWN
    # the few instances without a part, as open cars without side windows, are as the others there
    parts = outlines[:, kept]
    parts = np.where(np.isfinite(parts), parts, np.nanmean(parts, axis=0))
    return ShapeSpace(
        config.reach,
        mean,
        modes.astype(np.float32),
        sizes.mean(axis=0),
        log_modes,
        # what n instances leave beside k modes is less than what a new one will
        rest.std(axis=0) * n / (n - 1 - k),
        tuple(int(i) + 1 for i in np.nonzero(kept)[0]),
        parts.mean(axis=0),
        np.einsum("npmd,nk->pmdk", parts - parts.mean(axis=0), back),
        scores if config.keep_instances else np.zeros((0, k)),
    )
