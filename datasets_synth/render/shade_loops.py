"""The loops of shading over rays, compiled: values at the corners of faces, textures, geometry of hits.

They round as whole arrays of numpy and OpenCV's ``remap`` do, so that pictures are the same bytes: no product
and sum is rounded at once, and texels are weighted by thirty-seconds.
"""

from math import floor, sqrt

import numpy as np

from recon.arrays import Float32Array, IntArray, UInt8Array
from recon.compiled import exact

_ZERO, _ONE, _HALF, _STEPS = np.float32(0), np.float32(1), np.float32(0.5), np.float32(32)
_SHORTEST = np.float32(1e-6)


@exact
def interpolate(
    corner_values: Float32Array, face: IntArray, barycentric: Float32Array, out: Float32Array
) -> None:
    """Write values (k, n) at hits, between the values (m, 3, k) at the corners of their faces."""
    for i in range(len(face)):
        corners = corner_values[face[i]]
        u, v = barycentric[i, 0], barycentric[i, 1]
        for k in range(len(out)):
            first = corners[0, k]
            out[k, i] = first + u * (corners[1, k] - first) + v * (corners[2, k] - first)


@exact
def turn_to_viewer(flat: Float32Array, smooth: Float32Array, view: Float32Array) -> None:
    """Turn geometric and smooth normals (3, n) to the side of the viewer, in place, the smooth ones at unit
    length."""
    for i in range(flat.shape[1]):
        x, y, z = flat[0, i], flat[1, i], flat[2, i]
        if x * view[0, i] + y * view[1, i] + z * view[2, i] > _ZERO:
            x, y, z = -x, -y, -z
            flat[0, i], flat[1, i], flat[2, i] = x, y, z
        a, b, c = smooth[0, i], smooth[1, i], smooth[2, i]
        length = max(np.float32(sqrt(a * a + b * b + c * c)), _SHORTEST)
        # the smooth normal lies on the side of the flat one
        by = (-_ONE if a * x + b * y + c * z < _ZERO else _ONE) / length
        smooth[0, i], smooth[1, i], smooth[2, i] = a * by, b * by, c * by


@exact
def _texel(picture: UInt8Array, corner: IntArray, weight: IntArray, channel: int) -> int:
    """The byte of one channel between four texels."""
    x0, y0, x1, y1 = corner
    total = weight[0] * picture[y0, x0, channel] + weight[1] * picture[y0, x1, channel]
    total += weight[2] * picture[y1, x0, channel] + weight[3] * picture[y1, x1, channel]
    return int((total + 512) >> 10)


@exact
def _rounded(value: float) -> int:
    """The nearest whole number, even where two are as near."""
    return int(np.rint(value))


@exact
def sample_mip(
    picture: UInt8Array,
    level_box: Float32Array,
    linear: Float32Array,
    at: IntArray,
    uv: Float32Array,
    level: Float32Array,
    out: Float32Array,
) -> None:
    """Write the linear colours (n, 3) of a texture at some points, between texels and between mip levels.

    Args:
        picture: ``MipTexture.picture``.
        level_box: ``MipTexture.level_box``.
        linear: linear light of each byte, shape (256,).
        at: which of the points lie on this texture.
        uv: coordinates (n, 2) of all points, repeating outside [0, 1]; v = 1 is the top row.
        level: mip level (n,), 0 or more.
        out: colours (n, 3).
    """
    coarsest = len(level_box) - 1
    corner = np.empty((2, 4), np.int64)
    weight = np.empty((2, 4), np.int64)
    for i in at:
        wanted = min(level[i], np.float32(coarsest))
        lower = int(wanted)
        share = np.float64(wanted) - lower
        x_share = uv[i, 0] - np.float32(floor(uv[i, 0]))
        y_flipped = _ONE - uv[i, 1]
        y_share = y_flipped - np.float32(floor(y_flipped))
        for k in range(2):
            box = level_box[min(lower + k, coarsest)]
            x32 = _rounded((box[0] + x_share * box[2] - _HALF) * _STEPS)
            y32 = _rounded((box[1] + y_share * box[3] - _HALF) * _STEPS)
            x, y, fx, fy = x32 >> 5, y32 >> 5, x32 & 31, y32 & 31
            x1 = min(max(x + 1, 0), picture.shape[1] - 1)
            y1 = min(max(y + 1, 0), picture.shape[0] - 1)
            x, y = min(max(x, 0), picture.shape[1] - 1), min(max(y, 0), picture.shape[0] - 1)
            corner[k, 0], corner[k, 1], corner[k, 2], corner[k, 3] = x, y, x1, y1
            weight[k, 0], weight[k, 1] = (32 - fx) * (32 - fy), fx * (32 - fy)
            weight[k, 2], weight[k, 3] = (32 - fx) * fy, fx * fy
        for channel in range(3):
            fine = linear[_texel(picture, corner[0], weight[0], channel)]
            coarse = linear[_texel(picture, corner[1], weight[1], channel)]
            out[i, channel] = np.float32(fine + share * np.float64(coarse - fine))
