"""What depth an instance of a class shows from every side: maps of the class model's surface, rendered once.

A map lies in the upright plane through the middle of the instance that faces the camera. At each point of it
stands how far behind or before that plane the ray through it meets the surface. A pose is looked up in the
map of the nearest heading and distance, so that thousands of poses can be tried for a box.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.shape_space import ShapeSpace, sample_hull


@dataclass(frozen=True)
class DepthViewsConfig:
    """The shapes and places that maps are rendered of. Distances are in multiples of the class's length."""

    coefficients: tuple[tuple[float, ...], ...] = ((), (-1.0,), (1.0,), (0.0, -1.0), (0.0, 1.0))
    """Coefficients of the shapes in the shape space, the mean first; what is left out is 0."""
    headings: int = 48
    """An even number of directions of the nose, all around."""
    distances: tuple[float, ...] = (0.9, 1.3, 1.9, 2.9, 4.5, 9.0)
    step: float = 0.022
    """Distance between samples of a map."""
    half_width: float = 0.68
    """A map reaches this far to each side."""
    height: float = 0.53
    """A map reaches this far up from the ground."""
    depth: float = 0.25
    """A map reaches this far below the ground: there the near end of an instance is seen."""


@dataclass(frozen=True, eq=False)
class DepthViews:
    """Maps of shapes of one class, seen from one height above the ground."""

    relief_m: Float32Array
    """Distance along the ground from the plane of the map to the surface, positive behind it, shape
    (shapes, distances, headings, rows, columns); NaN where the ray misses the shape. Rows go up."""
    size_m: FloatArray
    """Length, width and height of each shape, shape (shapes, 3)."""
    distance_m: FloatArray
    """Rising, shape (distances,)."""
    step_m: float
    """Distance between samples of a map, whose middle column is in the middle."""
    ground_row: int
    """Row of the maps that lies on the ground."""

    @property
    def headings(self) -> int:
        """Number of headings; heading i is ``2 pi i / headings`` from the picture's right to its far end."""
        return int(self.relief_m.shape[2])

    @cached_property
    def inset_m(self) -> Float32Array:
        """Distance of each sample from the edge of the silhouette, 0 beside it, shape as ``relief_m``."""
        seen = np.isfinite(self.relief_m).reshape(-1, *self.relief_m.shape[3:])
        inset = np.stack([cv2.distanceTransform(s.astype(np.uint8), cv2.DIST_L2, 5) for s in seen])
        return np.asarray(inset.reshape(self.relief_m.shape) * np.float32(self.step_m), np.float32)

    @cached_property
    def extent_m(self) -> FloatArray:
        """Left, right, foot and top of each silhouette, shape (shapes, distances, headings, 4)."""
        seen = np.isfinite(self.relief_m)
        columns, rows = np.asarray(seen.any(axis=-2)), np.asarray(seen.any(axis=-1))
        half, last = columns.shape[-1] // 2, columns.shape[-1] - 1
        left, right = columns.argmax(axis=-1), last - columns[..., ::-1].argmax(axis=-1)
        foot, top = rows.argmax(axis=-1), rows.shape[-1] - 1 - rows[..., ::-1].argmax(axis=-1)
        foot, top = foot - self.ground_row, top - self.ground_row
        ends = np.stack([left - half - 0.5, right - half + 0.5, foot - 0.5, top + 0.5], axis=-1)
        return np.asarray(ends * self.step_m)

    @cached_property
    def border_m(self) -> FloatArray:
        """Distances at which the next maps begin to be the nearest, shape (distances - 1,)."""
        return np.asarray(np.sqrt(self.distance_m[1:] * self.distance_m[:-1]))


