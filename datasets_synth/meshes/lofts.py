"""Rounded solids for a MeshDraft: lofts through rings, tubes along curves, slabs with rounded edges."""

import numpy as np
from numpy.typing import ArrayLike

from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.mesh_build import grid_corners, smooth_normals
from datasets_synth.meshes.solids import MeshDraft
from recon.arrays import FloatArray

CREASE_RAD = float(np.deg2rad(50.0))
"""Faces that meet at a larger angle keep an edge between them."""


def xyz(x_m: float, y_m: float, z_m: float) -> FloatArray:
    """A point or an offset, shape (3,)."""
    return np.array([x_m, y_m, z_m], float)


def loft(
    draft: MeshDraft,
    rings_m: FloatArray,
    material: Material,
    *,
    tile_m: float = 1.0,
    capped: bool = True,
    uv_axes: tuple[int, int] | None = None,
) -> None:
    """Add the closed surface through rings, smooth but for creases; faces turn outwards by themselves.

    Args:
        draft: What it is added to.
        rings_m: Shape (r, k, 3): r rings of k corners each, in order around, the first not repeated.
        material: Its surface; u of a texture runs around, v along.
        tile_m: Metres that the texture spans.
        capped: Close both ends by fans; without, the last ring must lie on the first, or both be points.
        uv_axes: Axes along which u and v run instead: the texture of a board cut from one piece.
    """
    around = np.concatenate([rings_m, rings_m[:, :1]], axis=1)
    u = np.cumsum(_steps(around, axis=1), axis=1)
    v = np.cumsum(_steps(around, axis=0).mean(axis=1))
    v = np.broadcast_to(v[:, None], u.shape)
    corners = grid_corners(np.concatenate([around, np.stack([u, v], axis=-1) / tile_m], axis=-1))
    if capped:
        corners = np.concatenate([corners, _fan(around[0], tile_m), _fan(around[-1], tile_m)[:, ::-1]])
    a, b, c = (corners[:, i, :3] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    corners = corners[area > 1e-12]
    middle = corners[..., :3].mean(axis=(0, 1))
    a, b, c = (corners[:, i, :3] - middle for i in range(3))
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:  # six times the volume
        corners = corners[:, ::-1]
    points = corners[..., :3]
    uv = corners[..., 3:] if uv_axes is None else points[..., list(uv_axes)] / tile_m
    normals = smooth_normals(points, CREASE_RAD)
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    draft.add(points.reshape(-1, 3), faces, normals.reshape(-1, 3), uv.reshape(-1, 2), material)


def _steps(points_m: FloatArray, axis: int) -> FloatArray:
    """Distance of each point from the one before along an axis, 0 for the first."""
    step = np.linalg.norm(np.diff(points_m, axis=axis), axis=-1)
    return np.concatenate([np.zeros_like(np.take(step, [0], axis=axis)), step], axis=axis)


def _fan(ring_m: FloatArray, tile_m: float) -> FloatArray:
    """Triangles (k, 3, 5) from the middle of a closed ring (k + 1, 3) to its edges, flat texture."""
    middle = ring_m[:-1].mean(axis=0)
    offset = ring_m - middle
    e1 = offset[0] / max(float(np.linalg.norm(offset[0])), 1e-9)
    normal = np.cross(offset[:-1], offset[1:]).sum(axis=0)
    e2 = np.cross(normal / max(float(np.linalg.norm(normal)), 1e-12), e1)
    rim = np.concatenate([ring_m, np.stack([offset @ e1, offset @ e2], axis=1) / tile_m], axis=1)
    hub = np.broadcast_to(np.concatenate([middle, [0.0, 0.0]]), rim[:-1].shape)
    return np.stack([hub, rim[:-1], rim[1:]], axis=1)


def tube(
    draft: MeshDraft,
    path_m: ArrayLike,
    radius_m: ArrayLike,
    material: Material,
    *,
    sides: int = 10,
    closed: bool = False,
    tile_m: float = 1.0,
) -> None:
    """Add a tube along a curve.

    Args:
        draft: What it is added to.
        path_m: Shape (n, 3), n >= 2; not the first point again for a closed one.
        radius_m: One radius, or one for each point.
        material: Its surface; v of a texture runs along.
        sides: Corners of its section.
        closed: The tube comes back to its start (a tyre).
        tile_m: Metres that the texture spans.
    """
    path = np.asarray(path_m, float)
    tangent = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0) if closed else np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    e1 = np.empty_like(path)
    # the axis farthest from the whole curve, so that the section of a flat curve does not turn
    helper = np.eye(3)[int(np.argmin(np.abs(tangent).max(axis=0)))]
    for i, t in enumerate(tangent):
        across = (helper if i == 0 else e1[i - 1]) - t * ((helper if i == 0 else e1[i - 1]) @ t)
        e1[i] = across / np.linalg.norm(across)
    e2 = np.cross(tangent, e1)
    angle = np.arange(sides) * (2 * np.pi / sides)
    ring = np.cos(angle)[:, None] * e1[:, None] + np.sin(angle)[:, None] * e2[:, None]
    radius = np.broadcast_to(np.asarray(radius_m, float), (len(path),))
    rings = path[:, None] + radius[:, None, None] * ring
    if closed:
        rings = np.concatenate([rings, rings[:1]])
    loft(draft, rings, material, tile_m=tile_m, capped=not closed)


