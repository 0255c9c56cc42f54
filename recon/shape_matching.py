"""Shape matching: which points of two outlines belong together, and the warp that follows from them.

After S. Belongie, J. Malik and J. Puzicha, "Shape matching and object recognition using shape contexts",
IEEE Trans. PAMI 24(4), 2002: log-polar histograms of the other points, compared by chi-squared, matched
one to one; a thin-plate spline carries what lies between the points along.
"""

from dataclasses import dataclass
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray


def load_solvers() -> None:
    """Import what matching and bending take from scipy, half a second; importing this module does without.

    Without this call the first match takes it. Programs that must not wait then, nor read a file, call it.
    """
    for name in ("scipy.interpolate", "scipy.optimize", "scipy.spatial.distance"):
        import_module(name)


@dataclass(frozen=True)
class ShapeContextConfig:
    """Settings of the descriptor and of its matching."""

    radial_bins: int = 5
    angular_bins: int = 12
    inner_radius: float = 0.125
    """Radius of the innermost bin, in mean point distances."""
    outer_radius: float = 2.0
    """Points farther than this are left out."""
    position_weight: float = 1.0
    """Cost of a displacement by one root-mean-square radius of the outline, squared, beside the chi-squared
    cost in [0, 1]. Outlines that start aligned need not move far; 0 is the plain shape context."""


def shape_contexts(points: FloatArray, config: ShapeContextConfig) -> Float32Array:
    """Normalised histograms of outlines (..., m, 2), shape (..., m, radial * angular), each summing to 1.

    Invariant to translation, and to scale since radii are in units of the mean distance.
    """
    batch = points.reshape(-1, *points.shape[-2:])
    n, m, _ = batch.shape
    offset = batch[:, None, :, :] - batch[:, :, None, :]
    radius = np.hypot(offset[..., 0], offset[..., 1])
    mean = radius.sum(axis=(1, 2), keepdims=True) / max(m * (m - 1), 1)
    # a small slack keeps points on a bin's border in the same bin under rounding
    edges = np.geomspace(config.inner_radius, config.outer_radius, config.radial_bins) * (1 + 1e-9)
    ring = np.searchsorted(edges, radius / np.maximum(mean, 1e-12))
    turn = np.arctan2(offset[..., 1], offset[..., 0]) / (2 * np.pi) + 1e-9
    sector = np.floor(turn * config.angular_bins).astype(np.intp) % config.angular_bins
    bins = config.radial_bins * config.angular_bins
    row = np.arange(n * m).reshape(n, m, 1)
    use = (ring < config.radial_bins) & ~np.eye(m, dtype=bool)
    index = (row * bins + ring * config.angular_bins + sector)[use]
    counts = np.bincount(index, minlength=n * m * bins).reshape(n, m, bins).astype(np.float32)
    counts /= np.maximum(counts.sum(axis=2, keepdims=True), 1)
    return counts.reshape(*points.shape[:-1], bins)


def chi_squared(a: Float32Array, b: Float32Array) -> Float32Array:
    """Cost of every histogram of a (m, k) against every one of b (n, k), shape (m, n), in [0, 1].

    0.5 sum (a - b)^2 / (a + b) = 1 - 2 sum a b / (a + b) for histograms that sum to 1.
    """
    both = a[:, None, :] + b[None, :, :]
    np.maximum(both, np.float32(1e-12), out=both)
    np.divide(b[None, :, :], both, out=both)
    # the row of a is the same over n, so that the sum over bins is one matrix product a row
    overlap = np.matmul(both, a[:, :, None])[..., 0]
    return np.asarray(np.clip(1 - 2 * overlap, 0, 1), np.float32)


def match(
    a_points: FloatArray,
    a_context: Float32Array,
    b_points: FloatArray,
    b_context: Float32Array,
    config: ShapeContextConfig,
) -> tuple[NDArray[np.intp], float]:
    """The index in b of the partner of each point of a, shape (m,), and the mean chi-squared cost in [0, 1].

    One to one (the Hungarian method); b has at least as many points as a.
    """
    chi = chi_squared(a_context, b_context)
    a0, b0 = a_points - a_points.mean(axis=0), b_points - b_points.mean(axis=0)
    spread = np.mean(a0**2) + np.mean(b0**2)
    moved = ((a0[:, None, :] - b0[None, :, :]) ** 2).sum(axis=2) / max(float(spread), 1e-12)
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 (see load_solvers)

    rows, partner = linear_sum_assignment(chi + config.position_weight * moved)
    return np.asarray(partner, np.intp), float(chi[rows, partner].mean())


def thin_plate_operator(controls: FloatArray, points: FloatArray, regularisation: float) -> FloatArray:
    """The matrix W (p, m) with ``W @ targets`` = where the spline sends ``points`` (p, 2).

    The spline sends ``controls`` (m, 2) near ``targets`` (m, 2): exactly for regularisation 0; the larger,
    the more affine. The value is in units of the squared mean control distance. W depends on no target, so
    one matrix serves every candidate of a view bin. Needs three controls that are not on one line.
    """
    from scipy.interpolate import RBFInterpolator  # noqa: PLC0415 (see load_solvers)
    from scipy.spatial.distance import pdist  # noqa: PLC0415

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
