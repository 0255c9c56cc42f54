"""Thin-plate splines: the smooth map of the plane that moves some points to given places.

After F. L. Bookstein, "Principal warps", IEEE Trans. PAMI 11(6), 1989, with the regularisation of
Belongie et al. 2002.
"""

import numpy as np

from recon.arrays import FloatArray


def thin_plate_operator(controls: FloatArray, points: FloatArray, regularisation: float) -> FloatArray:
    """The matrix W (p, m) with ``W @ targets`` = where the spline sends ``points`` (p, 2).

    The spline sends ``controls`` (m, 2) near ``targets`` (m, 2): exactly for regularisation 0; the larger,
    the more affine. The value is in units of the squared mean control distance. W depends on no target, so
    one matrix serves every candidate of a view bin. Needs three controls that are not on one line.
    """
    m = len(controls)
    between = _distance_squared(controls, controls)
    scale = float(np.sqrt(between).sum() / (m * (m - 1))) ** 2
    system = np.zeros((m + 3, m + 3))
    system[:m, :m] = _kernel(between / scale) + regularisation * np.eye(m)
    system[:m, m:] = _affine(controls)
    system[m:, :m] = system[:m, m:].T
    coefficients = np.linalg.solve(system, np.eye(m + 3)[:, :m])
    basis = np.concatenate([_kernel(_distance_squared(points, controls) / scale), _affine(points)], axis=1)
    return np.asarray(basis @ coefficients)


def _distance_squared(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(((a[:, None, :] - b[None, :, :]) ** 2).sum(axis=2))


def _kernel(r2: FloatArray) -> FloatArray:
    """U(r) = r^2 log r^2, 0 at r = 0."""
    return np.asarray(r2 * np.log(np.where(r2 > 0, r2, 1.0)))


def _affine(points: FloatArray) -> FloatArray:
    return np.concatenate([np.ones((len(points), 1)), points], axis=1)
