"""Meshes of the parametric cars."""

from functools import lru_cache

import numpy as np

from datasets_synth.car_body import BOTTOM, FRONT_CAP, REAR_CAP, SIDE, TOP, BodyLines, loft_body
from datasets_synth.car_shapes import CarShape, car_shapes
from datasets_synth.mesh import Material, Mesh
from datasets_synth.mesh_build import Soup, join, mirrored, to_mesh
from datasets_synth.parts import CAR_PARTS, PART_LABEL

__all__ = ["CarShape", "car_mesh", "car_shapes"]


def car_mesh(shape: CarShape, rng: np.random.Generator) -> Mesh:
    """The mesh of a car in the object frame; rng picks paint and trim.

    Nose at +x, left at +y, z up, metres, the origin on the ground below the middle.
    """
    soup = _geometry(shape)
    rgb = rng.uniform(0.02, 0.7, 3)
    return to_mesh(soup, (Material("paint", (float(rgb[0]), float(rgb[1]), float(rgb[2])), specular=0.3, mirror=0.1),))


@lru_cache(maxsize=16)
def _geometry(shape: CarShape) -> Soup:
    lines = BodyLines(shape)
    half = loft_body(lines)
    return join([half, mirrored(half, _SWAP_SIDES)])


def _swap_table() -> np.ndarray:
    table = np.arange(256, dtype=np.uint8)
    for name in CAR_PARTS:
        other = name.replace("left", "right") if "left" in name else name.replace("right", "left")
        table[PART_LABEL[name]] = PART_LABEL[other]
    return table


_SWAP_SIDES = _swap_table()
_ = (BOTTOM, FRONT_CAP, REAR_CAP, SIDE, TOP)
