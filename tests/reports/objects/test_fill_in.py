"""Filling in from beside: exact for what repeats itself."""

import cv2
import numpy as np
import pytest

from recon.arrays import BoolArray, UInt8Array
from reports.objects.fill_in import filled_from_beside


def striped(period_px: int) -> UInt8Array:
    """A picture (80, 240, 3) of columns that repeat, each row with a light of its own."""
    rng = np.random.default_rng(0)
    tile = rng.integers(40, 160, (80, period_px, 3))
    return np.tile(tile, (1, 240 // period_px + 1, 1))[:, :240].astype(np.uint8)


def middle(left: int, right: int) -> BoolArray:
    mask = np.zeros((80, 240), bool)
    mask[20:60, left:right] = True
    return mask


@pytest.mark.parametrize("period_px", [24, 37])
def test_a_pattern_goes_on(period_px: int) -> None:
    truth, hidden = striped(period_px), middle(90, 150)
    broken = truth.copy()
    broken[hidden] = (255, 0, 0)
    filled, missing = filled_from_beside(broken, hidden, ~hidden, ~hidden)
    assert not missing.any()
    np.testing.assert_array_equal(filled[~hidden], truth[~hidden])
    # soft seams and the light of the border are all that may differ
    assert np.abs(filled[hidden].astype(int) - truth[hidden]).mean() < 1


def test_nothing_comes_from_what_is_not_known() -> None:
    picture, hidden = striped(24), middle(90, 130)
    box = middle(80, 170)
    picture[box & ~hidden] = (0, 0, 255)
    filled, missing = filled_from_beside(picture, hidden, ~hidden, ~(box | hidden))
    assert not missing.any()
    assert not (filled[hidden] == (0, 0, 255)).all(axis=1).any()


def test_what_has_no_beside_stays() -> None:
    picture, hidden = striped(24), middle(0, 240)
    filled, missing = filled_from_beside(picture, hidden, ~hidden, ~hidden)
    # rows farther from the border than a shift goes up or down have no source
    assert missing[25:55].all()
    np.testing.assert_array_equal(filled[missing], picture[missing])


def test_nothing_hidden_changes_nothing() -> None:
    picture, nothing = striped(24), np.zeros((80, 240), bool)
    filled, missing = filled_from_beside(picture, nothing, ~nothing, ~nothing)
    np.testing.assert_array_equal(filled, picture)
    assert not missing.any()


def test_a_large_picture_is_filled_in_coarsely() -> None:
    truth = np.asarray(cv2.resize(striped(24), (1440, 480), interpolation=cv2.INTER_LINEAR))
    hidden = np.zeros(truth.shape[:2], bool)
    hidden[120:360, 540:900] = True
    broken = truth.copy()
    broken[hidden] = (255, 0, 0)
    filled, missing = filled_from_beside(broken, hidden, ~hidden, ~hidden)
    assert not missing.any()
    np.testing.assert_array_equal(filled[~hidden], truth[~hidden])
    # at 640 pixels the columns of 6 pixels are 2.7 wide, and the pattern repeats every 64
    assert np.abs(filled[hidden].astype(int) - truth[hidden]).mean() < 8
