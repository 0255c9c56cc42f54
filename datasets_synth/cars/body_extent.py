"""How far the body of a car reaches: without mirrors, aerials and whatever else stands out, as in its papers.

A place belongs to the body where the surface reaches it over some length across; what stands out is short.
"""

import numpy as np

from recon.arrays import FloatArray

_CELL_M = 0.02
"""Width of the strips in which the surface is looked at."""
_SIDE_RUN_M = 0.5
"""The side of a car reaches its width over this length at least; no mirror is as long."""
_OTHER_RUN_M = 0.3
"""Front, rear and top reach their ends over this width at least: bumpers and roofs do, aerials, rails and
exhausts do not."""


def body_extent(corners_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest x, y and z (3,) of the body in triangles (m, 3, 3): nose at +x, z up, metres.

    The lowest z is that of everything, since cars stand on it.
    """
    points = _edge_points(corners_m)
    x, y, z = points.T
    low = [-_sturdy_reach(y, -x, _OTHER_RUN_M), -_sturdy_reach(x, -y, _SIDE_RUN_M), float(z.min())]
    high = [
        _sturdy_reach(y, x, _OTHER_RUN_M),
        _sturdy_reach(x, y, _SIDE_RUN_M),
        _sturdy_reach(y, z, _OTHER_RUN_M),
    ]
    return np.array(low), np.array(high)


def _edge_points(corners_m: FloatArray) -> FloatArray:
    """Points (n, 3) on the edges of triangles, so dense that none skips a strip.

    At every place across, the farthest point of a triangle lies on one of its edges.
    """
    start, end = corners_m.reshape(-1, 3), np.roll(corners_m, -1, axis=1).reshape(-1, 3)
    count = np.ceil(np.abs(end - start).max(axis=1) / (0.5 * _CELL_M)).astype(int) + 1
    # the end of an edge is the start of the next one
    long = count > 2
    corners, start, end, count = start, start[long], end[long], count[long]
    edge = np.repeat(np.arange(len(start)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (step / np.maximum(count[edge] - 1, 1))[:, None]
    return np.concatenate([corners, start[edge] * (1 - share) + end[edge] * share])


def _sturdy_reach(across: FloatArray, along: FloatArray, run_m: float) -> float:
    """The greatest ``along`` that the surface reaches or exceeds over ``run_m`` without a gap.

    Both (n,) are coordinates of its points. A surface narrower than the run is taken as it is.
    """
    cell = np.floor((across - across.min()) / _CELL_M).astype(int)
    reach = np.full(int(cell.max()) + 1, -np.inf)
    np.maximum.at(reach, cell, along)
    width = min(round(run_m / _CELL_M), len(reach))
    windows = np.lib.stride_tricks.sliding_window_view(reach, width)
    return float(windows.min(axis=1).max())
