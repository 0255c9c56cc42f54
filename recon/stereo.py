"""Measured depth: OpenCV's semi-global matching on a rectified pair, and KITTI's disparity files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SgbmConfig:
    """Settings of StereoSGBM."""

    num_disparities: int = 64


def compute_disparity(
    left_rgb: NDArray[np.uint8], right_rgb: NDArray[np.uint8], config: SgbmConfig
) -> NDArray[np.float32]:
    """Left disparity in pixels, shape (h, w); NaN where there is no measurement."""
    raise NotImplementedError


def read_disparity(path: Path, width_px: int, height_px: int) -> NDArray[np.float32]:
    """Disparity in pixels from a 16-bit PNG, value = 256 x pixels, 0 = none; NaN where there is none."""
    raise NotImplementedError


def write_disparity(path: Path, disparity_px: NDArray[np.float32]) -> None:
    """Write disparity as a 16-bit PNG (KITTI's convention)."""
    raise NotImplementedError
