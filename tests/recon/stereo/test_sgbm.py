import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from recon.camera import PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.stereo import sgbm
from recon.stereo.sgbm import (
    SgbmConfig,
    compute_disparity,
    disparities_to_reach,
    disparity_of_scene,
    read_disparity,
    write_disparity,
)

NAN = np.nan
SMALL = SgbmConfig(num_disparities=32)


def noise_pair(disparity_px=12, height=100, width=200, seed=0):
    """A right picture and its left one, which shows everything further right."""
    rng = np.random.default_rng(seed)
    grey = cv2.GaussianBlur(
        rng.integers(0, 256, (height, width + disparity_px)).astype(np.float32), (0, 0), 1.0
    )
    grey = np.clip((grey - 128) * 3 + 128, 0, 255).astype(np.uint8)
    rgb = np.repeat(grey[..., None], 3, axis=2)
    left, right = rgb[:, : width + disparity_px][:, :width], rgb[:, disparity_px:]
    return np.ascontiguousarray(left), np.ascontiguousarray(right)


def test_shifted_noise_has_the_disparity_of_the_shift():
    left, right = noise_pair(12)
    disparity = compute_disparity(left, right, SMALL)
    assert disparity.dtype == np.float32
    inside = disparity[5:-5, 16:-5]
    assert np.isfinite(inside).mean() > 0.95
    assert np.nanmax(np.abs(inside - 12)) < 0.5


def test_swapped_eyes_measure_chance_matches_only():
    left, right = noise_pair(12)
    assert np.isfinite(compute_disparity(left, right, SMALL)).mean() > 0.85
    assert np.isfinite(compute_disparity(right, left, SMALL)).mean() < 0.3


def test_left_border_is_measured_where_it_has_a_match():
    # bare SGBM leaves the first 32 columns empty; here only the 12 whose match lies outside the right picture
    left, right = noise_pair(12)
    bare = cv2.StereoSGBM.create(0, 32, 5, 200, 800).compute(left[..., 0], right[..., 0])
    assert (bare[:, :32] < 0).all()
    disparity = compute_disparity(left, right, SMALL)
    assert np.isfinite(disparity[5:-5, 16:32]).mean() > 0.95
    assert np.isnan(disparity[:, 0]).all()


def test_no_match_lies_outside_the_right_picture():
    left, right = noise_pair(24)
    disparity = compute_disparity(left, right, SMALL)
    column = np.broadcast_to(np.arange(disparity.shape[1]), disparity.shape)
    measured = np.isfinite(disparity)
    assert (column[measured] - disparity[measured] >= 0).all()
    assert (disparity[measured] > 0).all()


def test_matching_is_repeatable_with_any_number_of_threads():
    left, right = noise_pair(12)
    first = compute_disparity(left, right, SMALL)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        again = compute_disparity(left, right, SMALL)
    finally:
        cv2.setNumThreads(threads)
    assert first.tobytes() == again.tobytes()


def test_pictures_without_texture_have_no_disparity():
    grey = np.full((60, 120, 3), 128, np.uint8)
    assert np.isnan(compute_disparity(grey, grey, SMALL)).all()


def wall_before_a_wall(near_px, far_px=8, height=160, width=720):
    """A pair of a far wall, with a near one before its middle."""
    left, right = noise_pair(far_px, height, width)
    near, seen = noise_pair(near_px, height, width, seed=1)
    left[40:120, 300:500] = near[40:120, 300:500]
    right[40:120, 300 - near_px : 500 - near_px] = seen[40:120, 300 - near_px : 500 - near_px]
    return left, right


@pytest.mark.parametrize(("near_px", "asked"), [(20, 64), (61, 80), (110, 128), (150, 176), (190, 208)])
def test_a_wide_search_goes_no_farther_than_the_nearest_surface(near_px, asked, monkeypatch):
    left, right = wall_before_a_wall(near_px)
    whole = compute_disparity(left, right, SgbmConfig(num_disparities=208))
    searched = []

    def watched(left_rgb, right_rgb, config):
        searched.append(config.num_disparities)
        return compute_disparity(left_rgb, right_rgb, config)

    monkeypatch.setattr(sgbm, "compute_disparity", watched)
    found = disparity_of_scene(left, right, SgbmConfig(num_disparities=208))
    assert searched == [64, asked]
    both = np.isfinite(found) & np.isfinite(whole)
    assert (np.isfinite(found) != np.isfinite(whole)).mean() < 0.03
    assert (np.abs(found - whole)[both] > 0.5).mean() < 0.005
    assert np.nanmedian(found[60:100, 340:460]) == pytest.approx(near_px, abs=0.5)


