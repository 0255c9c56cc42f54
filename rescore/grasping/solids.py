"""Meshes as bodies that can be touched: whether a mesh is closed, convex pieces of it, and its weight."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from datasets_synth.meshes.filled import filled
from datasets_synth.meshes.mesh import Mesh
from recon.arrays import FloatArray, IntArray

CLOSED_WITHIN = 0.1
"""Largest difference between the volumes of a mesh along the three axes, as a share of the largest."""
_LARGE = 0.02
"""A piece with at least this share of the object's box is cut into slabs; a smaller one is one hull."""
_SMALLEST = 3e-4
"""Pieces below this share of the box, as door handles, are left out."""
_SLABS = 9
_BANDS = (0.0, 0.56, 1.0)
"""Heights at which slabs are cut, as shares of the piece's height: a car's body is wider than its roof."""
_MERGED_M = 1e-5
LEAST_INSIDE = 0.25
"""Least volume of a body that is filled from outside, as a share of the hull of its surface; cars have 0.4 or
more, a sheet or a shell with a large opening next to nothing."""
_FILLED_SLABS, _FILLED_BANDS = 12, (0.0, 0.28, 0.56, 1.0)
"""Pieces along a body that is filled, and the heights at which they are cut."""


@dataclass(frozen=True, eq=False)
class Solid:
    """An object that can be touched and weighed."""

    name: str
    hulls_m: tuple[FloatArray, ...]
    """Corners (n, 3) of its convex pieces in the object frame, at the size on the table."""
    size_m: FloatArray
    """Length, width and height, shape (3,)."""
    mass_kg: float
    middle_m: FloatArray
    """Centre of mass in the object frame, shape (3,)."""
    inertia_kg_m2: FloatArray
    """Moments of inertia about axes through the centre of mass along x, y and z, shape (3,)."""
    breaks_at_n: float = float("inf")
    """Force of one touch at which it breaks."""
    from_outside: bool = False
    """Whether its mesh, not closed or in very many pieces, was filled from outside."""

    @staticmethod
    def heavy_below(
        name: str, hulls_m: tuple[FloatArray, ...], size_m: FloatArray, mass_kg: float
    ) -> "Solid":
        """The body that weighs as a filled box with more weight below, where a model car has its metal."""
        square = size_m**2
        inertia = np.array([mass_kg / 12 * (square.sum() - s) for s in square])
        return Solid(name, hulls_m, size_m, mass_kg, np.array([0.0, 0.0, 0.4 * size_m[2]]), inertia)


def volumes_m3(mesh: Mesh) -> FloatArray:
    """The volume below the surface of a mesh, measured along x, y and z, shape (3,).

    The three agree where the surface is closed, by the divergence theorem, however many pieces it has.
    """
    corners = mesh.vertices_m[mesh.faces].astype(float)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    middle = corners.mean(axis=1) - corners.reshape(-1, 3).mean(axis=0)
    return np.asarray((area * middle).sum(axis=0))


def is_closed(mesh: Mesh) -> bool:
    """Whether the surface of a mesh encloses a volume."""
    volumes = volumes_m3(mesh)
    largest = float(volumes.max())
    return largest > 0 and float(volumes.min()) > (1 - CLOSED_WITHIN) * largest


def filled_solid(name: str, mesh: Mesh, scale: float, size_m: FloatArray, mass_kg: float) -> Solid | None:
    """The solid inside a surface that is not closed, evenly filled; None where it bounds next to nothing.

    Args:
        name: of the solid.
        mesh: the surface.
        scale: size of the solid in units of the mesh.
        size_m: length, width and height of the solid, shape (3,).
        mass_kg: its mass.
    """
    body = filled(mesh)
    if body.volume_m3 < LEAST_INSIDE * _hull_volume(mesh.vertices_m[np.unique(mesh.faces)].astype(float)):
        return None
    hulls = hulls_of([p * scale for p in body.pieces_m(_FILLED_SLABS, _FILLED_BANDS)])
    square = body.variance_m2 * scale**2
    inertia = mass_kg * (square.sum() - square)
    return Solid(name, hulls, size_m, mass_kg, body.middle_m * scale, inertia, from_outside=True)


def _hull_volume(points: FloatArray) -> float:
    """Volume of the convex hull of points (n, 3); infinite where they are flat."""
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return float("inf")


def convex_pieces(mesh: Mesh, scale: float) -> tuple[FloatArray, ...]:
    """Corners (n, 3) of convex pieces that cover a mesh, scaled: slabs of the body, wheels, mirrors."""
    vertices = mesh.vertices_m.astype(float)
    box = np.ptp(vertices, axis=0).prod()
    hulls: list[FloatArray] = []
    small: list[FloatArray] = []
    for faces in _components(vertices, mesh.faces.astype(np.int64)):
        points = vertices[np.unique(faces)]
        share = np.ptp(points, axis=0).prod() / box
        if share >= _LARGE:
            hulls += _slabs(vertices, faces)
        elif share >= _SMALLEST:
            small.append(points)
    return hulls_of([h * scale for h in hulls + _outer(small)])


