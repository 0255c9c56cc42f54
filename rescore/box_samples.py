"""A picture sampled on one grid of places in and around each box, so that all boxes are one array."""

import numpy as np

from recon.arrays import Float32Array, FloatArray

SAMPLES_U = (np.arange(56) + 0.5) / 56 * 1.6 - 0.3
"""Columns of the grid as fractions of the box's width from its left edge, (56,): 0.3 beyond each end."""
SAMPLES_V = (np.arange(44) + 0.5) / 44 * 1.6 - 0.35
"""Rows as fractions of the box's height from its top edge, shape (44,): 0.35 above, 0.25 below."""


def sample_boxes(picture: Float32Array, xyxy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The values at the grid of each box, shape (n, 44, 56), NaN outside the picture; and their rows (n, 44).

    The nearest pixel is taken: values across a depth edge must not be mixed.

    Args:
        picture: shape (h, w).
        xyxy_px: boxes, shape (n, 4), pixel edges.
    """
    height, width = picture.shape
    size = xyxy_px[:, 2:] - xyxy_px[:, :2]
    x = np.floor(xyxy_px[:, :1] + SAMPLES_U * size[:, :1]).astype(int)
    y = np.floor(xyxy_px[:, 1:2] + SAMPLES_V * size[:, 1:]).astype(int)
    inside = ((y >= 0) & (y < height))[:, :, None] & ((x >= 0) & (x < width))[:, None, :]
    values = picture[np.clip(y, 0, height - 1)[:, :, None], np.clip(x, 0, width - 1)[:, None, :]]
    return np.where(inside, values.astype(float), np.nan), y.astype(float)
