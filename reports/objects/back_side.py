"""The side of an object that its picture does not show: what is symmetric and stays behind what is seen.

A point behind the seen surface belongs to the object while its mirror image does too: it must also lie behind
the seen surface, and inside the outline. So every ray of the picture that meets the object leaves it
somewhere, and the surface through these places has the colours of the mirrored points.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import PinholeCamera
from recon.depth_map import DepthMap
from recon.reconstruction.instance import NEAR_M, Instance3D

_STEPS = 96
"""Places along a ray that are tried, over the diagonal of the object's box."""
_SLACK = 0.04
"""A mirror image may lie this share of the box's diagonal before the seen surface or outside the box, since
pose and planes are not exact."""
_LEAST = 0.08
"""What is thinner than this share of the diagonal is no body: its back is its front."""
_BEHIND = 0.002
"""The back lies behind the front by at least this share of the depth."""
_LIMB = 0.03
"""Half the width of limbs that have no back of their own, in roots of the object's area."""
_GAP = 0.12
"""Half the width of gaps in the body that are closed, in roots of the object's area."""
_COMPACT = 0.8
"""Share of the convex hull that the outline of a compact object fills."""
_SMOOTH_CELLS = 5


@dataclass(frozen=True, eq=False)
class BackSide:
    """Triangles that close an object behind what the picture shows."""

    xyz_m: FloatArray
    """Vertices (n, 3), camera frame."""
    faces: IntArray
    """Vertex indices (m, 3)."""
    uv_px: FloatArray
    """Where the colour of each vertex is in the picture, (n, 2), pixel centres."""
    mirrored: BoolArray
    """Triangles whose mirror image the picture shows, (m,): all others have no colour of their own."""
    depth_m: Float32Array
    """Z-depth of the back at the corners of cells, shape (h + 1, w + 1); NaN where the object is no body."""


def back_side(
    corner_uv_px: FloatArray,
    front_m: FloatArray,
    shown: DepthMap,
    instance: Instance3D,
    camera: PinholeCamera,
) -> BackSide:
    """The closed back of an object.

    Args:
        corner_uv_px: corners of the cells of the picture, shape (h + 1, w + 1, 2), pixel centres.
        front_m: z-depth of the seen surface at these corners, shape (h + 1, w + 1); NaN off the object.
        shown: z-depth of the seen surface, pixel by pixel; NaN outside the outline.
        instance: the object.
        camera: M.
    """
    seen = np.isfinite(front_m)
    thick = np.zeros(front_m.shape, np.float32)
    thick[seen] = _thickness(camera.rays(corner_uv_px[seen]), front_m[seen], shown, instance, camera)
    thick = np.where(seen, cv2.medianBlur(thick, _SMOOTH_CELLS), 0)
    use = _body(thick > _LEAST * float(np.linalg.norm(instance.size_m)), seen)
    rays = camera.rays(corner_uv_px[use])
    front = rays * (front_m[use] * (1 + _BEHIND))[:, None]
    back = front + rays * thick[use][:, None]
    index = np.full(front_m.shape, -1)
    index[use] = np.arange(use.sum())
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)
    quads = quads[(quads >= 0).all(axis=-1)]
    rim = _rim(quads)
    rim = np.concatenate([rim, rim[:, ::-1] + len(back)], axis=1)
    shown_back = _is_behind(
        _mirrored(back, instance), shown, camera, _SLACK * float(np.linalg.norm(instance.size_m)), near=True
    )
    mirrored = np.concatenate([shown_back[quads].all(axis=1), np.zeros(len(rim), bool)])
    quads = np.concatenate([quads, rim])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    uv = np.concatenate([camera.project(_mirrored(back, instance)), corner_uv_px[use]])
    depth = np.where(use, front_m + thick, np.nan).astype(np.float32)
    return BackSide(np.concatenate([back, front]), faces.astype(np.int64), uv, np.tile(mirrored, 2), depth)


