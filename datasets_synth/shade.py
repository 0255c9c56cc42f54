"""Radiance of what rays hit: sun with cast shadows, sky light, highlights, mirrored sky, haze."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datasets_synth.contact import ContactShade, contact_shade
from datasets_synth.mesh import Light, Placed
from datasets_synth.mip_textures import MipTexture, mip_texture, sample_textures
from datasets_synth.scene_rays import MISS, FaceTable, Hits, SceneRays, build_scene_rays, rows
from datasets_synth.sky import environment_radiance, ground_radiance, mean_sky, sky_radiance

FloatArray = NDArray[np.float32]

SHADOW_OFFSET_M = 4e-3
"""Shadow rays start this far off the surface, so that it does not shade itself."""


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """The materials of a scene as arrays over the index of the material."""

    rgb: FloatArray
    texture: NDArray[np.int32]
    """Index into the textures, -1 for none."""
    texture_px: FloatArray
    """Root of the number of texels of the texture."""
    specular: FloatArray
    shininess: FloatArray
    mirror: FloatArray


@dataclass(frozen=True, eq=False)
class Shader:
    """Everything that turns hits into radiance."""

    rays: SceneRays
    materials: MaterialTable
    textures: tuple[MipTexture, ...]
    contact: ContactShade
    light: Light
    focal_px: float

    def radiance(self, rays: FloatArray, hits: Hits) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Linear radiance (n, 3) along rays (n, 6) with their hits, and where the sun reaches (n,)."""
        distance_per_t = np.sqrt(np.einsum("ij,ij->i", rays[:, 3:], rays[:, 3:]))
        view = rays[:, 3:] / distance_per_t[:, None]
        hit = np.flatnonzero(hits.face != MISS)
        if len(hit) == len(rays):
            return self._surfaces(rays, view, distance_per_t, hits)
        sky = np.flatnonzero(hits.face == MISS)
        colour = np.empty((len(rays), 3), np.float32)
        sunlit = np.zeros(len(rays), np.bool_)
        colour[sky] = sky_radiance(rows(view, sky), self.light)
        colour[hit], sunlit[hit] = self._surfaces(
            rows(rays, hit), rows(view, hit), distance_per_t[hit], hits.at(hit)
        )
        return colour, sunlit

    def _surfaces(
        self, rays: FloatArray, view: FloatArray, distance_per_t: FloatArray, hits: Hits
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        table, light = self.rays.table, self.light
        point = rays[:, :3] + rays[:, 3:] * hits.t[:, None]
        distance = hits.t * distance_per_t
        flat, normal = _turn_to_viewer(hits.normal, _interpolate(table.corner_normals, hits), view)
        material = table.material[hits.face]
        albedo = self._albedo(hits, material, distance, -_dot(flat, view))
        sunlit, sun_cos = self._sun(point, flat, normal)

        sky_share = 0.5 + 0.5 * normal[:, 2:3]
        fill = light.ambient * mean_sky(light) * sky_share + ground_radiance(light) * (1 - sky_share)
        fill *= self.contact.sky_share(point, normal)[:, None]
        sun = np.array(light.sun_rgb, np.float32)
        colour = albedo * (fill + sun * sun_cos[:, None])
        self._add_gloss(colour, material, view, normal, sun_cos)
        if light.haze_per_m > 0:
            haze = 1 - np.exp(-np.float32(light.haze_per_m) * distance)
            colour += haze[:, None] * (np.array(light.sky_horizon_rgb, np.float32) - colour)
        return colour, sunlit

    def _albedo(
        self, hits: Hits, material: NDArray[np.int32], distance: FloatArray, cosine: FloatArray
    ) -> FloatArray:
        """Linear albedo (n, 3); textures at the mip level of the pixel's footprint."""
        albedo = rows(self.materials.rgb, material)
        texture = self.materials.texture[material]
        at = np.flatnonzero(texture >= 0)
        if len(at):
            part = hits.at(at)
            texels_per_m = self.rays.table.uv_per_m[part.face] * self.materials.texture_px[material[at]]
            # the footprint is cos times longer along the slope than across; a level between the two keeps
            # some of the texture of a road without much aliasing
            footprint_m = distance[at] / self.focal_px / np.maximum(cosine[at], 0.02) ** 0.7
            level = np.log2(np.maximum(texels_per_m * footprint_m, 1))
            albedo[at] *= sample_textures(
                self.textures, texture[at], _interpolate(self.rays.table.corner_uv, part), level
            )
        return albedo

    def _sun(
        self, point: FloatArray, flat: FloatArray, normal: FloatArray
    ) -> tuple[NDArray[np.bool_], FloatArray]:
        """Where the sun reaches (n,), and the cosine of its angle there (n,), 0 in the shade."""
        to_sun = np.array(self.light.sun_direction, np.float32)
        cosine = np.clip(np.einsum("ij,j->i", normal, to_sun), 0, 1)
        facing = np.flatnonzero(cosine > 0)
        start = rows(point, facing) + rows(flat, facing) * SHADOW_OFFSET_M
        rays = np.concatenate([start, np.broadcast_to(to_sun, start.shape)], axis=1)
        sunlit = np.zeros(len(point), np.bool_)
        sunlit[facing] = ~self.rays.shadowed(rays)
        return sunlit, np.where(sunlit, cosine, np.float32(0))

    def _add_gloss(
        self,
        colour: FloatArray,
        material: NDArray[np.int32],
        view: FloatArray,
        normal: FloatArray,
        sun_cos: FloatArray,
    ) -> None:
        """Add the highlight of the sun (Blinn-Phong) and the mirrored sky (Schlick's Fresnel) in place."""
        m = self.materials
        sun = np.array(self.light.sun_rgb, np.float32)
        to_sun = np.array(self.light.sun_direction, np.float32)
        at = np.flatnonzero((m.specular[material] > 0) & (sun_cos > 0))
        half = to_sun - rows(view, at)
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = np.clip(_dot(half, rows(normal, at)), 0, 1) ** m.shininess[material[at]]
        colour[at] += (m.specular[material[at]] * shine)[:, None] * sun

        at = np.flatnonzero(m.mirror[material] > 0)
        towards, facing = rows(view, at), rows(normal, at)
        cosine = np.clip(-_dot(towards, facing), 0, 1)
        base = m.mirror[material[at]]
        share = (base + (1 - base) * (1 - cosine) ** 5)[:, None]
        mirrored = towards + 2 * cosine[:, None] * facing
        mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
        colour[at] += share * (environment_radiance(mirrored, self.light) - colour[at])


def build_shader(items: tuple[Placed, ...], light: Light, focal_px: float) -> Shader:
    """The shader of placed meshes; builds the ray trees and reads every texture once."""
    rays = build_scene_rays(items)
    textures: list[NDArray[np.uint8]] = []
    index: dict[int, int] = {}
    for material in rays.table.materials:
        if material.texture is not None and id(material.texture) not in index:
            index[id(material.texture)] = len(textures)
            textures.append(material.texture)
    return Shader(
        rays,
        _material_table(rays.table, index),
        tuple(mip_texture(t) for t in textures),
        contact_shade(items),
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


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", a, b), np.float32)


def _interpolate(corner_values: FloatArray, hits: Hits) -> FloatArray:
    """Values (n, k) at the hits from those of the corners (m, 3, k)."""
    u, v = hits.barycentric[:, :1], hits.barycentric[:, 1:]
    corner = rows(corner_values, hits.face)
    first = corner[:, 0]
    return np.asarray(first + u * (corner[:, 1] - first) + v * (corner[:, 2] - first), np.float32)


def _turn_to_viewer(flat: FloatArray, smooth: FloatArray, view: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit geometric and smooth normals (n, 3) on the side of the viewer."""
    smooth = smooth / np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-6)
    smooth = np.where((_dot(smooth, flat) < 0)[:, None], -smooth, smooth)
    away = (_dot(flat, view) > 0)[:, None]
    return np.where(away, -flat, flat), np.where(away, -smooth, smooth)
