"""What the pixels of labelled parts say, in machine code: feet, angles to the rays, borders, depth on planes.

A look at one part is a look at few pixels of its window; whole arrays would go through all of them for each
part. Labels are bytes, so that tables by label have 256 rows. Importing this imports Numba.
"""

import math
from typing import NamedTuple

import numpy as np

from recon.arrays import BoolArray, FloatArray, Int32Array, IntArray, UInt8Array
from recon.compiled import compiled, within

LEFT, PLACED, WITHOUT_PLANE, EDGE_ON, BEYOND = range(5)
"""What became of a part: not reached yet, on its plane, or why not."""


class PartPixels(NamedTuple):
    """The pixels of the parts of a window, numbered from its corner on, rows one after the other."""

    start: IntArray
    """First place in ``pixels`` and ``facing`` of each label, shape (257,)."""
    pixels: Int32Array
    """Pixels by label."""
    facing: FloatArray
    """Viewing ray of each of these, with z = 1, times the normal of its part; NaN without one."""
    sine: FloatArray
    """Mean sine of the angle at which the rays of each part meet its plane, shape (256,)."""
    border_start: IntArray
    """First place in ``beyond`` of each label, shape (257,)."""
    beyond: Int32Array
    """Pixels of other parts along the border of each part: neighbours in a row or in a column; one counts as
    often as it adjoins the part."""


@compiled
def contacts(labels: UInt8Array, wanted: IntArray, tolerance_px: float) -> FloatArray:
    """Middle column and lowest row of some parts of a window (h, w), shape (n, 2); NaN of one not there.

    The middle is that of the columns whose lowest pixel is near the part's lowest.
    """
    h, w = labels.shape
    lowest, number = np.full((len(wanted), w), -1), np.full(256, -1)
    for i in range(len(wanted)):
        number[wanted[i]] = i
    for y in range(h):
        for x in range(w):
            i = number[labels[y, x]]
            if i >= 0:
                lowest[i, x] = y
    found = np.full((len(wanted), 2), np.nan)
    for i in range(len(wanted)):
        last = lowest[i].max()
        if last >= 0:
            touching = np.flatnonzero(lowest[i] >= max(last - tolerance_px, 0))
            found[i, 0], found[i, 1] = touching.mean(), last
    return found


