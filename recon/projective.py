"""Projective transforms of the image plane by linear regression."""

import numpy as np

from recon.arrays import FloatArray


def projective_transform(
    source: FloatArray, target: FloatArray, normal: FloatArray | None = None
) -> FloatArray:
    """The projective transform (3, 3), last entry 1, that linear regression gives for points (m, 2).

    With unit normals (m, 2), only the distances along them count: the points may slide along an outline.
    """
    x, y = source.T
    u, v = target.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows_u = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=1)
    rows_v = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=1)
    if normal is None:
        rows, value = np.concatenate([rows_u, rows_v]), np.concatenate([u, v])
    else:
        rows = normal[:, :1] * rows_u + normal[:, 1:] * rows_v
        value = (normal * target).sum(axis=1)
    solution, *_ = np.linalg.lstsq(rows, value, rcond=None)
    return np.append(solution, 1.0).reshape(3, 3)


def affine_transform(source: FloatArray, target: FloatArray) -> FloatArray:
    """The affine transform (3, 3) that linear regression gives for points (m, 2) to (m, 2)."""
    rows = np.concatenate([source, np.ones((len(source), 1))], axis=1)
    solution, *_ = np.linalg.lstsq(rows, target, rcond=None)
    return np.concatenate([solution.T, [[0.0, 0.0, 1.0]]])


def apply_projective(transform: FloatArray, points: FloatArray) -> FloatArray:
    """Points (m, 2) after projective transforms (..., 3, 3), shape (..., m, 2)."""
    moved = points @ np.swapaxes(transform[..., :2], -1, -2) + transform[..., None, :, 2]
    return np.asarray(moved[..., :2] / moved[..., 2:])


def nearest_on_outline(points: FloatArray, outline: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest points (..., m, 2) of a closed outline (d, 2) to points (..., m, 2), and unit normals there."""
    at = ((points[..., None, :] - outline) ** 2).sum(axis=-1).argmin(axis=-1)
    along = outline[(at + 1) % len(outline)] - outline[at - 1]
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return outline[at], normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
