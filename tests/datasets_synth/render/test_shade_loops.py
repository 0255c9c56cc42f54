"""The compiled loops of shading give the bits of whole arrays of numpy and OpenCV."""

import cv2
import numpy as np
import pytest

from datasets_synth.render.mip_textures import MipTexture, mip_texture
from datasets_synth.render.shade_loops import interpolate, turn_to_viewer
from recon.pixels import linear_from_srgb, sample_bilinear

N = 20_000


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def sampled_by_arrays(texture: MipTexture, uv: np.ndarray, level: np.ndarray) -> np.ndarray:
    coarsest = len(texture.level_box) - 1
    level = np.clip(level, 0, coarsest).astype(np.float32)
    lower = level.astype(np.intp)
    fraction = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
    fraction -= np.floor(fraction)

    def bilinear(at: np.ndarray) -> np.ndarray:
        box = texture.level_box[at]
        xy = box[:, :2] + fraction * box[:, 2:] - np.float32(0.5)
        return linear_from_srgb(sample_bilinear(texture.picture, xy, cv2.BORDER_REPLICATE))

    fine = bilinear(lower)
    mixed = fine + (level - lower)[:, None] * (bilinear(np.minimum(lower + 1, coarsest)) - fine)
    return mixed.astype(np.float32)


@pytest.mark.parametrize("shape", [(64, 48, 3), (1, 7, 3), (300, 1100, 3)])
def test_textures(rng: np.random.Generator, shape: tuple[int, int, int]) -> None:
    texture = mip_texture(rng.integers(0, 256, shape).astype(np.uint8))
    uv = (20 * rng.random((N, 2)) - 10).astype(np.float32)
    uv[:4] = [[0, 0], [1, 1], [0.5, -1], [-1e-9, 1 + 1e-7]]
    level = (12 * rng.random(N)).astype(np.float32)
    level[: N // 4] = 0
    np.testing.assert_array_equal(texture.sample(uv, level), sampled_by_arrays(texture, uv, level))


def test_values_between_corners(rng: np.random.Generator) -> None:
    corners = rng.standard_normal((50, 3, 2)).astype(np.float32)
    face, weights = rng.integers(0, 50, N), rng.random((N, 2), np.float32)
    out = np.empty((2, N), np.float32)
    interpolate(corners, face, weights, out)
    first, second, third = (corners[face, i].T for i in range(3))
    u, v = weights.T
    np.testing.assert_array_equal(out, first + u * (second - first) + v * (third - first))


def test_normals_on_the_side_of_the_viewer(rng: np.random.Generator) -> None:
    flat, smooth, view = rng.standard_normal((3, 3, N)).astype(np.float32)
    smooth[:, 0] = 0
    turned, unit = flat.copy(), smooth.copy()
    turn_to_viewer(turned, unit, view)

    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    np.testing.assert_array_equal(turned, flat * np.where(dot(flat, view) > 0, -1, 1).astype(np.float32))
    length = np.maximum(np.sqrt(dot(smooth, smooth)), np.float32(1e-6))
    sign = np.where(dot(smooth, turned) < 0, np.float32(-1), np.float32(1))
    np.testing.assert_array_equal(unit, smooth * (sign / length))
    assert (dot(turned, view) <= 0).all()
