"""Random smooth deformations of training shapes: a class has more forms than a few labelled instances show.

A deformation moves features along x, raises and lowers the top, rounds and tapers the plan, leans the sides and
changes the size. It keeps the box and the symmetry, so that a deformed shape is a training shape as well.
Coordinates are in units of length, width and height (see `recon.shape_space`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from recon.shape_space import InstanceShape, ShapeSpaceConfig, grid_points

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class DeformationConfig:
    """Standard deviations of the terms; 0 copies for none."""

    copies: int = 4
    """Deformed copies of each instance."""
    log_size: tuple[float, float, float] = (0.12, 0.04, 0.08)
    """Of the logarithms of length, width and height."""
    along: float = 0.02
    """Features moved along x, in lengths."""
    top: float = 0.06
    """The height of the top over x, as a share of it."""
    middle: float = 0.03
    """Features moved up or down between ground and top, in heights."""
    plan: float = 0.04
    """The width over x and z, as a share of it."""


@dataclass(frozen=True, eq=False)
class Deformation:
    """One deformation; all maps lead from deformed to original coordinates."""

    along: FloatArray
    """Shape (2,): shift of the middle, stretch of the middle."""
    top: FloatArray
    """Shape (3,): slope, bend and swing of the height over x."""
    middle: float
    plan: FloatArray
    """Shape (3,): taper and bend over x, lean over z."""
    log_size: FloatArray
    """Added to the logarithms of length, width and height, shape (3,)."""

    @staticmethod
    def draw(config: DeformationConfig, rng: np.random.Generator) -> "Deformation":
        """A random one; terms are held within two and a half standard deviations, so that none folds."""

        def term(std: float, count: int) -> FloatArray:
            return std * np.clip(rng.standard_normal(count), -2.5, 2.5)

        return Deformation(
            term(config.along, 2),
            term(config.top, 3),
            float(term(config.middle, 1)[0]),
            term(config.plan, 3),
            np.array(config.log_size) * term(1.0, 3),
        )

    def original(self, unit: FloatArray) -> FloatArray:
        """Original coordinates (n, 3) of deformed ones (n, 3), before the box is fitted."""
        x, y, z = unit.T
        inside = np.clip(x, -0.5, 0.5)
        s, c = np.sin(np.pi * inside), np.cos(np.pi * inside)
        s2, c2 = np.sin(2 * np.pi * inside), np.cos(2 * np.pi * inside)
        old_x = x + self.along[0] * c + self.along[1] * s2
        height = 1 + self.top[0] * s + self.top[1] * c2 + self.top[2] * s2
        old_z = z / height
        old_z = old_z + self.middle * np.sin(np.pi * np.clip(old_z, 0, 1))
        width = 1 + self.plan[0] * s + self.plan[1] * c2 + self.plan[2] * (np.clip(z, 0, 1) - 0.4)
        return np.stack([old_x, y / width, old_z], axis=1)


def deformed_shapes(
    shapes: Sequence[InstanceShape],
    space: ShapeSpaceConfig,
    config: DeformationConfig,
    rng: np.random.Generator,
) -> list[InstanceShape]:
    """Deformed copies of all shapes, in the order of the shapes."""
    return [
        deform(s, Deformation.draw(config, rng), space) for s in shapes for _ in range(config.copies)
    ]


def deform(shape: InstanceShape, deformation: Deformation, config: ShapeSpaceConfig) -> InstanceShape:
    """A shape with its box fitted again: its size is that of the original times the deformation's."""
    new = _Fitted(deformation, _fit(shape, deformation, config))
    return InstanceShape(
        _hull(shape, new, config),
        new.deformed(shape.outlines.reshape(-1, 3)).reshape(shape.outlines.shape),
        shape.log_size + deformation.log_size,
    )


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A deformation after which the object fills its box again."""

    deformation: Deformation
    fit: FloatArray
    """Low (3,) and high (3,) ends of the deformed object, shape (2, 3)."""

    def original(self, unit: FloatArray) -> FloatArray:
        """Original coordinates (n, 3) of deformed ones."""
        low, high = self.fit
        share = (unit - [-0.5, -0.5, 0.0]) * (high - low) + low
        return self.deformation.original(share)

    def deformed(self, unit: FloatArray) -> FloatArray:
        """Deformed coordinates (n, 3) of original ones; the map is near the identity, so that steps converge."""
        out = unit.copy()
        for _ in range(25):
            out += unit - self.original(out)
        return out


def _fit(shape: InstanceShape, deformation: Deformation, config: ShapeSpaceConfig) -> FloatArray:
    """Ends (2, 3) of the deformed object along each axis; the ground stays, and the middle plane."""
    unit = grid_points(config)
    values = _sample(shape.hull, deformation.original(unit), config)
    inside = unit[values < 0]
    # what lies above the box is no body, nor what stands out at the sides
    before = grid_points(config)[(shape.hull < 0).ravel()]
    low, high = inside.min(axis=0), inside.max(axis=0)
    old_low, old_high = before.min(axis=0), before.max(axis=0)
    x = (low[0] + 0.5 + (-0.5 - old_low[0]) - 0.5, high[0] + (0.5 - old_high[0]))
    top = high[2] / old_high[2]
    half = 0.5 * high[1] / old_high[1]
    return np.array([[x[0], -half, 0.0], [x[1], half, top]])


def _hull(shape: InstanceShape, new: _Fitted, config: ShapeSpaceConfig) -> NDArray[np.float32]:
    """The hull function carried along; near the surface it stays a distance in metres."""
    size = np.exp(shape.log_size)
    values = _sample(shape.hull, new.original(grid_points(config)), config).reshape(config.cells)
    steep_old = _sample(_steepness(shape.hull, size, config), new.original(grid_points(config)), config)
    steep_new = _steepness(values, size * np.exp(new.deformation.log_size), config)
    share = steep_old.reshape(config.cells) / np.maximum(steep_new, 1e-6)
    return np.asarray(values * np.clip(share, 0.4, 2.5), np.float32)


def _steepness(hull: NDArray[np.floating], size_m: FloatArray, config: ShapeSpaceConfig) -> FloatArray:
    """Length of the gradient of a hull function, on its grid."""
    rx, ry, rz = config.reach
    nx, ny, nz = config.cells
    cell = size_m * np.array([2 * rx / (nx - 1), ry / (ny - 1), rz / (nz - 1)])
    return np.asarray(np.sqrt(sum(g**2 for g in np.gradient(hull.astype(float), *cell))))


def _sample(values: NDArray[np.floating], unit: FloatArray, config: ShapeSpaceConfig) -> FloatArray:
    """Values (n,) on the grid at points (n, 3); beyond it those of its border."""
    rx, ry, rz = config.reach
    nx, ny, nz = config.cells
    at = np.stack(
        [
            (unit[:, 0] / (2 * rx) + 0.5) * (nx - 1),
            np.abs(unit[:, 1]) / ry * (ny - 1),
            unit[:, 2] / rz * (nz - 1),
        ]
    )
    return np.asarray(map_coordinates(values, at, order=1, mode="nearest"), float)
