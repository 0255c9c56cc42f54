"""3D pop-up scenes of one picture (section 7): objects on the ground, a backdrop, a turntable, likeness."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from recon.arrays import BoolArray, FloatArray, IntArray, UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.files import atomic_path
from recon.outlines import fill_polygon
from reports.objects.fill_in import filled_from_beside, filled_in
from reports.objects.mesh_files import MeshView, gltf_from_camera, turned_about
from reports.objects.object_mesh import object_layers
from reports.objects.picture_mesh import PictureMesh
from rescore.library.single_picture import FoundObject, Photo

Layer = tuple[str, PictureMesh, UInt8Array]
_ROW_STEP_PX = 2.0
_COLUMN_STEP_PX = 16.0
"""Texture coordinates are linear on triangles. Along a row of level ground that is exact; across rows it is
not, and the finer step keeps the error far below half a pixel."""
_RIM = 0.08
"""Width of what is filled in around objects, in roots of their area."""
_TRACE = 0.1
"""Pixels with a larger share of the object are not seen of the background."""
_PLAN_PX = 600
"""Longer side of the plan on which the ground is filled in."""
_VIEW_WIDTH_PX = 480
_FRAMES = 24
_SWING_RAD = float(np.deg2rad(35.0))
_STRIP_SHARES = (-1.0, -0.5, 0.0, 0.5, 1.0)


def scene_layers(photo: Photo, objects: Sequence[FoundObject]) -> list[Layer]:
    """Named meshes in the camera frame, each with its photograph: objects, ground and backdrop.

    The ground reaches behind the farthest object. What the picture shows beyond stands there as an upright
    surface. Behind the objects both are filled in from around them.
    """
    layers: list[Layer] = []
    for i, one in enumerate(objects):
        own = object_layers(photo.rgb, one, photo.seen_from.camera)
        layers += [(f"{one.instance.class_name}_{i + 1}_{k}", *layer) for k, layer in enumerate(own)]
    far = backdrop_distance_m(objects, photo.seen_from.ground)
    empty = without_objects(photo, objects, far)
    layers += [
        (name, mesh, empty)
        for name, mesh in (
            ("ground", ground_mesh(photo.seen_from, far)),
            ("backdrop", backdrop_mesh(photo.seen_from, far)),
        )
        if len(mesh.faces)
    ]
    return layers


def without_objects(photo: Photo, objects: Sequence[FoundObject], far_m: float) -> UInt8Array:
    """The picture (h, w, 3) with the pixels of objects, and of what hides them, filled in from beside them.

    The ground up to ``far_m`` is filled in as seen from above, the backdrop as seen from the camera. Nothing
    is taken from the boxes of the objects: there may be limbs that an outline has lost.
    """
    rgb, seen_from = photo.rgb, photo.seen_from
    shape = rgb.shape[:2]
    hidden, boxes = _hidden(shape, objects)
    fold = int(np.ceil(np.clip(_fold_row(seen_from, far_m), 0, seen_from.camera.height_px)))
    out, left = rgb.copy(), hidden.copy()
    out[:fold], left[:fold] = filled_from_beside(rgb[:fold], hidden[:fold], ~hidden[:fold], ~boxes[:fold])
    plan = ground_plan(seen_from, fold, far_m)
    if plan is not None and hidden[fold:].any():
        unknown = plan.warp(hidden.astype(np.uint8)) > 0
        seen, known = ((plan.warp(255 * m.astype(np.uint8)) > 254) & ~unknown for m in (~hidden, ~boxes))
        from_above, missing = filled_from_beside(plan.warp(rgb), unknown, seen, known)
        own = hidden & (np.arange(shape[0]) >= fold)[:, None]
        out = np.where(own[..., None], plan.unwarp(from_above, shape), out)
        left[fold:] &= plan.unwarp(missing.astype(np.uint8), shape)[fold:] > 0
    return filled_in(out, left) if left.any() else out


def _hidden(shape: tuple[int, int], objects: Sequence[FoundObject]) -> tuple[BoolArray, BoolArray]:
    """Pixels (h, w) of objects and what hides them, and their boxes (h, w), both with a margin."""
    hidden, boxes = np.zeros(shape, bool), np.zeros(shape, bool)
    for one in objects:
        own = (one.matte > _TRACE) | fill_polygon(one.picture.outline_px, *shape)
        if one.occluded is not None:
            own |= one.occluded
        hidden |= own
        # the outline may have lost a limb that the one it started from has
        points = np.concatenate([np.argwhere(own)[:, ::-1], one.picture.initial_outline_px])
        (left, top), (right, bottom) = np.maximum(points.min(axis=0), 0), points.max(axis=0) + 1
        boxes[int(top) : int(bottom), int(left) : int(right)] = True
    # a rim which the blur of the camera mixes with the object, and for what the outline misses
    across = max(7, round(_RIM * float(np.sqrt(hidden.sum() / max(len(objects), 1)))))
    square = np.ones((across, across), np.uint8)
    grown = [cv2.dilate(mask.astype(np.uint8), square) > 0 for mask in (hidden, boxes)]
    return np.asarray(grown[0]), np.asarray(grown[1])


@dataclass(frozen=True, eq=False)
class GroundPlan:
    """The ground before the camera seen from above, as a picture."""

    plan_from_picture: FloatArray
    """Homography (3, 3) of pixel centres."""
    size_px: tuple[int, int]
    """Width and height."""

    def warp(self, picture: UInt8Array) -> UInt8Array:
        """A picture (h, w) or (h, w, 3) seen from above; 0 beyond its border."""
        return np.asarray(cv2.warpPerspective(picture, self.plan_from_picture, self.size_px), np.uint8)

    def unwarp(self, plan: UInt8Array, shape: tuple[int, int]) -> UInt8Array:
        """What a camera sees of a plan, in a picture of a shape (h, w)."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        picture = cv2.warpPerspective(
            plan, self.plan_from_picture, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(picture, np.uint8)


