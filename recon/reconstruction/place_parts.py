"""Planes from the ground line upward, and the predicted depth map (section 4.3)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array, median
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


class SeenParts:
    """The parts of a labelled window as rays meet their planes: all that no place of a plane changes."""

    def __init__(self, parts: PartLabels, camera: PinholeCamera, normals: Mapping[int, FloatArray]) -> None:
        """Looks at the parts of a picture of a camera with unit plane normals in its frame, by label."""
        self.shape = parts.labels.shape
        self.normals = normals
        self.area = sum(parts.area_px.values())
        across, down = parts.rays(camera)
        self.ray_x, self.ray_y = (np.broadcast_to(v, self.shape).ravel() for v in (across, down[:, None]))
        """x and y of the viewing rays with z = 1 of all pixels of the window."""
        flat = parts.labels.ravel()
        self.pixels = {k: np.flatnonzero(flat == k) for k in parts.area_px}
        """Flat indices of the pixels of each part."""
        self.facing: dict[int, FloatArray] = {}
        """Rays of these pixels times the normal of the part."""
        self.sine: dict[int, float] = {}
        """Mean sine of the angle at which they meet its plane."""
        for k in self.pixels.keys() & normals.keys():
            x, y = self.ray_x.take(self.pixels[k]), self.ray_y.take(self.pixels[k])
            a, b, c = normals[k].tolist()
            self.facing[k] = a * x + b * y + c
            self.sine[k] = float((np.abs(self.facing[k]) / np.sqrt(x * x + y * y + 1)).mean())
        self.beyond, self.adjoining = _neighbours(parts.labels)

    def edge_on(self, label: int, config: PlacingConfig) -> bool:
        """Whether the plane of a part is seen at too small an angle."""
        return bool(self.sine[label] < np.sin(config.min_angle_rad))


def place_parts(
    parts: PartLabels,
    camera: PinholeCamera,
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
        parts: the part labels.
        camera: the camera of their picture.
        normals: unit plane normals in the camera frame by label.
        ground_points_m: known points (3,) or (m, 3) of the parts on the ground line.
        depth_limits_m: nearest and farthest depth that the object can have.
        config: settings.
    """
    return _placed(SeenParts(parts, camera, normals), ground_points_m, depth_limits_m, config)


def _placed(
    seen: SeenParts,
    ground_points_m: Mapping[int, FloatArray],
    depth_limits_m: tuple[float, float],
    config: PlacingConfig,
) -> PlacedParts:
    state = _Placing(seen, depth_limits_m, config)
    ready = {k: np.atleast_2d(points) for k, points in ground_points_m.items() if k in seen.pixels}
    # a ray along the plane never meets it
    with np.errstate(divide="ignore"):
        while ready:
            for label, points in ready.items():
                state.place(label, points)
            ready = {label: points for label in state.left if len(points := state.border_points(label))}
    for label in state.left:
        state.unplaced[label] = "touches no placed part"
    depth = state.depth.reshape(seen.shape).astype(np.float32)
    share = state.with_depth / max(seen.area, 1)
    return PlacedParts(state.planes, state.unplaced, depth, share)


class _Placing:
    """What is known while the planes spread."""

    def __init__(self, seen: SeenParts, depth_limits_m: tuple[float, float], config: PlacingConfig) -> None:
        self.seen = seen
        self.limits = depth_limits_m
        self.config = config
        self.depth = np.full(len(seen.ray_x), np.nan)
        self.with_depth = 0
        self.planes: dict[int, FloatArray] = {}
        self.unplaced: dict[int, str] = {}

    @property
    def left(self) -> list[int]:
        """Labels of the parts that are neither placed nor given up."""
        return [k for k in self.seen.pixels if k not in self.planes and k not in self.unplaced]

    def place(self, label: int, points_m: FloatArray) -> None:
        """Give a part its plane through known points (m, 3) and its pixels their depth, or say why not."""
        seen, normal = self.seen, self.seen.normals.get(label)
        if normal is None:
            self.unplaced[label] = "the class model has no plane for it"
            return
        if seen.edge_on(label, self.config):
            angle_deg = np.rad2deg(np.arcsin(seen.sine[label]))
            self.unplaced[label] = f"seen edge-on, at {angle_deg:.1f} degrees"
            return
        d = -median(points_m @ normal)
        depth = -d / seen.facing[label]
        good = (depth >= self.limits[0]) & (depth <= self.limits[1])
        number = int(np.count_nonzero(good))
        if number < 0.5 * len(good):
            self.unplaced[label] = f"{1 - number / len(good):.0%} of its depth lies beyond the object"
            return
        self.planes[label] = np.append(normal, d)
        self.depth[seen.pixels[label]] = depth if number == len(good) else np.where(good, depth, np.nan)
        self.with_depth += number

    def border_points(self, label: int) -> FloatArray:
        """3D points (m, 3) of placed neighbours along their borders with a part."""
        seen = self.seen
        if seen.adjoining.get(label, _NONE).isdisjoint(self.planes):
            return _NOWHERE
        beyond = seen.beyond[label]
        depth = self.depth.take(beyond)
        known = np.isfinite(depth)
        beyond, depth = beyond[known], depth[known]
        points = np.stack([seen.ray_x.take(beyond), seen.ray_y.take(beyond), np.ones(len(beyond))], axis=1)
        return np.asarray(points * depth[:, None])


