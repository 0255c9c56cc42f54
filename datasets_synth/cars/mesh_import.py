"""A user's own car meshes: OBJ, GLB and PLY files read through trimesh.

Files follow glTF: +Y up, +Z forward (the nose), metres. Everything is turned into the object frame
(x forward, y left, z up) and put on the ground, the middle of its body
(`datasets_synth.cars.body_extent`) at the origin.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from datasets_synth.cars.body_extent import body_extent
from datasets_synth.cars.parts import CAR_PARTS, PART_LABEL
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.mesh_build import smooth_normals
from recon.arrays import FloatArray, IntArray
from recon.errors import RescoreError
from recon.pixels import linear_from_encoded
from recon.reading import reading

SUFFIXES = (".obj", ".glb", ".gltf", ".ply")
MAX_FACE_CORNERS = 1000
"""Corners of a face of an OBJ file; one with more is refused before it is cut into triangles."""
LENGTH_RANGE_M = (1.5, 20.0)
"""Longest side that a road vehicle in metres may have."""

_OBJECT_FROM_GLTF = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_UNITS = ((0.01, "centimetres"), (0.001, "millimetres"), (0.0254, "inches"), (0.3048, "feet"))
_CREASE_RAD = float(np.deg2rad(40.0))
_GREY = (0.35, 0.35, 0.35)


@dataclass(frozen=True, eq=False)
class ImportedCar:
    """A car mesh from a file."""

    shape_id: str
    """Name of the mesh file without its suffix (with it, where two files share the name)."""
    mesh: Mesh
    size_m: tuple[float, float, float]
    """Length, width, height of the body: no mirrors or aerials, as in a car's papers."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """Faces of one geometry of a file, glTF axes."""

    corners_m: FloatArray
    corner_uv: FloatArray
    face_material: IntArray
    materials: tuple[Material, ...]
    part: int


def load_meshes(directory: Path) -> tuple[ImportedCar, ...]:
    """All OBJ, GLB, glTF and PLY files of a folder, in the order of their names.

    Base colours and textures are kept, several in one file too. A vertex-coloured mesh gets one material for
    each colour (finely quantised). Transparent materials become dark glass: nothing is seen through. Faces
    of an OBJ group (or glTF mesh) named after a part (`datasets_synth.cars.parts`) get its label, others 0.

    Raises:
        RescoreError: no such folder, no mesh in it, a file that cannot be read or holds no faces, or measures
            that no car has in metres with these axes.
    """
    if not directory.is_dir():
        raise RescoreError(
            f"expected a folder of car meshes, got {str(directory)!r}: give an existing folder"
        )
    paths = sorted(p for p in directory.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())
    if not paths:
        raise RescoreError(
            f"expected OBJ, GLB or PLY files in {str(directory)!r}, found none: put car meshes into it"
        )
    stems = [p.stem for p in paths]
    return tuple(_load(p, p.stem if stems.count(p.stem) == 1 else p.name) for p in paths)


def _load(path: Path, shape_id: str) -> ImportedCar:
    """One file as a car."""
    geometries = _geometries(path)
    with reading(path.name, "a mesh whose faces name its own vertices", "export it again"):
        pieces = [_piece(geometry) for geometry in geometries]
    corners = np.concatenate([p.corners_m for p in pieces]) @ _OBJECT_FROM_GLTF.T
    if not np.isfinite(corners).all():
        raise RescoreError(
            f"{path.name}: expected finite vertices, got NaN or infinity: export the mesh again"
        )
    low, high = corners.min((0, 1)), corners.max((0, 1))
    _check_size(path, high - low)
    low, high = body_extent(corners)
    corners -= [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]
    length, width, height = (float(v) for v in high - low)
    return ImportedCar(shape_id, _as_mesh(corners, pieces), (length, width, height))