def ground_plan(seen_from: GroundedCamera, fold: int, far_m: float) -> GroundPlan | None:
    """The plan of the ground between an image row and the lower edge; None where no ground is in between."""
    camera = seen_from.camera
    if fold > camera.height_px - 2:
        return None
    right, last = camera.width_px - 1.0, camera.height_px - 1.0
    corners = np.array([[0.0, fold], [right, fold], [right, last], [0.0, last]])
    points = seen_from.ground_points_m(corners)
    if not np.isfinite(points).all():
        return None
    own = np.stack([points[:, 0], -points @ _forward(seen_from.ground)], axis=1)
    low, high = own.min(axis=0), own.max(axis=0)
    # a pixel of the picture in the middle of the ground, but no more than a plan of this size
    scale = min(camera.fx_px / (0.6 * far_m), _PLAN_PX / float((high - low).max()))
    width, height = np.maximum(np.ceil((high - low) * scale), 2).astype(int).tolist()
    flat = ((own - low) * scale).astype(np.float32)
    above = cv2.getPerspectiveTransform(corners.astype(np.float32), flat)
    return GroundPlan(np.asarray(above, float), (width, height))


def backdrop_distance_m(objects: Sequence[FoundObject], ground: GroundPlane) -> float:
    """How far before the camera the backdrop stands: behind all objects by half the length of the largest."""
    forward = _forward(ground)
    farthest = max(float((one.instance.corners_m @ forward).max()) for one in objects)
    return farthest + 0.5 * max(float(one.instance.size_m.max()) for one in objects)


def ground_mesh(seen_from: GroundedCamera, far_m: float) -> PictureMesh:
    """The ground from the lower edge of the picture to a distance, in the camera frame; may have no faces."""
    camera = seen_from.camera
    first = min(_fold_row(seen_from, far_m), camera.height_px - 0.5)
    uv, faces = _grid(camera, first, camera.height_px - 0.5)
    points = seen_from.ground_points_m(uv)
    return PictureMesh(points, faces[np.isfinite(points[faces]).all(axis=(1, 2))], uv)


def backdrop_mesh(seen_from: GroundedCamera, far_m: float) -> PictureMesh:
    """An upright surface at a distance with what the picture shows above the ground's far end."""
    camera = seen_from.camera
    last = float(np.clip(_fold_row(seen_from, far_m), -0.5, camera.height_px - 0.5))
    uv, faces = _grid(camera, -0.5, last)
    rays = camera.rays(uv)
    along = rays @ _forward(seen_from.ground)
    points = rays * (far_m / np.maximum(along, 1e-6))[:, None]
    return PictureMesh(points, faces[(along[faces] > 0.05).all(axis=1)], uv)


