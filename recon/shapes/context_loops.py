"""Shape contexts in machine code: counts of pairs in bins, and costs of all pairs of histograms.

Whole arrays go through memory for each of the dozen comparisons of a pair of points, and for each pair of
histograms. Importing this imports Numba.
"""

import math

import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.compiled import compiled

_ONE, _TWO = np.float32(1), np.float32(2)
_SLACK = 2 * math.pi * 1e-9
"""Width of a border between sectors, in radii, so that rounding moves no point across it."""


@compiled
def counted(points: FloatArray, edges: FloatArray, borders: FloatArray, found: Float32Array) -> None:
    """Write how many of the other points lie in each bin around each to ``found`` (m, radial * angular).

    Args:
        points: Shape (m, 2).
        edges: Outer radii of the rings, in mean distances, shape (radial,).
        borders: Directions of the borders between the sectors of half a turn, from the x axis on, shape
            (angular / 2 - 1, 2).
        found: Written to; zeros.
    """
    m, half, rings = len(points), len(borders) + 1, len(edges)
    px, py = points[:, 0].copy(), points[:, 1].copy()
    x, y, radius = np.empty((3, m))
    ring, sector = np.empty((2, m), np.int64)
    total = 0.0
    for i in range(m - 1):
        for j in range(m - 1 - i):
            across, down = px[i + 1 + j] - px[i], py[i + 1 + j] - py[i]
            radius[j] = math.sqrt(across * across + down * down)
        for j in range(m - 1 - i):
            total += radius[j]
    mean = max(2 * total / max(m * (m - 1), 1), 1e-12)
    for i in range(m - 1):
        # each loop does one thing for all later points, so that the processor does it for several at once
        x_later, y_later = px[i + 1 :], py[i + 1 :]
        n = len(x_later)
        for j in range(n):
            across, down = x_later[j] - px[i], y_later[j] - py[i]
            radius[j] = math.sqrt(across * across + down * down)
            slack = _SLACK * radius[j]
            # of the sector and the opposite one, the one of the first half turn
            below = (down < -slack) | ((down <= slack) & (across < 0))
            x[j], y[j] = -across if below else across, -down if below else down
            sector[j] = half if below else 0
            ring[j] = 0
        for edge in edges:
            for j in range(n):
                ring[j] += 1 if radius[j] > mean * edge else 0
        # which side of the borders it lies on tells the sector, without an angle; within the slack it lies on
        # them
        for k in range(half - 1):
            along, up = borders[k]
            for j in range(n):
                sector[j] += 1 if y[j] * along + _SLACK * radius[j] >= x[j] * up else 0
        for j in range(n):
            if ring[j] < rings:
                first = 2 * half * ring[j]
                opposite = sector[j] + half if sector[j] < half else sector[j] - half
                found[i, first + sector[j]] += _ONE
                found[i + 1 + j, first + opposite] += _ONE


@compiled
def costs(a: Float32Array, b: Float32Array, found: Float32Array) -> None:
    """Write the chi-squared cost of histograms a (m, k) against b, transposed to (k, n), to ``found`` (m, n).

    0.5 sum (a - b)^2 / (a + b) = 1 - 2 sum a b / (a + b) for histograms that sum to 1.
    """
    m, n = found.shape
    for i in range(m):
        overlap = found[i]
        overlap[:] = 0
        for k in range(a.shape[1]):
            one = a[i, k]
            if one > 0:
                for j in range(n):
                    overlap[j] += one * b[k, j] / (one + b[k, j])
        for j in range(n):
            overlap[j] = min(max(_ONE - _TWO * overlap[j], np.float32(0)), _ONE)
