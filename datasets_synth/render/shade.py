"""Radiance of what rays hit: sun with cast shadows, sky light, highlights, mirrored sky, haze."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synth.meshes.grade import Grade
from datasets_synth.meshes.mesh import Light, Placed
from datasets_synth.render.contact import ContactShade, contact_shade
from datasets_synth.render.mip_textures import MipTexture, mip_texture, sample_textures
from datasets_synth.render.scene_rays import MISS, FaceTable, Hits, SceneRays, build_scene_rays, rows
from datasets_synth.render.sky import environment_radiance, ground_radiance, mean_sky, sky_radiance
from recon.arrays import BoolArray, Float32Array, UInt8Array

SHADOW_OFFSET_M = 4e-3
"""Shadow rays start this far off the surface, so that it does not shade itself."""
BLOCK = 65_536
"""Rays shaded at a time: what a block needs stays in the processor's cache."""


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """The materials of a scene as arrays over the index of the material."""

    rgb: Float32Array
    """Linear albedo in [0, 1], shape (k, 3)."""
    texture: NDArray[np.int32]
    """Index into the textures, -1 for none."""
    texture_px: Float32Array
    """Root of the number of texels of the texture."""
    specular: Float32Array
    """Share of light reflected as a highlight, in [0, 1], shape (k,)."""
    shininess: Float32Array
    """Blinn-Phong exponent, shape (k,)."""
    mirror: Float32Array
    """Share of the sky that is mirrored at normal incidence, in [0, 1], shape (k,)."""


@dataclass(frozen=True, eq=False)
class Shader:
    """Everything that turns hits into radiance."""

    rays: SceneRays
    materials: MaterialTable
    textures: tuple[MipTexture, ...]
    contact: ContactShade
    light: Light
    focal_px: float

    def radiance(self, rays: Float32Array, hits: Hits) -> tuple[Float32Array, BoolArray]:
        """Linear radiance (n, 3) along rays (n, 6) with their hits, and where the sun reaches (n,)."""
        colour = np.empty((len(rays), 3), np.float32)
        sunlit = np.empty(len(rays), np.bool_)
        for start in range(0, len(rays), BLOCK):
            block = slice(start, start + BLOCK)
            shaded, sunlit[block] = self._radiance(rays[block], hits.part(block))
            colour[block] = shaded.T
        return colour, sunlit

    def _radiance(self, rays: Float32Array, hits: Hits) -> tuple[Float32Array, BoolArray]:
        """Radiance (3, n) and where the sun reaches (n,).

        Inside, vectors are (3, n): each operation then runs along the rays, many times as fast as along three
        components.
        """
        direction = np.ascontiguousarray(rays[:, 3:].T)
        distance_per_t = np.sqrt(_dot(direction, direction))
        view = np.asarray(direction / distance_per_t, np.float32)
        hit = np.flatnonzero(hits.face != MISS)
        if len(hit) == len(rays):
            return self._surfaces(rays, view, distance_per_t, hits)
        sky = np.flatnonzero(hits.face == MISS)
        colour = np.empty((3, len(rays)), np.float32)
        sunlit = np.zeros(len(rays), np.bool_)
        colour[:, sky] = sky_radiance(_columns(view, sky).T, self.light).T
        if len(hit):
            colour[:, hit], sunlit[hit] = self._surfaces(
                rows(rays, hit), _columns(view, hit), distance_per_t[hit], hits.at(hit)
            )
        return colour, sunlit

    def _surfaces(
        self, rays: Float32Array, view: Float32Array, distance_per_t: Float32Array, hits: Hits
    ) -> tuple[Float32Array, BoolArray]:
        table, light = self.rays.table, self.light
        distance = hits.t * distance_per_t
        point = rays[:, :3].T + rays[:, 3:].T * hits.t
        smooth = _interpolate(table.corner_normals, hits)
        flat, normal = _turn_to_viewer(hits.normal.T.copy(), smooth, view)
        material = table.material[hits.face]
        albedo = self._albedo(hits, material, distance, -_dot(flat, view))
        sunlit, sun_cos = self._sun(point, flat, normal)

        sky_share = 0.5 + 0.5 * normal[2]
        fill = _column(light.ambient * mean_sky(light)) * sky_share
        fill += _column(ground_radiance(light)) * (1 - sky_share)
        fill *= self.contact.sky_share(point.T, normal.T)
        colour = albedo * (fill + _column(light.sun_rgb) * sun_cos)
        self._add_gloss(colour, material, view, normal, sun_cos)
        if light.haze_per_m > 0:
            haze = 1 - np.exp(-np.float32(light.haze_per_m) * distance)
            colour += haze * (_column(light.sky_horizon_rgb) - colour)
        return colour, sunlit

    def _albedo(
        self, hits: Hits, material: NDArray[np.int32], distance: Float32Array, cosine: Float32Array
    ) -> Float32Array:
        """Linear albedo (3, n); textures at the mip level of the pixel's footprint."""
        albedo = np.ascontiguousarray(rows(self.materials.rgb, material).T)
        texture = self.materials.texture[material]
        at = np.flatnonzero(texture >= 0)
        if len(at):
            part = hits.at(at)
            texels_per_m = self.rays.table.uv_per_m[part.face] * self.materials.texture_px[material[at]]
            # the footprint is cos times longer along the slope than across; a level between the two keeps
            # some of the texture of a road without much aliasing
            footprint_m = distance[at] / self.focal_px / np.maximum(cosine[at], 0.02) ** 0.7
            level = np.log2(np.maximum(texels_per_m * footprint_m, 1))
            uv = _interpolate(self.rays.table.corner_uv, part)
            texel = sample_textures(self.textures, texture[at], np.ascontiguousarray(uv.T), level)
            for channel in range(3):
                albedo[channel, at] *= texel[:, channel]
        return albedo

    def _sun(
        self, point: Float32Array, flat: Float32Array, normal: Float32Array
    ) -> tuple[BoolArray, Float32Array]:
        """Where the sun reaches (n,), and the cosine of its angle there (n,), 0 in the shade."""
        to_sun = _column(self.light.sun_direction)
        cosine = np.clip(_dot(normal, to_sun), 0, 1)
        facing = np.flatnonzero(cosine > 0)
        rays = np.empty((len(facing), 6), np.float32)
        rays[:, :3] = (_columns(point, facing) + _columns(flat, facing) * np.float32(SHADOW_OFFSET_M)).T
        rays[:, 3:] = to_sun.T
        sunlit = np.zeros(point.shape[1], np.bool_)
        sunlit[facing] = ~self.rays.shadowed(rays)
        return sunlit, np.where(sunlit, cosine, np.float32(0))

    def _add_gloss(
        self,
        colour: Float32Array,
        material: NDArray[np.int32],
        view: Float32Array,
        normal: Float32Array,
        sun_cos: Float32Array,
    ) -> None:
        """Add the highlight of the sun (Blinn-Phong) and the mirrored sky (Schlick's Fresnel) in place."""
        m = self.materials
        at = np.flatnonzero((m.specular[material] > 0) & (sun_cos > 0))
        half = _column(self.light.sun_direction) - _columns(view, at)
        half /= np.sqrt(_dot(half, half))
        shine = np.clip(_dot(half, _columns(normal, at)), 0, 1) ** m.shininess[material[at]]
        colour[:, at] += m.specular[material[at]] * shine * _column(self.light.sun_rgb)

        at = np.flatnonzero(m.mirror[material] > 0)
        towards, facing = _columns(view, at), _columns(normal, at)
        cosine = np.clip(-_dot(towards, facing), 0, 1)
        base = m.mirror[material[at]]
        share = base + (1 - base) * (1 - cosine) ** 5
        mirrored = towards + 2 * cosine * facing
        mirrored /= np.sqrt(_dot(mirrored, mirrored))
        seen = environment_radiance(mirrored.T, self.light).T
        before = _columns(colour, at)
        colour[:, at] = before + share * (seen - before)


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


