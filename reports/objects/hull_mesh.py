"""The surface of a fitted shape whose limbs no single net wraps around: chairs, airplanes, bicycles.

The surface is where the hull function is 0, less what the photograph shows the background at: between slats
and spokes, and beside a limb. Limbs that it has not are sheets (``limb_sheets``). What the photograph shows
is taken from there; the other side, where the mirror image is in the photograph, from that; the rest has the
plain colour of its part.
"""

from collections.abc import Mapping

import cv2
import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import PinholeCamera
from recon.localization.shape_fit import FittedShape
from recon.pixels import sample_bilinear
from reports.objects.limb_sheets import limb_sheets
from reports.objects.part_colours import part_colours
from reports.objects.picture_mesh import PictureMesh
from reports.objects.solid_mesh import lines_of_sight, ray_scene

_FACING = 0.15
"""Least cosine of the angle to the ray at which a place is seen."""
_BEFORE = 0.02
"""A place is seen if nothing lies farther before it than this share of the object's diagonal."""
_NEAR_PX = 4.0
"""Places this far beside the matte have the colours of its nearest pixels."""
_POINTS = 12
"""Points across each part outline that surfaces are told apart by."""


def hull_meshes(
    rgb: UInt8Array,
    matte: Float32Array,
    shape: FittedShape,
    camera: PinholeCamera,
    names: Mapping[int, str],
) -> list[PictureMesh]:
    """The surface of a shape in the camera frame: what is seen, what is mirrored, plain parts, and sheets.

    Args:
        rgb: the photograph with nothing but the object's colours, shape (h, w, 3).
        matte: how much of each pixel is the object, shape (h, w).
        shape: the fitted shape.
        camera: M.
        names: name of each part by label.
    """
    values, origin, step = _grid(shape)
    values = np.maximum(values, _holes(values, origin, step, matte, shape, camera))
    own, faces = surface(values, origin, step)
    turn = shape.cam_from_object
    xyz = own @ turn[:3, :3].T + turn[:3, 3]
    normal = _normals(xyz, faces)
    scene = ray_scene(xyz, faces)
    seen, uv = _seen(xyz, normal, scene, matte, camera)
    other = own * [1.0, -1.0, 1.0]
    # the mirror image of a place is the nearest vertex to where it would be
    gap, twin = cKDTree(own).query(other)
    twin_seen = seen[twin] & (gap < 2 * float(step.max()))
    part = _nearest_part(own, shape)
    shown = sample_bilinear(rgb, uv[seen], cv2.BORDER_REPLICATE)
    colours = part_colours(shown, part[seen], names)
    by_photo, by_twin = seen[faces].all(axis=1), twin_seen[faces].all(axis=1)
    by_twin &= ~by_photo
    out = [PictureMesh(xyz, faces[by_photo], uv), PictureMesh(xyz, faces[by_twin], uv[twin])]
    label = np.median(part[faces], axis=1).astype(int)
    for k in np.unique(label):
        rest = faces[~by_photo & ~by_twin & (label == k)]
        out.append(PictureMesh(xyz, rest, None, colours.get(int(k), colours[0])))
    sheets = limb_sheets(matte, scene, shape, camera)
    out += [] if sheets is None else [sheets]
    return [_compact(m) for m in out if len(m.faces)]


