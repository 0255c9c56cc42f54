"""Planes from the ground line upward, and the predicted depth map (section 4.3)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array


@dataclass(frozen=True)
class PlacingConfig:
    """When a part counts as placed."""

    min_angle_rad: float = float(np.deg2rad(12.0))
    """A plane that the rays of its part meet at a smaller angle (mean) is seen edge-on: its depth would be
    noise, so the part is not placed."""
    max_depth_range: float = 1.0
    """Depths farther from the ground line than this many object lengths (diagonals of the model's extents,
    scaled by the outline's width) are dropped; a part that loses more than half of them is not placed."""
    min_placed: float = 0.5
    """Smallest share of the labelled pixels that must get a depth."""


@dataclass(frozen=True, eq=False)
class PlacedParts:
    """Part planes in the camera frame and the depth that they give."""

    planes: dict[int, FloatArray]
    """Q_j alpha with its d, shape (4,), by label; in the order of placing."""
    unplaced: dict[int, str]
    """Why each other part of the image has no plane."""
    depth: Float32Array
    """Shape (h, w): z-depth at pixel centres, NaN outside placed parts."""
    placed_share: float
    """Share of the labelled pixels with a depth, in [0, 1]."""


def place_parts(
    labels: UInt8Array,
    rays: FloatArray,
    normals: Mapping[int, FloatArray],
    ground_points_m: Mapping[int, FloatArray],
    depth_limits_m: tuple[float, float],
    config: PlacingConfig,
) -> PlacedParts:
    """Place part planes breadth-first: first those on the ground line, then those that adjoin a placed part.

    A part gets its d from known 3D points: its ground points, or the points of placed parts along the shared
    border. The median over them all counts, so that a long border outweighs a short one. Each round places
    every part that adjoins a part of an earlier round, so the order of labels does not matter.

    Args:
        labels: part labels of a window, shape (h, w), 0 for none.
        rays: viewing rays of its pixel centres with z = 1, shape (h, w, 3).
        normals: unit plane normals in the camera frame by label.
        ground_points_m: known points (3,) or (m, 3) of the parts on the ground line.
        depth_limits_m: nearest and farthest depth that the object can have.
        config: settings.
    """
    state = _Placing(labels, rays, normals, depth_limits_m, config)
    for label, points in ground_points_m.items():
        if label in state.pixels:
            state.place(label, np.atleast_2d(points))
    borders = _borders(labels)
    while True:
        ready = {
            label: points
            for label in sorted(set(state.pixels) - set(state.planes) - set(state.unplaced))
            if len(points := state.border_points(label, borders))
        }
        if not ready:
            break
        for label, points in ready.items():
            state.place(label, points)
    for label in sorted(set(state.pixels) - set(state.planes) - set(state.unplaced)):
        state.unplaced[label] = "touches no placed part"
    share = float(np.isfinite(state.depth).sum() / max((labels > 0).sum(), 1))
    return PlacedParts(
        state.planes, state.unplaced, state.depth.reshape(labels.shape).astype(np.float32), share
    )


class _Placing:
    """What is known while the planes spread."""

    def __init__(
        self,
        labels: UInt8Array,
        rays: FloatArray,
        normals: Mapping[int, FloatArray],
        depth_limits_m: tuple[float, float],
        config: PlacingConfig,
    ) -> None:
        self.rays = rays.reshape(-1, 3)
        self.inverse_length = 1 / np.sqrt(np.einsum("ij,ij->i", self.rays, self.rays))
        self.normals = normals
        self.limits = depth_limits_m
        self.config = config
        self.labels = labels.ravel()
        present = np.nonzero(np.bincount(self.labels))[0]
        self.pixels = {int(k): np.nonzero(self.labels == k)[0] for k in present if k}
        self.depth = np.full(labels.size, np.nan)
        self.planes: dict[int, FloatArray] = {}
        self.unplaced: dict[int, str] = {}

    def place(self, label: int, points_m: FloatArray) -> None:
        """Give a part its plane through known points (m, 3) and its pixels their depth, or say why not."""
        normal = self.normals.get(label)
        if normal is None:
            self.unplaced[label] = "the class model has no plane for it"
            return
        pixels = self.pixels[label]
        rays = self.rays[pixels]
        facing = rays @ normal
        angle_sine = float((np.abs(facing) * self.inverse_length[pixels]).mean())
        if angle_sine < np.sin(self.config.min_angle_rad):
            self.unplaced[label] = f"seen edge-on, at {np.rad2deg(np.arcsin(angle_sine)):.1f} degrees"
            return
        d = -float(np.median(points_m @ normal))
        with np.errstate(divide="ignore"):
            depth = -d / facing
        good = (depth >= self.limits[0]) & (depth <= self.limits[1])
        if good.mean() < 0.5:
            self.unplaced[label] = f"{1 - good.mean():.0%} of its depth lies beyond the object"
            return
        self.planes[label] = np.append(normal, d)
        self.depth[pixels[good]] = depth[good]

    def border_points(self, label: int, borders: NDArray[np.intp]) -> FloatArray:
        """3D points (m, 3) of placed neighbours along their borders with a part."""
        own, other = borders
        flat = other[self.labels[own] == label]
        flat = flat[np.isfinite(self.depth[flat])]
        return np.asarray(self.depth[flat, None] * self.rays[flat])


def _borders(labels: UInt8Array) -> NDArray[np.intp]:
    """Flat indices (2, m) of 4-neighbours with different labels, both not 0; each pair in both orders."""
    index = np.arange(labels.size).reshape(labels.shape)
    a = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    b = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    flat = labels.ravel()
    use = (flat[a] != flat[b]) & (flat[a] > 0) & (flat[b] > 0)
    a, b = a[use], b[use]
    return np.stack([np.concatenate([a, b]), np.concatenate([b, a])])
