import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.camera import PinholeCamera, StereoCamera
from recon.depth_map import DepthMap
from recon.errors import Failure, Reason
from rescore.evidence.align_depth import (
    AlignConfig,
    DepthAlignment,
    Normalisation,
    align_depth,
    depth_range,
    fit_scale_offset,
    measured_depth,
)

BOX = np.array([2.0, 3.0, 12.0, 9.0])
RANGE = AlignConfig(percentiles=(0.0, 100.0))
CONFIGS = [RANGE, *(AlignConfig(normalisation) for normalisation in Normalisation)]


def depth_map(values: np.ndarray, x0: int = 2, y0: int = 3) -> DepthMap:
    return DepthMap(x0, y0, values.astype(np.float32))


def picture(values: np.ndarray, x0: int = 2, y0: int = 3) -> np.ndarray:
    out = np.full((20, 30), np.nan, np.float32)
    out[y0 : y0 + values.shape[0], x0 : x0 + values.shape[1]] = values
    return out


def solved(outcome: DepthAlignment | Failure) -> DepthAlignment:
    assert isinstance(outcome, DepthAlignment), outcome
    return outcome


def test_exact_line_has_difference_zero() -> None:
    # Zs = 3 Zi + 5, box range 3 * 0 + 5 .. 3 * 9 + 5, so normalised Zs = Zi / 9: a1 = 1/9, a2 = 0
    z_i = np.tile(np.arange(10.0), (6, 1))
    got = solved(align_depth(depth_map(z_i), picture(3 * z_i + 5), BOX, RANGE))
    assert got.scale == pytest.approx(1 / 9, abs=1e-7)
    assert got.offset == pytest.approx(0, abs=1e-6)
    assert got.difference == pytest.approx(0, abs=1e-6)
    assert (got.stereo_low, got.stereo_span, got.valid_share) == (5.0, 27.0, 1.0)


def test_uncorrelated_prediction_leaves_the_spread_of_stereo() -> None:
    # columns 0, 1 alternate in the prediction, rows alternate 7 and 9 in stereo: covariance 0, so a1 = 0,
    # a2 = mean = 0.5, and D = standard deviation of {0, 1} in equal shares = 0.5, the largest there is
    z_i = np.tile([0.0, 1.0], (6, 5))
    z_s = np.where(np.arange(6)[:, None] % 2, 9.0, 7.0) * np.ones((1, 10))
    got = solved(align_depth(depth_map(z_i), picture(z_s), BOX, RANGE))
    assert (got.scale, got.offset, got.difference) == pytest.approx((0, 0.5, 0.5), abs=1e-12)


def test_equals_numpy_least_squares() -> None:
    rng = np.random.default_rng(3)
    z_i, z_s = rng.normal(10, 2, 400), rng.uniform(0, 1, 400)
    design = np.stack([z_i, np.ones(400)], axis=1)
    (scale, offset), (residual,), *_ = np.linalg.lstsq(design, z_s)
    assert fit_scale_offset(z_i, z_s) == pytest.approx((scale, offset, np.sqrt(residual / 400)), rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 50), st.floats(-100, 100), st.sampled_from(CONFIGS))
def test_difference_ignores_scale_and_offset_of_the_prediction(
    seed: int, a: float, b: float, config: AlignConfig
) -> None:
    rng = np.random.default_rng(seed)
    z_i, z_s = rng.uniform(5, 10, (6, 10)), rng.uniform(2, 40, (6, 10))
    before = solved(align_depth(depth_map(z_i), picture(z_s), BOX, config))
    after = solved(align_depth(depth_map(a * z_i + b), picture(z_s), BOX, config))
    # float32 of a value near 100 with a spread of 0.01 * 5 keeps three digits
    assert after.difference == pytest.approx(before.difference, abs=2e-4)
    assert 0 <= before.difference <= 0.5


@pytest.mark.parametrize("config", CONFIGS)
def test_difference_ignores_the_unit_of_stereo(config: AlignConfig) -> None:
    rng = np.random.default_rng(1)
    z_i, z_s = rng.uniform(5, 10, (6, 10)), rng.uniform(2, 40, (6, 10))
    metres = solved(align_depth(depth_map(z_i), picture(z_s), BOX, config))
    other = solved(align_depth(depth_map(z_i), picture(z_s * 0.013), BOX, config))
    assert other.difference == pytest.approx(metres.difference, abs=1e-5)


