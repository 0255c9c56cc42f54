"""The loops over the pixels of a picture, compiled: rays of the eye, edges, mixing, exposure.

They round as whole arrays of numpy do, so that pictures are the same bytes.
"""

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, IntArray, UInt8Array
from recon.compiled import exact

_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
_BEND_COS, _JUMP = np.float32(0.85), np.float32(0.1)
_FULL_SCALE = np.float32(65535)
_MIDDLE_GREY = np.float32(0.18)
"""Share of full scale that contrast leaves as it is."""


@exact
def pixel_places(pixel: IntArray, width_px: int, offset_px: Float32Array, out: Float32Array) -> None:
    """Write columns and rows of places around pixels, the offsets (k, 2) of one pixel side by side."""
    row = 0
    for i in range(len(pixel)):
        u, v = np.float32(pixel[i] % width_px), np.float32(pixel[i] // width_px)
        for k in range(len(offset_px)):
            out[row, 0], out[row, 1] = u + offset_px[k, 0], v + offset_px[k, 1]
            row += 1


@exact
def shift_places(uv_px: Float32Array, middle_px: Float32Array, offset_px: float, roll: float) -> None:
    """Move places (n, 2) up by an offset, and roll them about the middle, in place."""
    for i in range(len(uv_px)):
        u, v = uv_px[i, 0], uv_px[i, 1]
        uv_px[i, 0] = u + roll * (v - middle_px[1])
        uv_px[i, 1] = v - offset_px - roll * (u - middle_px[0])


@exact
def rays_of_places(
    uv_px: Float32Array, origin: Float32Array, world_from_pixel: Float32Array, out: Float32Array
) -> None:
    """Write the rays (n, 6) of places (n, 2) in a picture."""
    for i in range(len(uv_px)):
        for axis in range(3):
            out[i, axis] = origin[axis]
            out[i, 3 + axis] = (
                uv_px[i, 0] * world_from_pixel[axis, 0]
                + uv_px[i, 1] * world_from_pixel[axis, 1]
                + world_from_pixel[axis, 2]
            )


@exact
def _mark(
    i: int, j: int, key: IntArray, normal: Float32Array, inverse: Float32Array, edge: BoolArray
) -> None:
    """Mark two neighbours where a thing, material, shadow, slope or depth changes between them."""
    bend = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1] + normal[i, 2] * normal[j, 2]
    if (
        key[i] != key[j]
        or bend < _BEND_COS
        or abs(inverse[i] - inverse[j]) > _JUMP * max(inverse[i], inverse[j])
    ):
        edge[i] = True
        edge[j] = True


@exact
def mark_edges(
    key: IntArray,
    normal: Float32Array,
    t: Float32Array,
    width_px: int,
    inverse: Float32Array,
    edge: BoolArray,
) -> None:
    """Mark the pixels (n,) whose right or lower neighbour shows another key, slope or depth, and these.

    In inverse depth, which is written too, a plane is linear over the picture, so only a real jump or bend
    shows up.
    """
    for i in range(len(t)):
        inverse[i] = _ONE / t[i]
        edge[i] = False
    for i in range(len(t)):
        if (i + 1) % width_px:
            _mark(i, i + 1, key, normal, inverse, edge)
        if i + width_px < len(t):
            _mark(i, i + width_px, key, normal, inverse, edge)


@exact
def face_keys(
    face: NDArray[np.int32],
    sunlit: BoolArray,
    item: NDArray[np.int32],
    material: NDArray[np.int32],
    n_materials: int,
    out: IntArray,
) -> None:
    """Write a number of what each hit shows: the thing, its material and the side of a shadow."""
    for i in range(len(face)):
        at = face[i]
        out[i] = -2 if at < 0 else (np.int64(item[at]) * n_materials + material[at]) * 2 + sunlit[i]


@exact
def mix(edge: IntArray, fine: Float32Array, n_fine: int, with_centre: bool, colour: Float32Array) -> None:
    """Replace the colours of some pixels by the mean of their finer rays, and of the centre's own."""
    n = np.float32(n_fine + 1 if with_centre else n_fine)
    for i in range(len(edge)):
        for k in range(3):
            total = fine[i * n_fine, k]
            for j in range(1, n_fine):
                total += fine[i * n_fine + j, k]
            if with_centre:
                total = colour[edge[i], k] + total
            colour[edge[i], k] = total / n


@exact
def nearer_hits(
    t: Float32Array,
    face: NDArray[np.int32],
    barycentric: Float32Array,
    normal: Float32Array,
    other_t: Float32Array,
    other_face: NDArray[np.int32],
    other_barycentric: Float32Array,
    other_normal: Float32Array,
    first_other: int,
) -> None:
    """Replace hits in place by others that are nearer, whose faces are counted from ``first_other``."""
    for i in range(len(t)):
        if other_t[i] < t[i]:
            t[i], face[i] = other_t[i], other_face[i] + first_other
            for k in range(2):
                barycentric[i, k] = other_barycentric[i, k]
            for k in range(3):
                normal[i, k] = other_normal[i, k]


@exact
def expose_pixels(
    signal: Float32Array,
    gain: Float32Array,
    noise: Float32Array,
    read_variance: float,
    shot_variance: float,
    contrast: float,
    srgb: UInt8Array,
    out: UInt8Array,
) -> None:
    """Write the bytes (h, w, 3) of a signal: gain, noise, contrast and the curve of sRGB.

    Args:
        signal: linear light (h, w, 3).
        gain: of each pixel, shape (h, w).
        noise: normal numbers (h, w, 3).
        read_variance: variance of a black pixel.
        shot_variance: variance that light of full scale adds.
        contrast: exponent around middle grey; 1 for none.
        srgb: byte of each linear value of 16 bits.
        out: the bytes.
    """
    height, width = gain.shape
    for y in range(height):
        for x in range(width):
            for k in range(3):
                value = signal[y, x, k] * gain[y, x]
                variance = read_variance + shot_variance * min(max(value, _ZERO), _ONE)
                value += np.float32(sqrt(variance)) * noise[y, x, k]
                if contrast != _ONE:
                    value = _MIDDLE_GREY * (max(value, _ZERO) / _MIDDLE_GREY) ** contrast
                out[y, x, k] = srgb[int(min(max(value, _ZERO), _ONE) * _FULL_SCALE + _HALF)]
