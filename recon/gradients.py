"""The gradient of a smoothed picture, as edge and border measures take it."""

import cv2
import numpy as np

from recon.arrays import Float32Array


def smooth_gradient(window: Float32Array, sigma_px: float) -> tuple[Float32Array, Float32Array]:
    """Change a pixel to the right and downwards of a window (h, w, c), each of shape (h, w, c).

    Args:
        window: colours.
        sigma_px: standard deviation of the Gaussian before.
    """
    smooth = cv2.GaussianBlur(window, (0, 0), sigma_px)
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return np.asarray(dx, np.float32), np.asarray(dy, np.float32)
