"""The compiled loops over pixels give the bits of whole arrays of numpy."""

import numpy as np
import pytest

from datasets_synth.render.picture_loops import expose_pixels, mark_edges, mix
from recon.pixels import bytes_of_linear_16bit, srgb_from_linear

HEIGHT, WIDTH = 60, 80
N = HEIGHT * WIDTH


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize("contrast", [1, 1.4])
def test_exposure(rng: np.random.Generator, contrast: float) -> None:
    signal, noise = rng.standard_normal((2, HEIGHT, WIDTH, 3)).astype(np.float32)
    gain, power = rng.random((HEIGHT, WIDTH), np.float32), np.float32(contrast)
    read, shot = np.float32(1e-4), np.float32(2e-3)
    rgb = np.empty(signal.shape, np.uint8)
    expose_pixels(signal, gain, noise, read, shot, power, bytes_of_linear_16bit(), rgb)
    value = signal * gain[..., None]
    value += np.sqrt(read + shot * np.clip(value, 0, 1)) * noise
    grey = np.float32(0.18)
    if contrast != 1:
        value = grey * (np.clip(value, 0, None) / grey) ** power
    np.testing.assert_array_equal(rgb, srgb_from_linear(value))


def test_edges(rng: np.random.Generator) -> None:
    key = (rng.random(N) < 0.05).astype(np.int64)
    normal = np.array([0, 0, 1], np.float32) + rng.normal(0, 0.2, (N, 3)).astype(np.float32)
    t = (10 + rng.normal(0, 0.3, N)).astype(np.float32)
    t[::50] = np.inf
    edge = np.empty(N, np.bool_)
    mark_edges(key, normal, t, WIDTH, np.empty(N, np.float32), edge)

    shape, expected = (HEIGHT, WIDTH), np.zeros((HEIGHT, WIDTH), np.bool_)
    keys, normals, inverse = key.reshape(shape), normal.reshape(*shape, 3), (1 / t).reshape(shape)
    everything, before, after = slice(None), slice(None, -1), slice(1, None)
    for a, b in (((before, everything), (after, everything)), ((everything, before), (everything, after))):
        jump = (keys[a] != keys[b]) | (np.einsum("ijk,ijk->ij", normals[a], normals[b]) < 0.85)
        jump |= np.abs(inverse[a] - inverse[b]) > 0.1 * np.maximum(inverse[a], inverse[b])
        expected[a] |= jump
        expected[b] |= jump
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(edge.reshape(shape), expected)


@pytest.mark.parametrize("with_centre", [False, True])
def test_finer_rays_are_averaged(rng: np.random.Generator, with_centre: bool) -> None:
    colour, fine = rng.random((N, 3), np.float32), rng.random((4 * N // 2, 3), np.float32)
    edge, total = np.arange(0, N, 2), fine.reshape(-1, 4, 3).sum(axis=1)
    expected = colour.copy()
    expected[edge] = (colour[edge] + total) / np.float32(5) if with_centre else total / np.float32(4)
    mix(edge, fine, 4, with_centre, colour)
    np.testing.assert_array_equal(colour, expected)