def is_compact(seen: BoolArray) -> bool:
    """Whether the outline of a region (h, w) fills most of its convex hull.

    The back of a car may be had by symmetry; that of a chair would fill the space between its legs.
    """
    hull = cv2.convexHull(np.stack(np.nonzero(seen), axis=1).astype(np.float32))
    # the hull runs through pixel centres
    area = cv2.contourArea(hull) + cv2.arcLength(hull, True) / 2 + 1
    return bool(seen.sum() > _COMPACT * area)


def _body(thick: BoolArray, seen: BoolArray) -> BoolArray:
    """Where an object (h, w) is thick, without thin limbs, and with gaps in its body closed."""
    across = float(np.sqrt(seen.sum()))

    def disc(share: float) -> UInt8Array:
        size = 2 * max(1, round(share * across)) + 1
        return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8)

    pad = round(_GAP * across) + 2
    opened = cv2.morphologyEx(np.pad(thick.astype(np.uint8), pad), cv2.MORPH_OPEN, disc(_LIMB))
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, disc(_GAP))[pad:-pad, pad:-pad]
    return np.asarray((closed > 0) & seen)


def mirror(instance: Instance3D) -> FloatArray:
    """Reflection (4, 4) of the camera frame in the object's upright middle plane."""
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    return np.asarray(instance.cam_from_object @ flip @ np.linalg.inv(instance.cam_from_object))


def _mirrored(points_m: FloatArray, instance: Instance3D) -> FloatArray:
    turn = mirror(instance)
    return np.asarray(points_m @ turn[:3, :3].T + turn[:3, 3])


def _thickness(
    rays: FloatArray, front_m: FloatArray, shown: DepthMap, instance: Instance3D, camera: PinholeCamera
) -> FloatArray:
    """Z-depth (n,) from the seen surface on along rays (n, 3) with z = 1 to where they leave the object."""
    diagonal = float(np.linalg.norm(instance.size_m))
    step = diagonal / _STEPS
    out = np.zeros(len(rays))
    alive = np.arange(len(rays))
    for k in range(1, _STEPS + 1):
        points = rays[alive] * (front_m[alive] + k * step)[:, None]
        inside = _in_box(points, instance, _SLACK * diagonal)
        inside &= _is_behind(_mirrored(points, instance), shown, camera, _SLACK * diagonal)
        alive = alive[inside]
        if not len(alive):
            break
        out[alive] = k * step
    return out


def _in_box(points_m: FloatArray, instance: Instance3D, slack_m: float) -> BoolArray:
    """Whether points (n, 3) lie above the ground and in the object's box, or beside it by a slack."""
    back = np.linalg.inv(instance.cam_from_object)
    own = points_m @ back[:3, :3].T + back[:3, 3]
    length, width, height = instance.size_m
    beside = np.abs(own[:, :2]) - np.array([length, width]) / 2
    return np.asarray((beside < slack_m).all(axis=1) & (own[:, 2] > 0) & (own[:, 2] < height + slack_m))


def _is_behind(
    points_m: FloatArray, shown: DepthMap, camera: PinholeCamera, slack_m: float, near: bool = False
) -> BoolArray:
    """Whether the picture shows the object before points (n, 3), or no farther behind them than a slack.

    With ``near`` no farther before them either, so that it shows the points themselves.
    """
    height, width = shown.depth.shape
    before = points_m[:, 2] > NEAR_M
    at = camera.project(np.where(before[:, None], points_m, 1.0)) - [shown.x0_px, shown.y0_px]
    column, row = np.round(at).astype(int).T
    before &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
    seen = shown.depth[np.where(before, row, 0), np.where(before, column, 0)]
    # a comparison with NaN, outside the outline, is false
    behind = before & (points_m[:, 2] + slack_m > seen)
    return np.asarray(behind & (points_m[:, 2] - slack_m < seen) if near else behind)


def _rim(quads: IntArray) -> IntArray:
    """Edges (m, 2) that one quad alone has, running against its order."""
    edges = np.concatenate([np.stack([quads[:, i], quads[:, (i + 1) % 4]], axis=1) for i in range(4)])
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(edges[first[count == 1]][:, ::-1])
