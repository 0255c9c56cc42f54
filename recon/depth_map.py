"""A depth map of a window of an image."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import Float32Array


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth of the pixels ``[y0, y0 + h) x [x0, x0 + w)`` of an image; NaN where there is none."""

    x0_px: int
    y0_px: int
    depth: Float32Array
    """Shape (h, w). Metres when the camera and ground were known, else in units of the default camera."""

    def __post_init__(self) -> None:
        if self.depth.ndim != 2 or self.depth.dtype != np.float32:
            raise ValueError(f"depth must be (h, w) float32, got {self.depth.shape} {self.depth.dtype}")

    @property
    def window(self) -> tuple[slice, slice]:
        """Index of this map's pixels in an array of the whole image, rows first."""
        h, w = self.depth.shape
        return slice(self.y0_px, self.y0_px + h), slice(self.x0_px, self.x0_px + w)
