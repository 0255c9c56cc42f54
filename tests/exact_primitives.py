"""The library of primitives in closed form: what the generic phase learns, without learning it."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.learning.primitives import PrimitiveLibrary, lift, primitive_normals
from recon.view_bins import ViewBins

FloatArray = NDArray[np.float64]


def cross_view_transforms(normals: FloatArray, rotation_a: FloatArray, rotation_b: FloatArray) -> FloatArray:
    """Matrices (k, 2, 2) from image offsets in view a to offsets in view b for planes with these normals.

    In object units, under scaled orthographic projection, which the learned transforms approach.
    """
    return np.asarray(rotation_b[:2] @ lift(normals, rotation_a))


@lru_cache(maxsize=8)
def exact_library(bins: ViewBins, min_facing: float = 0.07) -> PrimitiveLibrary:
    """Affine transforms under scaled orthography where both views see the same side of the primitive."""
    normals = primitive_normals()
    rotation = np.stack([bins.view_from_object(b) for b in range(bins.count)])
    facing = normals @ rotation[:, 2].T
    transform = np.full((len(normals), bins.count, bins.count, 3, 3), np.nan)
    for a in range(bins.count):
        for b in range(bins.count):
            seen = (facing[:, a] * facing[:, b] > 0) & (np.abs(facing[:, [a, b]]).min(axis=1) >= min_facing)
            transform[seen, a, b] = np.eye(3)
            transform[seen, a, b, :2, :2] = cross_view_transforms(normals[seen], rotation[a], rotation[b])
    residual = np.where(np.isnan(transform[..., 0, 0]), np.nan, 0.0)
    return PrimitiveLibrary(bins, normals, transform, residual)
