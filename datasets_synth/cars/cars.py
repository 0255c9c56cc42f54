"""Meshes of the parametric cars."""

from functools import lru_cache

import numpy as np

from datasets_synth.cars.add_ons import add_ons
from datasets_synth.cars.body import BodyLines, loft_body
from datasets_synth.cars.details import handle, mirror, roof_rail, wheel
from datasets_synth.cars.paint import car_materials
from datasets_synth.cars.parts import CAR_PARTS, PART_LABEL
from datasets_synth.cars.regions import dress_body
from datasets_synth.cars.shapes import CarShape, car_shapes
from datasets_synth.meshes.mesh import Mesh
from datasets_synth.meshes.mesh_build import join, mirrored, to_mesh
from recon.arrays import UInt8Array

__all__ = ["CarShape", "car_mesh", "car_shapes"]


def car_mesh(shape: CarShape, rng: np.random.Generator) -> Mesh:
    """The mesh of a car in the object frame; rng picks paint and trim, the geometry follows from the shape.

    Nose at +x, left at +y, z up, metres, the origin on the ground below the middle. The body measures
    `shape.size_m`; the outside mirrors stand out beyond its width. The arrays are shared between cars of one
    shape and are read-only.
    """
    geometry = _geometry(shape)
    return Mesh(
        geometry.vertices_m,
        geometry.faces,
        geometry.corner_normals,
        geometry.corner_uv,
        geometry.face_material,
        car_materials(rng),
        geometry.face_part,
    )


@lru_cache(maxsize=64)
def _geometry(shape: CarShape) -> Mesh:
    """The mesh of a shape, still without materials."""
    lines = BodyLines(shape)
    front, rear = shape.axles_t
    pieces = [
        dress_body(loft_body(lines), lines),
        wheel(lines, front, "front_left_wheel"),
        wheel(lines, rear, "rear_left_wheel"),
        *add_ons(lines),
        mirror(lines),
    ]
    if shape.doors:
        pieces.append(handle(lines, shape.pillar_t - 0.16))
    if shape.doors == 4:
        pieces.append(handle(lines, min(rear - 0.02, shape.length - 0.6)))
    if shape.body_type in ("estate", "suv"):
        pieces.append(roof_rail(lines))
    # a spare wheel stands behind the body: the middle is that of both
    left = join(pieces).moved((0.5 * shape.add_ons.spare, 0.0, 0.0))
    mesh = to_mesh(join([left, mirrored(left, _swap_sides())]), ())
    for array in (
        mesh.vertices_m, mesh.faces, mesh.corner_normals, mesh.corner_uv, mesh.face_material, mesh.face_part
    ):  # fmt: skip
        array.setflags(write=False)
    return mesh


def _swap_sides() -> UInt8Array:
    """Part labels seen in a mirror: left becomes right."""
    table = np.arange(256, dtype=np.uint8)
    for name in CAR_PARTS:
        other = name.replace("left", "right") if "left" in name else name.replace("right", "left")
        table[PART_LABEL[name]] = PART_LABEL[other]
    return table
