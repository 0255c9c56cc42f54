"""What annotations say of the vehicles of a street seen along its length."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from datasets_synth.cars.body_extent import body_extent
from datasets_synth.meshes.mesh import Placed, Scene
from datasets_synth.presets import AlongConfig
from datasets_synth.render.render import StereoRender
from datasets_synth.render.truth import VisibleObject, visible_objects
from datasets_synth.street.along.vehicles import OTHER_VEHICLES
from recon.arrays import FloatArray
from recon.camera import GroundPlane

Sizes = Mapping[str, tuple[float, float, float]]
LEAST_VISIBLE = (0.9, 0.5)
"""Shares that are seen of a fully visible and of a partly hidden vehicle, at least."""


def visible_vehicles(render: StereoRender, scene: Scene) -> tuple[VisibleObject, ...]:
    """Cars and other vehicles of which something is seen, in scene order."""
    found = [v for kind in ("car", *OTHER_VEHICLES) for v in visible_objects(render, scene, kind)]
    return tuple(sorted((v for v in found if v.visible_share > 0), key=lambda v: v.item))


def is_counted(vehicle: VisibleObject, kind: str, config: AlongConfig) -> bool:
    """Whether a vehicle is annotated without ``ignore``: a car, large enough, not too hidden, not cut off."""
    return (
        kind == "car"
        and float(vehicle.xyxy_px[3] - vehicle.xyxy_px[1]) >= config.min_height_px
        and vehicle.visible_share >= config.min_visibility
        and vehicle.truncated_share <= config.max_truncation
    )


def occlusion(visible_share: float) -> int:
    """KITTI's level of occlusion: 0 for fully visible, 1 for partly hidden, 2 for largely hidden."""
    return next((level for level, least in enumerate(LEAST_VISIBLE) if visible_share >= least), 2)


def box3d(placed: Placed, scene: Scene, sizes_m: Sizes) -> FloatArray:
    """The 3D box (7,) of a vehicle: centre x, y, z in the left camera frame, sizes, heading.

    The sizes are length, width and height of the body without mirrors, all in metres. The heading is KITTI's
    ``rotation_y`` in radians: 0 for a nose along the camera's x, positive clockwise seen from above.

    Args:
        placed: The vehicle.
        scene: Where it stands.
        sizes_m: Length, width and height of cars by their names; other vehicles are measured.
    """
    if placed.shape_id in sizes_m:
        size = np.array(sizes_m[placed.shape_id])
        middle = np.array([0.0, 0.0, size[2] / 2])
    else:
        low, high = body_extent(placed.mesh.vertices_m[placed.mesh.faces].astype(float))
        size, middle = high - low, (low + high) / 2
    cam_from_object = scene.left_from_world @ placed.world_from_object
    centre = cam_from_object[:3, :3] @ middle + cam_from_object[:3, 3]
    nose = cam_from_object[:3, 0]
    return np.array([*centre, *size, np.arctan2(-nose[2], nose[0])])


def annotation(
    vehicle: VisibleObject, scene: Scene, sizes_m: Sizes, config: AlongConfig
) -> Mapping[str, Any]:
    """One annotation without its ids; vehicles that are no cars are of the same category, with ignore = 1."""
    placed = scene.items[vehicle.item]
    x0, y0, x1, y1 = (round(float(v), 2) for v in vehicle.xyxy_px)
    width, height = round(x1 - x0, 2), round(y1 - y0, 2)
    return {
        "bbox": [x0, y0, width, height],
        "area": round(width * height, 2),
        "iscrowd": 0,
        "ignore": int(not is_counted(vehicle, placed.kind, config)),
        "kind": placed.kind,
        "visibility": round(vehicle.visible_share, 4),
        "truncated": round(vehicle.truncated_share, 4),
        "occluded": occlusion(vehicle.visible_share),
        "view_bin": vehicle.view_bin,
        "azimuth_deg": round(vehicle.azimuth_deg, 3),
        "pose": {
            "position_m": [round(float(v), 4) for v in vehicle.position_cam_m],
            "yaw_rad": round(vehicle.yaw_rad, 5),
        },
        "size_m": [round(v, 4) for v in vehicle.size_m],
        "bbox3d": [round(float(v), 4) for v in box3d(placed, scene, sizes_m)],
        "shape_id": vehicle.shape_id,
    }


def camera_record(scene: Scene, ground: GroundPlane | None) -> dict[str, float]:
    """The ``camera`` object of an image record; it states a ground where one is given."""
    left = scene.camera.left
    record = {
        "fx": left.fx_px, "fy": left.fy_px, "cx": left.cx_px, "cy": left.cy_px,
        "baseline_m": scene.camera.baseline_m,
    }  # fmt: skip
    return record if ground is None else record | ground_record(ground)


def ground_record(ground: GroundPlane) -> dict[str, float]:
    """The ground as records name it."""
    return {"height_m": ground.height_m, "pitch_rad": ground.pitch_rad, "roll_rad": ground.roll_rad}
