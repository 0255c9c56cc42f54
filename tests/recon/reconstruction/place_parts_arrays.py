"""Planes placed breadth-first in whole arrays, as the text reads: the compiled placing is held to it."""

from collections.abc import Mapping

import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera


def placed_in_arrays(
    labels: UInt8Array,
    camera: PinholeCamera,
    normals: Mapping[int, FloatArray],
    points_m: Mapping[int, FloatArray],
    limits_m: tuple[float, float],
    min_angle_rad: float,
) -> tuple[dict[int, FloatArray], FloatArray]:
    """Planes (4,) of the placed parts of a picture (h, w) by label, and its depth (h, w)."""
    v, u = np.mgrid[0 : labels.shape[0], 0 : labels.shape[1]].astype(float)
    rays = camera.rays(np.stack([u, v], axis=-1))
    depth, planes, given_up = np.full(labels.shape, np.nan), dict[int, FloatArray](), set[int]()
    ready = {k: np.atleast_2d(p) for k, p in points_m.items() if (labels == k).any()}
    while ready:
        for label, points in ready.items():
            own, normal = labels == label, normals.get(label)
            if normal is None:
                given_up.add(label)
                continue
            facing = rays[own] @ normal
            sine = np.mean(np.abs(facing) / np.linalg.norm(rays[own], axis=1))
            level = float(np.median(points @ normal))
            z = level / facing
            good = (z >= limits_m[0]) & (z <= limits_m[1])
            if sine < np.sin(min_angle_rad) or good.mean() < 0.5:
                given_up.add(label)
                continue
            depth[own] = np.where(good, z, np.nan)
            planes[label] = np.append(normal, -level)
        left = {*np.unique(labels).tolist()} - {0, *planes, *given_up}
        ready = {k: points for k in sorted(left) if len(points := _beyond(labels, k, rays, depth))}
    return planes, depth


def _beyond(labels: UInt8Array, label: int, rays: FloatArray, depth: FloatArray) -> FloatArray:
    """Points (m, 3) with a depth that adjoin a part."""
    found = []
    for own, other in (
        (np.s_[:, 1:], np.s_[:, :-1]),
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[1:], np.s_[:-1]),
        (np.s_[:-1], np.s_[1:]),
    ):
        at = (labels[own] == label) & (labels[other] != label) & np.isfinite(depth[other])
        found.append(rays[other][at] * depth[other][at][:, None])
    return np.concatenate(found)
