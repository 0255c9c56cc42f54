"""A linear shape space of a class: a mean hull with principal components, sizes and part outlines.

Object frame as everywhere (x forward, y left, z up) with the origin on the ground below the middle.
``recon.localization.learn_shapes`` learns one from part-labelled views.
"""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from typing import Any

import numpy as np

from recon.arrays import Float32Array, FloatArray


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """Shape = mean + coefficients @ modes; coefficients are standard normal over the training instances."""

    reach: tuple[float, float, float]
    """The grid ends at these multiples of length (both ways), width and height."""
    mean: Float32Array
    """Hull function in metres, shape (nx, ny, nz)."""
    modes: Float32Array
    """Shape (nx, ny, nz, k)."""
    log_size: FloatArray
    """Mean logarithm of length, width and height in metres, shape (3,)."""
    log_size_modes: FloatArray
    """Shape (3, k)."""
    log_size_rest: FloatArray
    """Standard deviation of what the modes leave of the logarithms, shape (3,)."""
    part_labels: tuple[int, ...]
    outlines: FloatArray
    """Mean outline of each part in units of length, width and height, shape (p, m, 3)."""
    outline_modes: FloatArray
    """Shape (p, m, 3, k)."""
    instances: FloatArray
    """Coefficients of the training instances where fits start from these too, shape (n, k); n may be 0."""

    @property
    def count(self) -> int:
        """Number of modes."""
        return int(self.modes.shape[-1])

    @property
    def is_thin(self) -> bool:
        """Whether shapes have limbs so thin that their mean has none; then fits start from instances."""
        return len(self.instances) > 0

    def size_m(self, coefficients: FloatArray, log_rest: FloatArray) -> FloatArray:
        """Length, width and height in metres, shape (3,)."""
        return np.asarray(np.exp(self.log_size + self.log_size_modes @ coefficients + log_rest))

    def hull(self, coefficients: FloatArray) -> Float32Array:
        """The hull function of a shape on the grid, metres, shape (nx, ny, nz)."""
        return np.asarray(self.mean + self.modes @ coefficients.astype(np.float32), np.float32)

    def part_outlines(self, coefficients: FloatArray, size_m: FloatArray) -> FloatArray:
        """Outlines of the parts in metres, shape (p, m, 3)."""
        unit = self.outlines + self.outline_modes @ coefficients
        # planes and outlines scatter from instance to instance; no part leaves the box
        return np.asarray(np.clip(unit, [-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]) * size_m)

    def grid_coordinates(self, unit: FloatArray) -> FloatArray:
        """Fractional indices (3, n) of points (n, 3) in units of length, width and height; mirrors y < 0."""
        nx, ny, nz = self.mean.shape
        rx, ry, rz = self.reach
        return np.stack(
            [
                (unit[:, 0] / (2 * rx) + 0.5) * (nx - 1),
                np.abs(unit[:, 1]) / ry * (ny - 1),
                unit[:, 2] / rz * (nz - 1),
            ]
        )

    def hull_values(self, unit: FloatArray, hull: Float32Array, size_m: FloatArray) -> FloatArray:
        """Values (n,) of a hull function of this grid at points (n, 3) in units of length, width and height.

        They grow with the distance from the grid beyond it, in metres of a size (3,).
        """
        beyond = np.maximum(np.abs(unit) - np.array(self.reach), 0) * size_m
        value = sample_hull(hull, self.grid_coordinates(unit))
        return np.asarray(value + np.sqrt((beyond**2).sum(axis=1)))

    @cached_property
    def digest(self) -> str:
        """A digest of the content: the same for spaces that are read twice."""
        total = sha256()
        for array in (self.mean, self.modes, self.log_size, self.log_size_modes):
            total.update(np.ascontiguousarray(array).tobytes())
        return total.hexdigest()

    def as_json(self) -> dict[str, Any]:
        """The space as JSON values; hull functions in half precision, half a millimetre at 1 m."""
        grids = np.concatenate([self.mean[..., None], self.modes], axis=-1).astype("<f2")
        return {
            "reach": list(self.reach),
            "log_size": self.log_size.tolist(),
            "log_size_modes": self.log_size_modes.tolist(),
            "log_size_rest": self.log_size_rest.tolist(),
            "part_labels": list(self.part_labels),
            "outlines": self.outlines.tolist(),
            "outline_modes": self.outline_modes.tolist(),
            "grid": list(grids.shape),
            "hulls": base64.b64encode(grids.tobytes()).decode("ascii"),
            "instances": self.instances.tolist(),
        }

    @staticmethod
    def from_json(value: Mapping[str, Any]) -> "ShapeSpace":
        """The space of ``as_json``.

        Raises:
            KeyError, TypeError, ValueError: something else was given.
        """
        shape = tuple(int(n) for n in value["grid"])
        data = base64.b64decode(value["hulls"], validate=True)
        grids = np.frombuffer(data, "<f2").reshape(shape).astype(np.float32)
        reach_x, reach_y, reach_z = (float(r) for r in value["reach"])
        labels = tuple(int(label) for label in value["part_labels"])
        count = shape[3] - 1
        return ShapeSpace(
            (reach_x, reach_y, reach_z),
            np.ascontiguousarray(grids[..., 0]),
            np.ascontiguousarray(grids[..., 1:]),
            np.array(value["log_size"], float).reshape(3),
            np.array(value["log_size_modes"], float).reshape(3, count),
            np.array(value["log_size_rest"], float).reshape(3),
            labels,
            np.array(value["outlines"], float).reshape(len(labels), -1, 3),
            np.array(value["outline_modes"], float).reshape(len(labels), -1, 3, count),
            np.array(value.get("instances", []), float).reshape(-1, count),
        )


def sample_hull(hull: Float32Array, coordinates: FloatArray) -> FloatArray:
    """Values (n,) of a hull function at fractional indices (3, n); beyond the grid its border."""
    from scipy.ndimage import map_coordinates  # noqa: PLC0415 (a third of a second)

    return np.asarray(map_coordinates(hull, coordinates, order=1, mode="nearest"), float)
