"""Textured triangle meshes and scenes made of them: what the renderer draws.

Frames: objects have x forward, y left, z up, metres, the origin on the ground under the middle of the
footprint; the world has x right, y away from the camera, z up, the ground near z = 0, or near the height of
the scene's grade.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from datasets_synth.meshes.grade import Grade
from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.camera import StereoCamera


@dataclass(frozen=True, eq=False)
class Material:
    """Surface colour and gloss."""

    name: str
    rgb: tuple[float, float, float]
    """Linear albedo in [0, 1]; multiplies the texture where there is one."""
    texture: UInt8Array | None = None
    """sRGB, shape (h, w, 3), repeats outside [0, 1]; row 0 is at v = 1 (the top)."""
    specular: float = 0.0
    """Share of light reflected as a highlight, in [0, 1]."""
    shininess: float = 32.0
    """Blinn-Phong exponent."""
    mirror: float = 0.0
    """Share of the sky that is mirrored at normal incidence (glass, car paint), in [0, 1]."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with smooth normals, texture coordinates, materials and part labels."""

    vertices_m: Float32Array
    """Shape (n, 3)."""
    faces: NDArray[np.int32]
    """Shape (m, 3), counter-clockwise seen from outside."""
    corner_normals: Float32Array
    """Shape (m, 3, 3): unit normal of each corner of each face, outward."""
    corner_uv: Float32Array
    """Shape (m, 3, 2); zeros where the material has no texture."""
    face_material: NDArray[np.int32]
    """Shape (m,), index into materials."""
    materials: tuple[Material, ...]
    face_part: UInt8Array
    """Shape (m,): part label, 0 for none (see datasets_synth.cars.parts)."""

    @cached_property
    def extent_m(self) -> Float32Array:
        """Lowest and highest coordinates, shape (2, 3)."""
        # column by column, since reducing rows of three is slow
        return np.array([(c.min(), c.max()) for c in self.vertices_m.T], np.float32).T


@dataclass(frozen=True, eq=False)
class Placed:
    """A mesh put into the world."""

    mesh: Mesh
    world_from_object: FloatArray
    """Shape (4, 4); a rotation, a uniform scale and a translation."""
    kind: str
    """What the thing is: "car", "road", "facade", "poster", "hedge", ... Truth and error analysis use it."""
    shape_id: str = ""
    """Name of the car shape; empty for everything else."""
    casts_shadow: bool = True


@dataclass(frozen=True)
class Light:
    """Sun and sky, in linear radiance."""

    sun_direction: tuple[float, float, float]
    """Unit vector towards the sun, world frame."""
    sun_rgb: tuple[float, float, float]
    sky_zenith_rgb: tuple[float, float, float]
    sky_horizon_rgb: tuple[float, float, float]
    ambient: float
    """Share of the mean sky colour that reaches every surface, scaled by how far it faces up."""
    haze_per_m: float = 0.0
    """Exponential fading towards the horizon colour."""


@dataclass(frozen=True)
class Imaging:
    """How a cheap stereo head turns radiance into pixels; one set of numbers for each eye where a pair is
    given."""

    exposure: tuple[float, float]
    """Gain of the left and the right eye."""
    blur_sigma_px: tuple[float, float]
    vignetting: float
    """Share of light lost in the corners, in [0, 1]."""
    read_noise: float
    """Standard deviation of the noise of a black pixel, in units of full scale."""
    shot_noise: float
    """Standard deviation at full scale of the noise that grows with the root of the signal."""
    rectification_error_px: tuple[float, float]
    """Vertical offset of the right picture in pixels, and its growth over half the width (a small roll)."""
    contrast: float = 1.0
    """Exponent of the signal around middle grey, before sRGB's curve; larger than 1 is harder than sRGB."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything one stereo pair shows."""

    items: tuple[Placed, ...]
    light: Light
    camera: StereoCamera
    left_from_world: FloatArray
    """Shape (4, 4), camera frame from world frame."""
    imaging: Imaging
    grade: Grade | None = None
    """How the ground rises and falls; None where it is level."""