@compiled
def part_pixels(labels: UInt8Array, across: FloatArray, down: FloatArray, normals: FloatArray) -> PartPixels:
    """The pixels of the parts of a window (h, w).

    Args:
        labels: Of the window, 0 for none.
        across: x of the viewing rays with z = 1 of its columns, shape (w,).
        down: y of those of its rows, shape (h,).
        normals: Unit normals of the planes by label, NaN where there is none, shape (256, 3).
    """
    h, w = labels.shape
    flat = labels.ravel()
    start, border_start = np.zeros((2, 257), np.int64)
    for a in range(h * w):
        start[flat[a] + 1] += 1
        for b in _neighbours(a, w, flat):
            if _border(flat[a], flat[b]):
                border_start[flat[a] + 1] += 1
                border_start[flat[b] + 1] += 1
    start[1] = 0
    for k in range(1, 257):
        start[k] += start[k - 1]
        border_start[k] += border_start[k - 1]
    pixels, beyond = np.empty(start[256], np.int32), np.empty(border_start[256], np.int32)
    facing, sine = np.empty(start[256]), np.zeros(256)
    at, border_at = start.copy(), border_start.copy()
    for a in range(h * w):
        k = flat[a]
        if k == 0:
            continue
        x, y = across[a % w], down[a // w]
        pixels[at[k]] = a
        facing[at[k]] = normals[k, 0] * x + normals[k, 1] * y + normals[k, 2]
        sine[k] += abs(facing[at[k]]) / math.sqrt(x * x + y * y + 1)
        at[k] += 1
        for b in _neighbours(a, w, flat):
            other = flat[b]
            if _border(k, other):
                beyond[border_at[k]], beyond[border_at[other]] = b, a
                border_at[k] += 1
                border_at[other] += 1
    for k in range(256):
        sine[k] /= start[k + 1] - start[k]
    return PartPixels(start, pixels, facing, sine, border_start, beyond)


@within
def _neighbours(a: int, w: int, flat: UInt8Array) -> tuple[int, int]:
    """The pixels beside and below a pixel, itself where there is none."""
    return a + 1 if (a + 1) % w else a, a + w if a + w < len(flat) else a


@within
def _border(label: int, other: int) -> bool:
    return label > 0 and other > 0 and label != other


@compiled
def spread(
    seen: PartPixels,
    across: FloatArray,
    down: FloatArray,
    normals: FloatArray,
    ready: BoolArray,
    level: FloatArray,
    near_m: float,
    far_m: float,
    min_sine: float,
    state: UInt8Array,
    kept: FloatArray,
    depth: FloatArray,
) -> IntArray:
    """Place planes breadth-first; the labels of the placed parts in their order.

    Args:
        seen: The pixels of the parts.
        across: As in ``part_pixels``, and so are the next two.
        down: Of the rows.
        normals: Of the planes.
        ready: Whether a point of the plane is known, by label, shape (256,). Written to.
        level: Normal times this point, shape (256,). Written to, for the other parts that are placed.
        near_m: Nearest depth that the object can have.
        far_m: Farthest one.
        min_sine: A plane that the rays meet at less is seen edge-on.
        state: Written to: what became of each part, shape (256,).
        kept: Written to: share of the pixels of each part within these depths, shape (256,).
        depth: Written to: depth of each pixel of the window, shape (h w,); NaN where there is none.
    """
    order, count = np.empty(256, np.int64), 0
    state[:] = LEFT
    depth[:] = np.nan
    while ready.any():
        for k in range(256):
            if not ready[k] or seen.start[k] == seen.start[k + 1]:
                continue
            if np.isnan(normals[k, 0]):
                state[k] = WITHOUT_PLANE
            elif seen.sine[k] < min_sine:
                state[k] = EDGE_ON
            else:
                kept[k] = _give_depth(seen, k, level[k], near_m, far_m, depth)
                state[k] = PLACED if kept[k] >= 0.5 else BEYOND
            if state[k] == PLACED:
                order[count] = k
                count += 1
            elif state[k] == BEYOND:
                depth[seen.pixels[seen.start[k] : seen.start[k + 1]]] = np.nan
        for k in range(256):
            ready[k] = False
            if state[k] == LEFT:
                levels = _border_levels(seen, k, across, down, normals[k], depth)
                if len(levels):
                    ready[k], level[k] = True, np.median(levels)
    return order[:count]


@within
def _give_depth(
    seen: PartPixels, k: int, level: float, near_m: float, far_m: float, depth: FloatArray
) -> float:
    """Write the depth of a part on its plane, NaN out of the limits; the share of it within."""
    good, first, last = 0, seen.start[k], seen.start[k + 1]
    for i in range(first, last):
        z = level / seen.facing[i]  # a ray along the plane never meets it
        good += near_m <= z <= far_m
        depth[seen.pixels[i]] = z if near_m <= z <= far_m else np.nan
    return float(good / (last - first))


@compiled
def _border_levels(
    seen: PartPixels, k: int, across: FloatArray, down: FloatArray, normal: FloatArray, depth: FloatArray
) -> FloatArray:
    """Normal of a part times the points of placed neighbours along its border."""
    beyond = seen.beyond[seen.border_start[k] : seen.border_start[k + 1]]
    levels, known = np.empty(len(beyond)), 0
    for pixel in beyond:
        z = depth[pixel]
        if not np.isnan(z):
            x, y = across[pixel % len(across)], down[pixel // len(across)]
            levels[known] = z * (normal[0] * x + normal[1] * y + normal[2])
            known += 1
    return levels[:known]
