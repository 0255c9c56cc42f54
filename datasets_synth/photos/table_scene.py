"""Model cars on a black table seen by one calibrated camera, as in section 5.1 of the report.

Scenes are drawn at the size of the real cars, table and camera enlarged with them: a picture does not change
when everything in it grows, and the shade near the ground is made for real cars. All measures that leave this
module are those of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Imaging, Light, Material, Mesh, Placed, Scene
from datasets_synth.meshes.solids import MeshDraft, pose
from datasets_synth.render.imaging import expose
from datasets_synth.render.render import render_radiance
from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.localization.standing_box import StandingBox, cam_from_ground
from recon.outlines import fill_polygon
from recon.pixels import linear_from_srgb

SCALE = 1 / 18
"""Size of a model car in units of the real one."""
TABLE_M = (1.2, 1.0)
"""Width and depth of the table."""
CAMERA_DISTANCE_M = 1.4
"""Distance from the camera to the middle of the table."""
ELEVATION_RAD = float(np.deg2rad(35.0))
"""Elevation of the camera seen from the middle of the table."""
CAMERA = PinholeCamera(1270.0, 1270.0, 799.5, 599.5, 1600, 1200)
GROUND = GroundPlane(CAMERA_DISTANCE_M * float(np.sin(ELEVATION_RAD)), ELEVATION_RAD)
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
TABLE_MIDDLE_M = np.array([0.0, CAMERA_DISTANCE_M * float(np.cos(ELEVATION_RAD))])
"""Middle of the table in the ground frame (see recon.localization.standing_box), shape (2,)."""

_TABLE = Material("black table", (0.052, 0.052, 0.054))
_LIGHT = Light(
    # two thirds of the light come from all sides, as in a room with pale walls; the rest from a lamp
    sun_direction=(0.35, -0.33, 0.877),
    sun_rgb=(0.42, 0.40, 0.36),
    sky_zenith_rgb=(0.78, 0.78, 0.76),
    sky_horizon_rgb=(0.62, 0.62, 0.62),
    ambient=1.0,
)
_IMAGING = Imaging((1.05, 1.05), (0.7, 0.7), 0.12, 0.004, 0.012, (0.0, 0.0))
_HIDDEN_PAINTS = ("paint black", "paint dark grey")
"""Paints as dark as the table: colour does not tell their outline from it, so such cars are not placed."""
_EMPTY_SHOTS = 16
"""Pictures of the empty table that are averaged."""
_MARGIN_PX = 24
_SHADOW_REACH = 1.6
"""The drawn window holds everything up to this many car lengths around the car's middle."""


@dataclass(frozen=True, eq=False)
class Placement:
    """A model car somewhere on the table."""

    car: CarModel
    xy_m: FloatArray
    """Middle of the footprint in the ground frame, shape (2,)."""
    yaw_rad: float
    """Direction of the nose, counter-clockwise from the x axis, in [-pi, pi)."""

    @property
    def box(self) -> StandingBox:
        """The true bounding box: the body without mirrors."""
        return StandingBox(self.xy_m, self.yaw_rad, np.array(self.car.size_m) * SCALE)


def place_at_random(car: CarModel, rng: np.random.Generator) -> Placement:
    """A placement in any orientation, uniform over the places where all of the car stands on the table."""
    size = np.array(car.size_m) * SCALE
    yaw = float(rng.uniform(-np.pi, np.pi))
    corners = StandingBox(np.zeros(2), yaw, size).footprint_m
    free = np.array(TABLE_M) / 2 - np.abs(corners).max(axis=0)
    return Placement(car, TABLE_MIDDLE_M + rng.uniform(-free, free), yaw)


def photograph(placements: list[Placement], rng: np.random.Generator) -> UInt8Array:
    """The picture (h, w, 3) sRGB of the table with cars on it; rng picks paints and noise."""
    radiance = _empty_radiance().copy()
    cars = [_placed(p, rng) for p in placements]
    for rows, columns in (_window(p) for p in placements):
        camera = replace(
            CAMERA,
            cx_px=CAMERA.cx_px - columns.start,
            cy_px=CAMERA.cy_px - rows.start,
            width_px=columns.stop - columns.start,
            height_px=rows.stop - rows.start,
        )
        radiance[rows, columns] = render_radiance(_scene(cars, camera))
    return expose(radiance, _IMAGING, 0, rng)


