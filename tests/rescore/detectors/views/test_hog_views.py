"""The filters of a view bin, against the descriptor that OpenCV computes for each window alone."""

import cv2
import numpy as np
import pytest

from rescore.detectors.views.hog import HogViewsConfig, ViewFilter, filter_scores, mirrored_blocks, window_of
from rescore.detectors.views.hog_blocks import block_features

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("stride_px", [4, 8])
def test_a_place_scores_weight_times_the_blocks_of_its_window_plus_bias(stride_px: int) -> None:
    picture = RNG.integers(0, 255, (80, 120), dtype=np.uint8)
    window = window_of(40, HogViewsConfig())
    assert (window.width_px, window.height_px) == (56, 48)
    found = ViewFilter(0, window, RNG.normal(size=(5, 6, 36)).astype(np.float32), 0.25)
    (scores,) = filter_scores([found], block_features(picture, stride_px), 8 // stride_px)
    assert scores.shape == ((80 - 48) // stride_px + 1, (120 - 56) // stride_px + 1)
    hog = cv2.HOGDescriptor((56, 48), (16, 16), (8, 8), (8, 8), 9)
    # OpenCV goes down the columns of blocks first
    weight = found.weight.transpose(1, 0, 2).ravel()
    for row, column in ((0, 0), (1, 3), (scores.shape[0] - 1, scores.shape[1] - 1)):
        corner = (column * stride_px, row * stride_px)
        values = np.ravel(hog.compute(picture, locations=[corner]))
        assert scores[row, column] == pytest.approx(values @ weight + 0.25, abs=1e-3)


def test_the_blocks_of_a_mirrored_window_are_the_mirrored_blocks() -> None:
    crop = cv2.GaussianBlur(RNG.integers(0, 255, (48, 56), dtype=np.uint8), (0, 0), 1.5)
    blocks, wanted = (block_features(np.ascontiguousarray(c), 8) for c in (crop, crop[:, ::-1]))
    mirrored = mirrored_blocks(blocks)
    # noise is the worst case: OpenCV weighs a block about a point half a pixel beside its middle
    assert np.abs(mirrored - wanted).max() < 0.07
    assert np.corrcoef(mirrored.ravel(), wanted.ravel())[0, 1] > 0.95
    assert np.corrcoef(blocks.ravel(), wanted.ravel())[0, 1] < 0.3
    np.testing.assert_array_equal(mirrored_blocks(mirrored), blocks)


def test_a_picture_smaller_than_the_window_has_no_place() -> None:
    found = ViewFilter(0, window_of(40, HogViewsConfig()), np.zeros((5, 6, 36), np.float32))
    (scores,) = filter_scores([found], block_features(np.zeros((40, 80), np.uint8), 4), 2)
    assert scores.size == 0
