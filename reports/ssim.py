"""Structural similarity of two pictures.

After Z. Wang, A. C. Bovik, H. R. Sheikh and E. P. Simoncelli, "Image quality assessment: from error
visibility to structural similarity", IEEE Trans. Image Processing 13(4), 2004, eq. 13.
"""

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array


def structural_similarity(a: UInt8Array, b: UInt8Array) -> FloatArray:
    """SSIM (h, w), in [-1, 1], of two grey pictures (h, w); Gaussian windows of sigma 1.5 pixels."""
    x, y = a.astype(float), b.astype(float)

    def mean(picture: FloatArray) -> FloatArray:
        return np.asarray(cv2.GaussianBlur(picture, (11, 11), 1.5, borderType=cv2.BORDER_REFLECT))

    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    mx, my = mean(x), mean(y)
    vx, vy, vxy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    return np.asarray((2 * mx * my + c1) * (2 * vxy + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2)))