def _material_table(table: FaceTable, index: dict[int, int]) -> MaterialTable:
    materials = table.materials
    return MaterialTable(
        np.array([m.rgb for m in materials], np.float32),
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


def _column(vector: Sequence[float] | Float32Array) -> Float32Array:
    """A vector (3, 1) that goes with vectors (3, n)."""
    return np.asarray(vector, np.float32).reshape(3, 1)


def _columns(vectors: Float32Array, index: NDArray[np.intp]) -> Float32Array:
    """The vectors (3, k) at an index (k,) of vectors (3, n)."""
    return np.take(vectors, index, axis=1)


def _dot(a: Float32Array, b: Float32Array) -> Float32Array:
    """Inner products (n,) of vectors (3, n)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], np.float32)


def _interpolate(corner_values: Float32Array, hits: Hits) -> Float32Array:
    """Values (k, n) at the hits, interpolated between the values at the corners (m, 3, k)."""
    from datasets_synth.render.shade_loops import interpolate  # noqa: PLC0415 (half a second to import)

    out = np.empty((corner_values.shape[2], len(hits.face)), np.float32)
    interpolate(corner_values, hits.face, hits.barycentric, out)
    return out


def _turn_to_viewer(
    flat: Float32Array, smooth: Float32Array, view: Float32Array
) -> tuple[Float32Array, Float32Array]:
    """Unit geometric and smooth normals (3, n) on the side of the viewer; what is given is overwritten."""
    from datasets_synth.render.shade_loops import turn_to_viewer  # noqa: PLC0415

    turn_to_viewer(flat, smooth, view)
    return flat, smooth
