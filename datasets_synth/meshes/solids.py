"""Textured boxes, panels, cylinders and blobs, put together into one mesh."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from datasets_synth.meshes.mesh import Material, Mesh
from recon.arrays import FloatArray, IntArray, UInt8Array

_BOX_FACES = ("-y", "+y", "+x", "-x", "+z", "-z")
_BOX_SIGNS = np.array(
    [
        # corners of each face: bottom left, bottom right, top right, top left as seen from outside
        [(-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)],
        [(1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1)],
        [(1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)],
        [(-1, 1, -1), (-1, -1, -1), (-1, -1, 1), (-1, 1, 1)],
        [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
        [(-1, 1, -1), (1, 1, -1), (1, -1, -1), (-1, -1, -1)],
    ],
    float,
)


@dataclass
class MeshDraft:
    """Collects patches of triangles, then gives one Mesh; part labels are 0 outside of ``labelling``."""

    _vertices: list[FloatArray] = field(default_factory=list)
    _faces: list[IntArray] = field(default_factory=list)
    _normals: list[FloatArray] = field(default_factory=list)
    _uv: list[FloatArray] = field(default_factory=list)
    _face_material: list[NDArray[np.int32]] = field(default_factory=list)
    _face_part: list[UInt8Array] = field(default_factory=list)
    _materials: list[Material] = field(default_factory=list)
    _n_vertices: int = 0
    _panels: list[FloatArray] = field(default_factory=list)
    """Panels that wait to be turned into triangles together, each (k, 4, 3)."""
    _panel_meta: list[tuple[float, float, float, float, int, int, int]] = field(default_factory=list)
    """Tile across and up, uv of the corner, material, part and number of panels (k) of each block of
    panels."""
    _part: int = 0
    """Part label of what is added next."""

    @property
    def n_patches(self) -> int:
        """How many patches were added; a draft without any has no mesh."""
        return len(self._vertices) + len(self._panels)

    @contextmanager
    def labelling(self, part: int) -> Iterator[None]:
        """What is added inside the ``with`` block carries this part label, 1 to 255."""
        before, self._part = self._part, part
        try:
            yield
        finally:
            self._part = before

    def _material_index(self, material: Material) -> int:
        for i, known in enumerate(self._materials):
            if known is material:
                return i
        self._materials.append(material)
        return len(self._materials) - 1

    def add(
        self,
        vertices: FloatArray,
        faces: IntArray,
        normals: FloatArray,
        uv: FloatArray,
        material: Material,
    ) -> None:
        """Add triangles: vertices (n, 3), faces (m, 3), normals and uv of each vertex (n, 3), (n, 2)."""
        n = len(faces)
        index = np.full(n, self._material_index(material), np.int32)
        self._append(vertices, faces, normals, uv, index, np.full(n, self._part, np.uint8))

    def _append(
        self,
        vertices: FloatArray,
        faces: IntArray,
        normals: FloatArray,
        uv: FloatArray,
        face_material: NDArray[np.int32],
        face_part: UInt8Array,
    ) -> None:
        self._vertices.append(vertices)
        self._faces.append(faces + self._n_vertices)
        self._normals.append(normals[faces])
        self._uv.append(uv[faces])
        self._face_material.append(face_material)
        self._face_part.append(face_part)
        self._n_vertices += len(vertices)

    def panel(
        self,
        corners_m: ArrayLike,
        material: Material,
        tile_m: float | tuple[float, float] = 0.0,
        uv0: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Add a flat quadrilateral.

        Args:
            corners_m: (4, 3), bottom left, bottom right, top right, top left seen from outside.
            material: Its surface.
            tile_m: Metres that the texture spans (one number, or across and up); 0 stretches it once over.
            uv0: Texture coordinates of the bottom left corner.
        """
        tile = (tile_m, tile_m) if isinstance(tile_m, int | float) else tile_m
        block = np.asarray(corners_m, float).reshape(1, 4, 3)
        self._panels.append(block)
        self._panel_meta.append((*tile, *uv0, self._material_index(material), self._part, 1))

    def _flush(self) -> None:
        """Turn the waiting panels into triangles; one by one would take most of the time of a scene."""
        if not self._panels:
            return
        p = np.concatenate(self._panels)
        counts = [m[6] for m in self._panel_meta]
        meta = np.repeat(np.array(self._panel_meta, float)[:, :6], counts, axis=0)
        n = len(p)
        across = np.linalg.norm(p[:, 1] - p[:, 0], axis=1)
        up = np.linalg.norm(p[:, 3] - p[:, 0], axis=1)
        tiled = meta[:, 0] > 0
        u = np.where(tiled, across / np.where(tiled, meta[:, 0], 1), 1.0)
        v = np.where(tiled, up / np.where(tiled, meta[:, 1], 1), 1.0)
        unit = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        uv = unit * np.stack([u, v], 1)[:, None] + meta[:, None, 2:4]
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 3] - p[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        faces = (np.arange(n)[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        self._append(
            p.reshape(-1, 3),
            faces,
            np.repeat(normal, 4, axis=0),
            uv.reshape(-1, 2),
            np.repeat(meta[:, 4].astype(np.int32), 2),
            np.repeat(meta[:, 5].astype(np.uint8), 2),
        )
        self._panels, self._panel_meta = [], []

    def box(
        self,
        centre_m: ArrayLike,
        size_m: ArrayLike,
        material: Material,
        tile_m: float = 0.0,
        *,
        yaw_rad: float = 0.0,
        skip: tuple[str, ...] = (),
        tilt_rad: float = 0.0,
    ) -> None:
        """Add a box, turned by the tilt about y, then by the yaw about z, without the faces in ``skip``."""
        centre, half = np.asarray(centre_m, float), np.asarray(size_m, float) / 2
        turn = rotation_z(yaw_rad) @ rotation_y(tilt_rad)
        keep = [i for i, name in enumerate(_BOX_FACES) if name not in skip]
        self._panels.append(centre + (_BOX_SIGNS[keep] * half) @ turn.T)
        self._panel_meta.append(
            (tile_m, tile_m, 0.0, 0.0, self._material_index(material), self._part, len(keep))
        )

    def bar(
        self, a_m: ArrayLike, b_m: ArrayLike, radius_m: float, material: Material, sides: int = 8
    ) -> None:
        """Add a closed cylinder from a to b."""
        a, b = np.asarray(a_m, float), np.asarray(b_m, float)
        self.cone(a, b, (radius_m, radius_m), material, sides=sides)

    def cone(
        self,
        a_m: ArrayLike,
        b_m: ArrayLike,
        radii_m: tuple[float, float],
        material: Material,
        *,
        sides: int = 12,
        tile_m: float = 1.0,
    ) -> None:
        """Add a closed cylinder or cone from a to b with a radius at each, smooth around."""
        radius_a_m, radius_b_m = radii_m
        a, b = np.asarray(a_m, float), np.asarray(b_m, float)
        length = float(np.linalg.norm(b - a))
        axis = (b - a) / length
        helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.9 else np.array([0, 1.0, 0])
        e1 = np.cross(axis, helper)
        e1 /= np.linalg.norm(e1)
        e2 = np.cross(axis, e1)
        angle = np.linspace(0, 2 * np.pi, sides + 1)
        ring = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
        vertices = np.concatenate([a + radius_a_m * ring, b + radius_b_m * ring])
        around = angle * max(radius_a_m, radius_b_m) / tile_m
        uv = np.concatenate(
            [
                np.stack([around, np.zeros_like(around)], 1),
                np.stack([around, np.full_like(around, length / tile_m)], 1),
            ]
        )
        i = np.arange(sides)
        j = i + sides + 1
        faces = np.concatenate([np.stack([i, i + 1, j + 1], 1), np.stack([i, j + 1, j], 1)])
        self.add(vertices, faces, np.concatenate([ring, ring]), uv, material)
        for centre, radius, sign in ((a, radius_a_m, -1.0), (b, radius_b_m, 1.0)):
            if radius > 0:
                self.disc(centre, radius * ring, sign * axis, material)

    def disc(self, centre: FloatArray, spokes: FloatArray, normal: FloatArray, material: Material) -> None:
        """Add a flat disc: centre (3,), spokes (n + 1, 3) to its rim, the last the same as the first."""
        n = len(spokes) - 1
        vertices = np.concatenate([centre[None], centre + spokes])
        i = np.arange(1, n + 1)
        order = (i, i + 1) if np.dot(np.cross(spokes[0], spokes[1]), normal) > 0 else (i + 1, i)
        faces = np.stack([np.zeros(n, int), *order], 1)
        uv = 0.5 + 0.5 * np.concatenate(
            [np.zeros((1, 2)), np.stack([np.cos(t := np.linspace(0, 2 * np.pi, n + 1)), np.sin(t)], 1)]
        )
        self.add(vertices, faces, np.tile(normal, (len(vertices), 1)), uv, material)

    def ring(self, centre_m: ArrayLike, radius_m: float, tube_m: float, material: Material) -> None:
        """Add a thin ring in the x z plane (a bicycle's tyre), smooth, with a tube of radius ``tube_m``."""
        n, k = 20, 5
        around, tube = np.meshgrid(
            np.linspace(0, 2 * np.pi, n + 1), np.linspace(0, 2 * np.pi, k + 1), indexing="ij"
        )
        out = np.stack([np.cos(around), np.zeros_like(around), np.sin(around)], -1)
        normal = np.cos(tube)[..., None] * out + np.sin(tube)[..., None] * np.array([0.0, 1, 0])
        vertices = np.asarray(centre_m, float) + radius_m * out + tube_m * normal
        i = (np.arange(n)[:, None] * (k + 1) + np.arange(k)).ravel()
        j = i + k + 1
        faces = np.concatenate([np.stack([i, i + 1, j + 1], 1), np.stack([i, j + 1, j], 1)])
        uv = np.zeros(((n + 1) * (k + 1), 2))
        self.add(vertices.reshape(-1, 3), faces, normal.reshape(-1, 3), uv, material)

    def wheel(
        self, centre_m: ArrayLike, radius_m: float, width_m: float, tyre: Material, rim: Material
    ) -> None:
        """Add a wheel whose axle runs along y."""
        c = np.asarray(centre_m, float)
        half = np.array([0, width_m / 2, 0])
        self.cone(c - half, c + half, (radius_m, radius_m), tyre, sides=18)
        self.cone(c - half * 1.08, c + half * 1.08, (radius_m * 0.6, radius_m * 0.6), rim, sides=12)

    def blob(
        self,
        centre_m: ArrayLike,
        radii_m: ArrayLike,
        material: Material,
        rng: np.random.Generator,
        *,
        bumps: float = 0.15,
        tile_m: float = 1.5,
        power: float = 1.0,
    ) -> None:
        """Add a bumpy ellipsoid (a crown, a bush); a power below 1 squares it off like a clipped hedge."""
        n_lat, n_lon = 13, 24
        lat = np.linspace(-np.pi / 2, np.pi / 2, n_lat)
        lon = np.linspace(0, 2 * np.pi, n_lon + 1)
        d = np.stack(
            np.broadcast_arrays(
                np.cos(lat)[:, None] * np.cos(lon), np.cos(lat)[:, None] * np.sin(lon), np.sin(lat)[:, None]
            ),
            -1,
        ).reshape(-1, 3)
        shape = np.sign(d) * np.abs(d) ** power
        waves = rng.normal(size=(10, 3)) * rng.uniform(2, 7, (10, 1))
        bump = np.sin(d @ waves.T + rng.uniform(0, 6.28, 10)).mean(1) * bumps * 2
        radii = np.asarray(radii_m, float)
        vertices = np.asarray(centre_m, float) + shape * radii * (1 + bump)[:, None]
        i = (np.arange(n_lat - 1)[:, None] * (n_lon + 1) + np.arange(n_lon)).ravel()
        j = i + n_lon + 1
        faces = np.concatenate([np.stack([i, i + 1, j + 1], 1), np.stack([i, j + 1, j], 1)])
        uv = np.stack(
            [
                np.tile(lon, n_lat) * float(radii[:2].mean()) / tile_m,
                np.repeat(lat, n_lon + 1) * radii[2] / tile_m,
            ],
            1,
        )
        normals = vertex_normals(vertices, faces, d)
        self.add(vertices, faces, normals, uv, material)

    def transform(self, rotation: FloatArray, shift_m: ArrayLike) -> None:
        """Turn and move everything added so far: rotation (3, 3), then shift (3,)."""
        self._flush()
        shift = np.asarray(shift_m, float)
        self._vertices = [v @ rotation.T + shift for v in self._vertices]
        self._normals = [n @ rotation.T for n in self._normals]

    def mesh(self) -> Mesh:
        """Everything added so far as one mesh."""
        self._flush()
        faces = np.concatenate(self._faces).astype(np.int32)
        return Mesh(
            vertices_m=np.concatenate(self._vertices).astype(np.float32),
            faces=faces,
            corner_normals=np.concatenate(self._normals).astype(np.float32),
            corner_uv=np.concatenate(self._uv).astype(np.float32),
            face_material=np.concatenate(self._face_material),
            materials=tuple(self._materials),
            face_part=np.concatenate(self._face_part),
        )


def rotation_z(angle_rad: float) -> FloatArray:
    """Rotation about z, shape (3, 3)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def rotation_y(angle_rad: float) -> FloatArray:
    """Rotation about y, shape (3, 3)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0, s], [0, 1.0, 0], [-s, 0, c]])


def pose(x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0) -> FloatArray:
    """world_from_object, shape (4, 4), of an upright object turned by the yaw about z."""
    out = np.eye(4)
    out[:3, :3] = rotation_z(yaw_rad)
    out[:3, 3] = (x_m, y_m, z_m)
    return out


def vertex_normals(vertices: FloatArray, faces: IntArray, outward: FloatArray) -> FloatArray:
    """Area-weighted vertex normals (n, 3), with ``outward`` (n, 3) where a vertex has no area around it."""
    p = vertices[faces]
    face = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], face)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 1e-9, total / np.maximum(length, 1e-9), outward)
