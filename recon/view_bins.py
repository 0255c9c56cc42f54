"""The view bins of section 3.1: k directions on a circle at a fixed elevation, each with its T_alpha.

Frames: the object frame has x forward (the nose), y left, z up; a view frame has x right, y down,
z forward, as a camera has. Bin ``b`` is seen from azimuth ``b * 360 / k`` degrees, counter-clockwise seen
from above, measured from the nose: bin 0 shows the front; of 12 bins, bin 3 shows the left side with the
nose to the left of the picture.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError

ELEVATION_RAD = float(np.deg2rad(5.0))
"""Elevation at which views are labelled: low, as in a street, but roof and hood can be seen."""

NAMES = (
    *("front", "front left", "left front", "left", "left rear", "rear left"),
    *("rear", "rear right", "right rear", "right", "right front", "front right"),
)
"""Names of 12 bins, from azimuth 0 on: "front left" is nearer to the front, "left front" to the left side."""


@dataclass(frozen=True)
class ViewBins:
    """k view bins equally spaced around a circle at a fixed elevation."""

    count: int = 12
    elevation_rad: float = ELEVATION_RAD

    def __post_init__(self) -> None:
        if self.count < 1 or not -np.pi / 2 < self.elevation_rad < np.pi / 2:
            raise RescoreError(
                f"view bins: expected at least one bin and an elevation within 90 degrees, got {self}; "
                "mend the config"
            )

    def azimuth_rad(self, view_bin: int) -> float:
        """Azimuth of the centre of a bin in [0, 2 pi)."""
        self.check(view_bin)
        return 2 * np.pi * view_bin / self.count

    def check(self, view_bin: int) -> None:
        """Raises RescoreError where the bin does not exist."""
        if not 0 <= view_bin < self.count:
            raise RescoreError(
                f"view bin: expected 0 to {self.count - 1}, got {view_bin}; "
                f"bin b is seen from azimuth b * {360 / self.count:g} degrees"
            )

    def containing(self, azimuth_rad: float) -> int:
        """The bin whose centre is nearest to an azimuth; any real angle."""
        return round(azimuth_rad / (2 * np.pi) * self.count) % self.count

    def name(self, view_bin: int) -> str:
        """The side from which a bin is seen, in words: of 12 bins one of ``NAMES``, else its azimuth.

        Raises:
            RescoreError: no such bin.
        """
        self.check(view_bin)
        return NAMES[view_bin] if self.count == len(NAMES) else f"{360 * view_bin / self.count:g} degrees"

    def shares(self, azimuth_rad: FloatArray, width_rad: float) -> FloatArray:
        """How much of intervals of azimuths lies in each bin, shape (n, count); rows sum to 1.

        Args:
            azimuth_rad: Middle of each interval, shape (n,); any real angles.
            width_rad: Width of the intervals, at most that of a bin.
        """
        centre = 2 * np.pi * np.arange(self.count) / self.count
        off = np.abs((azimuth_rad[:, None] - centre + np.pi) % (2 * np.pi) - np.pi)
        inside = np.pi / self.count + width_rad / 2 - off
        return np.asarray(np.clip(inside, 0, width_rad) / width_rad)

    def view_from_object(self, view_bin: int) -> FloatArray:
        """T_alpha, shape (3, 3): object frame to the view frame of the bin."""
        return rotation(self.azimuth_rad(view_bin), self.elevation_rad)

    def level_view_from_object(self, view_bin: int) -> FloatArray:
        """T_alpha at the bin's azimuth and elevation 0, shape (3, 3): its y axis is the object's down."""
        return _level_rotation(self, view_bin).copy()


@lru_cache(maxsize=64)
def _level_rotation(bins: ViewBins, view_bin: int) -> FloatArray:
    return rotation(bins.azimuth_rad(view_bin), 0.0)


def rotation(azimuth_rad: float, elevation_rad: float) -> FloatArray:
    """Rotation (3, 3) from the object frame to the frame of a camera that looks at the object's origin.

    The camera stands in the direction (cos e cos a, cos e sin a, sin e); its x axis stays level.
    """
    ca, sa = np.cos(azimuth_rad), np.sin(azimuth_rad)
    ce, se = np.cos(elevation_rad), np.sin(elevation_rad)
    right = np.array([-sa, ca, 0.0])
    forward = -np.array([ce * ca, ce * sa, se])
    return np.stack([right, np.cross(forward, right), forward])
