import numpy as np
import pytest

from datasets_synth.meshes.textures import TEXTURE_KINDS, fractal_noise, lettering, texture


def test_fractal_noise_has_zero_mean_unit_spread_and_tiles() -> None:
    noise = fractal_noise(np.random.default_rng(0), 128)
    assert noise.shape == (128, 128)
    assert abs(float(noise.mean())) < 1e-5
    assert float(noise.std()) == pytest.approx(1.0, abs=1e-5)
    # across the seam neighbours differ no more than neighbours inside do
    seam = np.abs(noise[:, 0] - noise[:, -1]).mean()
    inside = np.abs(np.diff(noise, axis=1)).mean()
    assert seam < 1.5 * inside


@pytest.mark.parametrize("kind", TEXTURE_KINDS)
def test_every_texture_is_a_picture_with_contrast(kind: str) -> None:
    picture = texture(kind, 0)
    assert picture.dtype == np.uint8
    assert picture.ndim == 3
    assert picture.shape[2] == 3
    assert picture.std() > 2
    assert not picture.flags.writeable  # it is shared by every scene of the process


def test_a_variant_is_always_the_same_picture_and_variants_differ() -> None:
    first = texture("bricks", 3).copy()
    texture.cache_clear()
    assert np.array_equal(texture("bricks", 3), first)
    assert not np.array_equal(texture("bricks", 2), first)


def test_lettering_fills_the_strip_with_ink_that_stands_out() -> None:
    strip = lettering(np.random.default_rng(1), 200, 40)
    assert strip.shape == (40, 200, 3)
    ground = strip[0, 0].astype(int)
    inked = np.abs(strip.astype(int) - ground).sum(axis=2) > 100
    assert 0.02 < inked.mean() < 0.6