def _geometries(path: Path) -> list[Any]:
    """The triangle meshes of a file with their nodes' transforms applied."""
    options: dict[str, Any] = {}
    if path.suffix.lower() == ".obj":
        _refuse_large_faces(path)
        options = {"split_groups": True}
    try:
        scene = trimesh.load_scene(path, process=False, **options)
        dumped = scene.dump(concatenate=False)
    except Exception as error:  # whatever trimesh and its readers raise means the same to the user
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RescoreError(
            f"{path.name}: expected a readable mesh file, got: {reason}; export it again"
        ) from error
    found = [g for g in dumped if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    if not found:
        raise RescoreError(f"{path.name}: expected a mesh with faces, got none: export triangles, not points")
    return found


def _refuse_large_faces(path: Path) -> None:
    """Refuses faces whose triangles would take memory with the square of their corners."""
    with path.open("rb") as lines:
        for number, line in enumerate(lines, start=1):
            corners = len(line.split()) - 1 if line.lstrip()[:2] in (b"f ", b"f\t") else 0
            if corners > MAX_FACE_CORNERS:
                raise RescoreError(
                    f"{path.name}: line {number}: expected faces of at most {MAX_FACE_CORNERS} corners, got "
                    f"{corners}: export triangles"
                )


def _check_size(path: Path, size: FloatArray) -> None:
    """Refuses measures that a car in metres with the nose along +Z cannot have."""
    longest = float(size.max())
    got = " x ".join(f"{v:.4g}" for v in size)
    if not LENGTH_RANGE_M[0] <= longest <= LENGTH_RANGE_M[1]:
        unit = next((f" (in {name}?)" for scale, name in _UNITS if 2.3 <= longest * scale <= 6.5), "")
        raise RescoreError(
            f"{path.name}: expected a car {LENGTH_RANGE_M[0]:g} to {LENGTH_RANGE_M[1]:g} metres long, "
            f"got length x width x height {got}{unit}: scale the mesh to metres"
        )
    if size[0] < 0.9 * size[1] or size[0] < 0.7 * size[2]:
        raise RescoreError(
            f"{path.name}: expected +Y up and the nose along +Z, got length x width x height {got}: turn it"
        )


def _piece(geometry: Any) -> _Piece:
    """Faces, materials and part of one trimesh geometry."""
    faces = np.asarray(geometry.faces)
    corners = np.asarray(geometry.vertices, dtype=np.float64)[faces]
    visual = geometry.visual
    uv = np.zeros((len(faces), 3, 2))
    material = np.zeros(len(faces), np.int64)
    if visual.kind == "texture":
        materials: tuple[Material, ...] = (_material(visual.material),)
        if visual.uv is not None and materials[0].texture is not None:
            uv = np.asarray(visual.uv, dtype=np.float64)[faces]
    elif visual.kind in ("vertex", "face"):
        material, materials = _colour_materials(np.asarray(visual.face_colors, dtype=np.float64)[:, :3] / 255)
    else:
        materials = (Material("default", _GREY),)
    # Files often carry the right normals beside faces of either winding: the normals win.
    face_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    given = np.asarray(geometry.vertex_normals)[faces].sum(1)
    flip = (face_normal * given).sum(1) < 0
    corners[flip], uv[flip] = corners[flip][:, ::-1], uv[flip][:, ::-1]
    return _Piece(corners, uv, material, materials, _part(geometry))


def _part(geometry: Any) -> int:
    """Part label from the geometry's name: trimesh names it group_material, and numbers doubles."""
    name = str(geometry.metadata.get("name") or "").lower()
    material = str(getattr(getattr(geometry.visual, "material", None), "name", None) or "").lower()
    plain = re.sub(r"_\d+$", "", name)
    candidates = {name, plain}
    if material:
        candidates |= {text.removesuffix(f"_{material}") for text in (name, plain)}
    return next((PART_LABEL[part] for part in CAR_PARTS if part in candidates), 0)


def _material(source: Any) -> Material:
    """A Material from trimesh's simple (OBJ) or physically based (glTF) one."""
    name = str(source.name or "material")
    if isinstance(source, trimesh.visual.material.PBRMaterial):
        factor = source.baseColorFactor
        rgba = np.ones(4) if factor is None else np.asarray(factor, dtype=np.float64) / 255
        rgb, image = rgba[:3], source.baseColorTexture
        rough = 1.0 if source.roughnessFactor is None else float(source.roughnessFactor)
        metal = 0.0 if source.metallicFactor is None else float(source.metallicFactor)
        clear = source.alphaMode == "BLEND"
        specular, shininess, mirror = (
            0.5 * (1 - rough),
            2 + 200 * (1 - rough) ** 2,
            (1 - rough) * (0.06 + 0.3 * metal),
        )
    else:
        rgba = np.asarray(source.diffuse, dtype=np.float64) / 255
        rgb, image = linear_from_encoded(rgba[:3]), source.image
        gloss = np.asarray(source.specular, dtype=np.float64)[:3].mean() / 255
        clear = True
        specular, shininess = 0.4 * float(gloss), float(np.clip(source.glossiness or 32.0, 2, 400))
        mirror = 0.08 * float(gloss)
    texture = (
        None if image is None else np.ascontiguousarray(np.asarray(image.convert("RGB"), dtype=np.uint8))
    )
    if texture is not None and not rgb.any():
        rgb = np.ones(3)  # exporters write a black base colour beside a texture
    if clear and rgba[3] < 0.75:
        rgb, specular, shininess, mirror = rgb * 0.3 * rgba[3], 0.5, 200.0, 0.2
    return Material(
        name,
        (float(rgb[0]), float(rgb[1]), float(rgb[2])),
        texture,
        float(specular),
        float(shininess),
        float(mirror),
    )


def _colour_materials(rgb: FloatArray) -> tuple[IntArray, tuple[Material, ...]]:
    """Material index of each face and the materials, for face colours (m, 3) in sRGB [0, 1].

    Colours within one of 16 steps a channel share a material of their mean colour.
    """
    key = np.minimum((rgb * 16).astype(np.int64), 15) @ np.array([256, 16, 1])
    _, index = np.unique(key, return_inverse=True)
    index = index.ravel()
    count = np.bincount(index)
    mean = np.stack([np.bincount(index, linear_from_encoded(rgb)[:, k]) / count for k in range(3)], axis=1)
    materials = tuple(
        Material(f"colour {i}", (float(r), float(g), float(b)), specular=0.1)
        for i, (r, g, b) in enumerate(mean)
    )  # fmt: skip
    return index.astype(np.int64), materials


def _as_mesh(corners: FloatArray, pieces: list[_Piece]) -> Mesh:
    """One mesh of the pieces, with their corners (m, 3, 3) in the object frame."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    keep = area > 1e-12
    first = np.cumsum([0] + [len(p.materials) for p in pieces[:-1]])
    material = np.concatenate([p.face_material + start for p, start in zip(pieces, first, strict=True)])
    part = np.concatenate([np.full(len(p.corners_m), p.part) for p in pieces])
    kept = corners[keep]
    vertices, index = np.unique(kept.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True)
    return Mesh(
        vertices_m=vertices,
        faces=index.reshape(-1, 3).astype(np.int32),
        corner_normals=smooth_normals(kept, _CREASE_RAD).astype(np.float32),
        corner_uv=np.concatenate([p.corner_uv for p in pieces])[keep].astype(np.float32),
        face_material=material[keep].astype(np.int32),
        materials=tuple(m for p in pieces for m in p.materials),
        face_part=part[keep].astype(np.uint8),
    )
