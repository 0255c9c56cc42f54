"""The generic phase (section 3.2): what turning does to the image of each oriented planar primitive.

Class-independent and run once for a view space. Flat shapes of each orientation are rendered as they turn
through the view space in small steps. Shape contexts find the points of one picture in the next, so that
points are followed from view bin to view bin. Linear regression gives the 2D projective transform of each
pair of bins.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import as_file, files

import numpy as np
from joblib import delayed

from recon.arrays import FloatArray
from recon.learning.primitives import (
    PrimitiveLibrary,
    apply_projective,
    nearest_on_outline,
    plane_axes,
    primitive_normals,
    projective_transform,
)
from recon.outlines import fill_polygon, largest_outline, resample
from recon.shapes.shape_matching import ShapeContextConfig, match, shape_contexts
from recon.view_bins import ViewBins, rotation
from recon.workers import workers

SHAPES: tuple[FloatArray, ...] = (
    np.array([[-1.2, -0.8], [1.2, -0.8], [1.2, 0.1], [0.3, 0.1], [0.3, 0.9], [-1.2, 0.9]]),
    np.array([[-1.3, -0.5], [-0.2, -0.9], [1.1, -0.6], [1.4, 0.3], [0.4, 0.7], [-0.6, 0.6], [-1.1, 1.0]]),
    np.array([[-0.9, -1.2], [0.7, -1.0], [0.5, -0.2], [1.0, 0.5], [0.2, 1.2], [-0.7, 1.0], [-0.5, 0.1]]),
)
"""Corners of the flat shapes that turn, in their plane; none is symmetric, which would mix up points."""


@dataclass(frozen=True)
class GenericPhaseConfig:
    """Settings of the generic phase."""

    steps_per_bin: int = 3
    """Pictures from one view bin to the next."""
    boundary_points: int = 64
    """Points that are followed on each outline."""
    settling_rounds: int = 3
    """Rounds of regression on distances from the outline, after that on matched points."""
    scale_px: float = 90.0
    """Pixels an object unit in the rendered pictures."""
    min_facing: float = 0.07
    """A primitive seen at a smaller cosine is edge-on: there the sequence breaks. Level planes seen from an
    elevation of 5 degrees are not: roofs and hoods in a street."""
    shape_context: ShapeContextConfig = field(default_factory=lambda: ShapeContextConfig(position_weight=4.0))


def learn_primitives(
    bins: ViewBins,
    config: GenericPhaseConfig | None = None,
    jobs: int = 1,
    normals: FloatArray | None = None,
) -> PrimitiveLibrary:
    """The library of primitives for a view space; the same settings give the same bytes for any ``jobs``.

    Args:
        bins: the view space.
        config: settings; None for the defaults.
        jobs: primitives at a time.
        normals: orientations to learn, shape (k, 3); None for all of ``primitive_normals``.
    """
    config = config or GenericPhaseConfig()
    normals = primitive_normals() if normals is None else normals
    rows = workers(jobs)(delayed(_learn_primitive)(n, bins, config) for n in normals)
    transform = np.stack([t for t, _ in rows])
    return PrimitiveLibrary(bins, normals, transform, np.stack([r for _, r in rows]))


@lru_cache(maxsize=4)
def primitive_library(bins: ViewBins) -> PrimitiveLibrary:
    """The library for a view space: that of the package where it holds one, else learned here, which takes
    some 20 seconds; remembered."""
    with as_file(files("recon") / "data" / file_name(bins)) as path:
        return PrimitiveLibrary.load(path) if path.is_file() else learn_primitives(bins)


def file_name(bins: ViewBins) -> str:
    """Name of the file of a library."""
    return f"primitives_{bins.count}_bins_{np.rad2deg(bins.elevation_rad):g}_deg.npz"


def _learn_primitive(
    normal: FloatArray, bins: ViewBins, config: GenericPhaseConfig
) -> tuple[FloatArray, FloatArray]:
    """Transforms (b, b, 3, 3) and residuals (b, b) of one primitive."""
    sequences = [_Sequence(shape, normal, bins, config) for shape in SHAPES]
    transform = np.full((bins.count, bins.count, 3, 3), np.nan)
    residual = np.full((bins.count, bins.count), np.nan)
    for a in range(bins.count):
        followed = [s.followed(a) for s in sequences]
        for b in set.intersection(*(set(f) for f in followed)):
            source, target = (np.concatenate([f[b][end] for f in followed]) for end in (0, 1))
            transform[a, b] = projective_transform(source, target)
            error = ((apply_projective(transform[a, b], source) - target) ** 2).sum(axis=1).mean()
            residual[a, b] = np.sqrt(error / (target**2).sum(axis=1).mean())
    return transform, residual


class _Sequence:
    """One flat shape that turns once around, with its points followed from picture to picture."""

    def __init__(
        self, shape: FloatArray, normal: FloatArray, bins: ViewBins, config: GenericPhaseConfig
    ) -> None:
        self.config = config
        self.length = bins.count * config.steps_per_bin
        views = np.stack(
            [rotation(2 * np.pi * f / self.length, bins.elevation_rad) for f in range(self.length)]
        )
        facing = views[:, 2] @ normal
        corners = (shape - _centroid(shape)) @ plane_axes(normal)
        self.outline: dict[int, FloatArray] = {
            int(f): _rendered_outline(corners @ views[f, :2].T, config)
            for f in np.flatnonzero(np.abs(facing) >= config.min_facing)
        }
        """Many points (d, 2) on the outline in each picture that shows the shape, object units."""
        contexts = {f: shape_contexts(o, config.shape_context) for f, o in self.outline.items()}
        self.step: dict[int, FloatArray] = {}
        """The projective transform (3, 3) from each picture to the next one."""
        for f, outline in self.outline.items():
            g = (f + 1) % self.length
            if g in self.outline and facing[f] * facing[g] > 0:
                partner, _ = match(outline, contexts[f], self.outline[g], contexts[g], config.shape_context)
                self.step[f] = self._step(outline, self.outline[g][partner], g)

    def followed(self, view_bin: int) -> dict[int, tuple[FloatArray, FloatArray]]:
        """A bin's points (m, 2) in its own picture and in that of each bin they can be followed to, by bin.

        Both ways around are tried; the shorter one has drifted less.
        """
        start = view_bin * self.config.steps_per_bin
        if start not in self.outline:
            return {}
        source = self.outline[start]
        found: dict[int, tuple[FloatArray, FloatArray]] = {view_bin: (source, source)}
        for direction in (1, -1):
            points: FloatArray = source
            f = start
            for _ in range(self.length // 2):
                g = (f + direction) % self.length
                step = self.step.get(f if direction > 0 else g)
                if step is None:
                    break
                back = np.asarray(np.linalg.inv(step))
                moved = apply_projective(step if direction > 0 else back, points)
                points, f = self._onto_outline(moved, g), g
                if f % self.config.steps_per_bin == 0:
                    found.setdefault(f // self.config.steps_per_bin, (source, points))
        return found

    def _step(self, source: FloatArray, target: FloatArray, to: int) -> FloatArray:
        """The transform to picture ``to`` that matched points (m, 2) give, settled on its outline.

        Shape contexts change as the shape turns, which draws partners along the outline; so the regression
        is repeated for the distances from the outline alone.
        """
        step = projective_transform(source, target)
        for _ in range(self.config.settling_rounds):
            nearest, normal = nearest_on_outline(apply_projective(step, source), self.outline[to])
            step = projective_transform(source, nearest, normal)
        return step

    def _onto_outline(self, points: FloatArray, f: int) -> FloatArray:
        """Points (m, 2) moved onto the outline of a picture, at right angles to the outline."""
        nearest, normal = nearest_on_outline(points, self.outline[f])
        return np.asarray(points - normal * ((points - nearest) * normal).sum(axis=1, keepdims=True))


def _centroid(polygon: FloatArray) -> FloatArray:
    """Centre of the area of a polygon (m, 2)."""
    x, y = polygon.T
    x1, y1 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y1 - x1 * y
    return np.asarray(np.array([((x + x1) * cross).sum(), ((y + y1) * cross).sum()]) / (3 * cross.sum()))


def _rendered_outline(corners: FloatArray, config: GenericPhaseConfig) -> FloatArray:
    """Points (d, 2) on the outline of a flat shape as a picture shows it, object units."""
    low = corners.min(axis=0) - 3 / config.scale_px
    width, height = np.ceil((corners.max(axis=0) - low) * config.scale_px).astype(int) + 4
    mask = fill_polygon((corners - low) * config.scale_px, int(height), int(width))
    ring = largest_outline(mask)
    assert ring is not None, "a shape that is not edge-on covers pixels"
    return resample(ring / config.scale_px + low, config.boundary_points)
