"""Outlines: masks and rings are two forms of one thing."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from recon.outlines import fill_polygon, fill_rings, largest_outline, mask_rings, resample


@pytest.mark.parametrize("seed", range(20))
def test_rings_give_the_mask_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = uniform_filter(rng.normal(size=(40, 50)), 1 + seed % 5) > 0.05
    np.testing.assert_array_equal(fill_rings(mask_rings(mask), 40, 50), mask)


def test_region_with_a_hole_and_an_island() -> None:
    mask = np.zeros((20, 20), bool)
    mask[2:18, 2:18] = True
    mask[5:15, 5:15] = False
    mask[9:11, 9:11] = True
    np.testing.assert_array_equal(fill_rings(mask_rings(mask), 20, 20), mask)


def test_largest_outline_leaves_the_small_region() -> None:
    mask = np.zeros((20, 30), bool)
    mask[2:5, 2:5] = True
    mask[8:18, 10:28] = True
    ring = largest_outline(mask)
    assert ring is not None
    assert (ring.min(axis=0).tolist(), ring.max(axis=0).tolist()) == ([10, 8], [27, 17])
    assert largest_outline(np.zeros((4, 4), bool)) is None


def test_resampling_a_square_is_even() -> None:
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    # perimeter 16 in 8 steps of 2
    expected = [[0, 0], [2, 0], [4, 0], [4, 2], [4, 4], [2, 4], [0, 4], [0, 2]]
    np.testing.assert_allclose(resample(square, 8), expected)


def test_filled_polygon_covers_its_pixels() -> None:
    mask = fill_polygon(np.array([[1.0, 1.0], [6.0, 1.0], [6.0, 3.0], [1.0, 3.0]]), 6, 9)
    expected = np.zeros((6, 9), bool)
    expected[1:4, 1:7] = True
    np.testing.assert_array_equal(mask, expected)
