"""The inside of a surface that need not be closed: what a ball that comes from outside does not reach.

A grid lies around the surface. A ball too large for the gaps that are to be bridged is rolled around outside;
what it sweeps is outside, and all else belongs to the body. Neither the sense of the faces nor walls inside
matter.
"""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from scipy import ndimage

from datasets_synth.meshes.mesh import Mesh
from recon.arrays import BoolArray, FloatArray

_CELLS = 150
"""Cells along the longest extent of the surface."""
_BALL_CELLS = 3.0
"""Radius of the ball: gaps up to twice as wide, a twenty-fifth of the longest extent, are bridged."""
_PAD = int(_BALL_CELLS) + 3
_SHIFT = 0.37
"""Where the grid begins inside a cell, so that its lines keep away from edges at round numbers."""


@dataclass(frozen=True, eq=False)
class Filled:
    """The body that a surface bounds, on a grid in the frame of its mesh."""

    inside: BoolArray
    """Whether the middle of a cell lies inside, shape (nx, ny, nz)."""
    first_m: FloatArray
    """Middle of the first cell, shape (3,)."""
    cell_m: float
    """Side of a cell."""
    bounds_m: FloatArray
    """Least and greatest coordinates of the surface, shape (2, 3)."""

    @property
    def volume_m3(self) -> float:
        """Volume of the body."""
        return float(self.inside.sum() * self.cell_m**3)

    @property
    def middle_m(self) -> FloatArray:
        """Centre of mass of the body, evenly filled, shape (3,)."""
        return np.asarray(self._points_m().mean(axis=0))

    @property
    def variance_m2(self) -> FloatArray:
        """Mean square distances of the filled body from its middle along x, y and z, shape (3,)."""
        return np.asarray(self._points_m().var(axis=0)) + self.cell_m**2 / 12

    def pieces_m(self, slabs: int, bands: tuple[float, ...]) -> list[FloatArray]:
        """Points (n, 3) around each piece of the body, none beyond the bounds of the surface.

        Args:
            slabs: pieces along x.
            bands: rising heights at which these are cut, from 0 to 1, as shares of the height.
        """
        low, high = self.bounds_m
        skin = self.inside & ~ndimage.binary_erosion(self.inside)
        middles = self.first_m + np.argwhere(skin) * self.cell_m
        at = np.clip((middles - low) / (high - low), 0.0, 1.0 - 1e-9)
        slab, band = (at[:, 0] * slabs).astype(int), np.digitize(at[:, 2], bands) - 1
        half = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3) * self.cell_m
        pieces = [middles[(slab == i) & (band == k)] for i in range(slabs) for k in range(len(bands) - 1)]
        return [np.clip(p[:, None] + half, low, high).reshape(-1, 3) for p in pieces if len(p)]

    def _points_m(self) -> FloatArray:
        return self.first_m + np.argwhere(self.inside) * self.cell_m


def filled(mesh: Mesh) -> Filled:
    """The body that the surface of a mesh bounds; it has few cells or none where that bounds nothing."""
    corners = mesh.vertices_m[np.unique(mesh.faces)].astype(float)
    low, high = corners.min(axis=0), corners.max(axis=0)
    cell = float((high - low).max()) / _CELLS
    shape = tuple(int(n) for n in np.ceil((high - low) / cell).astype(int) + 2 * _PAD + 1)
    first = low - (_PAD - _SHIFT) * cell
    walls = _walls(mesh, first, cell, shape)
    return Filled(~_outside(walls), first, cell, np.stack([low, high]))


def _walls(mesh: Mesh, first_m: FloatArray, cell_m: float, shape: tuple[int, ...]) -> list[BoolArray]:
    """Whether the surface lies between the middle of a cell and that of the next along x, y and z."""
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.vertices_m, np.float32)),
        o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.faces, np.uint32)),
    )
    walls = []
    for axis in range(3):
        across = [k for k in range(3) if k != axis]
        lines = np.stack(np.meshgrid(*(np.arange(shape[k]) for k in across), indexing="ij"), axis=-1)
        lines = lines.reshape(-1, 2)
        rays = np.zeros((len(lines), 6), np.float32)
        rays[:, across] = first_m[across] + lines * cell_m
        rays[:, axis], rays[:, 3 + axis] = first_m[axis], cell_m
        hits = scene.list_intersections(o3d.core.Tensor.from_numpy(rays), nthreads=1)
        at, line = hits["t_hit"].numpy(), hits["ray_ids"].numpy().astype(np.int64)
        wall = np.zeros(shape, np.bool_)
        index: list[np.ndarray] = [np.empty(0)] * 3
        index[axis] = np.clip(at.astype(np.int64), 0, shape[axis] - 1)
        index[across[0]], index[across[1]] = lines[line].T
        wall[tuple(index)] = True
        walls.append(wall)
    return walls


def _outside(walls: list[BoolArray]) -> BoolArray:
    """The cells that a ball from outside reaches, and those beside them that no wall parts from it."""
    near = np.zeros_like(walls[0])
    for axis, wall in enumerate(walls):
        near |= wall | np.roll(wall, 1, axis)
    free = ndimage.distance_transform_edt(~near) > _BALL_CELLS
    pieces, _ = ndimage.label(free)
    rolled = ndimage.distance_transform_edt(pieces != pieces[0, 0, 0]) <= _BALL_CELLS
    outside = rolled & ~near
    # the ball stops at cells with a wall: their middles lie on either side of it
    reached = outside.copy()
    for axis, wall in enumerate(walls):
        reached |= np.roll(outside & ~wall, 1, axis)
        reached |= np.roll(outside, -1, axis) & ~wall
    return np.asarray(reached)