def _grid(shape: FittedShape) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The hull function on both sides with a margin outside, the place of its first sample, and its step."""
    half, reach = shape.hull, np.array(shape.space.reach)
    both = np.concatenate([half[:, :0:-1], half], axis=1).astype(float)
    step = np.array([2, 1, 1]) * reach / (np.array(half.shape) - 1) * shape.size_m
    origin = np.array([-reach[0], -reach[1], 0.0]) * shape.size_m - step
    return np.pad(both, 1, constant_values=float(step.min())), origin, step


def surface(values: FloatArray, origin: FloatArray, step: FloatArray) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and triangles (m, 3) of the surface where a function on a grid (nx, ny, nz) is 0.

    Normals point to where it is larger. One point in each cell that the surface passes, the mean of where it
    crosses the cell's edges (S. Gibson, "Constrained elastic surface nets", MICCAI 1998). Values at the edge
    of the grid must be positive.
    """
    cells = np.array(values.shape) - 1
    total, count = np.zeros((cells.prod(), 3)), np.zeros(cells.prod())
    quads = []
    units = np.eye(3, dtype=np.int64)
    for axis in range(3):
        first, second = np.delete(values, -1, axis), np.delete(values, 0, axis)
        at = np.argwhere((first < 0) != (second < 0))
        a, b = first[tuple(at.T)], second[tuple(at.T)]
        point = at + (a / (a - b))[:, None] * units[axis]
        u, v = units[(axis + 1) % 3], units[(axis + 2) % 3]
        around = np.stack(
            [np.ravel_multi_index(tuple((at - d).T), cells) for d in (0 * u, u, u + v, v)], axis=1
        )
        for corner in around.T:
            count += np.bincount(corner, minlength=len(count))
            for k in range(3):
                total[:, k] += np.bincount(corner, point[:, k], len(count))
        quads.append(np.where((a < 0)[:, None], around, around[:, ::-1]))
    used = count > 0
    index = (np.cumsum(used) - 1)[np.concatenate(quads)]
    points = total[used] / count[used, None] * step + origin
    return points, np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])


def _holes(
    values: FloatArray,
    origin: FloatArray,
    step: FloatArray,
    matte: Float32Array,
    shape: FittedShape,
    camera: PinholeCamera,
) -> FloatArray:
    """How deep samples lie behind what the matte leaves out, in metres; negative behind the object."""
    hole = matte <= 0.5
    deep = cv2.distanceTransform(hole.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    beside = cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in values.shape), indexing="ij"), axis=-1)
    turn = shape.cam_from_object
    xyz = (index.reshape(-1, 3) * step + origin) @ turn[:3, :3].T + turn[:3, 3]
    signed = sample_bilinear((deep - beside).astype(np.float32), camera.project(xyz), cv2.BORDER_REPLICATE)
    return np.asarray(signed * xyz[:, 2] / camera.fx_px, float).reshape(values.shape)


def _normals(xyz: FloatArray, faces: IntArray) -> FloatArray:
    """Outward unit normals (n, 3) of vertices."""
    a, b, c = (xyz[faces[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    out = np.zeros_like(xyz)
    for i in range(3):
        for k in range(3):
            out[:, k] += np.bincount(faces[:, i], face[:, k], len(xyz))
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12))


def _seen(
    xyz: FloatArray,
    normal: FloatArray,
    scene: o3d.t.geometry.RaycastingScene,
    matte: Float32Array,
    camera: PinholeCamera,
) -> tuple[BoolArray, FloatArray]:
    """Whether the photograph shows each vertex (n,), and where, (n, 2)."""
    direction, distance, hit = lines_of_sight(xyz, scene)
    seen = hit > distance - _BEFORE * float(np.linalg.norm(np.ptp(xyz, axis=0)))
    seen &= -(normal * direction).sum(axis=1) > _FACING
    uv = camera.project(xyz)
    size = np.array([camera.width_px, camera.height_px])
    seen &= ((uv > -0.5) & (uv < size - 0.5)).all(axis=1)
    away = cv2.distanceTransform((matte <= 0.5).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    column, row = np.clip(np.rint(uv).astype(int), 0, size - 1).T
    return np.asarray(seen & (away[row, column] <= _NEAR_PX)), uv


def _nearest_part(own: FloatArray, shape: FittedShape) -> IntArray:
    """Label (n,) of the part whose outline is nearest to each point (n, 3) of the object frame."""
    share = np.linspace(0, 1, _POINTS)[:, None, None]
    points, labels = [], []
    for label, outline in zip(shape.space.part_labels, shape.parts_m, strict=True):
        inside = (share * outline + (1 - share) * outline.mean(axis=0)).reshape(-1, 3)
        points.append(inside)
        labels.append(np.full(len(inside), label))
    _, nearest = cKDTree(np.concatenate(points)).query(own)
    return np.asarray(np.concatenate(labels)[nearest])


def _compact(mesh: PictureMesh) -> PictureMesh:
    """The mesh without the vertices that no triangle has."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    uv = None if mesh.uv_px is None else mesh.uv_px[used]
    return PictureMesh(mesh.xyz_m[used], faces.reshape(-1, 3).astype(np.int64), uv, mesh.rgb)