@lru_cache(maxsize=1)
def photograph_empty() -> Float32Array:
    """Mean linear light of several pictures of the empty table, shape (h, w, 3), in [0, 1]."""
    rng = np.random.default_rng(18)
    shots = [
        linear_from_srgb(expose(_empty_radiance().copy(), _IMAGING, 0, rng)) for _ in range(_EMPTY_SHOTS)
    ]
    return np.asarray(np.mean(shots, axis=0, dtype=np.float32))


def table_mask() -> BoolArray:
    """Where the picture of the calibrated camera shows the table, shape (h, w)."""
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(TABLE_M) / 2
    corners = np.insert(half + TABLE_MIDDLE_M, 2, 0.0, axis=1)
    return fill_polygon(project_ground(corners), CAMERA.height_px, CAMERA.width_px)


def project_ground(points_m: FloatArray) -> FloatArray:
    """Pixels (n, 2) of points (n, 3) of the ground frame."""
    cam_from_table = cam_from_ground(GROUND)
    return CAMERA.project(points_m @ cam_from_table[:3, :3].T + cam_from_table[:3, 3])


@lru_cache(maxsize=1)
def _empty_radiance() -> Float32Array:
    return render_radiance(_scene([], CAMERA))


def _placed(placement: Placement, rng: np.random.Generator) -> Placed:
    x, y = placement.xy_m / SCALE
    car = placement.car
    return Placed(visible_mesh(car, rng), pose(x, y, 0.0, placement.yaw_rad), "car", car.shape_id)


def visible_mesh(car: CarModel, rng: np.random.Generator) -> Mesh:
    """The car in a paint that stands out from the table; a user's mesh keeps its own."""
    mesh = car.build(rng)
    while mesh.materials[0].name in _HIDDEN_PAINTS:
        mesh = car.build(rng)
    return mesh


def table_scene(items: Sequence[Placed], camera: PinholeCamera, cam_from_table: FloatArray) -> Scene:
    """The table with things on it as another camera sees it.

    Args:
        items: things with their poses, at the size of real cars.
        camera: the camera.
        cam_from_table: pose (4, 4) of the ground frame in the camera frame, in metres of the table.
    """
    world_to_camera = cam_from_table.copy()
    world_to_camera[:3, 3] /= SCALE
    return Scene((*items, *_furniture()), _LIGHT, StereoCamera(camera, 1.0), world_to_camera, _IMAGING)


def _scene(cars: list[Placed], camera: PinholeCamera) -> Scene:
    return table_scene(cars, camera, cam_from_ground(GROUND))


@lru_cache(maxsize=1)
def _furniture() -> tuple[Placed, ...]:
    """The table top; around it the camera sees the pale room of the light."""
    x, y = TABLE_MIDDLE_M / SCALE
    w, d = np.array(TABLE_M) / 2 / SCALE
    top = MeshDraft()
    top.panel([(x - w, y - d, 0), (x + w, y - d, 0), (x + w, y + d, 0), (x - w, y + d, 0)], _TABLE)
    return (Placed(top.mesh(), np.eye(4), "table", casts_shadow=False),)


def _window(placement: Placement) -> tuple[slice, slice]:
    """Rows and columns that the car and its shadow can change."""
    box = placement.box
    around = StandingBox(
        box.xy_m, box.yaw_rad, box.size_m * np.array([_SHADOW_REACH, 1 + _SHADOW_REACH, 1.1])
    )
    uv = project_ground(around.corners_m)
    limit = [CAMERA.width_px, CAMERA.height_px]
    low = np.clip(np.floor(uv.min(axis=0)) - _MARGIN_PX, 0, limit).astype(int)
    high = np.clip(np.ceil(uv.max(axis=0)) + _MARGIN_PX, 0, limit).astype(int)
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
