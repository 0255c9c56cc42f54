"""Compiled loops of ``rescore.metrics.boxes3d``."""

import numpy as np

from recon.arrays import FloatArray
from recon.compiled import exact


@exact
def areas_within(corners: FloatArray, half: FloatArray) -> FloatArray:
    """Area (n,) that convex polygons (n, k, 2) share with rectangles about the origin, half sides (n, 2).

    Corners go counter-clockwise, and one side after the other cuts.

    After I. E. Sutherland and G. W. Hodgman, "Reentrant polygon clipping", Comm. ACM 17(1), 1974.
    """
    n, k, _ = corners.shape
    areas = np.zeros(n)
    # each side adds a corner at most
    polygon, cut = np.empty((2 * k + 8, 2)), np.empty((2 * k + 8, 2))
    for i in range(n):
        polygon[:k] = corners[i]
        count = k
        for side in range(4):
            axis, sign = side // 2, 1.0 - 2.0 * (side % 2)
            kept = 0
            for c in range(count):
                after = (c + 1) % count
                inside = half[i, axis] - sign * polygon[c, axis]
                inside_after = half[i, axis] - sign * polygon[after, axis]
                if inside >= 0:
                    cut[kept, 0], cut[kept, 1] = polygon[c, 0], polygon[c, 1]
                    kept += 1
                if (inside >= 0) != (inside_after >= 0):
                    share = inside / (inside - inside_after)
                    for xy in range(2):
                        cut[kept, xy] = polygon[c, xy] + share * (polygon[after, xy] - polygon[c, xy])
                    kept += 1
            polygon, cut, count = cut, polygon, kept
        twice = 0.0
        for c in range(1, count - 1):
            x, y = polygon[c, 0] - polygon[0, 0], polygon[c, 1] - polygon[0, 1]
            x_after, y_after = polygon[c + 1, 0] - polygon[0, 0], polygon[c + 1, 1] - polygon[0, 1]
            twice += x * y_after - y * x_after
        areas[i] = max(twice / 2, 0.0)
    return areas
