"""Blocks on a grid against OpenCV's descriptor of the whole picture."""

import cv2
import numpy as np
import pytest

from rescore.detectors.views.hog_blocks import block_features


@pytest.mark.parametrize("stride_px", [4, 8])
@pytest.mark.parametrize("shape", [(16, 16), (50, 93), (130, 104)])
def test_blocks_are_those_of_opencv(shape: tuple[int, int], stride_px: int) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, shape, dtype=np.uint8)
    # directions of every kind, steep and faint, and flat ground
    picture[:, shape[1] // 2 :] = cv2.GaussianBlur(picture, (0, 0), 3.0)[:, shape[1] // 2 :]
    picture[shape[0] // 2 :, : shape[1] // 4] = 90
    height, width = (n // 8 * 8 for n in shape)
    hog = cv2.HOGDescriptor((width, height), (16, 16), (stride_px, stride_px), (8, 8), 9)
    found = np.ravel(hog.compute(np.ascontiguousarray(picture[:height, :width])))
    rows, columns = ((n - 16) // stride_px + 1 for n in (height, width))
    # OpenCV goes down a column first
    wanted = found.reshape(columns, rows, 36).transpose(1, 0, 2)
    np.testing.assert_allclose(block_features(picture, stride_px), wanted, atol=2e-6)


def test_a_picture_smaller_than_a_block_has_none() -> None:
    assert block_features(np.zeros((15, 40), np.uint8), 4).shape == (0, 7, 36)
    assert block_features(np.zeros((40, 8), np.uint8), 4).shape == (7, 0, 36)
