"""Planes from the ground line upward, and the predicted depth map (section 4.3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.reconstruction.ground_line import GroundLine
from recon.reconstruction.part_labels import PartLabels


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


def feet(model: ClassModel) -> dict[int, FloatArray]:
    """Lowest outline point (3,) of each part that reaches the lowest tenth of the model, by label."""
    low = {p.label: p.outline[np.argmin(p.outline[:, 2])] for p in model.parts}
    limit = min(float(point[2]) for point in low.values()) + 0.1 * model.extents[2]
    return {label: point for label, point in low.items() if point[2] <= limit}


def place_instance(
    parts: PartLabels,
    line: GroundLine,
    cam_from_object: FloatArray,
    model: ClassModel,
    camera: PinholeCamera,
    config: PlacingConfig,
) -> PlacedParts:
    """Part planes and depth of one instance, within the depth limits of an object of this size."""
    labels, rays = parts.labels, camera.rays(parts.uv_px)
    normals = {p.label: cam_from_object @ p.plane[:3] for p in model.parts}
    depth = float(np.mean([p[2] for p in line.points_m.values()]))
    scale = _metres_per_unit(labels, depth, cam_from_object, model, camera)
    # the object's size: the diagonal of the model's extents
    reach = config.max_depth_range * scale * float(np.linalg.norm(model.extents))
    limits = (max(depth - reach, 1e-3), depth + reach)
    placed = place_parts(labels, rays, normals, line.points_m, limits, config)
    if placed.placed_share >= config.min_placed:
        return placed
    rest = {k: n for k, n in normals.items() if k not in placed.planes}
    stand_in = _stand_in(labels, rays, rest, line.points_m, scale, cam_from_object, model, config)
    on_ground = {k: p for k, p in line.points_m.items() if k in placed.planes}
    again = place_parts(labels, rays, normals, on_ground | stand_in, limits, config)
    if again.placed_share <= placed.placed_share:
        return placed
    # why the parts on the ground have no plane was found in the first round
    reasons = again.unplaced | {k: why for k, why in placed.unplaced.items() if k in line.points_m}
    return replace(again, unplaced={k: v for k, v in reasons.items() if k not in again.planes})


def _stand_in(
    labels: UInt8Array,
    rays: FloatArray,
    normals: Mapping[int, FloatArray],
    points_m: Mapping[int, FloatArray],
    metres_per_unit: float,
    cam_from_object: FloatArray,
    model: ClassModel,
    config: PlacingConfig,
) -> dict[int, FloatArray]:
    """A known point of one part for a view that shows the parts on the ground edge-on, as a car's front.

    It belongs to the part that shows the most area to the camera and is not edge-on itself, and lies as far
    from the ground contacts as in the class model.
    """
    shown = {}
    for k in (k for k in normals if k not in points_m and (labels == k).any()):
        own = rays[labels == k]
        sine = np.abs(own @ normals[k]) / np.linalg.norm(own, axis=1)
        if sine.mean() >= np.sin(config.min_angle_rad):
            shown[k] = float(sine.sum())
    if not shown:
        return {}
    label = max(shown, key=lambda k: shown[k])
    foot, centroid = feet(model), model.part(label).centroid
    steps = [p + metres_per_unit * cam_from_object @ (centroid - foot[k]) for k, p in points_m.items()]
    return {label: np.mean(steps, axis=0)}


def _metres_per_unit(
    labels: UInt8Array,
    depth_m: float,
    cam_from_object: FloatArray,
    model: ClassModel,
    camera: PinholeCamera,
) -> float:
    """Metres of a unit of the model, from the width of the object in the picture at the depth of its feet."""
    across: Sequence[FloatArray] = [p.outline @ cam_from_object[0] for p in model.parts]
    columns = np.nonzero(labels.any(axis=0))[0]
    width_m = (columns[-1] - columns[0] + 1) * depth_m / camera.fx_px
    return float(width_m / np.ptp(np.concatenate(across)))
