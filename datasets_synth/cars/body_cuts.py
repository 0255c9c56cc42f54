"""Cutting and painting the lofted body of a car along level functions.

Every region is a level function over the surface, negative inside. The surface is cut along its outline, so
that outlines are sharp at any size.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from datasets_synth.cars.body import BodyLines
from datasets_synth.cars.paint import Finish
from datasets_synth.cars.parts import PART_LABEL
from datasets_synth.meshes.mesh_build import Soup, cut
from recon.arrays import BoolArray, FloatArray, IntArray


def smooth_max(first: FloatArray, *others: FloatArray, radius: float = 0.04) -> FloatArray:
    """Intersection of regions with rounded corners: the maximum, blended where two values are close."""
    out = first
    for other in others:
        blend = np.clip(radius - np.abs(out - other), 0, None)
        out = np.maximum(out, other) + blend**2 / (4 * radius)
    return out


def box_level(
    u: FloatArray, v: FloatArray, box: tuple[float, float, float, float], corner: float = 0.02
) -> FloatArray:
    """Level of a box (u low, v low, u high, v high) with rounded corners."""
    du = np.abs(u - 0.5 * (box[0] + box[2])) - 0.5 * (box[2] - box[0]) + corner
    dv = np.abs(v - 0.5 * (box[1] + box[3])) - 0.5 * (box[3] - box[1]) + corner
    outside = np.hypot(np.clip(du, 0, None), np.clip(dv, 0, None))
    return np.asarray(outside + np.minimum(np.maximum(du, dv), 0) - corner)


def line_level(
    u: FloatArray, v: FloatArray, start: tuple[float, float], end: tuple[float, float]
) -> FloatArray:
    """Signed distance to the line through two points: positive right of start -> end (u right, v up)."""
    du, dv = end[0] - start[0], end[1] - start[1]
    return np.asarray(((u - start[0]) * dv - (v - start[1]) * du) / np.hypot(du, dv))


def above_curve_level(u: FloatArray, v: FloatArray, curve_u: FloatArray, curve_v: FloatArray) -> FloatArray:
    """Signed distance to the graph of a curve (curve_u increasing): positive above it.

    The distance is that to the nearest of points 4 mm apart on the polyline: at 2 cm it errs by 0.1 mm.
    """
    way = np.concatenate([[0], np.cumsum(np.hypot(np.diff(curve_u), np.diff(curve_v)))])
    fine = np.linspace(0, way[-1], 2 + int(way[-1] / 0.004))
    samples = np.stack([np.interp(fine, way, curve_u), np.interp(fine, way, curve_v)], axis=1)
    # faces share their corners, some six each
    points, which = np.unique(u.ravel() + 1j * v.ravel(), return_inverse=True)
    distance = cKDTree(samples).query(np.stack([points.real, points.imag], axis=1))[0][which].reshape(u.shape)
    return np.asarray(np.where(v > np.interp(u, curve_u, curve_v), distance, -distance))


SEAM_M = 0.011
"""Width of a door gap."""


@dataclass(frozen=True, eq=False)
class Points:
    """Coordinates of the corners that a level function is asked about; each of shape (m, 3)."""

    t: FloatArray
    """Distance from the nose as built."""
    y: FloatArray
    """Distance to the left of the middle."""
    z: FloatArray
    """Height above the ground."""
    s: FloatArray
    """Station: distance from the nose before nose and tail were bent."""


Level = Callable[[Points], FloatArray]


def _points(soup: Soup, where: IntArray, lines: BodyLines) -> Points:
    c = soup.corners_m[where]
    return Points(0.5 * lines.shape.length - c[..., 0], c[..., 1], c[..., 2], soup.station[where])


def _values(soup: Soup, lines: BodyLines, zones: tuple[int, ...], level: Level) -> FloatArray:
    """Level at the corners of the faces in the zones, NaN elsewhere."""
    out = np.full(soup.corners_m.shape[:2], np.nan)
    where = np.flatnonzero(np.isin(soup.zone, zones))
    out[where] = level(_points(soup, where, lines))
    return out


def divide(soup: Soup, lines: BodyLines, zones: tuple[int, ...], *levels: Level) -> tuple[Soup, BoolArray]:
    """The surface cut along each level's outline in turn, and a mask of the faces inside all levels.

    Several levels keep a corner sharp that one level, being interpolated over a face, would bevel.
    """
    out = soup
    for level in levels:
        out = cut(out, _values(out, lines, zones, level))
    highest = np.maximum.reduce([_values(out, lines, zones, level).mean(1) for level in levels])
    return out, highest < 0


def paint(
    soup: Soup,
    lines: BodyLines,
    zones: tuple[int, ...],
    levels: Level | tuple[Level, ...],
    finish: Finish | None = None,
    *,
    part: str | None = None,
    only: Finish | None = None,
) -> Soup:
    """The surface with the region inside all levels painted; only: leave faces of other finishes alone."""
    out, inside = divide(soup, lines, zones, *(levels if isinstance(levels, tuple) else (levels,)))
    if only is not None:
        inside &= out.material == only
    return out.painted(
        inside, None if finish is None else int(finish), None if part is None else PART_LABEL[part]
    )


def band(soup: Soup, lines: BodyLines, zones: tuple[int, ...], level: Level, width: float = SEAM_M) -> Soup:
    """The surface with a dark line along the outline of a region, where there is paint or trim."""
    out = cut(soup, _values(soup, lines, zones, level))
    out = cut(out, _values(out, lines, zones, level), width)
    middle = _values(out, lines, zones, level).mean(1)
    inside = (middle > 0) & (middle < width) & np.isin(out.material, (Finish.PAINT, Finish.CLADDING))
    return out.painted(inside, int(Finish.SEAM))
