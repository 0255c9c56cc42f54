"""The pair that would measure as finely as a depth camera: depth of a pair gives its baseline back."""

import numpy as np
import pytest

from recon.arrays import Float32Array
from recon.camera import GroundPlane, PinholeCamera, StereoCamera
from recon.stereo.depth_noise import LIMITS_M, MATCHER_NOISE_PX, equivalent_pair, local_noise
from recon.stereo.sgbm import SgbmConfig, compute_disparity

CAMERA = PinholeCamera(600, 600, 320, 180, 640, 360)
NOISE_PX = MATCHER_NOISE_PX / 1.26
"""White noise of disparity that counts as much as a matcher's, by ``local_noise``."""


def street() -> Float32Array:
    """Depth of a street up to a house at 30 m, with a car-sized board at 8 m."""
    u, v = np.meshgrid(np.arange(640.0), np.arange(360.0))
    ground = GroundPlane(1.6, 0.02, 0.01).intersect(CAMERA.rays(np.stack([u, v], axis=-1)))[..., 2]
    depth = np.fmin(ground, 30 + 0.01 * u)
    depth[150:260, 200:400] = np.minimum(depth[150:260, 200:400], 8)
    return depth.astype(np.float32)


def measured(baseline_m: float, step_px: float = 0.0) -> Float32Array:
    """Depth of the street by a pair with a matcher's noise, its disparity rounded to steps."""
    pair = StereoCamera(CAMERA, baseline_m)
    noise = np.random.default_rng(0).normal(0, NOISE_PX, (360, 640))
    disparity = pair.disparity_px(street()) + noise
    return pair.depth_m(np.round(disparity / step_px) * step_px if step_px else disparity)


@pytest.mark.parametrize("baseline_m", [0.05, 0.12, 0.35, 0.54, 1.2])
@pytest.mark.parametrize("step_px", [0, 1 / 16])
def test_the_baseline_of_a_pair_comes_back(baseline_m: float, step_px: float) -> None:
    depth = measured(baseline_m, step_px)
    assert equivalent_pair(depth, CAMERA).baseline_m == pytest.approx(baseline_m, rel=0.05)
    in_millimetres = np.round(depth * 1000).astype(np.float32) / np.float32(1000)
    assert equivalent_pair(in_millimetres, CAMERA).baseline_m == pytest.approx(baseline_m, rel=0.06)


def test_half_the_picture_and_holes_tell_as_much() -> None:
    depth = measured(0.35)
    depth[np.random.default_rng(1).random(depth.shape) < 0.3] = np.nan
    depth[:, :320] = np.nan
    assert equivalent_pair(depth, CAMERA).baseline_m == pytest.approx(0.35, rel=0.08)


def test_a_picture_twice_as_large_has_the_same_pair() -> None:
    """Noise in pixels grows with the focal length for the same noise of depth."""
    depth = street() + np.random.default_rng(0).normal(0, 0.1, (360, 640)).astype(np.float32)
    one = equivalent_pair(depth, CAMERA).baseline_m
    double = PinholeCamera(1200, 1200, 640, 360, 1280, 720)
    assert equivalent_pair(depth, double).baseline_m == pytest.approx(one / 2, rel=1e-6)


def test_exact_depth_has_the_largest_and_coarse_steps_count_as_noise() -> None:
    exact = street()
    assert equivalent_pair(exact, CAMERA).baseline_m == LIMITS_M[1]
    # most neighbours of whole pixels of disparity are equal, and half a pixel off
    whole = equivalent_pair(measured(0.35, 1.0), CAMERA).baseline_m
    assert whole == pytest.approx(0.35 * MATCHER_NOISE_PX * np.sqrt(12) / 1.26, rel=0.1)
    # steps of half a metre are steps of 0.5 fx / Z^2 pixels for a metre of baseline
    coarse = np.round(exact * 2) / 2
    step_px = 0.5 * 600 / np.nanmedian(coarse) ** 2
    expected = NOISE_PX * np.sqrt(12) / step_px
    assert equivalent_pair(coarse, CAMERA).baseline_m == pytest.approx(expected, rel=0.02)


def test_what_tells_nothing_has_the_least() -> None:
    nothing = np.full((360, 640), np.nan, np.float32)
    assert equivalent_pair(nothing, CAMERA).baseline_m == LIMITS_M[0]
    points = nothing.copy()
    points[::7, ::7] = 10
    assert equivalent_pair(points, CAMERA).baseline_m == LIMITS_M[0]


def test_the_matcher_has_about_that_noise() -> None:
    """A textured board, turned away, seen by two eyes that differ by a little noise."""
    rng = np.random.default_rng(0)
    texture = rng.uniform(0, 255, (200, 700))
    texture = (texture + np.roll(texture, 1, 0) + np.roll(texture, 1, 1)) / 3
    shift = 8 + 0.02 * np.arange(500)
    columns = np.arange(500) + shift
    left = texture[:, 40:540]
    right = np.stack([np.interp(40 + columns, np.arange(700), row) for row in texture])
    eyes = [np.clip(e + rng.normal(0, 4, e.shape), 0, 255).astype(np.uint8) for e in (left, right)]
    disparity = compute_disparity(*(np.repeat(e[..., None], 3, axis=2) for e in eyes), SgbmConfig(32))
    assert local_noise(disparity) == pytest.approx(MATCHER_NOISE_PX, rel=0.8)
