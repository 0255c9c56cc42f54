"""A closed surface of a fitted shape, with a picture of its own that wraps around it.

The surface is a net of meridians, from the tip of the nose to that of the tail, and of rings around the
length. Its picture is that net laid flat. What the photograph shows is taken from there; the other side,
where the mirror image is in the photograph, from that; the rest has the plain colour of its part.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import open3d as o3d

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import PinholeCamera
from recon.localization.shape_fit import FittedShape, hull_values
from recon.outlines import fill_polygon
from recon.pixels import sample_bilinear
from reports.objects.part_colours import Colour, part_colours
from reports.objects.picture_mesh import PictureMesh

_SLICES = 200
_MERIDIANS = 128
"""Divisible by 4, so that the net is its own mirror image."""
_RINGS = 144
_SAMPLES = 80
"""Places along each spoke of a slice."""
_TEXELS = 4
"""Pixels of the picture a mesh of the net."""
_FACING = (0.1, 0.35)
"""Cosines of the angle to the ray: below the first a place is not seen, above the second it is seen well."""
_REACH = 0.04
"""How far outside the matte, in lengths of the outline's box, the nearest colours inside it still count."""
_PART_REACH = 0.12
"""Greatest distance, in lengths, from the plane of a part to the surface that it names."""
_SAME_WAY = 0.5
"""Least cosine between the normals of surface and part."""
_UNDERSIDE, _SHADE = -0.7, 0.3
"""What faces down more than this has this share of its colour."""


@dataclass(frozen=True, eq=False)
class _Net:
    """Points of a surface, rings by meridians."""

    xyz: FloatArray
    """Shape (rings, meridians + 1, 3); the last meridian is the first."""

    @property
    def normals(self) -> FloatArray:
        """Outward unit normals, shape (rings, meridians + 1, 3)."""
        around = np.concatenate([self.xyz[:, -2:-1], self.xyz, self.xyz[:, 1:2]], axis=1)
        across = around[:, 2:] - around[:, :-2]
        along = np.gradient(self.xyz, axis=0)
        normal = np.cross(across, along)
        return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12))

    def finer(self, factor: int) -> "_Net":
        """The net with more points in between."""
        rings, meridians = self.xyz.shape[:2]
        row = np.linspace(0, rings - 1, factor * rings)
        column = np.linspace(0, meridians - 1, factor * (meridians - 1))
        u, v = np.meshgrid(column.astype(np.float32), row.astype(np.float32))
        fine = cv2.remap(self.xyz.astype(np.float32), u, v, cv2.INTER_LINEAR)
        return _Net(np.asarray(fine, float))


def solid_mesh(
    rgb: UInt8Array,
    matte: Float32Array,
    shape: FittedShape,
    camera: PinholeCamera,
    names: Mapping[int, str],
) -> tuple[PictureMesh, UInt8Array]:
    """The surface of a shape in the camera frame, and the picture (h, w, 3) that its coordinates refer to.

    Args:
        rgb: the photograph with nothing but the object's colours, shape (h, w, 3).
        matte: how much of each pixel is the object, shape (h, w).
        shape: the fitted shape.
        camera: M.
        names: name of each part by label.
    """
    net = _net(shape)
    fine = net.finer(_TEXELS)
    turn = shape.cam_from_object
    at, normal = (fine.xyz @ turn[:3, :3].T + turn[:3, 3]), fine.normals @ turn[:3, :3].T
    mesh, scene = _mesh(net, turn, fine.xyz.shape[:2])
    seen, uv = _seen(at, normal, scene, matte, camera)
    shown = sample_bilinear(rgb, uv.reshape(-1, 2), cv2.BORDER_REPLICATE).reshape(*seen.shape, 3)
    part = _parts(fine, shape)
    colours = part_colours(shown[seen > 0.5], part[seen > 0.5], names)
    plain = _plain(part, colours, fine.normals)
    # the net is its own mirror image
    twin, twin_seen = shown[:, ::-1], seen[:, ::-1] * (1 - seen)
    rest = (1 - seen - twin_seen)[..., None]
    picture = seen[..., None] * shown + twin_seen[..., None] * twin + rest * plain
    return mesh, np.clip(np.round(picture), 0, 255).astype(np.uint8)


