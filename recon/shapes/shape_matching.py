"""Shape matching: which points of two outlines belong together, and the warp that follows from them.

After S. Belongie, J. Malik and J. Puzicha, "Shape matching and object recognition using shape contexts",
IEEE Trans. PAMI 24(4), 2002: log-polar histograms of the other points, compared by chi-squared, matched
one to one; a thin-plate spline carries what lies between the points along.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray


@dataclass(frozen=True)
class ShapeContextConfig:
    """Settings of the descriptor and of its matching."""

    radial_bins: int = 5
    angular_bins: int = 12
    """An even number: a sector and the opposite one."""
    inner_radius: float = 0.125
    """Radius of the innermost bin, in mean point distances."""
    outer_radius: float = 2.0
    """Points farther than this are left out."""
    position_weight: float = 1.0
    """Cost of a displacement by one root-mean-square radius of the outline, squared, beside the chi-squared
    cost in [0, 1]. Outlines that start aligned need not move far; 0 is the plain shape context."""

    @cached_property
    def edges(self) -> FloatArray:
        """Outer radii of the rings of bins, in mean point distances, shape (radial_bins,)."""
        # a small slack keeps points on a bin's border in the same bin under rounding
        return np.geomspace(self.inner_radius, self.outer_radius, self.radial_bins) * (1 + 1e-9)

    @cached_property
    def borders(self) -> FloatArray:
        """Directions of the borders between the sectors of half a turn, shape (angular_bins / 2 - 1, 2)."""
        turn = 2 * np.pi / self.angular_bins * np.arange(1, self.angular_bins // 2)
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def __post_init__(self) -> None:
        if self.angular_bins % 2:
            raise ValueError(f"angular_bins: expected an even number, got {self.angular_bins}")


def shape_contexts(points: FloatArray, config: ShapeContextConfig) -> Float32Array:
    """Normalised histograms of outlines (..., m, 2), shape (..., m, radial * angular), each summing to 1.

    Invariant to translation, and to scale since radii are in units of the mean distance.
    """
    from recon.shapes.context_loops import counted  # noqa: PLC0415 (takes half a second with Numba)

    batch = np.asarray(points, float).reshape(-1, *points.shape[-2:])
    found = np.zeros((*batch.shape[:2], config.radial_bins * config.angular_bins), np.float32)
    for outline, counts in zip(batch, found, strict=True):
        counted(outline, config.edges, config.borders, counts)
    found /= np.maximum(found.sum(axis=2, keepdims=True), 1)
    return found.reshape(*points.shape[:-1], -1)


def chi_squared(a: Float32Array, b: Float32Array) -> Float32Array:
    """Cost of every histogram of a (m, k) against every one of b (n, k), shape (m, n), in [0, 1]."""
    from recon.shapes.context_loops import costs  # noqa: PLC0415 (takes half a second with Numba)

    found = np.empty((len(a), len(b)), np.float32)
    costs(np.ascontiguousarray(a), np.ascontiguousarray(b.T), found)
    return found


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
    a_square, b_square = (a0 * a0).sum(axis=1), (b0 * b0).sum(axis=1)
    weight = config.position_weight / max(float(a_square.mean() + b_square.mean()) / a0.shape[1], 1e-12)
    cost = a0 @ (-2 * weight * b0.T)
    cost += chi
    cost += (weight * a_square)[:, None]
    cost += weight * b_square
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 (a third of a second)

    rows, partner = linear_sum_assignment(cost)
    return np.asarray(partner, np.intp), float(chi[rows, partner].mean())


def thin_plate_operator(controls: FloatArray, points: FloatArray, regularisation: float) -> FloatArray:
    """The matrix W (p, m) with ``W @ targets`` = where the spline sends ``points`` (p, 2).

    The spline sends ``controls`` (m, 2) near ``targets`` (m, 2): exactly for regularisation 0; the larger,
    the more affine. The value is in units of the squared mean control distance. W depends on no target, so
    one matrix serves every candidate of a view bin. Needs three controls that are not on one line.
    """
    from scipy.interpolate import RBFInterpolator  # noqa: PLC0415 (a third of a second)
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