def _forward(ground: GroundPlane) -> FloatArray:
    """Level direction (3,) in which the camera looks."""
    forward = np.array([0.0, 0.0, 1.0]) - ground.up[2] * ground.up
    return np.asarray(forward / np.linalg.norm(forward))


def _fold_row(seen_from: GroundedCamera, far_m: float) -> float:
    """Image row of the ground at a distance; above the picture where it is behind the picture's plane."""
    ground = seen_from.ground
    point = far_m * _forward(ground) - ground.height_m * ground.up
    return float(seen_from.camera.project(point)[1]) if point[2] > 0 else -0.5


def _grid(camera: PinholeCamera, top: float, bottom: float) -> tuple[FloatArray, IntArray]:
    """Pixels (n, 2) of a grid over rows of the picture and its triangles (m, 3)."""
    rows = np.linspace(top, bottom, max(2, int((bottom - top) / _ROW_STEP_PX) + 1))
    columns = np.linspace(-0.5, camera.width_px - 0.5, int(camera.width_px / _COLUMN_STEP_PX) + 2)
    u, v = np.meshgrid(columns, rows)
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (index[s] for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    if bottom - top < 1e-6:
        faces = faces[:0]
    return np.stack([u.ravel(), v.ravel()], axis=1), faces.astype(np.int64)


def in_scene_axes(layers: Sequence[Layer], ground: GroundPlane) -> list[Layer]:
    """The layers in glTF's axes: +Y up, +Z towards the viewer, the origin on the ground under the camera."""
    transform = gltf_from_camera(ground)
    return [(name, mesh.moved(transform), rgb) for name, mesh, rgb in layers]


def turntable(
    photo: Photo, objects: Sequence[FoundObject], layers: Sequence[Layer], angles_rad: FloatArray
) -> list[UInt8Array]:
    """What a camera sees that walks around the objects, one picture (h, w, 3) an angle; 0 is the photograph.

    Positive angles show more of what is on the left in the picture.
    """
    view = MeshView([(mesh, rgb) for _, mesh, rgb in layers])
    camera = close_camera(photo, objects, _VIEW_WIDTH_PX)
    centre = np.mean([one.instance.centroid_m for one in objects], axis=0)
    return [
        view.picture(camera, turned_about(centre, photo.seen_from.ground.up, float(a)))[0] for a in angles_rad
    ]


def close_camera(
    photo: Photo, objects: Sequence[FoundObject], width_px: int, height_px: int | None = None
) -> PinholeCamera:
    """The photograph's camera cut to the objects with a margin, for a picture of a width.

    With a height too, the cut is widened to its shape; without, the height follows from the cut.
    """
    points = np.concatenate([one.picture.outline_px for one in objects])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    if height_px is None:
        half = np.maximum(half * 1.5, half.max() * np.array([0.75, 0.55]))
        scale = width_px / (2 * half[0])
        height_px = max(16, round(2 * half[1] * scale))
    else:
        scale = float((np.array([width_px, height_px]) / (2 * 1.45 * half)).min())
        half = np.array([width_px, height_px]) / (2 * scale)
    c = photo.seen_from.camera
    centre = (np.array([c.cx_px, c.cy_px]) - (middle - half) + 0.5) * scale - 0.5
    return PinholeCamera(
        c.fx_px * scale, c.fy_px * scale, float(centre[0]), float(centre[1]), width_px, height_px
    )


def write_turntable(
    folder: Path, photo: Photo, objects: Sequence[FoundObject], layers: Sequence[Layer]
) -> None:
    """Write ``views.png``, a strip of five views from left to right, and ``turntable.gif``."""
    strip = turntable(photo, objects, layers, _SWING_RAD * np.array(_STRIP_SHARES))
    write_png(folder / "views.png", np.hstack(strip))
    swing = _SWING_RAD * np.sin(2 * np.pi * np.arange(_FRAMES) / _FRAMES)
    frames = [Image.fromarray(p) for p in turntable(photo, objects, layers, swing)]
    with atomic_path(folder / "turntable.gif") as beside:
        frames[0].save(beside, save_all=True, append_images=frames[1:], duration=80, loop=0)


def write_png(path: Path, rgb: UInt8Array) -> None:
    """Write a picture (h, w, 3) as PNG."""
    with atomic_path(path) as beside:
        Image.fromarray(rgb).save(beside)
