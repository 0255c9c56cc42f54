"""A user's own car meshes: files of ``MESH_FORMS`` read through trimesh.

Files follow glTF unless said otherwise: +Y up, +Z forward (the nose). Metres are taken as they are; other
units are known by the length. Everything is turned into the object frame (x forward, y left, z up) and put on
the ground, the middle of its body (`datasets_synth.cars.body_extent`) at the origin.
"""

import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh

from datasets_synth.cars import MESH_FORMS
from datasets_synth.cars.body_extent import body_extent
from datasets_synth.cars.gltf_files import SUFFIXES as GLTF
from datasets_synth.cars.gltf_files import plain_gltf
from datasets_synth.cars.mesh_axes import MeshAxes, NoCarSizeError, metres_a_unit, refuse_no_car
from datasets_synth.cars.parts import CAR_PARTS, PART_LABEL
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.mesh_build import smooth_normals
from recon.arrays import Float32Array, FloatArray, IntArray
from recon.errors import RescoreError
from recon.pixels import linear_from_encoded
from recon.reading import reading

SUFFIXES = (".obj", ".ply", ".stl", ".off", *GLTF)
MAX_FACE_CORNERS = 1000
"""Corners of a face of an OBJ file; one with more is refused before it is cut into triangles."""
MAX_FACES = 2_000_000
"""Triangles of a mesh; one with more would take minutes and gigabytes, and shows no more on a picture."""

_CREASE_RAD = float(np.deg2rad(40.0))
_GREY = (0.35, 0.35, 0.35)


@dataclass(frozen=True, eq=False)
class ImportedCar:
    """A car mesh from a file."""

    shape_id: str
    """Name by which all else knows it: see ``load_meshes``."""
    mesh: Mesh
    size_m: tuple[float, float, float]
    """Length, width, height of the body: no mirrors or aerials, as in a car's papers."""
    notes: tuple[str, ...] = ()
    """What was taken for granted or is missing, a line each."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """Faces of one geometry of a file, in its axes and unit."""

    corners: FloatArray
    corner_uv: FloatArray
    face_material: IntArray
    materials: tuple[Material, ...]
    part: int


def load_meshes(directory: Path, axes: MeshAxes | None = None) -> tuple[ImportedCar, ...]:
    """All mesh files (``SUFFIXES``) of a folder and the folders in it, in the order of their paths.

    Base colours and textures are kept, several in one file too. A vertex-coloured mesh gets one material for
    each colour (finely quantised). Transparent materials become dark glass: nothing is seen through. Faces
    of an OBJ group (or glTF mesh) named after a part (`datasets_synth.cars.parts`) get its label, others 0.

    A mesh is called by the names of the folders it lies in and its own without the suffix, joined by "-"; a
    folder's only car by those of the folders, as models of ShapeNet. Where two would share a name, both are
    called by all of their paths. What lies beside a car and has no car's size is left out, with a note.

    Args:
        directory: The folder.
        axes: Those of the files; None for glTF's.

    Raises:
        RescoreError: no such folder, no mesh in it, a file that cannot be read, holds no faces or too many,
            or needs an extension of glTF that is not read, or measures that no car on its wheels has with
            these axes.
    """
    axes = axes or MeshAxes()
    if not directory.is_dir():
        raise RescoreError(
            f"expected a folder of car meshes, got {str(directory)!r}: give an existing folder"
        )
    paths = [p.relative_to(directory) for p in directory.rglob("*") if p.suffix.lower() in SUFFIXES]
    # hidden folders hold copies of what is beside them
    paths = sorted(
        p for p in paths if (directory / p).is_file() and not any(part[0] in "._" for part in p.parts)
    )
    if not paths:
        raise RescoreError(
            f"expected {MESH_FORMS} files in {str(directory)!r}, found none: put car meshes into it"
        )
    return _cars(directory, paths, axes)


def _cars(directory: Path, paths: Sequence[Path], axes: MeshAxes) -> tuple[ImportedCar, ...]:
    """The cars of files, less what lies beside a car and has no car's size, as wheels in their own files."""
    cars: dict[Path, ImportedCar] = {}
    others: dict[Path, NoCarSizeError] = {}
    for path in paths:
        try:
            cars[path] = _load(directory, path, axes)
        except NoCarSizeError as error:
            others[path] = error
    first = {path.parent: path for path in reversed(cars)}
    for path, refusal in others.items():
        if path.parent not in first:
            raise refusal
        beside = first[path.parent]
        note = f"{path.as_posix()}: left out: it has no car's size and lies beside {beside.name}"
        cars[beside] = replace(cars[beside], notes=(*cars[beside].notes, note))
    names = _names(list(cars))
    return tuple(replace(car, shape_id=name) for car, name in zip(cars.values(), names, strict=True))


def _names(paths: Sequence[Path]) -> list[str]:
    """A name for each mesh by its path (see ``load_meshes``)."""
    meshes = Counter(p.parent for p in paths)
    short = [
        p.parent.parts if p.parent.parts and meshes[p.parent] == 1 else (*p.parent.parts, p.stem)
        for p in paths
    ]
    uses = Counter("-".join(parts) for parts in short)
    names = [
        name if uses[name := "-".join(parts)] == 1 else "-".join(p.parts)
        for p, parts in zip(paths, short, strict=True)
    ]
    twice = next((name for name, n in Counter(names).items() if n > 1), None)
    if twice is not None:
        raise RescoreError(
            f"expected car meshes with different paths, got two that make {twice!r}: rename one"
        )
    return names


