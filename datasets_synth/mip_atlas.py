"""All textures of a scene, with smaller copies of each, in one picture that is sampled in one call.

Mip levels keep a far texture from aliasing; aliasing would differ between the two eyes and spoil stereo.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synth.sampling import sample_bilinear

FloatArray = NDArray[np.float32]

MAX_TEXTURE_PX = 1024
"""Larger textures are halved first: no object covers more of a picture than this."""
MAX_SHELF_ROWS = 16384
"""cv2.remap refuses pictures of 32,767 rows or more; taller stacks continue in a new column."""


@dataclass(frozen=True, eq=False)
class MipAtlas:
    """Textures and their mip levels in one sRGB picture, each level with a wrapped border of one texel."""

    picture: NDArray[np.uint8]
    """Shape (rows, columns, 3), sRGB."""
    level_box: NDArray[np.int32]
    """Shape (n_textures, n_levels, 4): left, top, width, height of each level without its border.

    Levels beyond the smallest of a texture repeat it.
    """

    def sample(self, texture: NDArray[np.int32], uv: FloatArray, level: FloatArray) -> FloatArray:
        """Linear colours (n, 3), interpolated between texels and between levels.

        Args:
            texture: Index of the texture, shape (n,).
            uv: Texture coordinates (n, 2), repeating outside [0, 1]; v = 1 is the top row.
            level: Mip level (n,), 0 for the full texture; clipped to the levels there are.
        """
        level = np.clip(level, 0, self.level_box.shape[1] - 1).astype(np.float32)
        coarse_share = level - np.floor(level)
        lower = level.astype(np.int32)
        upper = np.minimum(lower + 1, self.level_box.shape[1] - 1)
        fraction = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
        fraction -= np.floor(fraction)
        fine = self._bilinear(self.level_box[texture, lower], fraction)
        coarse = self._bilinear(self.level_box[texture, upper], fraction)
        return fine + coarse_share[:, None] * (coarse - fine)

    def _bilinear(self, box: NDArray[np.int32], fraction: FloatArray) -> FloatArray:
        """Linear colours at fractions (n, 2) of level boxes (n, 4), from 0 at the edge of the first texel."""
        xy = (box[:, :2] + fraction * box[:, 2:] - 0.5).astype(np.float32)
        return linear_from_srgb(sample_bilinear(self.picture, xy, cv2.BORDER_REPLICATE))


@lru_cache(maxsize=1)
def _linear_table() -> FloatArray:
    c = np.arange(256) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_from_srgb(srgb: NDArray[np.uint8]) -> FloatArray:
    """Linear colour in [0, 1] of sRGB bytes, same shape (IEC 61966-2-1)."""
    return np.asarray(np.take(_linear_table(), srgb))


@lru_cache(maxsize=1)
def _srgb_table() -> NDArray[np.uint8]:
    x = np.arange(65536) / 65535
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * encoded), np.uint8)


def srgb_from_linear(linear: FloatArray) -> NDArray[np.uint8]:
    """The sRGB bytes of linear colour, same shape; clipped to [0, 1]."""
    return np.take(_srgb_table(), (np.clip(linear, 0, 1) * 65535 + 0.5).astype(np.uint16))


def build_atlas(textures: Sequence[NDArray[np.uint8]]) -> MipAtlas:
    """The atlas of textures (h, w, 3) sRGB, in their order."""
    pyramids = [_pyramid(t) for t in textures]
    n_levels = max((len(p) for p in pyramids), default=1)
    box = np.ones((max(len(pyramids), 1), n_levels, 4), np.int32)
    shelf_x, shelf_y, shelf_width, rows = 0, 0, 0, 1
    for i, pyramid in enumerate(pyramids):
        height = pyramid[0].shape[0] + 2
        if shelf_y and shelf_y + height > MAX_SHELF_ROWS:
            shelf_x, shelf_y, shelf_width = shelf_x + shelf_width, 0, 0
        x = shelf_x
        for level in range(n_levels):
            h, w = pyramid[min(level, len(pyramid) - 1)].shape[:2]
            if level < len(pyramid):
                box[i, level] = x + 1, shelf_y + 1, w, h
                x += w + 2
            else:
                box[i, level] = box[i, level - 1]
        shelf_width = max(shelf_width, x - shelf_x)
        shelf_y += height
        rows = max(rows, shelf_y)
    picture = np.zeros((rows + 1, shelf_x + shelf_width + 3, 3), np.uint8)
    for i, pyramid in enumerate(pyramids):
        for level, texels in enumerate(pyramid):
            x, y, w, h = box[i, level]
            picture[y - 1 : y + h + 1, x - 1 : x + w + 1] = np.pad(
                texels, ((1, 1), (1, 1), (0, 0)), mode="wrap"
            )
    return MipAtlas(picture, box)


def _pyramid(texture: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """The texture and its halves down to one texel on the shorter side; averaged in linear light."""
    linear = np.take(_linear_16bit_table(), texture)  # 16 bits are enough to average, and quick
    while max(linear.shape[:2]) > MAX_TEXTURE_PX:
        linear = _half(linear)
    levels = [np.take(_srgb_table(), linear)]
    while min(linear.shape[:2]) > 1:
        linear = _half(linear)
        levels.append(np.take(_srgb_table(), linear))
    return levels


@lru_cache(maxsize=1)
def _linear_16bit_table() -> NDArray[np.uint16]:
    return np.asarray(np.rint(65535 * _linear_table()), np.uint16)


def _half(linear: NDArray[np.uint16]) -> NDArray[np.uint16]:
    h, w = linear.shape[:2]
    half = cv2.resize(linear, (max(w // 2, 1), max(h // 2, 1)), interpolation=cv2.INTER_AREA)
    return np.asarray(half, np.uint16)
