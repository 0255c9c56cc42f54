"""Radiance of what rays hit: sun with cast shadows, sky light, highlights, mirrored sky, haze."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from datasets_synth.meshes.grade import Grade
from datasets_synth.meshes.mesh import Light, Placed
from datasets_synth.render.contact import ContactShade, contact_shade
from datasets_synth.render.mip_textures import MipTexture, mip_texture, tint_by_textures
from datasets_synth.render.scene_rays import FaceTable, Hits, SceneRays, build_scene_rays
from datasets_synth.render.sky import CLOUD_PX, cloud_noise, cloud_shift, light_colours
from recon.arrays import BoolArray, Float32Array, UInt8Array
from recon.pixels import sample_bilinear

if TYPE_CHECKING:
    from datasets_synth.render.shade_loops import Materials, Surfaces

SHADOW_OFFSET_M = 4e-3
"""Shadow rays start this far off the surface, so that it does not shade itself."""
BLOCK = 65_536
"""Rays shaded at a time: what a block needs stays in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Shader:
    """Everything that turns hits into radiance."""

    rays: SceneRays
    materials: "Materials"
    textures: tuple[MipTexture, ...]
    contact: ContactShade
    light: Light
    focal_px: float

    def radiance(self, rays: Float32Array, hits: Hits) -> tuple[Float32Array, BoolArray]:
        """Linear radiance (n, 3) along rays (n, 6) with their hits, and where the sun reaches (n,)."""
        colour = np.empty((len(rays), 3), np.float32)
        sunlit = np.empty(len(rays), np.bool_)
        block = _Block(self, min(len(rays), BLOCK))
        for start in range(0, len(rays), BLOCK):
            part = slice(start, start + BLOCK)
            block.shade(rays[part], hits.part(part), colour[part], sunlit[part])
        return colour, sunlit


class _Block:
    """Rays that are shaded at a time, and room for what lies between the steps."""

    def __init__(self, shader: Shader, size: int) -> None:
        from datasets_synth.render import shade_loops  # noqa: PLC0415 (half a second to import)

        self._loops = shade_loops
        self._shader = shader
        self._light = light_colours(shader.light)
        self._shift = cloud_shift(shader.light)
        self._clouds = cloud_noise()
        self._vectors = np.empty((3, size, 3), np.float32)
        self._numbers = np.empty((5, size), np.float32)
        self._pairs = np.empty((2, size, 2), np.float32)
        self._at = np.empty(size, np.int64)
        self._shadow_rays = np.empty((size, 6), np.float32)

    def shade(self, rays: Float32Array, hits: Hits, colour: Float32Array, sunlit: BoolArray) -> None:
        """Write the linear radiance (n, 3) of rays (n, 6), and where the sun reaches (n,)."""
        n = len(rays)
        view, point, normal = self._vectors[:3, :n]
        distance, slope_cos, sun_cos, sky_share = self._numbers[:4, :n]
        surfaces = self._loops.Surfaces(view, distance, point, normal, slope_cos, sun_cos, sky_share, colour)
        self._find_sun(rays, hits, surfaces, sunlit)
        sky_share[:] = self._shader.contact.sky_share(point, normal)
        self._find_albedo(hits, surfaces)
        self._light_up(hits, surfaces)
        if self._shader.light.haze_per_m > 0:
            # not in a loop, since the exponential of arrays has other bits
            haze = 1 - np.exp(-np.float32(self._shader.light.haze_per_m) * distance)
            self._loops.add_haze(hits.face, haze, self._light.horizon, colour)
        n_sky = self._loops.find_sky(
            hits.face, view, self._shift, np.float32(CLOUD_PX), self._at, self._pairs[0]
        )
        at, noise = self._at[:n_sky], self._noise(self._pairs[0, :n_sky])
        self._loops.paint_sky(at, view, noise, self._light, colour)

    def _find_sun(self, rays: Float32Array, hits: Hits, surfaces: "Surfaces", sunlit: BoolArray) -> None:
        scene = self._shader.rays
        n_facing = self._loops.find_surfaces(
            rays,
            hits.t,
            hits.face,
            hits.barycentric,
            hits.normal,
            scene.table.corner_normals,
            self._light.to_sun,
            np.float32(SHADOW_OFFSET_M),
            surfaces,
            self._at,
            self._shadow_rays,
        )
        shadowed = scene.shadowed(self._shadow_rays[:n_facing])
        self._loops.shade(self._at[:n_facing], shadowed, surfaces.sun_cos, sunlit)

    def _find_albedo(self, hits: Hits, surfaces: "Surfaces") -> None:
        """Write the linear albedo; textures at the mip level of the pixel's footprint."""
        table, textures = self._shader.rays.table, self._shader.textures
        ends = np.empty(len(textures) + 1, np.int64)
        uv, level = self._pairs[0], self._numbers[4]
        self._loops.find_texels(
            hits.face,
            hits.barycentric,
            table.material,
            self._shader.materials,
            table.corner_uv,
            table.uv_per_m,
            np.float32(self._shader.focal_px),
            surfaces,
            ends,
            self._at,
            uv,
            level,
        )
        tint_by_textures(textures, self._at, ends, uv, level, surfaces.colour)

    def _light_up(self, hits: Hits, surfaces: "Surfaces") -> None:
        mirrored, cloud = self._pairs
        n_mirrors = self._loops.light_surfaces(
            hits.face,
            self._shader.rays.table.material,
            self._shader.materials,
            self._light,
            self._shift,
            np.float32(CLOUD_PX),
            surfaces,
            self._at,
            mirrored,
            cloud,
        )
        at, noise = self._at[:n_mirrors], self._noise(cloud[:n_mirrors])
        self._loops.add_mirrored(at, mirrored, noise, self._light, surfaces.colour)

    def _noise(self, cloud: Float32Array) -> Float32Array:
        return sample_bilinear(self._clouds, cloud, cv2.BORDER_WRAP)


def build_shader(
    items: tuple[Placed, ...],
    light: Light,
    focal_px: float,
    rays: SceneRays | None = None,
    grade: Grade | None = None,
) -> Shader:
    """The shader of placed meshes; reads every texture once, builds ray trees where none are given."""
    rays = build_scene_rays(items, grade) if rays is None else rays
    textures: list[UInt8Array] = []
    index: dict[int, int] = {}
    for material in rays.table.materials:
        if material.texture is not None and id(material.texture) not in index:
            index[id(material.texture)] = len(textures)
            textures.append(material.texture)
    return Shader(
        rays,
        _material_table(rays.table, index),
        tuple(mip_texture(t) for t in textures),
        contact_shade(items, grade),
        light,
        focal_px,
    )


def _material_table(table: FaceTable, index: dict[int, int]) -> "Materials":
    from datasets_synth.render.shade_loops import Materials  # noqa: PLC0415

    materials = table.materials
    return Materials(
        np.array([m.rgb for m in materials], np.float32).reshape(-1, 3),
        np.array([-1 if m.texture is None else index[id(m.texture)] for m in materials], np.int32),
        np.array(
            [
                1.0 if m.texture is None else np.sqrt(m.texture.shape[0] * m.texture.shape[1])
                for m in materials
            ],
            np.float32,
        ),
        np.array([m.specular for m in materials], np.float32),
        np.array([m.shininess for m in materials], np.float32),
        np.array([m.mirror for m in materials], np.float32),
    )