def test_percentiles_withstand_one_streak_and_the_range_does_not() -> None:
    rng = np.random.default_rng(0)
    z_i, z_s = rng.uniform(5, 10, (6, 10)), rng.uniform(8, 12, (6, 10))
    streak = z_s.copy()
    streak[0, 0] = 400.0
    by_range = [solved(align_depth(depth_map(z_i), picture(z), BOX, RANGE)).difference for z in (z_s, streak)]
    robust = [
        solved(align_depth(depth_map(z_i), picture(z), BOX, AlignConfig())).difference for z in (z_s, streak)
    ]
    assert by_range[1] < 0.6 * by_range[0]
    assert robust[1] == pytest.approx(robust[0], rel=0.1)


def test_constant_prediction_fits_the_mean() -> None:
    z_s = np.random.default_rng(0).uniform(4, 9, (6, 10))
    got = solved(align_depth(depth_map(np.full((6, 10), 123.4)), picture(z_s), BOX, RANGE))
    normalised = (z_s - z_s.min()) / np.ptp(z_s)
    assert got.scale == 0
    assert got.difference == pytest.approx(normalised.std(), abs=1e-6)


def test_constant_stereo_has_difference_zero() -> None:
    z_i = np.random.default_rng(0).uniform(4, 9, (6, 10))
    got = solved(align_depth(depth_map(z_i), picture(np.full((6, 10), 7.0)), BOX, AlignConfig()))
    assert (got.scale, got.difference, got.stereo_span) == (0, 0, 0)


def test_holes_and_pixels_outside_the_box_are_left_out() -> None:
    z_i = np.tile(np.arange(14.0), (8, 1))  # window from (1, 2): one pixel wider than the box on each side
    z_s = 2 * z_i + 1
    z_s[:, [0, -3, -2, -1]] = 999.0  # columns 1 and 12, 13, 14 of the picture: outside the box [2, 12)
    z_s[[0, -1]] = -50.0  # rows 2 and 9: outside [3, 9)
    z_s[2:4, 4] = np.nan
    got = solved(align_depth(depth_map(z_i, 1, 2), picture(z_s, 1, 2), BOX, RANGE))
    assert got.difference == pytest.approx(0, abs=1e-6)
    assert got.valid_share == pytest.approx(58 / 60)  # 10 x 6 pixels less two holes


def test_too_little_stereo_is_a_reason() -> None:
    z_s = np.full((6, 10), np.nan)
    z_s[0, :] = 5.0
    few = align_depth(depth_map(np.ones((6, 10))), picture(z_s), BOX, AlignConfig())
    assert isinstance(few, Failure)
    assert few.reason is Reason.NO_STEREO
    assert "at least 30 measured pixels" in few.detail
    assert "got 10 of 60" in few.detail
    share = align_depth(
        depth_map(np.ones((6, 10))), picture(z_s), BOX, AlignConfig(min_valid_px=5, min_valid_share=0.2)
    )
    assert isinstance(share, Failure)  # 10 of 60 is less than 0.2
    assert isinstance(
        align_depth(depth_map(np.full((6, 10), np.nan)), picture(z_s), BOX, AlignConfig()), Failure
    )


def test_measured_depth_with_and_without_camera() -> None:
    disparity = np.array([[10.0, np.nan, 0.0]], np.float32)
    camera = StereoCamera(PinholeCamera(500, 500, 1, 1, 3, 1), 0.2)
    # 500 * 0.2 / 10 = 10 m; without a camera 1 / 10
    np.testing.assert_allclose(measured_depth(disparity, camera), [[10, np.nan, np.nan]])
    np.testing.assert_allclose(measured_depth(disparity, None), [[0.1, np.nan, np.nan]])


def test_depth_range_of_a_picture() -> None:
    values = np.arange(101, dtype=np.float32)
    assert depth_range(np.append(values, np.nan), (2, 98)) == pytest.approx((2, 98))
    assert depth_range(np.full((2, 2), np.nan, np.float32), (2, 98)) == (0, 0)
