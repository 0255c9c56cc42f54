from dataclasses import replace

import numpy as np
import pytest

from recon.stereo.accuracy import BAD_1, BAD_2, DisparityError, disparity_error, fill_holes

NAN = np.nan


def test_holes_take_the_farther_neighbour_of_their_row():
    disparity = np.array([[NAN, 5, NAN, NAN, 3, NAN], [NAN] * 6, [7, 7, NAN, 9, 9, 9], [NAN] * 6], np.float32)
    expected = [[5, 5, 3, 3, 3, 3], [5, 5, 3, 3, 3, 3], [7, 7, 7, 9, 9, 9], [7, 7, 7, 9, 9, 9]]
    np.testing.assert_array_equal(fill_holes(disparity), np.array(expected, np.float32))
    np.testing.assert_array_equal(fill_holes(disparity[1:3])[0], np.array(expected[2], np.float32))
    assert np.isnan(fill_holes(np.full((3, 3), NAN, np.float32))).all()


def test_disparity_error_of_a_map_worked_out_by_hand():
    truth = np.array([[10, 10, 10, 100, 10, NAN, 10]], np.float32)
    measured = np.array([[10.5, 14, NAN, 104, 13, 50, 9]], np.float32)
    mask = np.array([[1, 1, 1, 1, 1, 1, 0]], bool)
    error = disparity_error(measured, truth, mask)
    # truth at the first five; four are measured, off by 0.5, 4, 4, 3. Only the 4 of 10 is wrong: 4 of 100 is
    # under 5 %, and 3 is not more than 3. The hole is filled with min(14, 104) = 14, which is wrong too.
    assert error.n_truth == 5
    assert error.n_measured == 4
    assert error.density == pytest.approx(0.8)
    assert error.end_point_error_px == pytest.approx(11.5 / 4)
    assert error.wrong_share_measured == pytest.approx(1 / 4)
    assert error.wrong_share_filled == pytest.approx(2 / 5)


def test_disparity_error_without_truth_or_measurement():
    truth = np.full((2, 2), 10.0, np.float32)
    none = np.full((2, 2), NAN, np.float32)
    everywhere = np.ones((2, 2), bool)
    unmeasured = disparity_error(none, truth, everywhere)
    assert unmeasured.density == 0
    assert np.isnan(unmeasured.end_point_error_px)
    assert unmeasured.wrong_share_filled == 1
    assert disparity_error(truth, none, everywhere).n_truth == 0
    assert np.isnan(disparity_error(truth, truth, ~everywhere).wrong_share_filled)


def test_middlebury_counts_pixels_off_by_more_than_one_and_two():
    truth = np.full((1, 6), 100.0, np.float32)
    measured = np.array([[100, 101, 101.5, 102, 102.5, NAN]], np.float32)
    everywhere = np.ones((1, 6), bool)
    # off by 0, 1, 1.5, 2, 2.5; the hole takes 102.5
    one, two = (disparity_error(measured, truth, everywhere, rule) for rule in (BAD_1, BAD_2))
    assert (one.n_wrong_measured, one.n_wrong_filled) == (3, 4)
    assert (two.n_wrong_measured, two.n_wrong_filled) == (1, 2)
    # 2.5 is under 3 pixels and under 5 %
    assert disparity_error(measured, truth, everywhere).n_wrong_filled == 0


def test_errors_of_two_halves_add_up_to_that_of_the_whole():
    rng = np.random.default_rng(0)
    truth = rng.uniform(5, 60, (20, 30)).astype(np.float32)
    measured = (truth + rng.normal(0, 4, truth.shape)).astype(np.float32)
    measured[rng.random(truth.shape) < 0.2] = NAN
    left = np.zeros(truth.shape, bool)
    left[:, :11] = True
    whole = disparity_error(measured, truth, np.ones(truth.shape, bool))
    both = disparity_error(measured, truth, left) + disparity_error(measured, truth, ~left)
    assert 0 < whole.n_wrong_measured < whole.n_wrong_filled < whole.n_truth == 600
    assert both.absolute_error_px == pytest.approx(whole.absolute_error_px)
    assert replace(both, absolute_error_px=0) == replace(whole, absolute_error_px=0)
    assert both + DisparityError() == both
