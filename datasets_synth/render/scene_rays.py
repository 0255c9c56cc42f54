"""A scene made ready for ray casting: its meshes in the world frame, one table of faces, two ray trees."""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from datasets_synth.meshes.grade import Grade
from datasets_synth.meshes.mesh import Material, Mesh, Placed
from recon.arrays import BoolArray, Float32Array, UInt8Array

MISS = -1
FLAT_M = 0.3
"""Things that stay below this height above level ground, like roads, share the tree of those that cast a
shadow: one cast serves both; what is so low shades little beside itself."""
BANKED_M = 1.0
"""Height that flat things stay below on ground that rises and falls: kerbs and crossfall add up there."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Where n rays meet the scene first."""

    t: Float32Array
    """Shape (n,), in units of the ray direction; infinite for a miss."""
    face: NDArray[np.int32]
    """Shape (n,), index into the table of faces; MISS for none."""
    barycentric: Float32Array
    """Shape (n, 2): weights of the second and the third corner."""
    normal: Float32Array
    """Shape (n, 3): unit geometric normal, not turned to the viewer."""

    def part(self, block: slice) -> "Hits":
        """The hits of a run of rays, not copied."""
        return Hits(self.t[block], self.face[block], self.barycentric[block], self.normal[block])


@dataclass(frozen=True, eq=False)
class FaceTable:
    """What shading needs of every face of the scene, in the world frame."""

    item: NDArray[np.int32]
    """Shape (m,): index into the items of the scene."""
    material: NDArray[np.int32]
    """Shape (m,): index into ``materials``."""
    part: UInt8Array
    """Shape (m,): part label."""
    corner_normals: Float32Array
    """Shape (m, 3, 3)."""
    corner_uv: Float32Array
    """Shape (m, 3, 2)."""
    uv_per_m: Float32Array
    """Shape (m,): root of the texture area (in uv units) of a face over its area."""
    materials: tuple[Material, ...]


class RayTree:
    """Faces that rays are cast at, on one thread, since frames run side by side."""

    def __init__(self, vertices_m: Float32Array, faces: NDArray[np.int32]) -> None:
        self.n_faces = len(faces)
        self._scene = o3d.t.geometry.RaycastingScene()
        if self.n_faces:
            self._scene.add_triangles(
                o3d.core.Tensor.from_numpy(np.ascontiguousarray(vertices_m, np.float32)),
                o3d.core.Tensor.from_numpy(np.ascontiguousarray(faces, np.uint32)),
            )

    def cast(self, rays: Float32Array) -> Hits:
        """First hits of rays (n, 6): origin and direction."""
        if not self.n_faces or not len(rays):
            n = len(rays)
            zeros = np.zeros((n, 3), np.float32)
            return Hits(np.full(n, np.inf, np.float32), np.full(n, MISS, np.int32), zeros[:, :2], zeros)
        answer = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
        # the largest number of 32 bits, which stands for none, is MISS with a sign
        face = answer["primitive_ids"].numpy().view(np.int32)
        return Hits(
            answer["t_hit"].numpy(),
            face,
            answer["primitive_uvs"].numpy(),
            answer["primitive_normals"].numpy(),
        )

    def occluded(self, rays: Float32Array, t_far: float = np.inf) -> BoolArray:
        """Whether anything lies on rays (n, 6) before ``t_far``."""
        if not self.n_faces or not len(rays):
            return np.zeros(len(rays), np.bool_)
        return np.asarray(
            self._scene.test_occlusions(o3d.core.Tensor.from_numpy(rays), tfar=t_far, nthreads=1).numpy(),
            np.bool_,
        )


@dataclass(frozen=True, eq=False)
class SceneRays:
    """The ray trees of a scene: things that cast a shadow come first in the table of faces."""

    table: FaceTable
    casters: RayTree
    others: RayTree

    def cast(self, rays: Float32Array) -> Hits:
        """First hits of rays (n, 6) in the whole scene."""
        from datasets_synth.render.picture_loops import nearer_hits  # noqa: PLC0415 (half a second to import)

        a = self.casters.cast(rays)
        if not self.others.n_faces:
            return a
        b = self.others.cast(rays)
        nearer_hits(
            *(a.t, a.face, a.barycentric, a.normal),
            *(b.t, b.face, b.barycentric, b.normal),
            np.int32(self.casters.n_faces),
        )
        return a

    def shadowed(self, rays: Float32Array) -> BoolArray:
        """Whether something that casts a shadow lies on rays (n, 6)."""
        return self.casters.occluded(rays)


