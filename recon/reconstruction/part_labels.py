"""Part labels of a window of a picture, and where the window lies."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray, UInt8Array


@dataclass(frozen=True, eq=False)
class PartLabels:
    """Part labels of the pixels ``[y0, y0 + h) x [x0, x0 + w)`` of a picture."""

    x0_px: int
    """Image column of the window's first column."""
    y0_px: int
    """Image row of the window's first row."""
    labels: UInt8Array
    """Shape (h, w), 0 for none."""

    @property
    def uv_px(self) -> FloatArray:
        """Pixel centres of the window in the picture, shape (h, w, 2)."""
        h, w = self.labels.shape
        v, u = np.mgrid[self.y0_px : self.y0_px + h, self.x0_px : self.x0_px + w]
        return np.stack([u, v], axis=-1).astype(float)
