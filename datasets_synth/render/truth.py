"""What is known of the objects of a rendered scene: box, visible share, pose, view bin, size."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synth.meshes.mesh import Placed, Scene
from datasets_synth.render.render import StereoRender, eye_rays
from datasets_synth.render.scene_rays import RayTree, world_vertices
from recon.arrays import FloatArray
from recon.camera import PinholeCamera

N_VIEW_BINS = 12
"""k of section 3: bin b is centred on azimuth 30 b degrees."""

NEAR_M = 0.05
"""Nothing nearer than this is projected."""


@dataclass(frozen=True, eq=False)
class VisibleObject:
    """The truth of one object in the left picture."""

    item: int
    """Index into ``scene.items``; the instance picture holds item + 1."""
    shape_id: str
    xyxy_px: FloatArray
    """Amodal box, shape (4,): extent of the whole projected object, hidden parts too, as pixel edges clipped
    to the picture."""
    visible_share: float
    """Visible pixels / pixels that the object alone would cover inside the picture, in [0, 1]."""
    truncated_share: float
    """Share of the area of the amodal box that lies outside the picture, in [0, 1]."""
    position_cam_m: FloatArray
    """Origin of the object (on the ground, under its middle) in the left camera frame, shape (3,)."""
    yaw_rad: float
    """Heading of the nose, counter-clockwise seen from above, from the camera's right; in (-pi, pi]."""
    azimuth_deg: float
    """Direction of the camera seen from the object, counter-clockwise from its nose, in [0, 360)."""
    view_bin: int
    size_m: tuple[float, float, float]
    """Length, width and height."""


def visible_objects(render: StereoRender, scene: Scene, kind: str = "car") -> tuple[VisibleObject, ...]:
    """The objects of a kind whose projection meets the left picture, hidden ones too, in scene order."""
    found = []
    for index, placed in enumerate(scene.items):
        if placed.kind != kind:
            continue
        full = projected_box(placed, scene)
        clipped = None if full is None else _clip(full, scene.camera.left)
        if full is None or clipped is None:
            continue
        cam_from_object = scene.left_from_world @ placed.world_from_object
        azimuth = azimuth_deg(cam_from_object)
        found.append(
            VisibleObject(
                item=index,
                shape_id=placed.shape_id,
                xyxy_px=clipped,
                visible_share=_visible_share(render, scene, index, clipped),
                truncated_share=float(1 - _area(clipped) / _area(full)),
                position_cam_m=cam_from_object[:3, 3].copy(),
                yaw_rad=yaw_rad(cam_from_object),
                azimuth_deg=azimuth,
                view_bin=view_bin(azimuth),
                size_m=_size_m(placed),
            )
        )
    return tuple(found)


def azimuth_deg(cam_from_object: FloatArray) -> float:
    """Direction of the camera seen from an object with pose (4, 4), in degrees, [0, 360).

    0 when the camera stands before the nose, 90 when it sees the left side.
    """
    camera_in_object = np.linalg.inv(cam_from_object)[:3, 3]
    return float(np.degrees(np.arctan2(camera_in_object[1], camera_in_object[0])) % 360)


def view_bin(azimuth: float) -> int:
    """The view bin, 0 to 11, of an azimuth in degrees; bin b is centred on 30 b."""
    width = 360 / N_VIEW_BINS
    return int(np.floor(azimuth / width + 0.5)) % N_VIEW_BINS


def yaw_rad(cam_from_object: FloatArray) -> float:
    """Heading of the nose of an object with pose (4, 4) about its own up, from the camera's right."""
    axes = cam_from_object[:3, :3] / np.linalg.norm(cam_from_object[:3, 0])
    nose, up = axes[:, 0], axes[:, 2]
    right = np.array([1.0, 0, 0]) - up[0] * up
    away = np.cross(up, right)
    return float(np.arctan2(nose @ away, nose @ right))


def projected_box(placed: Placed, scene: Scene) -> FloatArray | None:
    """Pixel edges (4,) of the extent of a projected mesh, not clipped; None behind the camera."""
    pose = scene.left_from_world
    xyz = world_vertices(placed) @ pose[:3, :3].T + pose[:3, 3]
    front = xyz[:, 2] >= NEAR_M
    if not front.any():
        return None
    points = xyz[front]
    if not front.all():
        points = np.concatenate([points, _near_crossings(xyz, placed.mesh.faces)])
    edge = scene.camera.left.project(points) + 0.5
    return np.concatenate([edge.min(axis=0), edge.max(axis=0)])


def _near_crossings(xyz: FloatArray, faces: NDArray[np.int32]) -> FloatArray:
    """Points (n, 3) where edges of faces cross the near plane."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    a, b = xyz[edges[:, 0]], xyz[edges[:, 1]]
    crosses = (a[:, 2] >= NEAR_M) != (b[:, 2] >= NEAR_M)
    a, b = a[crosses], b[crosses]
    share = (NEAR_M - a[:, 2]) / (b[:, 2] - a[:, 2])
    points: FloatArray = a + share[:, None] * (b - a)
    return points


def _clip(edges_px: FloatArray, camera: PinholeCamera) -> FloatArray | None:
    size = np.array([camera.width_px, camera.height_px], float)
    low = np.clip(edges_px[:2], 0, size)
    high = np.clip(edges_px[2:], 0, size)
    return np.concatenate([low, high]) if (high > low).all() else None


def _area(edges_px: FloatArray) -> float:
    return float(np.prod(edges_px[2:] - edges_px[:2]))


def _visible_share(render: StereoRender, scene: Scene, index: int, clipped_px: FloatArray) -> float:
    """Visible pixels / pixels hit when only this item is cast at; 0 where it is thinner than a pixel."""
    placed = scene.items[index]
    x0, y0 = np.floor(clipped_px[:2]).astype(int)
    x1, y1 = np.ceil(clipped_px[2:]).astype(int)
    visible = int((render.instance[y0:y1, x0:x1] == index + 1).sum())
    if not visible:
        return 0.0
    v, u = np.mgrid[y0:y1, x0:x1].astype(np.float32)
    rays = eye_rays(scene, np.stack([u.ravel(), v.ravel()], axis=1), eye=0)
    alone = int(RayTree(world_vertices(placed), placed.mesh.faces).occluded(rays).sum())
    return min(visible / alone, 1.0) if alone else 0.0


def _size_m(placed: Placed) -> tuple[float, float, float]:
    extent = np.ptp(placed.mesh.vertices_m, axis=0) * np.linalg.norm(placed.world_from_object[:3, 0])
    return float(extent[0]), float(extent[1]), float(extent[2])
