"""The planes of one instance: known points from its ground line, or from the part that shows most."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.ground_line import GroundLine
from recon.predict_depth import PlacedParts, PlacingConfig, place_parts


def feet(model: ClassModel) -> dict[int, FloatArray]:
    """Lowest outline point (3,) of each part that reaches the lowest tenth of the model, by label."""
    low = {p.label: p.outline[np.argmin(p.outline[:, 2])] for p in model.parts}
    limit = min(float(point[2]) for point in low.values()) + 0.1 * model.extents[2]
    return {label: point for label, point in low.items() if point[2] <= limit}


def place_instance(
    labels: UInt8Array,
    x0_px: int,
    y0_px: int,
    line: GroundLine,
    cam_from_object: FloatArray,
    model: ClassModel,
    camera: PinholeCamera,
    config: PlacingConfig,
) -> PlacedParts:
    """Part planes and depth of one instance, within the depth limits of an object of this size."""
    v, u = np.mgrid[y0_px : y0_px + labels.shape[0], x0_px : x0_px + labels.shape[1]]
    rays = camera.rays(np.stack([u, v], axis=-1).astype(float))
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
