"""Planes of the parts in a picture, turned a little so that parts that adjoin meet along their borders."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.reconstruction.instance import NEAR_M, Instance3D
from recon.reconstruction.reconstruct import Reconstruction

_MAX_APART = 0.08
"""Parts whose polygons come nearer to each other than this share of the box's diagonal adjoin in 3D; where
parts farther apart adjoin in the picture, one hides the other."""
_BORDER_WEIGHT = 30.0
"""Weight of a pixel of a border beside one of a part seen face-on."""
_LEAST_SINE = 0.05
"""Parts seen edge-on count as if seen at this sine, so that every plane is fixed."""
_PREDICTED_WEIGHT = 0.3
"""Weight of a pixel on a plane that the class model predicts beside one on a plane from the picture."""
_SLACK = 0.05
"""Joining moves a part by no more than this share of the box's diagonal beyond its depths."""
_BEYOND = 0.25
"""No part leaves the object's box by more than this share of the diagonal towards the camera or away."""
_ABOVE = 0.002
"""What touches the ground is this share of its depth before it."""
_SAMPLES = 400
"""Pixels of a part that are looked at."""


@dataclass(frozen=True, eq=False)
class JoinedPlanes:
    """A plane for each part in the picture, as inverse depth, which is linear in the picture."""

    inverse_depth: dict[int, FloatArray]
    """Vector (3,) by label: its product with a ray of z = 1 is 1 / z."""
    limits_m: dict[int, tuple[float, float]]
    """Nearest and farthest z-depth of each part by label."""
    adjoining: frozenset[tuple[int, int]]
    """Labels of parts that adjoin in the picture and in 3D, both orders."""
    ground: FloatArray
    """The ground as inverse depth, shape (3,)."""

    def depth_along(self, label: int, rays: FloatArray) -> FloatArray:
        """Z-depth (n,) at which rays (n, 3) with z = 1 meet the plane of a part, within its limits.

        Nothing of an object is below the ground, or so near to it that the ground would hide it.
        """
        near, far = self.limits_m[label]
        inverse = np.clip(rays @ self.inverse_depth[label], 1 / far, 1 / near)
        return np.asarray(1 / np.maximum(inverse, rays @ self.ground * (1 + _ABOVE)))


def joined_planes(found: Reconstruction, instance: Instance3D, camera: PinholeCamera) -> JoinedPlanes:
    """Planes near those of the instance that meet where parts adjoin in the picture and in 3D.

    Each part has the plane from the picture or, where it has none, that which the class model predicts; they
    come from borders, contacts and the class model one by one, and miss each other by a little. Linear least
    squares over all parts at once: a part keeps the depth of its plane the better the more it faces the
    camera, and both parts of a border have the same depth there.
    """
    parts = {p.label: p for p in instance.parts}
    labels = [int(k) for k in np.unique(found.part_labels) if int(k) in parts]
    column = {k: 3 * i for i, k in enumerate(labels)}
    rows, values = [], []
    limits = {}
    diagonal_m = float(np.linalg.norm(instance.size_m))
    slack = _SLACK * diagonal_m
    first, last = instance.corners_m[:, 2].min(), instance.corners_m[:, 2].max()
    first, last = max(first - _BEYOND * diagonal_m, NEAR_M), last + _BEYOND * diagonal_m
    for k in labels:
        rays = _rays(np.nonzero(found.part_labels == k), found, camera)
        step = max(1, len(rays) // _SAMPLES)
        z = parts[k].depth_along(rays[::step])
        weight = max(parts[k].facing_sine, _LEAST_SINE) * np.sqrt(step)
        weight *= 1.0 if parts[k].seen else np.sqrt(_PREDICTED_WEIGHT)
        block = np.zeros((len(z), 3 * len(labels)))
        block[:, column[k] : column[k] + 3] = weight * z[:, None] * rays[::step]
        rows.append(block)
        values.append(np.full(len(z), weight))
        limits[k] = _within(float(z.min()) - slack, float(z.max()) + slack, float(first), float(last))
    adjoining = _adjoining(found, instance, labels)
    distance = instance.distance_m
    for a, b in sorted(p for p in adjoining if p[0] < p[1]):
        rays = _rays(_border(found.part_labels, a, b), found, camera)
        block = np.zeros((len(rays), 3 * len(labels)))
        block[:, column[a] : column[a] + 3] = np.sqrt(_BORDER_WEIGHT) * distance * rays
        block[:, column[b] : column[b] + 3] = -np.sqrt(_BORDER_WEIGHT) * distance * rays
        rows.append(block)
        values.append(np.zeros(len(rays)))
    solution, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    planes = {k: solution[c : c + 3] for k, c in column.items()}
    up, on_ground = instance.cam_from_object[:3, 2], instance.cam_from_object[:3, 3]
    return JoinedPlanes(planes, limits, adjoining, up / (up @ on_ground))


def _within(near: float, far: float, first: float, last: float) -> tuple[float, float]:
    """The depth limits of a part, cut to the limits of its object."""
    near = min(max(near, first), last)
    return near, max(min(far, last), near)


def _rays(at: tuple[NDArray[np.intp], ...], found: Reconstruction, camera: PinholeCamera) -> FloatArray:
    """Rays (n, 3) through pixels of the window, given as rows and columns."""
    return camera.rays(np.stack([at[1] + found.x0_px, at[0] + found.y0_px], axis=1).astype(float))


def _border(labels: UInt8Array, a: int, b: int) -> tuple[NDArray[np.intp], ...]:
    """Rows and columns of the pixels of part a that touch part b."""
    other = np.pad(labels == b, 1)
    touched = other[:-2, 1:-1] | other[2:, 1:-1] | other[1:-1, :-2] | other[1:-1, 2:]
    return np.nonzero((labels == a) & touched)


def _adjoining(found: Reconstruction, instance: Instance3D, labels: list[int]) -> frozenset[tuple[int, int]]:
    """Pairs of labels that adjoin in the picture and whose polygons in 3D come near each other."""
    limit = _MAX_APART * float(np.linalg.norm(instance.size_m))
    points = {p.label: p.outline_m for p in instance.parts}
    pairs = set()
    for i, a in enumerate(labels):
        for b in labels[i + 1 :]:
            if len(_border(found.part_labels, a, b)[0]):
                gap, _ = cKDTree(points[a]).query(points[b])
                if gap.min() <= limit:
                    pairs |= {(a, b), (b, a)}
    return frozenset(pairs)
