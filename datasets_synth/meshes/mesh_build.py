"""Building surfaces: triangle soups that are cut along level lines, painted, mirrored and joined to a Mesh.

A soup keeps three corners for each face and shares nothing, so that cutting is a plain whole-array operation:
both faces beside an edge interpolate the same two end points in the same order, and get the same new corner.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datasets_synth.meshes.mesh import Material, Mesh
from recon.arrays import BoolArray, FloatArray, IntArray, UInt8Array

_SNAP_M = 0.0022
"""A corner nearer to the level line than this counts as lying on it: fewer slivers."""
_MIN_AREA_M2 = 1e-10


@dataclass(frozen=True, eq=False)
class Soup:
    """Faces that share no vertices, each with a zone (where it was built), a material and a part."""

    corners_m: FloatArray
    """Shape (m, 3, 3): corner, then xyz."""
    normals: FloatArray
    """Shape (m, 3, 3), unit, outward."""
    zone: NDArray[np.int32]
    """Shape (m,): which piece of the construction the face comes from; the builder's own numbers."""
    material: NDArray[np.int32]
    """Shape (m,): index into the materials of the mesh to be."""
    part: UInt8Array
    """Shape (m,): part label, 0 for none."""
    station: FloatArray
    """Shape (m, 3): the builder's own coordinate along the object at each corner, before any bending."""

    def __len__(self) -> int:
        return len(self.corners_m)

    def take(self, index: NDArray[np.intp] | BoolArray) -> "Soup":
        """The chosen faces."""
        return Soup(
            self.corners_m[index],
            self.normals[index],
            self.zone[index],
            self.material[index],
            self.part[index],
            self.station[index],
        )

    def painted(self, where: BoolArray, material: int | None = None, part: int | None = None) -> "Soup":
        """The soup with another material or part on the faces that ``where`` chooses."""
        out = self
        if material is not None:
            out = replace(out, material=np.where(where, material, out.material).astype(np.int32))
        if part is not None:
            out = replace(out, part=np.where(where, part, out.part).astype(np.uint8))
        return out

    def moved(self, offset_m: tuple[float, float, float]) -> "Soup":
        """The soup with all faces shifted by offset_m."""
        return replace(self, corners_m=self.corners_m + np.asarray(offset_m))


def soup_of(
    corners_m: FloatArray,
    *,
    zone: int = 0,
    material: int = 0,
    part: int = 0,
    crease_rad: float = np.deg2rad(40.0),
    normals: FloatArray | None = None,
    station: FloatArray | None = None,
) -> Soup:
    """Faces of one zone, material and part; smooth normals with creases unless normals are given.

    Args:
        corners_m: shape (m, 3, 3). Faces without area are dropped.
        zone: number of the piece, see Soup.
        material: index of the material.
        part: part label.
        crease_rad: faces that meet at a larger angle keep their own normals.
        normals: shape (m, 3, 3), or None.
        station: shape (m, 3), or None for zeros.
    """
    cross = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    keep = np.linalg.norm(cross, axis=1) > 2 * _MIN_AREA_M2
    kept = np.asarray(corners_m[keep], dtype=np.float64)
    n = smooth_normals(kept, crease_rad) if normals is None else normals[keep]
    m = len(kept)
    return Soup(
        kept,
        n,
        np.full(m, zone, np.int32),
        np.full(m, material, np.int32),
        np.full(m, part, np.uint8),
        np.zeros((m, 3)) if station is None else station[keep],
    )


def grid_corners(points_m: FloatArray, *, flip: bool = False) -> FloatArray:
    """Triangle corners (2 (r-1) (c-1), 3, k) of a grid of points (r, c, k), k >= 3.

    Faces are counter-clockwise seen from the side that (row direction) x (column direction) points to.

    Args:
        points_m: shape (rows, columns, k); coordinates after xyz are carried along.
        flip: turn the faces round.
    """
    a, b = points_m[:-1, :-1], points_m[1:, :-1]
    c, d = points_m[1:, 1:], points_m[:-1, 1:]
    # The diagonal alternates, so that no direction of the grid shows in the shading.
    odd = (np.add.outer(np.arange(a.shape[0]), np.arange(a.shape[1])) % 2 == 1)[..., None, None]
    first = np.where(odd, np.stack([a, b, d], -2), np.stack([a, b, c], -2))
    second = np.where(odd, np.stack([b, c, d], -2), np.stack([a, c, d], -2))
    size = points_m.shape[-1]
    corners = np.concatenate([first.reshape(-1, 3, size), second.reshape(-1, 3, size)])
    return corners[:, ::-1] if flip else corners


