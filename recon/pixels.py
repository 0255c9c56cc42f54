"""Values of pixels: look-up between them, sRGB and linear light, and the gradient of a smoothed picture."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array

_COLUMNS = 1024
_ROWS = 16384
"""cv2.remap refuses 32,767 rows or columns, so a list is folded, and what is very long is cut."""


def sample_bilinear(
    picture: NDArray[Any],
    xy: FloatArray | Float32Array,
    border: int,
    border_value: float | Sequence[float] = 0.0,
) -> NDArray[Any]:
    """Values of a picture at points, in the picture's type: the shape of the points, then any channels.

    Args:
        picture: Shape (h, w) or (h, w, channels), uint8 or float32; h and w below 32,767.
        xy: Points, a list (n, 2) or a grid (rows, columns, 2) of fewer than 32,767 columns: column and row,
            whole numbers at the centres of the picture's pixels. OpenCV rounds them to 1/32 pixel.
        border: One of cv2.BORDER_*: what lies outside.
        border_value: With BORDER_CONSTANT: of a picture without channels, or of each channel.
    """
    shape = (*xy.shape[:-1], *picture.shape[2:])
    if xy.size == 0:
        return np.zeros(shape, picture.dtype)
    grid = xy.astype(np.float32) if xy.ndim == 3 else _folded(xy)
    parts = [
        cv2.remap(
            picture,
            grid[i : i + _ROWS, :, 0],
            grid[i : i + _ROWS, :, 1],
            cv2.INTER_LINEAR,
            borderMode=border,
            borderValue=border_value,
        )
        for i in range(0, len(grid), _ROWS)
    ]
    return np.concatenate(parts).reshape(-1, *picture.shape[2:])[: xy.size // 2].reshape(shape)


def sample_nearest(picture: NDArray[Any], column: NDArray[Any], row: NDArray[Any]) -> FloatArray:
    """Values of the pixels of a picture (h, w), NaN outside it; the shape that columns and rows broadcast to.

    For what must not be mixed, as values across a depth edge.
    """
    h, w = picture.shape
    there = (column >= 0) & (column < w) & (row >= 0) & (row < h)
    return np.where(there, picture[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)].astype(float), np.nan)


def _folded(xy: FloatArray | Float32Array) -> Float32Array:
    """A list of points (n, 2) as a grid (rows, ``_COLUMNS``, 2), filled up with zeros."""
    folded = np.zeros((-(-len(xy) // _COLUMNS) * _COLUMNS, 2), np.float32)
    folded[: len(xy)] = xy
    return folded.reshape(-1, _COLUMNS, 2)


def linear_from_srgb(rgb: UInt8Array) -> Float32Array:
    """Linear light in [0, 1] of sRGB bytes, same shape."""
    return np.asarray(linear_of_bytes()[rgb])


def srgb_from_linear(linear: Float32Array) -> UInt8Array:
    """The sRGB bytes of linear light, same shape; clipped to [0, 1]."""
    return srgb_from_linear_16bit((np.clip(linear, 0, 1) * 65535 + 0.5).astype(np.uint16))


def linear_16bit_from_srgb(rgb: UInt8Array) -> NDArray[np.uint16]:
    """Linear light in [0, 65535] of sRGB bytes, same shape: enough to average, and quick."""
    return np.asarray(_linear_16bit_of_bytes()[rgb])


def srgb_from_linear_16bit(linear: NDArray[np.uint16]) -> UInt8Array:
    """The sRGB bytes of linear light in [0, 65535], same shape."""
    return np.take(bytes_of_linear_16bit(), linear)


def linear_from_encoded(srgb: FloatArray) -> FloatArray:
    """Linear light in [0, 1] of sRGB values in [0, 1], same shape (IEC 61966-2-1)."""
    return np.asarray(np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4))


@lru_cache(maxsize=1)
def linear_of_bytes() -> Float32Array:
    """Linear light in [0, 1] of each sRGB byte, shape (256,)."""
    return linear_from_encoded(np.arange(256) / 255).astype(np.float32)


@lru_cache(maxsize=1)
def _linear_16bit_of_bytes() -> NDArray[np.uint16]:
    return np.asarray(np.rint(65535 * linear_of_bytes()), np.uint16)


@lru_cache(maxsize=1)
def bytes_of_linear_16bit() -> UInt8Array:
    """The sRGB byte of each linear light in [0, 65535], shape (65536,)."""
    x = np.arange(65536) / 65535
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * encoded), np.uint8)


def smooth_gradient(window: Float32Array, sigma_px: float) -> tuple[Float32Array, Float32Array]:
    """Change a pixel to the right and downwards of a window (h, w, c), each of shape (h, w, c).

    Args:
        window: colours.
        sigma_px: standard deviation of the Gaussian before.
    """
    smooth = cv2.GaussianBlur(window, (0, 0), sigma_px)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return np.asarray(dx, np.float32), np.asarray(dy, np.float32)
