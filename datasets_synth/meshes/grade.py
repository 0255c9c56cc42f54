"""The rise and fall of a street along its length."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import Float32Array, FloatArray


@dataclass(frozen=True)
class Grade:
    """A slope that changes once, smoothly, from one value to another."""

    slope: float
    """Rise over run before the bend."""
    bend: float = 0.0
    """Slope behind the bend less the slope before it."""
    at_m: float = 25.0
    """World y of the middle of the bend."""
    length_m: float = 4.0
    """How gently the slope changes: two thirds of the change happen within this on either side."""

    def height_m(self, y_m: FloatArray | Float32Array | float) -> FloatArray:
        """Height of the ground at world y, any shape, 0 at y = 0."""
        y = np.asarray(y_m, float)
        return self.slope * y + self.bend * (self._bent(y) - self._bent(np.zeros(())))

    def slope_at(self, y_m: float) -> float:
        """Rise over run at world y."""
        return float(self.slope + self.bend / (1 + np.exp(-(y_m - self.at_m) / self.length_m)))

    def _bent(self, y_m: FloatArray) -> FloatArray:
        """Length of the road behind the bend, smoothed; its derivative goes from 0 to 1."""
        return np.asarray(self.length_m * np.logaddexp(0, (y_m - self.at_m) / self.length_m))