_NONE: frozenset[int] = frozenset()
_NOWHERE = np.zeros((0, 3))


def _neighbours(labels: UInt8Array) -> tuple[dict[int, NDArray[np.intp]], dict[int, frozenset[int]]]:
    """Flat indices (m,) of the pixels of other parts along the border of each, and the labels of these parts.

    Neighbours in a row or in a column; a pixel counts as often as it adjoins the part.
    """
    flat, width = labels.ravel(), labels.shape[1]
    across = np.flatnonzero(flat[1:] != flat[:-1])
    across = across[(across + 1) % width > 0]
    down = np.flatnonzero(flat[width:] != flat[:-width])
    a = np.concatenate([across, down])
    b = np.concatenate([across + 1, down + width])
    both = (flat.take(a) > 0) & (flat.take(b) > 0)
    a, b = a[both], b[both]
    own, other = np.concatenate([a, b]), np.concatenate([b, a])
    label, beyond = flat.take(own), flat.take(other)
    found = {k: label == k for k in np.flatnonzero(np.bincount(label)).tolist()}
    adjoining = {k: frozenset(np.flatnonzero(np.bincount(beyond[of])).tolist()) for k, of in found.items()}
    return {k: other[of] for k, of in found.items()}, adjoining


@lru_cache(maxsize=8)
def feet(model: ClassModel) -> Mapping[int, FloatArray]:
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
    outlines, planes, diagonal = _arrays(model)
    turned = planes[:, :3] @ cam_from_object.T
    normals = {p.label: normal for p, normal in zip(model.parts, turned, strict=True)}
    seen = SeenParts(parts, camera, normals)
    depth = float(np.mean([p[2] for p in line.points_m.values()]))
    scale = _metres_per_unit(parts, depth, outlines @ cam_from_object[0], camera)
    # the object's size: the diagonal of the model's extents
    reach = config.max_depth_range * scale * diagonal
    limits = (max(depth - reach, 1e-3), depth + reach)
    placed = _placed(seen, line.points_m, limits, config)
    if placed.placed_share >= config.min_placed:
        return placed
    stand_in = _stand_in(seen, placed, line.points_m, scale, cam_from_object, model, config)
    on_ground = {k: p for k, p in line.points_m.items() if k in placed.planes}
    again = _placed(seen, on_ground | stand_in, limits, config)
    if again.placed_share <= placed.placed_share:
        return placed
    # why the parts on the ground have no plane was found in the first round
    reasons = again.unplaced | {k: why for k, why in placed.unplaced.items() if k in line.points_m}
    return replace(again, unplaced={k: v for k, v in reasons.items() if k not in again.planes})


def _stand_in(
    seen: SeenParts,
    placed: PlacedParts,
    points_m: Mapping[int, FloatArray],
    metres_per_unit: float,
    cam_from_object: FloatArray,
    model: ClassModel,
    config: PlacingConfig,
) -> dict[int, FloatArray]:
    """A known point of one part for a view that shows the parts on the ground edge-on, as a car's front.

    It belongs to the part without a plane that shows the most area to the camera and is not edge-on itself,
    and lies as far from the ground contacts as in the class model.
    """
    shown = {
        k: seen.sine[k] * len(pixels)
        for k, pixels in seen.pixels.items()
        if k in seen.normals and k not in placed.planes and k not in points_m and not seen.edge_on(k, config)
    }
    if not shown:
        return {}
    label = max(shown, key=lambda k: shown[k])
    foot, centroid = feet(model), model.part(label).centroid
    steps = [p + metres_per_unit * cam_from_object @ (centroid - foot[k]) for k, p in points_m.items()]
    return {label: np.mean(steps, axis=0)}


def _metres_per_unit(parts: PartLabels, depth_m: float, across: FloatArray, camera: PinholeCamera) -> float:
    """Metres of a unit of the model, from the width of the object in the picture at the depth of its feet.

    ``across`` (m,) are the outlines of the model along the camera's x axis.
    """
    first, last = parts.columns
    width_m = (last - first + 1) * depth_m / camera.fx_px
    return float(width_m / np.ptp(across))


@lru_cache(maxsize=8)
def _arrays(model: ClassModel) -> tuple[FloatArray, FloatArray, float]:
    """Points of all outlines (m, 3), planes of all parts (k, 4), and the diagonal of the extents."""
    outlines = np.concatenate([p.outline for p in model.parts])
    return outlines, np.stack([p.plane for p in model.parts]), float(np.linalg.norm(model.extents))