def render_depth_views(space: ShapeSpace, height_m: float, config: DepthViewsConfig) -> DepthViews:
    """Maps of shapes of a class seen from a height above the ground.

    Args:
        space: The class.
        height_m: Height of the camera above the ground.
        config: Shapes and places.
    """
    length = float(np.exp(space.log_size[0]))
    distance, step = length * np.array(config.distances), length * config.step
    half = int(np.ceil(config.half_width / config.step))
    below, above = (int(np.ceil(reach / config.step)) for reach in (config.depth, config.height))
    across, up = np.meshgrid(step * np.arange(-half, half + 1), step * np.arange(-below, above + 1))
    shapes = [first_coefficients(space, c) for c in config.coefficients]
    relief = np.stack(
        [
            np.stack([_relief(space, shape, across, up, d, height_m, config.headings) for d in distance])
            for shape in shapes
        ]
    )
    relief[..., :, [0, -1]] = np.nan
    relief[..., [0, -1], :] = np.nan
    size = np.stack([space.size_m(c, np.zeros(3)) for c in shapes])
    return DepthViews(relief.astype(np.float32), size, distance, float(step), below)


def first_coefficients(space: ShapeSpace, first: Sequence[float]) -> FloatArray:
    """Coefficients (k,) of a shape from its first ones; modes that the space lacks change nothing."""
    own = np.array(first[: space.count], float)
    return np.pad(own, (0, space.count - len(own)))


def _relief(
    space: ShapeSpace,
    coefficients: FloatArray,
    across_m: FloatArray,
    up_m: FloatArray,
    distance_m: float,
    height_m: float,
    headings: int,
) -> FloatArray:
    """Maps (headings, rows, columns) of one shape at one distance.

    Shapes are symmetric, so a heading and the one mirrored at the line of sight have mirrored maps.
    """
    target = np.stack([across_m, np.full_like(across_m, distance_m), up_m - height_m], axis=-1).reshape(-1, 3)
    reach = np.linalg.norm(target, axis=1)
    origins, directions = [], []
    mirror = (headings // 2 - np.arange(headings)) % headings
    cast = np.unique(np.minimum(np.arange(headings), mirror))
    for turn in cast * (2 * np.pi / headings):
        c, s = np.cos(turn), np.sin(turn)
        own = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        origins.append(np.broadcast_to(own @ [0.0, -distance_m, height_m], target.shape))
        directions.append(target / reach[:, None] @ own.T)
    size = space.size_m(coefficients, np.zeros(3))
    hull = space.hull(coefficients)
    ahead = first_hit(space, hull, size, np.concatenate(origins), np.concatenate(directions))
    found = (ahead.reshape(len(cast), *across_m.shape) / reach.reshape(across_m.shape) - 1) * distance_m
    maps = np.empty((headings, *across_m.shape))
    maps[mirror[cast]] = found[..., ::-1]
    maps[cast] = found
    return maps


_SURFACE_M = 0.01
"""A ray has met the surface where the hull function is below this."""
_LEAST_STEP_M = 0.02
_STEPS = 64


def first_hit(
    space: ShapeSpace, hull: Float32Array, size_m: FloatArray, origin_m: FloatArray, direction: FloatArray
) -> FloatArray:
    """How far along each ray the surface of a shape begins, shape (n,), in metres; NaN where it is missed.

    The hull function is at most the distance to the surface, so a ray may go on by it (Hart 1996, sphere
    tracing).

    Args:
        space: The class.
        hull: Hull function of the shape.
        size_m: Length, width and height, shape (3,).
        origin_m: Shape (n, 3), in the object frame.
        direction: Unit vectors, shape (n, 3).
    """
    high = np.array(space.reach) * size_m
    low = -high * [1, 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin_m) / direction, (high - origin_m) / direction
    enter = np.nanmax(np.minimum(a, b), axis=1)
    leave = np.nanmin(np.maximum(a, b), axis=1)
    found = np.full(len(direction), np.nan)
    ray = np.nonzero((leave > enter) & (leave > 0))[0]
    ahead = np.maximum(enter[ray], 0)
    for _ in range(_STEPS):
        points = origin_m[ray] + ahead[:, None] * direction[ray]
        value = sample_hull(hull, space.grid_coordinates(points / size_m))
        met = value < _SURFACE_M
        found[ray[met]] = ahead[met]
        ahead = ahead + np.maximum(0.8 * value, _LEAST_STEP_M)
        on = ~met & (ahead < leave[ray])
        ray, ahead = ray[on], ahead[on]
        if not len(ray):
            break
    return found