def _net(shape: FittedShape) -> _Net:
    """The net of a shape in the object frame, metres."""
    hull, space, size = shape.hull, shape.space, shape.size_m

    def value(points_m: FloatArray) -> FloatArray:
        return hull_values(points_m, space, hull, size)

    x = np.linspace(space.reach[0], -space.reach[0], _SLICES) * size[0]
    z = np.linspace(0, space.reach[2], _SAMPLES) * size[2]
    column = np.stack(np.broadcast_arrays(x[:, None], 0.0, z[None]), axis=-1)
    inside = value(column) < 0
    x, inside = x[inside.any(axis=1)], inside[inside.any(axis=1)]
    low, high = z[inside.argmax(axis=1)], z[_SAMPLES - 1 - inside[:, ::-1].argmax(axis=1)]
    middle = cv2.blur(((low + high) / 2)[:, None], (1, 9), borderType=cv2.BORDER_REPLICATE)[:, 0]
    # from below around to below, so that the mirror image has the reversed order
    angle = -np.pi / 2 - 2 * np.pi * np.arange(_MERIDIANS + 1) / _MERIDIANS
    spoke = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
    reach = np.linspace(0, float(np.linalg.norm(size[1:])), _SAMPLES)
    centre = np.stack([x, np.zeros_like(x), middle], axis=-1)
    values = value(centre[:, None, None] + reach[:, None] * spoke[:, None])
    radius = _crossing(values, reach)
    surface = centre[:, None] + radius[..., None] * spoke
    whole = np.concatenate(
        [
            np.broadcast_to(centre[:1], surface[0].shape)[None],
            surface,
            np.broadcast_to(centre[-1:], surface[0].shape)[None],
        ]
    )
    return _Net(_evenly(whole, _RINGS))


def _crossing(values: FloatArray, reach: FloatArray) -> FloatArray:
    """Where values (..., s) first become positive along a reach (s,)."""
    out = values > 0
    first = np.where(out.any(axis=-1), out.argmax(axis=-1), len(reach) - 1)
    before = np.maximum(first - 1, 0)
    a, b = (np.take_along_axis(values, k[..., None], axis=-1)[..., 0] for k in (before, first))
    share = np.where(first > 0, np.clip(-a / np.where(b > a, b - a, 1.0), 0, 1), 0.0)
    return np.asarray(reach[before] + share * (reach[first] - reach[before]))


def _evenly(lines: FloatArray, count: int) -> FloatArray:
    """Lines (n, k, 3) with a number of points an equal way apart along each, shape (count, k, 3)."""
    step = np.linalg.norm(np.diff(lines, axis=0), axis=2)
    way = np.concatenate([np.zeros((1, lines.shape[1])), np.cumsum(step, axis=0)])
    # one rule for a ring keeps rings smooth where neighbours differ
    share = (way / way[-1]).mean(axis=1)
    at = np.linspace(0, 1, count)
    flat = lines.reshape(len(lines), -1)
    out = np.stack([np.interp(at, share, column) for column in flat.T], axis=1)
    return out.reshape(count, *lines.shape[1:])


def _mesh(
    net: _Net, turn: FloatArray, shape_px: tuple[int, int]
) -> tuple[PictureMesh, o3d.t.geometry.RaycastingScene]:
    """The net as triangles in the camera frame, and the same ready for rays."""
    rings, meridians = net.xyz.shape[:2]
    index = np.arange(rings * meridians).reshape(rings, meridians)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    # the first and the last ring are points, where one of the two triangles has no area
    first, second = np.stack([a, c, b], -1)[:-1], np.stack([a, d, c], -1)[1:]
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    xyz = net.xyz.reshape(-1, 3) @ turn[:3, :3].T + turn[:3, 3]
    v, u = np.meshgrid(
        np.linspace(0, shape_px[0] - 1, rings), np.linspace(0, shape_px[1] - 1, meridians), indexing="ij"
    )
    return PictureMesh(xyz, faces.astype(np.int64), np.stack([u.ravel(), v.ravel()], axis=1)), ray_scene(
        xyz, faces
    )