_Columns = tuple[NDArray[np.int32], NDArray[np.int32], UInt8Array, Float32Array, Float32Array, Float32Array]


def build_scene_rays(items: tuple[Placed, ...], grade: Grade | None = None) -> SceneRays:
    """The ray trees and the table of faces of placed meshes, which stand on ground of a grade."""
    world = [world_vertices(p) for p in items]
    casts = [p.casts_shadow or _is_flat(v, grade) for p, v in zip(items, world, strict=True)]
    order = [i for i, c in enumerate(casts) if c] + [i for i, c in enumerate(casts) if not c]
    materials: list[Material] = []
    first_material: dict[int, int] = {}
    density: dict[int, Float32Array] = {}
    trees: dict[bool, list[tuple[Float32Array, NDArray[np.int32]]]] = {True: [], False: []}
    columns: list[_Columns] = []
    for i in order:
        placed, mesh = items[i], items[i].mesh
        if id(mesh) not in first_material:
            first_material[id(mesh)] = len(materials)
            materials.extend(mesh.materials)
            density[id(mesh)] = _uv_per_m(mesh)
        trees[casts[i]].append((world[i], mesh.faces))
        scale = float(np.cbrt(np.linalg.det(placed.world_from_object[:3, :3])))
        rotation = (placed.world_from_object[:3, :3] / scale).astype(np.float32)
        columns.append(
            (
                np.full(len(mesh.faces), i, np.int32),
                mesh.face_material + np.int32(first_material[id(mesh)]),
                mesh.face_part,
                np.einsum("mcj,ij->mci", mesh.corner_normals, rotation),
                mesh.corner_uv,
                density[id(mesh)] / np.float32(scale),
            )
        )
    if not columns:  # a scene of sky alone
        columns.append(_no_faces())
    item, material, part, normals, uv, uv_per_m = (np.concatenate(c) for c in zip(*columns, strict=True))
    table = FaceTable(
        item.astype(np.int32),
        material.astype(np.int32),
        part.astype(np.uint8),
        normals.astype(np.float32),
        uv.astype(np.float32),
        uv_per_m.astype(np.float32),
        tuple(materials),
    )
    return SceneRays(table, _tree(trees[True]), _tree(trees[False]))


def _is_flat(vertices_m: Float32Array, grade: Grade | None) -> bool:
    if grade is None:
        return float(vertices_m[:, 2].max()) <= FLAT_M
    return float((vertices_m[:, 2] - grade.height_m(vertices_m[:, 1])).max()) <= BANKED_M


def _no_faces() -> _Columns:
    number, part = np.zeros(0, np.int32), np.zeros(0, np.uint8)
    normals, uv = np.zeros((0, 3, 3), np.float32), np.zeros((0, 3, 2), np.float32)
    return number, number, part, normals, uv, np.zeros(0, np.float32)


def world_vertices(placed: Placed) -> Float32Array:
    """Vertices (n, 3) of a placed mesh in the world frame."""
    pose = placed.world_from_object.astype(np.float32)
    # einsum, since the bits of a BLAS product may depend on the number of threads
    return np.asarray(np.einsum("nj,ij->ni", placed.mesh.vertices_m, pose[:3, :3]) + pose[:3, 3], np.float32)


def _tree(meshes: list[tuple[Float32Array, NDArray[np.int32]]]) -> RayTree:
    if not meshes:
        return RayTree(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    start = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    return RayTree(
        np.concatenate([v for v, _ in meshes]),
        np.concatenate([f + s for (_, f), s in zip(meshes, start, strict=True)]),
    )


def _uv_per_m(mesh: Mesh) -> Float32Array:
    corner = mesh.vertices_m[mesh.faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    u = mesh.corner_uv[:, 1] - mesh.corner_uv[:, 0]
    v = mesh.corner_uv[:, 2] - mesh.corner_uv[:, 0]
    uv_area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    return np.asarray(np.sqrt(uv_area / np.maximum(area, 1e-12)), np.float32)
