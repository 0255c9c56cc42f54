"""Planes from the ground line upward, and the predicted depth map (section 4.3)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import asin, degrees

import numpy as np

from recon.arrays import Float32Array, FloatArray, median
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


class _SeenParts:
    """The parts of a labelled window as rays meet their planes: all that no place of a plane changes."""

    def __init__(self, parts: PartLabels, camera: PinholeCamera, normals: Mapping[int, FloatArray]) -> None:
        """Looks at the parts of a picture of a camera with unit plane normals in its frame, by label."""
        from recon.reconstruction.part_loops import part_pixels  # noqa: PLC0415 (half a second with Numba)

        self.shape, self.area = parts.labels.shape, parts.area_px
        self.across, self.down = parts.rays(camera)
        self.normals = np.full((256, 3), np.nan)
        for label, normal in normals.items():
            self.normals[label] = normal
        self.pixels = part_pixels(parts.labels, self.across, self.down, self.normals)

    def placed(
        self,
        known_m: Mapping[int, FloatArray],
        depth_limits_m: tuple[float, float],
        config: PlacingConfig,
    ) -> "PlacedParts":
        """The planes that follow from known points (3,) or (m, 3) of some parts, by label."""
        from recon.reconstruction.part_loops import spread  # noqa: PLC0415 (half a second with Numba)

        ready, level, kept = np.zeros(256, bool), np.empty(256), np.empty(256)
        state, depth = np.empty(256, np.uint8), np.empty(self.shape)
        for label in known_m.keys() & self.area.keys():
            ready[label] = True
            level[label] = median(np.atleast_2d(known_m[label]) @ self.normals[label])
        rays = (self.across, self.down, self.normals)
        limits = (*depth_limits_m, float(np.sin(config.min_angle_rad)))
        order = spread(self.pixels, *rays, ready, level, *limits, state, kept, depth.reshape(-1)).tolist()
        planes = dict(zip(order, np.column_stack([self.normals, -level])[order], strict=True))
        unplaced = {k: self._why_not(k, int(state[k]), float(kept[k])) for k in self.area if k not in planes}
        share = int(np.isfinite(depth).sum()) / max(sum(self.area.values()), 1)
        return PlacedParts(planes, unplaced, depth.astype(np.float32), share)

    def faces(self, label: int, config: PlacingConfig) -> bool:
        """Whether the plane of a part is known and not seen edge-on."""
        return bool(self.pixels.sine[label] >= np.sin(config.min_angle_rad))

    def _why_not(self, label: int, state: int, kept: float) -> str:
        """Why a part has no plane."""
        from recon.reconstruction.part_loops import BEYOND, EDGE_ON, WITHOUT_PLANE  # noqa: PLC0415 (as above)

        if state == WITHOUT_PLANE:
            return "the class model has no plane for it"
        if state == EDGE_ON:
            return f"seen edge-on, at {degrees(asin(self.pixels.sine[label])):.1f} degrees"
        if state == BEYOND:
            return f"{1 - kept:.0%} of its depth lies beyond the object"
        return "touches no placed part"


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
    return _SeenParts(parts, camera, normals).placed(ground_points_m, depth_limits_m, config)


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
    seen = _SeenParts(parts, camera, normals)
    depth = float(np.mean([p[2] for p in line.points_m.values()]))
    scale = _metres_per_unit(parts, depth, outlines @ cam_from_object[0], camera)
    # the object's size: the diagonal of the model's extents
    reach = config.max_depth_range * scale * diagonal
    limits = (max(depth - reach, 1e-3), depth + reach)
    placed = seen.placed(line.points_m, limits, config)
    if placed.placed_share >= config.min_placed:
        return placed
    stand_in = _stand_in(seen, placed, line.points_m, scale, cam_from_object, model, config)
    on_ground = {k: p for k, p in line.points_m.items() if k in placed.planes}
    again = seen.placed(on_ground | stand_in, limits, config)
    if again.placed_share <= placed.placed_share:
        return placed
    # why the parts on the ground have no plane was found in the first round
    reasons = again.unplaced | {k: why for k, why in placed.unplaced.items() if k in line.points_m}
    return replace(again, unplaced={k: v for k, v in reasons.items() if k not in again.planes})


def _stand_in(
    seen: _SeenParts,
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
        k: seen.pixels.sine[k] * area
        for k, area in seen.area.items()
        if k not in placed.planes and k not in points_m and seen.faces(k, config)
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