def _seen(
    at: FloatArray,
    normal: FloatArray,
    scene: o3d.t.geometry.RaycastingScene,
    matte: Float32Array,
    camera: PinholeCamera,
) -> tuple[FloatArray, FloatArray]:
    """How well the photograph shows each place (h, w), in [0, 1], and where, (h, w, 2)."""
    direction, distance, hit = lines_of_sight(at, scene)
    facing = -(normal * direction).sum(axis=2)
    seen = np.clip((facing - _FACING[0]) / (_FACING[1] - _FACING[0]), 0, 1)
    seen *= hit > distance - 0.01 * np.ptp(distance)
    uv = camera.project(at.reshape(-1, 3)).reshape(*at.shape[:2], 2)
    inside = matte > 0.5
    away = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    rows, columns = np.nonzero(inside)
    reach_px = _REACH * max(float(np.ptp(rows)), float(np.ptp(columns)), 1.0)
    pixel = np.clip(np.rint(uv).astype(int), 0, [matte.shape[1] - 1, matte.shape[0] - 1])
    in_picture = ((uv > -0.5) & (uv < [matte.shape[1] - 0.5, matte.shape[0] - 0.5])).all(axis=2)
    seen *= in_picture & (away[pixel[..., 1], pixel[..., 0]] < reach_px)
    return seen, uv


def ray_scene(xyz: FloatArray, faces: IntArray) -> o3d.t.geometry.RaycastingScene:
    """Triangles (m, 3) of vertices (n, 3), ready for rays."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(xyz.astype(np.float32)),
        o3d.core.Tensor.from_numpy(faces.astype(np.uint32)),
    )
    return scene


def lines_of_sight(
    at: FloatArray, scene: o3d.t.geometry.RaycastingScene
) -> tuple[FloatArray, FloatArray, Float32Array]:
    """Directions from the camera to places (..., 3), their distances, and those of what is hit first."""
    distance = np.linalg.norm(at, axis=-1)
    direction = at / distance[..., None]
    rays = np.concatenate([np.zeros_like(direction), direction], axis=-1).astype(np.float32)
    return direction, distance, scene.cast_rays(o3d.core.Tensor.from_numpy(rays))["t_hit"].numpy()


def _parts(net: _Net, shape: FittedShape) -> IntArray:
    """Label of the part that each place (h, w) belongs to; 0 for none."""
    points, normal = net.xyz, net.normals
    limit = _PART_REACH * float(shape.size_m[0])
    nearest = np.full(points.shape[:2], limit)
    out = np.zeros(points.shape[:2], np.int64)
    for label, outline in zip(shape.space.part_labels, shape.parts_m, strict=True):
        middle = outline.mean(axis=0)
        axes = np.linalg.svd(outline - middle)[2]
        own = points - middle
        off = np.abs(own @ axes[2])
        facing = np.abs(normal @ axes[2]) > _SAME_WAY
        facing &= (own * normal).sum(axis=2) < limit
        inside = _inside(own @ axes[:2].T, (outline - middle) @ axes[:2].T)
        better = facing & inside & (off < nearest)
        out[better], nearest[better] = label, off[better]
    return out


def _inside(flat: FloatArray, polygon: FloatArray) -> BoolArray:
    """Whether points (h, w, 2) lie inside a polygon (m, 2), shape (h, w)."""
    low, size = polygon.min(axis=0), max(float(np.ptp(polygon, axis=0).max()), 1e-9)
    filled = fill_polygon((polygon - low) / size * 255, 256, 256)
    at = np.rint((flat - low) / size * 255).astype(int)
    good = ((at >= 0) & (at < 256)).all(axis=2)
    at = np.where(good[..., None], at, 0)
    return np.asarray(good & filled[at[..., 1], at[..., 0]])


def _plain(part: IntArray, colours: Mapping[int, Colour], normal: FloatArray) -> FloatArray:
    """The plain colour (h, w, 3) of each place; undersides lie in their own shade."""
    table = np.zeros((part.max() + 1, 3))
    for label in range(len(table)):
        table[label] = colours.get(label, colours[0])
    out = table[part]
    out[normal[..., 2] < _UNDERSIDE] *= _SHADE
    return np.asarray(out)
