"""Thin-plate splines: the smooth map of the plane that moves some points to given places.

After F. L. Bookstein, "Principal warps", IEEE Trans. PAMI 11(6), 1989, with the regularisation of
Belongie et al. 2002.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import pdist

FloatArray = NDArray[np.float64]


def thin_plate_operator(controls: FloatArray, points: FloatArray, regularisation: float) -> FloatArray:
    """The matrix W (p, m) with ``W @ targets`` = where the spline sends ``points`` (p, 2).

    The spline sends ``controls`` (m, 2) near ``targets`` (m, 2): exactly for regularisation 0; the larger,
    the more affine. The value is in units of the squared mean control distance. W depends on no target, so
    one matrix serves every candidate of a view bin. Needs three controls that are not on one line.
    """
    scale = pdist(controls).mean()
    # scipy's kernel r^2 log r is half of Bookstein's r^2 log r^2, and so is its smoothing
    spline = RBFInterpolator(
        controls / scale,
        np.eye(len(controls)),
        kernel="thin_plate_spline",
        smoothing=regularisation / 2,
        degree=1,
    )
    return np.asarray(spline(points / scale))