def _load(directory: Path, path: Path, axes: MeshAxes) -> ImportedCar:
    """The car of a file, called by its path, which is relative to the folder."""
    where = path.as_posix()
    geometries, missing = _geometries(directory, path)
    with reading(where, "a mesh whose faces name its own vertices", "export it again"):
        pieces = [_piece(geometry) for geometry in geometries]
    corners = np.concatenate([p.corners for p in pieces]) @ axes.object_from_file.T
    if not np.isfinite(corners).all():
        raise RescoreError(f"{where}: expected finite vertices, got NaN or infinity: export the mesh again")
    scale, unit = metres_a_unit(where, np.ptp(corners.reshape(-1, 3), axis=0))
    corners *= scale
    refuse_no_car(where, corners, axes)
    low, high = body_extent(corners)
    corners -= [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]
    length, width, height = (float(v) for v in high - low)
    notes = [f"{where}: {name!r} is not there, so that what it colours is plain" for name in missing]
    if scale != 1:
        notes.insert(0, f"{where}: taken as {unit}: {length:.2f} m long")
    return ImportedCar(where, _as_mesh(corners, pieces), (length, width, height), tuple(notes))


class _Beside(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
    """Finds the files that a mesh names, in the folder of all meshes and nowhere else."""

    def __init__(self, path: Path, directory: Path) -> None:
        super().__init__(str(path))
        self._directory = directory.resolve()
        self.missing: dict[str, None] = {}
        """Names of files that are not there, in their order."""

    def get(self, name: str) -> bytes:
        """The content of a file that a mesh names."""
        try:
            return bytes(super().get(name))
        except (OSError, ValueError):
            self.missing[name.strip()] = None
            raise

    def absolute(self, name: str) -> Path:
        """The place of a file that a mesh names, as in ``../images/paint.jpg`` of ShapeNet.

        Raises:
            ValueError: it lies outside the folder of all meshes.
        """
        # glTF writes a blank in a name as %20
        named = name.strip().replace("\\", "/"), unquote(name)
        places = [(Path(self.parent) / n).resolve() for n in named]
        path = next((p for p in places if p.exists()), places[0])
        if not path.is_relative_to(self._directory):
            raise ValueError(f"{name!r} lies outside {self._directory}")
        return path


def _geometries(directory: Path, path: Path) -> tuple[list[Any], tuple[str, ...]]:
    """The triangle meshes of a file with their nodes' transforms applied, and files that it lacks."""
    suffix, file = path.suffix.lower(), directory / path
    options: dict[str, Any] = {}
    beside = _Beside(file, directory)
    if suffix == ".obj":
        _refuse_large_faces(file, path.as_posix())
        options = {"split_groups": True}
    try:
        written = plain_gltf(file, path.as_posix()) if suffix in GLTF else None
        source = str(file) if written is None else io.BytesIO(written)
        options |= {} if written is None else {"file_type": "glb"}
        scene = trimesh.load_scene(source, resolver=beside, process=False, **options)
        dumped = scene.dump(concatenate=False)
    except RescoreError:
        raise
    except Exception as error:  # whatever trimesh and its readers raise means the same to the user
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RescoreError(
            f"{path.as_posix()}: expected a readable mesh file, got: {reason}; export it again"
        ) from error
    found = [g for g in dumped if isinstance(g, trimesh.Trimesh) and len(g.faces)]
    if not any(len(getattr(g, "vertices", ())) for g in dumped):
        form = suffix[1:].upper()
        raise RescoreError(
            f"{path.as_posix()}: expected a mesh, got no vertices, so that it is no {form} file, or an empty "
            "one: export the mesh again"
        )
    if not found:
        raise RescoreError(
            f"{path.as_posix()}: expected a mesh with faces, got none: export triangles, not points"
        )
    _refuse_many_faces(path.as_posix(), sum(len(g.faces) for g in found))
    return found, tuple(beside.missing)


def _refuse_many_faces(where: str, count: int) -> None:
    if count > MAX_FACES:
        raise RescoreError(
            f"{where}: expected at most {MAX_FACES} faces, got {count}: reduce the mesh (decimate it)"
        )


def _refuse_large_faces(path: Path, where: str) -> None:
    """Refuses too many faces, and those whose triangles take memory with the square of their corners."""
    count = 0
    with path.open("rb") as lines:
        for number, line in enumerate(lines, start=1):
            if line[:2] not in (b"f ", b"f\t") and line.lstrip()[:2] not in (b"f ", b"f\t"):
                continue
            count += 1
            # a corner takes two characters at least
            corners = len(line.split()) - 1 if len(line) > 2 * MAX_FACE_CORNERS else 0
            if corners > MAX_FACE_CORNERS:
                raise RescoreError(
                    f"{where}: line {number}: expected faces of at most {MAX_FACE_CORNERS} corners, got "
                    f"{corners}: export triangles"
                )
    _refuse_many_faces(where, count)


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
    part = np.concatenate([np.full(len(p.corners), p.part) for p in pieces])
    kept = corners[keep]
    vertices, index = _unique_rows(kept.reshape(-1, 3).astype(np.float32))
    return Mesh(
        vertices_m=vertices,
        faces=index.reshape(-1, 3).astype(np.int32),
        corner_normals=smooth_normals(kept, _CREASE_RAD).astype(np.float32),
        corner_uv=np.concatenate([p.corner_uv for p in pieces])[keep].astype(np.float32),
        face_material=material[keep].astype(np.int32),
        materials=tuple(m for p in pieces for m in p.materials),
        face_part=part[keep].astype(np.uint8),
    )


def _unique_rows(points: Float32Array) -> tuple[Float32Array, IntArray]:
    """Different rows (k, 3) in their order, and the row of each point (n,); much faster than np.unique."""
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    index = np.empty(len(points), np.int64)
    index[order] = np.cumsum(new) - 1
    return ordered[new], index
