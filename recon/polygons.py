"""Polygons drawn by hand: what is wrong with one, and the pixels inside it."""

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.outlines import fill_polygon

BORDER_TOLERANCE_PX = 1.0
"""Labelling tools round, and differ by half a pixel in where a picture ends."""
_BLOCK = 1024
"""Edges compared with all others at a time, which bounds memory for long polygons."""


def open_ring(points: FloatArray) -> FloatArray:
    """The polygon (m, 2) without points that repeat the one before; the first follows the last."""
    return points[(points != np.roll(points, 1, axis=0)).any(axis=1)] if len(points) > 1 else points


def polygon_problem(points: FloatArray, height_px: int, width_px: int) -> str | None:
    """What was expected and what came, where a polygon (m, 2) in pixel edges cannot be filled; else None."""
    if not np.isfinite(points).all():
        return f"expected finite coordinates, got {points[~np.isfinite(points).all(axis=1)][0].tolist()}"
    ring = open_ring(points)
    if len(ring) < 3:
        return f"expected at least 3 different points, got {len(ring)}"
    size = np.array([width_px, height_px])
    outside = ((ring < -BORDER_TOLERANCE_PX) | (ring > size + BORDER_TOLERANCE_PX)).any(axis=1)
    if outside.any():
        return f"expected points inside {width_px} x {height_px} pixels, got {_shown(ring[outside][0])}"
    crossing = first_crossing(ring)
    if crossing is not None:
        at = " and ".join(_shown(ring[i]) for i in crossing)
        return f"expected a polygon that does not cross itself, got edges that cross after {at}"
    if area_px(ring) < 1.0:
        return f"expected an area of at least one pixel, got {area_px(ring):.2g}"
    return None


def area_px(ring: FloatArray) -> float:
    """Area inside a polygon (m, 2)."""
    x, y = (ring - ring.mean(axis=0)).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def first_crossing(ring: FloatArray) -> tuple[int, int] | None:
    """The first two edges of a polygon (m, 2) that cross; edge i goes from point i to the next.

    Edges cross where each has its ends strictly on both sides of the other. Touching, also of an end and the
    middle of an edge, is allowed: tools snap points to each other, and the inside is the same.
    """
    start, end = ring, np.roll(ring, -1, axis=0)
    low, high = np.minimum(start, end), np.maximum(start, end)
    slack = 1e-12 * float(np.ptp(ring, axis=0).max()) ** 2
    for first in range(0, len(ring), _BLOCK):
        block = slice(first, first + _BLOCK)
        # few edges come near each other, and only those that do can cross
        near = ((low[block, None] <= high[None]) & (low[None] <= high[block, None])).all(axis=2)
        i, j = np.nonzero(near)
        i += first
        a, b, c, d = start[i], end[i], start[j], end[j]
        cross = np.nonzero(_straddles(a, b, c, d, slack) & _straddles(c, d, a, b, slack))[0]
        if len(cross):
            return int(i[cross[0]]), int(j[cross[0]])
    return None


def _straddles(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, slack: float) -> BoolArray:
    """Whether c and d (n, 2) lie strictly on both sides of the line through a and b (n, 2), shape (n,)."""
    along = b - a
    side_c = along[:, 0] * (c - a)[:, 1] - along[:, 1] * (c - a)[:, 0]
    side_d = along[:, 0] * (d - a)[:, 1] - along[:, 1] * (d - a)[:, 0]
    strictly = (np.minimum(side_c, side_d) < -slack) & (np.maximum(side_c, side_d) > slack)
    return np.asarray(strictly, dtype=bool)


def polygon_mask(points: FloatArray, height_px: int, width_px: int) -> BoolArray:
    """The mask (h, w) inside a polygon (m, 2) in pixel edges."""
    return fill_polygon(points - 0.5, height_px, width_px)


def _shown(point: FloatArray) -> str:
    return f"({point[0]:g}, {point[1]:g})"
