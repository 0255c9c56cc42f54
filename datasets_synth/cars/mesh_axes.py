"""How a mesh file measures: which way is up, where the nose points, and in which unit."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError

LENGTH_RANGE_M = (1.5, 20.0)
"""Longest side that a road vehicle in metres may have."""

LENGTH_SHARES = (0.08, 0.85)
"""Width and height of a road vehicle over its length, from a bus or a low racer to a car for two."""

_CAR_LENGTHS_M = (2.3, 6.5)
"""Lengths by which a unit is known."""
_UNITS = ((0.001, "millimetres"), (0.01, "centimetres"), (0.0254, "inches"), (0.3048, "feet"))
_BINS = 24
_UNEVEN = 0.10
"""Share of the surface without a partner behind the mirror that no upright car has: steering wheels,
exhausts and plates have less."""
_INSIDE = np.array(
    [
        (a + third, b + third, 4 - a - b - 2 * third)
        for third in (1 / 3, 2 / 3)
        for a in range(4)
        for b in range(4)
        if a + b + 2 * third < 4
    ]
) / np.array(4.0)
"""Weights of a triangle's corners at the middles of its 16 parts, shape (16, 3)."""


class NoCarSizeError(RescoreError):
    """No unit makes a mesh as long as a car, or it is not as wide or high as a car of its length."""


class Axis(StrEnum):
    """An axis of a file, or its reverse."""

    X = "x"
    Y = "y"
    Z = "z"
    MINUS_X = "-x"
    MINUS_Y = "-y"
    MINUS_Z = "-z"

    @property
    def vector(self) -> FloatArray:
        """The unit vector, shape (3,)."""
        sign = -1.0 if self.value[0] == "-" else 1.0
        return np.asarray(sign * np.eye(3)["xyz".index(self.value[-1])])


@dataclass(frozen=True)
class MeshAxes:
    """The axes of mesh files; glTF's, unless said otherwise."""

    up: Axis = Axis.Y
    nose: Axis = Axis.Z

    def __post_init__(self) -> None:
        if self.up.value[-1] == self.nose.value[-1]:
            raise RescoreError(
                f"--up and --nose: expected two different axes, got {self.up.value} and {self.nose.value}; "
                f"name both (without --up it is {MeshAxes.up.value}, without --nose {MeshAxes.nose.value})"
            )

    @property
    def object_from_file(self) -> FloatArray:
        """Turns points of the file into x forward, y left, z up, shape (3, 3)."""
        up, nose = self.up.vector, self.nose.vector
        return np.stack([nose, np.cross(up, nose), up])

    def __str__(self) -> str:
        return f"up along {self.up.value} and the nose along {self.nose.value}"


def mesh_axes(up: str, nose: str) -> MeshAxes:
    """The axes that a user names.

    Raises:
        RescoreError: no such axis, or one named twice.
    """
    for option, value in (("--up", up), ("--nose", nose)):
        if value not in set(Axis):
            raise RescoreError(
                f"{option}: expected one of {', '.join(Axis)}, got {value!r}; choose one of these"
            )
    return MeshAxes(Axis(up), Axis(nose))


def metres_a_unit(where: str, size: FloatArray) -> tuple[float, str]:
    """How many metres a unit of a file has, and its name, from length, width and height (3,) in the file.

    Raises:
        NoCarSizeError: no unit gives a car's length.
    """
    longest = float(size.max())
    if LENGTH_RANGE_M[0] <= longest <= LENGTH_RANGE_M[1]:
        return 1.0, "metres"
    for scale, name in _UNITS:
        if _CAR_LENGTHS_M[0] <= longest * scale <= _CAR_LENGTHS_M[1]:
            return scale, name
    raise NoCarSizeError(
        f"{where}: expected a car {LENGTH_RANGE_M[0]:g} to {LENGTH_RANGE_M[1]:g} metres long (or in "
        f"millimetres, centimetres or inches), got length x width x height {_measures(size)}: scale the mesh "
        "to metres"
    )


def refuse_no_car(where: str, corners_m: FloatArray, axes: MeshAxes) -> None:
    """Nothing, where triangles (m, 3, 3), turned to x forward, y left, z up, can be a car on its wheels.

    Raises:
        NoCarSizeError: it has no car's proportions.
        RescoreError: it lies on its side, stands on its nose or goes sideways.
    """
    size = np.ptp(corners_m.reshape(-1, 3), axis=0)
    if size[0] < 0.9 * size[1] or size[0] < 0.7 * size[2]:
        raise RescoreError(
            f"{where}: expected {axes}, got length x width x height {_measures(size)}: turn it, or say its "
            "axes with --up and --nose"
        )
    low, high = LENGTH_SHARES
    if size[1:].min() < low * size[0] or size[1:].max() > high * size[0]:
        raise NoCarSizeError(
            f"{where}: expected a car, {low:g} to {high:g} of its length wide and high, got length x width x "
            f"height {_measures(size)} metres: take the mesh of a car, or say its axes with --up and --nose"
        )
    across, upward = (_unevenness(corners_m, k) for k in (1, 2))
    if across > _UNEVEN and across > 2 * upward:
        raise RescoreError(
            f"{where}: expected {axes}, got a car that lies on its side: its left and right differ, its top "
            "and bottom do not: turn it, or say its axes with --up and --nose"
        )


def _unevenness(corners: FloatArray, axis: int) -> float:
    """Share of the surface of triangles (m, 3, 3) without a partner as far from the middle."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    along = corners[..., axis]
    low, high = along.min(), along.max()
    share = np.zeros(_BINS)
    for weights in _INSIDE:
        # shared between the two nearest, so that what lies on the border of two does not jump between them
        place = np.clip((along @ weights - low) / max(high - low, 1e-12), 0, 1) * (_BINS - 1)
        cell = np.minimum(place.astype(int), _BINS - 2)
        share += np.bincount(cell, area * (1 + cell - place), _BINS)
        share += np.bincount(cell + 1, area * (place - cell), _BINS)
    return float(np.abs(share - share[::-1]).sum() / (2 * max(share.sum(), 1e-12)))


def _measures(size: FloatArray) -> str:
    return " x ".join(f"{v:.4g}" for v in size)