def circle(centre_m: ArrayLike, radius_m: float, normal: str, n: int) -> FloatArray:
    """n points (n, 3) around a circle whose axis is "x", "y" or "z"."""
    angle = np.arange(n) * (2 * np.pi / n)
    ring = np.zeros((n, 3))
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[normal]
    ring[:, first], ring[:, second] = np.cos(angle), np.sin(angle)
    return np.asarray(centre_m, float) + radius_m * ring


def curve(a_m: ArrayLike, b_m: ArrayLike, c_m: ArrayLike) -> FloatArray:
    """A smooth curve (13, 3) from a to c, drawn to b."""
    a, b, c = (np.asarray(p, float) for p in (a_m, b_m, c_m))
    t = np.linspace(0, 1, 13)[:, None]
    return np.asarray((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c)


def superellipse(half_x_m: float, half_y_m: float, power: float, n: int = 48) -> FloatArray:
    """n points (n, 2) around |x / a|^p + |y / b|^p = 1: 2 is an ellipse, large powers a rounded rectangle.

    The points lie evenly in angle seen from the middle of the unit shape, and start at +x.
    """
    angle = np.arange(n) * (2 * np.pi / n)
    d = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = (np.abs(d) ** power).sum(axis=1, keepdims=True) ** (-1 / power)
    return np.asarray(d * radius * [half_x_m, half_y_m])


def rounded_edge(outline_m: FloatArray, thickness_m: float, edge_m: float) -> tuple[FloatArray, FloatArray]:
    """Outlines (8, n, 2) around a plate with rounded edges, and their heights (8,) about its middle.

    Args:
        outline_m: Shape (n, 2), about the origin.
        thickness_m: Of the plate.
        edge_m: Radius of the edges, at most half the thickness.
    """
    angle = np.linspace(0, np.pi / 2, 4)
    inset = np.concatenate([1 - np.sin(angle), 1 - np.sin(angle)[::-1]]) * edge_m
    below = thickness_m / 2 - edge_m * (1 - np.cos(angle))
    out = outline_m / np.linalg.norm(outline_m, axis=1, keepdims=True)
    return outline_m - inset[:, None, None] * out, np.concatenate([-below, below[::-1]])


def slab(
    draft: MeshDraft,
    outline_m: FloatArray,
    z_m: tuple[float, float],
    edge_m: float,
    material: Material,
    *,
    tile_m: float = 1.0,
) -> None:
    """Add a plate with rounded edges: a seat, a cushion.

    Args:
        draft: What it is added to.
        outline_m: Shape (n, 2), seen from above.
        z_m: Underside and top.
        edge_m: Radius of the rounded edges, at most half the thickness.
        material: Its surface.
        tile_m: Metres that the texture spans.
    """
    low, high = z_m
    flat, height = rounded_edge(outline_m, high - low, edge_m)
    height += (low + high) / 2
    rings = np.concatenate([flat, np.broadcast_to(height[:, None, None], (*flat.shape[:2], 1))], axis=-1)
    loft(draft, rings, material, tile_m=tile_m, uv_axes=(1, 0))
