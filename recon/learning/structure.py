"""Class skeleton from part centroids: scaled-orthographic structure with known rotations (section 3.2)."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.errors import RescoreError


@dataclass(frozen=True, eq=False)
class Structure:
    """Part centroids in 3D, and the scale and shift of each view: scale_v u = R_v S + shift_v."""

    points: FloatArray
    """S_j, shape (n, 3); NaN where no two views of different directions show a point."""
    scale: FloatArray
    """Object units a pixel of each view, shape (v,); positive, mean 1 over the views."""
    shift: FloatArray
    """Offset of each view in object units, shape (v, 2)."""


def solve_structure(uv: FloatArray, rotation: FloatArray, weight: FloatArray | None = None) -> Structure:
    """Points, scales and shifts that explain centroids in views of known rotation.

    Linear and homogeneous in all unknowns: minimises the sum over views and points of
    weight_vj |R_v S_j + shift_v - scale_v u_vj|^2. The gauge is fixed by sum_j S_j = 0 and the mean scale 1.

    Args:
        uv: centroids, shape (v, n, 2); NaN where a view does not show a point.
        rotation: object to view, shape (v, 3, 3); the first two rows are used.
        weight: how much each centroid counts, shape (v, n), positive where seen; all the same for None.

    Raises:
        RescoreError: the views do not determine the structure.
    """
    views, count, _ = uv.shape
    seen: BoolArray = np.asarray(np.isfinite(uv).all(axis=2))
    solved = np.nonzero(_has_depth(seen, rotation))[0]
    used = np.nonzero(seen[:, solved].any(axis=1))[0]
    if len(solved) < 2 or len(used) < 2:
        raise RescoreError(
            f"skeleton: expected at least two parts that two views show, got {len(solved)}; "
            "label views of nearer bins"
        )
    chosen = np.ix_(used, solved)
    root = np.sqrt(np.ones_like(uv[..., 0]) if weight is None else weight)
    system = _system(uv[chosen], seen[chosen], rotation[used], root[chosen])
    n, v = len(solved), len(used)
    gauge = np.zeros((4, system.shape[1]))
    for axis in range(3):
        gauge[axis, axis : 3 * n : 3] = 1.0
    gauge[3, 3 * n : 3 * n + v] = 1.0
    # the constraints hold exactly: solve in the directions that they leave free
    _, _, vt = np.linalg.svd(gauge)
    free = vt[4:].T
    start = np.linalg.pinv(gauge) @ np.array([0.0, 0.0, 0.0, v])
    step, _, rank, singular = np.linalg.lstsq(system @ free, -system @ start, rcond=None)
    if rank < free.shape[1] or singular[-1] < 1e-4 * singular[0]:
        raise RescoreError(
            "skeleton: expected views that fix the depth of the parts, got views from the same or opposite "
            "bins; label views of other bins"
        )
    solution = start + free @ step
    scale, points = np.full(views, np.nan), np.full((count, 3), np.nan)
    shift = np.full((views, 2), np.nan)
    points[solved] = solution[: 3 * n].reshape(n, 3)
    scale[used] = solution[3 * n : 3 * n + v]
    shift[used] = solution[3 * n + v :].reshape(v, 2)
    if (scale[used] <= 0).any():
        raise RescoreError(
            f"skeleton: expected positive scales of all views, got {np.round(scale[used], 2).tolist()}; "
            "view bins contradict each other"
        )
    return Structure(points, scale, shift)


def _has_depth(seen: BoolArray, rotation: FloatArray) -> BoolArray:
    """Whether views that differ in direction show each point, shape (n,).

    The smallest eigenvalue of the sum of R^T R (two rows each) is 1 - |cos| of the angle between two views:
    0 for views from the same or opposite sides.
    """
    rows = rotation[:, :2]
    known = np.einsum("vn,vri,vrj->nij", seen.astype(float), rows, rows)
    return np.asarray(np.linalg.eigvalsh(known)[:, 0] > 1 - np.cos(np.deg2rad(5)))


def _system(uv: FloatArray, seen: BoolArray, rotation: FloatArray, factor: FloatArray) -> FloatArray:
    """Rows of factor_vj (R_v S_j + shift_v - scale_v u_vj); columns are points, scales, shifts."""
    views, count, _ = uv.shape
    v, j = np.nonzero(seen)
    system = np.zeros((len(v), 2, 3 * count + 3 * views))
    row = np.arange(len(v))
    for axis in range(3):
        system[row, :, 3 * j + axis] = rotation[v, :2, axis]
    system[row, :, 3 * count + v] = -uv[v, j]
    for axis in range(2):
        system[row, axis, 3 * count + views + 2 * v + axis] = 1.0
    system *= factor[v, j][:, None, None]
    return system.reshape(2 * len(v), -1)
