"""The stereo head on a car in the street: which rig, where it looks, and the road in its frame."""

from dataclasses import dataclass

import numpy as np

from datasets_synth.presets import AlongConfig, RigConfig
from datasets_synth.street.along.road import Road
from recon.arrays import FloatArray
from recon.camera import GroundPlane, PinholeCamera, StereoCamera

GROUND_NEAR_M, GROUND_FAR_M = 4.0, 25.0
"""The ground of a frame is the plane through the carriageway between these distances."""


@dataclass(frozen=True, eq=False)
class Head:
    """A stereo head above a lane."""

    rig: RigConfig
    camera: StereoCamera
    left_from_world: FloatArray
    """Shape (4, 4)."""
    x_m: float
    """Where it stands across the street; along the street it stands at 0."""


def sample_head(rig: RigConfig, config: AlongConfig, road: Road, rng: np.random.Generator) -> Head:
    """A head of a rig in a lane that leads away, looking along it or, now and then, aside."""
    focal = rig.focal_px * float(rng.uniform(0.985, 1.015))
    cx = (rig.width_px - 1) / 2 + float(rng.uniform(-6, 6))
    cy = rig.height_px * rig.horizon_share + float(rng.uniform(-4, 4))
    left = PinholeCamera(focal, focal, cx, cy, rig.width_px, rig.height_px)
    own = [x for x in road.lanes_m if x > 0]
    x_m = own[int(rng.integers(len(own)))] + float(rng.normal(0, 0.25))
    turned = rng.random() < 0.22
    yaw = float(rng.choice([-1, 1]) * rng.uniform(8, 32) if turned else rng.normal(0, 2.5))
    pitch = float(rng.uniform(*config.pitch_deg))
    roll = float(rng.uniform(-1, 1) * config.roll_deg)
    left_from_world = _pose(road, x_m, float(rng.uniform(*rig.height_m)), np.radians([yaw, pitch, roll]))
    return Head(rig, StereoCamera(left, float(rng.uniform(*rig.baseline_m))), left_from_world, x_m)


def _pose(road: Road, x_m: float, height_m: float, angles_rad: FloatArray) -> FloatArray:
    """Camera from world (4, 4) of a camera above the road at (x, 0), turned by yaw, pitch and roll."""
    yaw, pitch, roll = angles_rad
    right, along, up = road.axes(x_m, 0.0).T
    level = np.stack(
        [np.cos(yaw) * right - np.sin(yaw) * along, -up, np.cos(yaw) * along + np.sin(yaw) * right]
    )
    leaning = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]])
    looking = np.array([[1.0, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    eye = road.world_m(x_m, 0.0) + height_m * up
    pose = np.eye(4)
    pose[:3, :3] = looking @ leaning @ level
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def ground_of(head: Head, road: Road) -> GroundPlane:
    """The plane that lies closest to the carriageway before the camera."""
    xs = np.linspace(road.edge_m[0] + 0.2, road.edge_m[1] - 0.2, 9)
    ys = np.linspace(GROUND_NEAR_M, GROUND_FAR_M, 15)
    tracks = [(b.x0_m, b.x1_m) for b in road.bands if b.role == "tracks"]
    xs = np.array([x for x in xs if not any(a <= x <= b for a, b in tracks)])
    points = np.array([road.world_m(x, y) for x in xs for y in ys])
    xyz = points @ head.left_from_world[:3, :3].T + head.left_from_world[:3, 3]
    return plane_through(xyz)


def plane_through(xyz_m: FloatArray) -> GroundPlane:
    """The plane with the least squared distances from points (n, 3) of the ground, camera frame."""
    middle = xyz_m.mean(axis=0)
    up = np.linalg.svd(xyz_m - middle, full_matrices=False)[2][2]
    up = up if up[1] < 0 else -up
    return GroundPlane(float(-up @ middle), float(np.arctan2(-up[2], -up[1])), float(np.arcsin(-up[0])))
