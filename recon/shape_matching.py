"""Shape matching: which points of two outlines belong together, and the warp that follows from them.

After S. Belongie, J. Malik and J. Puzicha, "Shape matching and object recognition using shape contexts",
IEEE Trans. PAMI 24(4), 2002: log-polar histograms of the other points, compared by chi-squared, matched
one to one; a thin-plate spline carries what lies between the points along.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

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

    def __post_init__(self) -> None:
        if self.angular_bins % 2:
            raise ValueError(f"angular_bins: expected an even number, got {self.angular_bins}")


def shape_contexts(points: FloatArray, config: ShapeContextConfig) -> Float32Array:
    """Normalised histograms of outlines (..., m, 2), shape (..., m, radial * angular), each summing to 1.

    Invariant to translation, and to scale since radii are in units of the mean distance.
    """
    batch = points.reshape(-1, *points.shape[-2:])
    bins = config.radial_bins * config.angular_bins
    found = np.empty((*batch.shape[:2], bins), np.float32)
    # outlines one by one, since the pairs of one stay near the processor
    for outline, counts in zip(batch, found, strict=True):
        counts[:] = _counts(outline, config)
    found /= np.maximum(found.sum(axis=2, keepdims=True), 1)
    return found.reshape(*points.shape[:-1], bins)


def _counts(points: FloatArray, config: ShapeContextConfig) -> NDArray[np.intp]:
    """How many of the other points (m, 2) lie in each bin around each, shape (m, radial * angular)."""
    m, rings, sectors = len(points), config.radial_bins, config.angular_bins
    pairs = first, second = _pairs(m)
    x, y = (row.take(second) - row.take(first) for row in np.ascontiguousarray(points.T))
    radius = np.sqrt(x * x + y * y)
    mean = max(2 * float(radius.sum()) / max(m * (m - 1), 1), 1e-12)
    # ring ``rings`` is for what lies farther, and left out
    ring = (radius > mean * config.edges[:, None]).sum(axis=0, dtype=np.uint16) * np.uint16(sectors)
    cells = np.concatenate([ring + s for s in _sectors(x, y, 2 * np.pi * 1e-9 * radius, sectors)])
    index = pairs.ravel() * ((rings + 1) * sectors) + cells
    counts = np.bincount(index, minlength=m * (rings + 1) * sectors)
    return counts.reshape(m, rings + 1, sectors)[:, :rings].reshape(m, -1)


_Sectors = NDArray[np.uint16]


@lru_cache(maxsize=4)
def _pairs(m: int) -> NDArray[np.intp]:
    """Every pair of m points once, the lower index first, shape (2, pairs)."""
    return np.stack(np.triu_indices(m, 1))


def _sectors(x: FloatArray, y: FloatArray, slack: FloatArray, count: int) -> tuple[_Sectors, _Sectors]:
    """The sector of each offset (n,) among an even count, from the x axis on, and that of its opposite.

    Which side of the borders it lies on says it, without an angle; within ``slack`` it lies on them.
    """
    below = (y < -slack) | ((y <= slack) & (x < 0))
    x, y = np.where(below, -x, x), np.where(below, -y, y)
    y_low, y_high = y - slack, y + slack
    sector = np.zeros(len(x), np.uint16)
    for i in range(1, count // 2):
        # of lines through the origin, the upright one is at a quarter of a turn
        slope = np.tan(2 * np.pi / count * i)
        sector += (
            x <= slack if 4 * i == count else y_high >= x * slope if 4 * i < count else y_low <= x * slope
        )
    half = below * np.uint16(count // 2)
    return sector + half, sector + (np.uint16(count // 2) - half)


def chi_squared(a: Float32Array, b: Float32Array) -> Float32Array:
    """Cost of every histogram of a (m, k) against every one of b (n, k), shape (m, n), in [0, 1].

    0.5 sum (a - b)^2 / (a + b) = 1 - 2 sum a b / (a + b) for histograms that sum to 1.
    """
    # what one side never has adds nothing; ``compress`` keeps the rows together in memory
    used = a.any(axis=0) & b.any(axis=0)
    a, b = a.compress(used, axis=1), b.compress(used, axis=1)
    both = (a + np.float32(1e-12))[:, None, :] + b
    np.divide(b, both, out=both)
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
    moved = ((a0**2).sum(axis=1)[:, None] + (b0**2).sum(axis=1) - 2 * a0 @ b0.T) / max(float(spread), 1e-12)
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415 (a third of a second)

    rows, partner = linear_sum_assignment(chi + config.position_weight * moved)
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
