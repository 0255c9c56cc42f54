from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.render.imaging import expose, rectification_shift, vignette
from recon.pixels import linear_from_srgb
from tests.datasets_synth.simple_scenes import CLEAN

SHAPE = (240, 320, 3)


def flat(level):
    return np.full(SHAPE, level, np.float32)


def linear_picture(radiance, imaging, eye=0, seed=0):
    return linear_from_srgb(expose(radiance, imaging, eye, np.random.default_rng(seed)))


def test_noise_has_the_stated_mean_and_variance():
    # variance = read^2 + shot^2 * signal = 0.01^2 + 0.03^2 * 0.3 = 3.7e-4; one byte at 0.3 is 0.0037 wide
    picture = linear_picture(flat(0.3), replace(CLEAN, read_noise=0.01, shot_noise=0.03))
    assert picture.mean() == pytest.approx(0.3, abs=5e-4)
    assert picture.var() == pytest.approx(3.7e-4 + 0.0037**2 / 12, rel=0.02)


def test_shot_noise_grows_with_the_signal_and_read_noise_does_not():
    shot = replace(CLEAN, shot_noise=0.03)
    read = replace(CLEAN, read_noise=0.03)
    ratio = {
        n: linear_picture(flat(0.8), i).std() / linear_picture(flat(0.2), i).std()
        for n, i in (("shot", shot), ("read", read))
    }
    assert ratio["shot"] == pytest.approx(2.0, rel=0.03)  # root of 4
    assert ratio["read"] == pytest.approx(1.0, rel=0.03)


def test_noise_of_the_two_eyes_and_channels_is_independent():
    imaging = replace(CLEAN, read_noise=0.02)
    rng = np.random.default_rng(3)
    left, right = (linear_from_srgb(expose(flat(0.4), imaging, eye, rng)) for eye in (0, 1))
    channels = np.stack([left[..., 0], left[..., 1], right[..., 0]]).reshape(3, -1)
    correlation = np.corrcoef(channels)
    assert np.abs(correlation - np.eye(3)).max() < 0.02  # 3 / sqrt(76800) = 0.011


def test_exposure_scales_each_eye():
    imaging = replace(CLEAN, exposure=(0.5, 0.6))
    left, right = (linear_picture(flat(0.7), imaging, eye).mean() for eye in (0, 1))
    assert left == pytest.approx(0.35, rel=0.01)
    assert right / left == pytest.approx(1.2, rel=0.01)


def test_more_light_than_full_scale_saturates():
    picture = expose(flat(2.0), replace(CLEAN, read_noise=0.01), 0, np.random.default_rng(0))
    assert (picture == 255).all()


def test_vignetting_is_quadratic_in_the_radius():
    share = vignette(241, 321, 0.4)
    assert share[120, 160] == pytest.approx(1.0)
    assert share[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(0.6, abs=1e-6)
    # the end of the half width 160 is at 160 / 200 = 0.8 of the radius of the corner (120, 160)
    assert share[120, 0] == pytest.approx(1 - 0.4 * 0.64, abs=2e-3)


@pytest.mark.parametrize("sigma_px", [0.7, 1.5])
def test_blur_has_its_standard_deviation(sigma_px):
    # the slope of a blurred step is the kernel: its second moment is sigma^2
    step = flat(0.2)
    step[:, 160:] = 0.8
    row = linear_picture(step, replace(CLEAN, blur_sigma_px=(sigma_px, 0.0)))[120, :, 0]
    kernel = np.diff(row.astype(float))
    kernel /= kernel.sum()
    x = np.arange(len(kernel)) - 159.0
    assert np.sqrt((kernel * x * x).sum()) == pytest.approx(sigma_px, rel=0.1)
    sharp = linear_picture(step, replace(CLEAN, blur_sigma_px=(sigma_px, 0.0)), eye=1)[120, :, 0]
    assert sharp[159] == pytest.approx(0.2, abs=0.01)


def test_rectification_shift_is_an_offset_and_a_small_roll():
    imaging = replace(CLEAN, rectification_error_px=(0.3, 0.5))
    middle = np.array([[319.5, 239.5]], np.float32)
    right_end = np.array([[639.5, 239.5]], np.float32)
    # the ray of a pixel is that of the ideal pixel 0.3 higher; at the end of the half width 0.5 more
    np.testing.assert_allclose(rectification_shift(middle, imaging, 640, 480), [[319.5, 239.2]], atol=1e-4)
    np.testing.assert_allclose(rectification_shift(right_end, imaging, 640, 480), [[639.5, 238.7]], atol=1e-4)
    # a roll moves columns too: 240 px below the middle by 0.5 / 320 * 240 = 0.375
    low = np.array([[319.5, 479.5]], np.float32)
    np.testing.assert_allclose(rectification_shift(low, imaging, 640, 480)[0, 0], 319.875, atol=1e-4)