def smooth_normals(corners_m: FloatArray, crease_rad: float) -> FloatArray:
    """Unit corner normals (m, 3, 3): the mean of the faces around a corner, weighted by their corner angles.

    Only faces whose normals differ from the corner's own face by at most the crease angle take part.

    Args:
        corners_m: shape (m, 3, 3); corners within 0.01 mm are one vertex.
        crease_rad: the crease angle.
    """
    m = len(corners_m)
    if m == 0:
        return np.zeros((0, 3, 3))
    face_normal = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    face_normal /= np.maximum(np.linalg.norm(face_normal, axis=1, keepdims=True), 1e-30)
    ahead = np.roll(corners_m, -1, axis=1) - corners_m
    behind = np.roll(corners_m, 1, axis=1) - corners_m
    cosine = (ahead * behind).sum(-1) / np.maximum(
        np.linalg.norm(ahead, axis=-1) * np.linalg.norm(behind, axis=-1), 1e-30
    )
    weight = np.arccos(np.clip(cosine, -1, 1)).ravel()
    _, vertex = np.unique(_point_keys(corners_m.reshape(-1, 3)), return_inverse=True)
    first, second = _pairs_of_equal(vertex)
    face = np.repeat(np.arange(m), 3)
    close = (face_normal[face[first]] * face_normal[face[second]]).sum(1) >= np.cos(crease_rad)
    first, second = first[close], second[close]
    total = np.stack(
        [np.bincount(first, face_normal[face[second], k] * weight[second], 3 * m) for k in range(3)], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    own = np.repeat(face_normal, 3, axis=0)
    return np.where(length > 1e-12, total / np.maximum(length, 1e-12), own).reshape(m, 3, 3)


def _point_keys(points_m: FloatArray) -> IntArray:
    """A number for each point (n, 3), the same within 0.01 mm, in the order of x, then y, then z.

    Sorting these is several times faster than sorting rows.
    """
    steps = np.round(points_m / 1e-5).astype(np.int64)
    steps -= steps.min(axis=0)
    _, y_steps, z_steps = (int(v) + 1 for v in steps.max(axis=0))
    return np.asarray((steps[:, 0] * y_steps + steps[:, 1]) * z_steps + steps[:, 2])


def _pairs_of_equal(group: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All ordered pairs (i, j), i = j too, with group[i] == group[j]."""
    order = np.argsort(group, kind="stable")
    count = np.bincount(group)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    repeats = count[group[order]]
    first = np.repeat(order, repeats)
    within = np.arange(len(first)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    second = order[np.repeat(start[group[order]], repeats) + within]
    return first, second


def cut(soup: Soup, values: FloatArray, level: float = 0.0) -> Soup:
    """The soup with its faces split along the line values = level; order of faces may change.

    Args:
        soup: the faces.
        values: shape (m, 3), at each corner; NaN in any corner leaves the face whole.
        level: the level.
    """
    v = values - level
    v = np.where(np.abs(v) < _SNAP_M, 0.0, v)
    # column by column, since reducing rows of three is slow
    low = np.minimum(np.minimum(v[:, 0], v[:, 1]), v[:, 2])
    high = np.maximum(np.maximum(v[:, 0], v[:, 1]), v[:, 2])
    crossing = (low < 0) & (high > 0)
    if not crossing.any():
        return soup
    hit = np.flatnonzero(crossing)
    pieces = [soup.take(np.flatnonzero(~crossing))]
    negative, positive = (v[hit] < 0).sum(1), (v[hit] > 0).sum(1)
    for chosen, lone_sign in (
        ((negative == 1) & (positive == 2), -1),
        ((negative == 2) & (positive == 1), 1),
        ((negative == 1) & (positive == 1), 0),
    ):
        if chosen.any():
            pieces.extend(_split(soup, hit[chosen], v[hit[chosen]], lone_sign))
    return join(pieces)


def _split(soup: Soup, index: NDArray[np.intp], v: FloatArray, lone_sign: int) -> list[Soup]:
    """Pieces of faces with one lone corner (that with the lone sign; 0: the corner on the line)."""
    lone = np.argmax(np.sign(v) == lone_sign, axis=1)
    turn = (lone[:, None] + np.arange(3)) % 3
    rows = np.arange(len(index))[:, None]
    packed = np.concatenate(
        [soup.corners_m[index], soup.normals[index], soup.station[index][..., None]], axis=2
    )[rows, turn]
    w = v[rows, turn]
    a, b, c = packed[:, 0], packed[:, 1], packed[:, 2]

    def build(*corners: FloatArray) -> Soup:
        p = np.stack(corners, axis=1)
        base = soup.take(index)
        n = p[..., 3:6]
        n = n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-12)
        return replace(base, corners_m=p[..., :3], normals=n, station=p[..., 6])

    if lone_sign == 0:
        bc = _between(b, c, w[:, 1], w[:, 2])
        return [build(a, b, bc), build(a, bc, c)]
    ab, ac = _between(a, b, w[:, 0], w[:, 1]), _between(a, c, w[:, 0], w[:, 2])
    return [build(a, ab, ac), build(ab, b, c), build(ab, c, ac)]


def _between(a: FloatArray, b: FloatArray, va: FloatArray, vb: FloatArray) -> FloatArray:
    """Where the value is 0 between a and b, from the negative end: equal on both sides of an edge."""
    swap = (va > 0)[:, None]
    low, high = np.where(swap, b, a), np.where(swap, a, b)
    v_low, v_high = np.minimum(va, vb), np.maximum(va, vb)
    return np.asarray(low + (high - low) * (v_low / (v_low - v_high))[:, None])


def join(soups: Iterable[Soup]) -> Soup:
    """One soup with the faces of all."""
    parts = list(soups)
    return Soup(
        np.concatenate([s.corners_m for s in parts]),
        np.concatenate([s.normals for s in parts]),
        np.concatenate([s.zone for s in parts]),
        np.concatenate([s.material for s in parts]),
        np.concatenate([s.part for s in parts]),
        np.concatenate([s.station for s in parts]),
    )


def mirrored(soup: Soup, part_map: UInt8Array) -> Soup:
    """The soup mirrored in the plane y = 0; part_map (256,) gives the label of each part on the other
    side."""
    flip = np.array([1.0, -1.0, 1.0])
    return Soup(
        (soup.corners_m * flip)[:, ::-1],
        (soup.normals * flip)[:, ::-1],
        soup.zone,
        soup.material,
        part_map[soup.part],
        soup.station[:, ::-1],
    )


def _edges(soup: Soup) -> FloatArray:
    """All edges in the direction of their faces, shape (3 m, 2, 3)."""
    ends = np.roll(soup.corners_m, -1, axis=1)
    return np.stack([soup.corners_m, ends], axis=2).reshape(-1, 2, 3)


def _edge_codes(edges: FloatArray) -> IntArray:
    """A number for each edge (n, 2, 3), the same for both directions."""
    _, point = np.unique(_point_keys(edges.reshape(-1, 3)), return_inverse=True)
    pair = np.sort(point.reshape(-1, 2), axis=1).astype(np.int64)
    return np.asarray(pair[:, 0] * (int(point.max()) + 1) + pair[:, 1])


def recess(
    soup: Soup, inside: BoolArray, *, axis: int, floor: float, hub_m: FloatArray, material: int, part: int
) -> Soup:
    """The surface with a hole instead of the faces inside, closed by walls along one axis and a flat floor.

    Args:
        soup: the faces, already cut along the outline of the hole.
        inside: shape (m,), the faces to take out.
        axis: 0, 1 or 2: the direction of the walls.
        floor: coordinate of the floor on that axis.
        hub_m: shape (3,), a point from which the whole outline is seen (its axis coordinate is not used).
        material: material of walls and floor.
        part: their part label.
    """
    kept = soup.take(~inside)
    edges = _edges(kept)
    code = _edge_codes(np.concatenate([edges, _edges(soup.take(inside))]))
    shared = np.isin(code[: len(edges)], code[len(edges) :])
    a, b = edges[shared, 0], edges[shared, 1]
    a_low, b_low = a.copy(), b.copy()
    a_low[:, axis] = b_low[:, axis] = floor
    hub = np.broadcast_to(hub_m, a.shape).copy()
    hub[:, axis] = floor
    faces = np.concatenate(
        [np.stack(c, axis=1) for c in ((b, a, a_low), (b, a_low, b_low), (b_low, a_low, hub))]
    )
    return join([kept, soup_of(faces, zone=-1, material=material, part=part)])


def to_mesh(soup: Soup, materials: tuple[Material, ...]) -> Mesh:
    """The soup as a Mesh with shared vertices, without texture coordinates."""
    flat = soup.corners_m.reshape(-1, 3).astype(np.float32)
    keys = _point_keys(flat.astype(np.float64))
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1, 3).astype(np.int32)
    vertices = flat[first]
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    keep = np.linalg.norm(np.cross(b - a, c - a), axis=1) > _MIN_AREA_M2
    m = int(keep.sum())
    return Mesh(
        vertices_m=vertices,
        faces=faces[keep],
        corner_normals=soup.normals[keep].astype(np.float32),
        corner_uv=np.zeros((m, 3, 2), np.float32),
        face_material=soup.material[keep].astype(np.int32),
        materials=materials,
        face_part=soup.part[keep].astype(np.uint8),
    )
