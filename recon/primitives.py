"""Oriented planar primitives and the cross-view transforms that they induce (section 3.2, the generic phase).

Under scaled orthographic projection with known rotations the transform between two views of a plane is
affine and known in closed form, so this phase needs no training images.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def primitive_normals() -> FloatArray:
    """The library: unit normals (k, 3) in the object frame.

    Every 15 degrees around at inclinations of 0, +-30 and +-60 degrees, and straight up and down.
    """
    azimuth = np.deg2rad(np.arange(0, 360, 15))
    rings = [
        np.stack(
            [
                np.cos(azimuth) * np.cos(tilt),
                np.sin(azimuth) * np.cos(tilt),
                np.full_like(azimuth, np.sin(tilt)),
            ],
            axis=1,
        )
        for tilt in np.deg2rad([0, 30, -30, 60, -60])
    ]
    return np.concatenate([*rings, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])


def lift(normals: FloatArray, rotation: FloatArray) -> FloatArray:
    """Matrices (k, 3, 2) from image offsets of a view to object offsets on planes through a point.

    The offset e obeys R e = u (two rows of ``rotation``) and n . e = 0. Not finite for a plane seen edge-on.
    """
    k = len(normals)
    system = np.empty((k, 3, 3))
    system[:, :2] = rotation[:2]
    system[:, 2] = normals
    facing = normals @ rotation[2]
    system[np.abs(facing) < 1e-9] = np.nan
    return np.asarray(np.linalg.inv(system)[:, :, :2])


def cross_view_transforms(normals: FloatArray, rotation_a: FloatArray, rotation_b: FloatArray) -> FloatArray:
    """Matrices (k, 2, 2) from image offsets in view a to offsets in view b for planes with these normals.

    In object units; divide by the scale of b and multiply by that of a for pixels.
    """
    return np.asarray(rotation_b[:2] @ lift(normals, rotation_a))