def _components(vertices: FloatArray, faces: IntArray) -> list[IntArray]:
    """The faces (k, 3) of each connected piece; corners at one place are one."""
    _, same = np.unique(np.round(vertices / _MERGED_M).astype(np.int64), axis=0, return_inverse=True)
    ends = same.reshape(-1)[faces]
    rows, columns = ends[:, [0, 1]].ravel(), ends[:, [1, 2]].ravel()
    count = int(ends.max()) + 1
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, piece = connected_components(graph, directed=False)
    of_face = piece[ends[:, 0]]
    return [faces[of_face == k] for k in np.unique(of_face)]


def _outer(pieces: list[FloatArray]) -> list[FloatArray]:
    """The pieces, points (n, 3) each, that lie in the box around no other one: of a wheel the tyre."""
    boxes = [(p.min(axis=0), p.max(axis=0)) for p in pieces]
    kept: list[int] = []
    for i in sorted(range(len(pieces)), key=lambda i: -float(np.prod(boxes[i][1] - boxes[i][0]))):
        slack = 0.2 * (boxes[i][1] - boxes[i][0])
        low, high = boxes[i][0] + slack, boxes[i][1] - slack
        if not any((low >= boxes[k][0]).all() and (high <= boxes[k][1]).all() for k in kept):
            kept.append(i)
    return [pieces[i] for i in sorted(kept)]


def _slabs(vertices: FloatArray, faces: IntArray) -> list[FloatArray]:
    """Points (n, 3) whose hulls are the pieces of a surface between levels of length and height."""
    shares = np.linspace(0.0, 1.0, _SLABS + 1)
    slabs = cut_between(vertices[faces], 0, shares)
    return [band.reshape(-1, 3) for slab in slabs for band in cut_between(slab, 2, np.array(_BANDS))]


def cut_between(corners: FloatArray, axis: int, shares: FloatArray) -> list[FloatArray]:
    """Pieces of a surface between levels of an axis, those without any left out.

    Args:
        corners: triangles (m, 3, 3); those of a piece have its corners, and cover it in no other way.
        axis: 0, 1 or 2.
        shares: rising levels (k,) as shares of the surface's extent.
    """
    low, size = corners[..., axis].min(), np.ptp(corners[..., axis])
    pieces = [_between(corners, axis, low + a * size, low + b * size) for a, b in pairwise(shares)]
    return [p for p in pieces if len(p)]


def hulls_of(pieces: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """Corners (n, 3) of the hulls of points (m, 3); flat ones are left out."""
    corners = [_hull_corners(p) for p in pieces]
    return tuple(c for c in corners if c is not None)


def _between(corners: FloatArray, axis: int, low: float, high: float) -> FloatArray:
    """Triangles (k, 3, 3) that cover the same part of a surface (m, 3, 3) between two levels of an axis."""
    return _below(_below(corners, axis, high, 1.0), axis, low, -1.0)


def _below(corners: FloatArray, axis: int, level: float, sign: float) -> FloatArray:
    side = sign * (corners[..., axis] - level)
    inside = (side <= 0).all(axis=1)
    cut = ~inside & (side < 0).any(axis=1)
    return np.concatenate([corners[inside], _clipped(corners[cut], side[cut])])


def _clipped(corners: FloatArray, side: FloatArray) -> FloatArray:
    """Triangles (k, 3, 3) of what is left of triangles (m, 3, 3), one or two corners of which are above 0.

    Args:
        corners: the triangles.
        side: how far each corner is above the plane that cuts, shape (m, 3).
    """
    above = side > 0
    lone = above.sum(axis=1) == 1
    # the corner that is alone on its side comes first
    first = np.where(lone, above.argmax(axis=1), (~above).argmax(axis=1))
    turn = (first[:, None] + np.arange(3)) % 3
    (a, b, c), (sa, sb, sc) = (np.moveaxis(np.take_along_axis(v, t, axis=1), 1, 0)
                               for v, t in ((corners, turn[..., None]), (side, turn)))  # fmt: skip
    ab, ac = (a + (q - a) * (sa / (sa - s))[:, None] for q, s in ((b, sb), (c, sc)))
    tips = np.stack([a, ab, ac], axis=1)[~lone]
    rests = [np.stack(t, axis=1)[lone] for t in ((ab, b, c), (ab, c, ac))]
    return np.concatenate([tips, *rests])


def _hull_corners(points: FloatArray) -> FloatArray | None:
    """Corners of the convex hull of points (n, 3); None where they are flat."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return None
