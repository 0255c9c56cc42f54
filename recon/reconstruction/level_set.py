"""The steps of a level set in machine code: the one loop of outlines that whole arrays do not do well.

A step looks at the neighbours of each pixel some thirty times, and its pull concerns one pixel in ten; whole
arrays would go through memory for every look. Importing this imports Numba.
"""

import math

import numpy as np

from recon.arrays import Float32Array
from recon.compiled import compiled, on_unit

_ZERO, _HALF, _ONE, _FOUR, _TINY = (np.float32(v) for v in (0, 0.5, 1, 4, 1e-10))


_WAVE = on_unit(lambda s: np.sinc(2 * np.sqrt(s)), 8)
"""sin(2 pi s) / (2 pi s) by the square of s in [0, 1], to 2e-6."""
_BELL = on_unit(lambda t: np.cos(np.pi * np.sqrt(t)), 6)
"""cos(pi t) by the square of t in [0, 1], to 2e-6."""


@compiled
def _frame(a: Float32Array, slope: np.float32) -> None:
    """Sets the frame of an array (h, w) as what it holds goes on: with slope 1 straight, so that central
    differences at its border are one-sided; with slope 0 level."""
    h, w = a.shape
    for x in range(w):
        a[0, x] = a[1, x] + slope * (a[1, x] - a[2, x])
        a[h - 1, x] = a[h - 2, x] + slope * (a[h - 2, x] - a[h - 3, x])
    for y in range(h):
        a[y, 0] = a[y, 1] + slope * (a[y, 1] - a[y, 2])
        a[y, w - 1] = a[y, w - 2] + slope * (a[y, w - 2] - a[y, w - 3])


@compiled
def evolved(
    phi: Float32Array,
    edge: Float32Array,
    push: Float32Array,
    steps: int,
    time_step: np.float32,
    distance_weight: np.float32,
    length_weight: np.float32,
    width_px: np.float32,
) -> Float32Array:
    """phi after some steps, shape (n, h, w).

    The distance regulariser is div(d_p(|grad phi|) grad phi) for the double-well potential p_2 (eqs. 16 and
    17 of Li et al.): d_p(s) = sin(2 pi s) / (2 pi s) for s <= 1, and 1 - 1 / s above. It is written as the
    Laplacian plus the divergence of (d_p - 1) grad phi, which damps the checkerboard that central
    differences do not see.

    Args:
        phi: the start, shape (n, h, w).
        edge: the edge indicator, of the same shape.
        push: what pulls inwards where positive, of the same shape.
        steps: number of steps; this and the rest are those of ``SegmentConfig``.
        time_step: pseudo time of one step.
        distance_weight: weight of the distance regulariser.
        length_weight: weight of the edge-weighted length.
        width_px: half width of the smoothed delta function.
    """
    n, h, w = phi.shape
    out = np.empty_like(phi)
    now, after, edges, normal_x, normal_y, rate_x, rate_y = np.zeros((7, h + 2, w + 2), np.float32)
    for i in range(n):
        now[1:-1, 1:-1] = phi[i]
        edges[1:-1, 1:-1] = edge[i]
        _frame(edges, _ONE)
        for _ in range(steps):
            _frame(now, _ONE)
            for y in range(1, h + 1):
                for x in range(1, w + 1):
                    across = (now[y, x + 1] - now[y, x - 1]) * _HALF
                    down = (now[y + 1, x] - now[y - 1, x]) * _HALF
                    square = across * across + down * down
                    s = min(square, _ONE)
                    wave = _WAVE[0] * s + _WAVE[1]
                    wave = (wave * s + _WAVE[2]) * s + _WAVE[3]
                    wave = (wave * s + _WAVE[4]) * s + _WAVE[5]
                    wave = (wave * s + _WAVE[6]) * s + _WAVE[7]
                    unit = _ONE / (math.sqrt(square) + _TINY)
                    # d_p(|grad phi|) - 1
                    rate = wave - _ONE if square <= _ONE else -unit
                    normal_x[y, x] = across * unit
                    normal_y[y, x] = down * unit
                    rate_x[y, x] = across * rate
                    rate_y[y, x] = down * rate
            _frame(now, _ZERO)
            _frame(normal_x, _ONE)
            _frame(normal_y, _ONE)
            _frame(rate_x, _ONE)
            _frame(rate_y, _ONE)
            for y in range(1, h + 1):
                for x in range(1, w + 1):
                    around = now[y, x - 1] + now[y, x + 1] + now[y - 1, x] + now[y + 1, x]
                    spread = rate_x[y, x + 1] - rate_x[y, x - 1] + rate_y[y + 1, x] - rate_y[y - 1, x]
                    change = around - _FOUR * now[y, x] + _HALF * spread
                    after[y, x] = now[y, x] + time_step * distance_weight * change
            for y in range(1, h + 1):
                for x in range(1, w + 1):
                    if abs(now[y, x]) <= width_px:
                        bend = (
                            normal_x[y, x + 1] - normal_x[y, x - 1] + normal_y[y + 1, x] - normal_y[y - 1, x]
                        )
                        pull = (edges[y, x + 1] - edges[y, x - 1]) * normal_x[y, x]
                        pull += (edges[y + 1, x] - edges[y - 1, x]) * normal_y[y, x] + edges[y, x] * bend
                        pull = length_weight * _HALF * pull + push[i, y - 1, x - 1]
                        t = (now[y, x] / width_px) * (now[y, x] / width_px)
                        bell = (_BELL[0] * t + _BELL[1]) * t + _BELL[2]
                        bell = ((bell * t + _BELL[3]) * t + _BELL[4]) * t + _BELL[5]
                        after[y, x] += time_step * pull * (_ONE + bell) * (_HALF / width_px)
            now, after = after, now
        out[i] = now[1:-1, 1:-1]
    return out