def test_a_search_of_64_disparities_is_never_cut_short():
    left, right = wall_before_a_wall(20)
    config = SgbmConfig(num_disparities=64)
    np.testing.assert_array_equal(
        disparity_of_scene(left, right, config), compute_disparity(left, right, config)
    )


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"num_disparities": 40}, "multiple of 16, got 40; try 48"),
        ({"num_disparities": 0}, "multiple of 16, got 0; try 16"),
        ({"block_size": 4}, "block_size must be odd and positive, got 4"),
        ({"p1": 900}, "0 <= p1 < p2, got p1=900, p2=800"),
    ],
)
def test_settings_that_sgbm_cannot_use_are_refused(settings_, message):
    with pytest.raises(RescoreError, match=message):
        SgbmConfig(**settings_)


def test_a_picture_too_narrow_for_a_repeatable_result_is_refused():
    picture = np.zeros((40, 66, 3), np.uint8)
    with pytest.raises(RescoreError, match=r"half a block \(3 px\) must fit .* \(66 - 64 px\)"):
        compute_disparity(picture, picture, SgbmConfig(num_disparities=64, block_size=7))
    compute_disparity(picture, picture, SgbmConfig(num_disparities=64, block_size=5))  # 2 px fit


def test_enough_disparities_for_the_nearest_surface():
    # 720 px * 0.5 m = 360: 8 m is 45 px, 7.5 m is exactly 48 px, which 48 disparities (0 to 47) do not reach
    camera = StereoCamera(PinholeCamera(720.0, 720.0, 320, 240, 640, 480), 0.5)
    assert [disparities_to_reach(camera, z) for z in (50.0, 8.0, 7.5)] == [16, 48, 64]
    # with the right principal point 13 px farther right, 7.5 m is matched at 35 px; with it 20 px left, at 68
    assert [disparities_to_reach(camera, 7.5, offset) for offset in (13.0, -20.0)] == [48, 80]
    assert disparities_to_reach(camera, 50.0, 100.0) == 16


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (
            np.zeros((40, 90), np.uint8),
            np.zeros((40, 90), np.uint8),
            r"left picture must be \(h, w, 3\) uint8",
        ),
        (np.zeros((40, 90, 3), np.uint8), np.zeros((40, 90, 3), np.float32), "right picture .* float32"),
        (np.zeros((40, 90, 3), np.uint8), np.zeros((40, 80, 3), np.uint8), "got 90 x 40 and 80 x 40"),
    ],
)
def test_pictures_that_are_no_pair_are_refused(left, right, message):
    with pytest.raises(RescoreError, match=message):
        compute_disparity(left, right, SMALL)


@settings(max_examples=30, deadline=None)
@given(arrays(np.float32, (4, 5), elements=st.one_of(st.just(NAN), st.floats(0.0625, 255.9375, width=32))))
def test_a_disparity_file_keeps_512ths_and_holes(tmp_path_factory, disparity):
    path = tmp_path_factory.mktemp("disparity") / "d.png"
    write_disparity(path, disparity)
    back = read_disparity(path, 5, 4)
    np.testing.assert_array_equal(np.isnan(back), np.isnan(disparity))
    np.testing.assert_allclose(back, disparity, atol=1 / 512)
    assert [p.name for p in path.parent.iterdir()] == ["d.png"]


def test_a_disparity_file_holds_256_times_the_pixels(tmp_path):
    write_disparity(tmp_path / "d.png", np.array([[1.0, NAN, 100.5]], np.float32))
    np.testing.assert_array_equal(
        cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED), np.array([[256, 0, 25728]], np.uint16)
    )


@pytest.mark.parametrize("bad", [-1.0, 256.0, np.inf])
def test_disparities_that_a_file_cannot_hold_are_refused_and_leave_no_file(tmp_path, bad):
    with pytest.raises(RescoreError, match=r"must lie in \[0, 256\) pixels"):
        write_disparity(tmp_path / "d.png", np.array([[5.0, bad]], np.float32))
    assert not list(tmp_path.iterdir())


def test_a_disparity_array_of_integers_is_refused(tmp_path):
    with pytest.raises(RescoreError, match=r"expected an \(h, w\) float disparity, got \(2, 2\) uint16"):
        write_disparity(tmp_path / "d.png", np.zeros((2, 2), np.uint16))


def png(array):
    return cv2.imencode(".png", array)[1].tobytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (png(np.ones((40, 50), np.uint8)), "16-bit grey .* got a PNG of mode L"),
        (png(np.ones((40, 50, 3), np.uint8)), "16-bit grey .* got a PNG of mode RGB"),
        (png(np.ones((50, 40), np.uint16)), "expected 50 x 40 pixels, got 40 x 50"),
        (
            png(np.random.default_rng(0).integers(1, 9999, (40, 50)).astype(np.uint16))[:-900],
            "whole disparity PNG",
        ),
        (b"no picture", "whole disparity PNG"),
        (b"", "whole disparity PNG"),
    ],
)
def test_files_that_are_no_disparity_are_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "d.png"
    path.write_bytes(content)
    with pytest.raises(RescoreError, match=message) as error:
        read_disparity(path, 50, 40)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_disparity_file_is_named(tmp_path):
    with pytest.raises(RescoreError, match=r"none\.png: expected a disparity PNG, found no file"):
        read_disparity(tmp_path / "none.png", 50, 40)
