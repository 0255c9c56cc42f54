"""Textures with smaller copies of themselves, sampled at the level that suits the size of a pixel.

Mip levels keep a far texture from aliasing; aliasing would differ between the two eyes and spoil stereo.
"""

import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, UInt8Array
from recon.pixels import (
    linear_16bit_from_srgb,
    linear_of_bytes,
    srgb_from_linear_16bit,
)

MAX_TEXTURE_PX = 1024
"""Larger textures are halved first: no object covers more of a picture than this."""


@dataclass(frozen=True, eq=False)
class MipTexture:
    """A texture and its mip levels side by side in one picture, each with a wrapped border of one texel."""

    picture: UInt8Array
    """Shape (rows, columns, 3), sRGB."""
    level_box: Float32Array
    """Shape (n_levels, 4): left, top, width, height of each level without its border."""

    def sample(self, uv: Float32Array, level: Float32Array) -> Float32Array:
        """Linear colours (n, 3), interpolated between texels and between levels.

        Args:
            uv: Texture coordinates (n, 2), repeating outside [0, 1]; v = 1 is the top row.
            level: Mip level (n,), 0 for the full texture; clipped to the levels there are.
        """
        colour = np.ones((len(uv), 3), np.float32)
        self.tint(np.arange(len(uv)), uv, level, colour)
        return colour

    def tint(
        self, at: NDArray[np.int64], uv: Float32Array, level: Float32Array, colour: Float32Array
    ) -> None:
        """Multiply some of n colours, rows ``at`` of ``colour`` (n, 3), by what ``sample`` gives them."""
        from datasets_synth.render.shade_loops import tint_by_mip  # noqa: PLC0415 (half a second to import)

        tint_by_mip(self.picture, self.level_box, linear_of_bytes(), at, uv, level, colour)


def tint_by_textures(
    textures: Sequence[MipTexture],
    order: NDArray[np.int64],
    ends: NDArray[np.int64],
    uv: Float32Array,
    level: Float32Array,
    colour: Float32Array,
) -> None:
    """Multiply colours (n, 3) of points that lie on different textures by these.

    Args:
        textures: The textures.
        order: The points that lie on textures, those of one texture side by side.
        ends: Where those of each texture begin in ``order``, and of the last end.
        uv: Texture coordinates (n, 2).
        level: Mip levels (n,).
        colour: What is multiplied.
    """
    for i, texture in enumerate(textures):
        if ends[i] < ends[i + 1]:
            texture.tint(order[ends[i] : ends[i + 1]], uv, level, colour)


_known: dict[int, tuple[weakref.ref[UInt8Array], MipTexture]] = {}


def mip_texture(texture: UInt8Array) -> MipTexture:
    """The mip levels of a texture (h, w, 3) sRGB, which must not be changed afterwards.

    They are kept as long as the texture lives, since scenes share textures.
    """
    key = id(texture)
    if key in _known and _known[key][0]() is texture:
        return _known[key][1]
    built = _build(texture)
    _known[key] = weakref.ref(texture, lambda _: _known.pop(key, None)), built
    return built


def _build(texture: UInt8Array) -> MipTexture:
    pyramid = _pyramid(texture)
    width = sum(t.shape[1] + 2 for t in pyramid)
    picture = np.zeros((pyramid[0].shape[0] + 2, width, 3), np.uint8)
    box = np.empty((len(pyramid), 4), np.float32)
    x = 0
    for level, texels in enumerate(pyramid):
        h, w = texels.shape[:2]
        picture[: h + 2, x : x + w + 2] = np.pad(texels, ((1, 1), (1, 1), (0, 0)), mode="wrap")
        box[level] = x + 1, 1, w, h
        x += w + 2
    return MipTexture(picture, box)


def _pyramid(texture: UInt8Array) -> list[UInt8Array]:
    """The texture and its halves down to one texel on the shorter side; averaged in linear light."""
    linear = linear_16bit_from_srgb(texture)
    while max(linear.shape[:2]) > MAX_TEXTURE_PX:
        linear = _half(linear)
    levels = [srgb_from_linear_16bit(linear)]
    while min(linear.shape[:2]) > 1:
        linear = _half(linear)
        levels.append(srgb_from_linear_16bit(linear))
    return levels


def _half(linear: NDArray[np.uint16]) -> NDArray[np.uint16]:
    h, w = linear.shape[:2]
    half = cv2.resize(linear, (max(w // 2, 1), max(h // 2, 1)), interpolation=cv2.INTER_AREA)
    return np.asarray(half, np.uint16)
