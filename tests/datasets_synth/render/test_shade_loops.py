"""The compiled loops of shading give the bits of whole arrays of numpy and OpenCV."""

import cv2
import numpy as np
import pytest

from datasets_synth.meshes.mesh import Light
from datasets_synth.render.mip_textures import MipTexture, mip_texture
from datasets_synth.render.shade_loops import (
    Materials,
    Surfaces,
    add_mirrored,
    find_sky,
    find_surfaces,
    light_surfaces,
    paint_sky,
)
from datasets_synth.render.sky import CLOUD_PX, cloud_noise, cloud_shift, light_colours
from recon.pixels import linear_from_srgb, sample_bilinear

N = 20_000
SHAPES = ((N, 3), (N,), (N, 3), (N, 3), (N,), (N,), (N,), (N, 3))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def sampled_by_arrays(texture: MipTexture, uv: np.ndarray, level: np.ndarray) -> np.ndarray:
    coarsest = len(texture.level_box) - 1
    level = np.clip(level, 0, coarsest).astype(np.float32)
    lower = level.astype(np.intp)
    fraction = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
    fraction -= np.floor(fraction)

    def bilinear(at: np.ndarray) -> np.ndarray:
        box = texture.level_box[at]
        xy = box[:, :2] + fraction * box[:, 2:] - np.float32(0.5)
        return linear_from_srgb(sample_bilinear(texture.picture, xy, cv2.BORDER_REPLICATE))

    fine = bilinear(lower)
    mixed = fine + (level - lower)[:, None] * (bilinear(np.minimum(lower + 1, coarsest)) - fine)
    return mixed.astype(np.float32)


@pytest.mark.parametrize("shape", [(64, 48, 3), (1, 7, 3), (300, 1100, 3)])
def test_textures(rng: np.random.Generator, shape: tuple[int, int, int]) -> None:
    texture = mip_texture(rng.integers(0, 256, shape).astype(np.uint8))
    uv = (20 * rng.random((N, 2)) - 10).astype(np.float32)
    uv[:4] = [[0, 0], [1, 1], [0.5, -1], [-1e-9, 1 + 1e-7]]
    level = (12 * rng.random(N)).astype(np.float32)
    level[: N // 4] = 0
    np.testing.assert_array_equal(texture.sample(uv, level), sampled_by_arrays(texture, uv, level))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, :1] * b[:, :1] + a[:, 1:2] * b[:, 1:2] + a[:, 2:] * b[:, 2:]


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.sqrt(dot(vectors, vectors))


@pytest.fixture
def light() -> Light:
    return Light((0.48, 0.6, 0.64), (3.0, 2.8, 2.5), (0.2, 0.4, 0.9), (0.7, 0.8, 0.9), 0.6)


@pytest.fixture
def surfaces(rng: np.random.Generator) -> Surfaces:
    sight, normal = (unit(v) for v in rng.standard_normal((2, N, 3)).astype(np.float32))
    number = rng.random((4, N), np.float32)
    number[2, ::3] = 0  # in the shade
    point, colour = rng.random((2, N, 3), np.float32)
    return Surfaces(sight, 30 * number[0], point, normal, *number[1:], colour)


def clouds_by_arrays(direction: np.ndarray, light: Light) -> np.ndarray:
    place = direction[:, :2] / np.maximum(direction[:, 2:], 0.02) * 40.0 + cloud_shift(light)
    place = (place - np.floor(place / CLOUD_PX) * CLOUD_PX).astype(np.float32)
    return sample_bilinear(cloud_noise(), place, cv2.BORDER_WRAP)[:, None]


def sky_by_arrays(direction: np.ndarray, light: Light) -> np.ndarray:
    colours, up = light_colours(light), direction[:, 2:]
    clear = colours.horizon + (colours.zenith - colours.horizon) * np.sqrt(np.clip(up, 0, 1))
    cover = np.clip((clouds_by_arrays(direction, light) - 0.45) * 3, 0, 1) * np.clip((up - 0.05) * 6, 0, 1)
    return clear + cover * (colours.cloud - clear) * 0.7


def test_surfaces_and_their_shadow_rays(rng: np.random.Generator, light: Light) -> None:
    rays = rng.standard_normal((N, 6)).astype(np.float32)
    t, uv = rng.random(N, np.float32), rng.random((N, 2), np.float32)
    face = rng.integers(-1, 50, N, np.int32)
    flat = unit(rng.standard_normal((N, 3)).astype(np.float32))
    corners = rng.standard_normal((50, 3, 3)).astype(np.float32)
    out = Surfaces(*(np.empty(shape, np.float32) for shape in SHAPES))
    facing, shadow_rays = np.empty(N, np.int64), np.empty((N, 6), np.float32)
    to_sun = light_colours(light).to_sun
    offset = np.float32(0.004)
    n = find_surfaces(rays, t, face, uv, flat, corners, to_sun, offset, out, facing, shadow_rays)

    direction = rays[:, 3:]
    per_t = np.sqrt(dot(direction, direction))
    sight = direction / per_t
    flat = flat * np.where(dot(flat, sight) > 0, -1, 1).astype(np.float32)
    first, second, third = (corners[face, i] for i in range(3))
    smooth = first + uv[:, :1] * (second - first) + uv[:, 1:] * (third - first)
    length = np.maximum(np.sqrt(dot(smooth, smooth)), np.float32(1e-6))
    normal = smooth * (np.where(dot(smooth, flat) < 0, np.float32(-1), np.float32(1)) / length)
    point, hit = rays[:, :3] + direction * t[:, None], face >= 0
    cosine = np.clip(dot(normal, to_sun[None]), 0, 1)[:, 0]
    np.testing.assert_array_equal(out.sight, sight)
    np.testing.assert_array_equal(out.distance_m, np.where(hit, t * per_t[:, 0], 0))
    np.testing.assert_array_equal(out.point[hit], point[hit])
    np.testing.assert_array_equal(out.normal, np.where(hit[:, None], normal, 0))
    np.testing.assert_array_equal(out.slope_cos[hit], -dot(flat, sight)[hit, 0])
    np.testing.assert_array_equal(out.sun_cos, np.where(hit, cosine, 0))
    np.testing.assert_array_equal(facing[:n], np.flatnonzero(hit & (cosine > 0)))
    np.testing.assert_array_equal(shadow_rays[:n, :3], (point + flat * offset)[facing[:n]])
    np.testing.assert_array_equal(shadow_rays[:n, 3:], np.broadcast_to(to_sun, (n, 3)))


def test_sky(rng: np.random.Generator, light: Light) -> None:
    sight = unit(rng.standard_normal((N, 3)).astype(np.float32))
    face = rng.integers(-1, 1, N, np.int32)
    at, cloud, colour = np.empty(N, np.int64), np.empty((N, 2), np.float32), np.zeros((N, 3), np.float32)
    n = find_sky(face, sight, cloud_shift(light), np.float32(CLOUD_PX), at, cloud)
    np.testing.assert_array_equal(at[:n], np.flatnonzero(face < 0))
    noise = sample_bilinear(cloud_noise(), cloud[:n], cv2.BORDER_WRAP)
    paint_sky(at[:n], sight, noise, light_colours(light), colour)
    np.testing.assert_array_equal(colour[at[:n]], sky_by_arrays(sight[at[:n]], light))
    assert (colour[face >= 0] == 0).all()


def test_light_highlights_and_mirrors(rng: np.random.Generator, light: Light, surfaces: Surfaces) -> None:
    k, material = 4, rng.integers(0, 4, N)
    specular = np.array([0, 0.3, 0.5, 0], np.float32)
    mirror = np.array([0, 0, 0.04, 0.5], np.float32)
    shininess = np.array([1, 8, 80, 30], np.float32)
    zeros = np.zeros(k, np.float32)
    table = Materials(
        np.ones((k, 3), np.float32), np.full(k, -1, np.int32), zeros, specular, shininess, mirror
    )
    colours, face_material = light_colours(light), np.arange(k, dtype=np.int32)
    albedo, at = surfaces.colour.copy(), np.empty(N, np.int64)
    mirrored, cloud = np.empty((2, N, 2), np.float32)
    size, shift = np.float32(CLOUD_PX), cloud_shift(light)
    face = material.astype(np.int32)
    n = light_surfaces(face, face_material, table, colours, shift, size, surfaces, at, mirrored, cloud)
    noise = sample_bilinear(cloud_noise(), cloud[:n], cv2.BORDER_WRAP)
    add_mirrored(at[:n], mirrored, noise, colours, surfaces.colour)

    sight, normal, sun_cos = surfaces.sight, surfaces.normal, surfaces.sun_cos[:, None]
    share = 0.5 + 0.5 * normal[:, 2:]
    fill = (colours.fill * share + colours.ground * (1 - share)) * surfaces.sky_share[:, None]
    expected = albedo * (fill + colours.sun * sun_cos)
    half = unit(colours.to_sun - sight)
    shine = specular[material, None] * np.clip(dot(half, normal), 0, 1) ** shininess[material, None]
    expected += np.where(sun_cos > 0, shine, 0) * colours.sun
    does = mirror[material] > 0
    sight, normal, base = sight[does], normal[does], mirror[material[does], None]
    cosine = np.clip(-dot(sight, normal), 0, 1)
    shown = unit(sight + 2 * cosine * normal)
    above = np.clip((shown[:, 2:] - 0.02) / 0.2, 0, 1)
    seen = colours.ground + (sky_by_arrays(shown, light) - colours.ground) * (above * above * (3 - 2 * above))
    expected[does] += (base + (1 - base) * (1 - cosine) ** 5) * (seen - expected[does])
    powered = (specular > 0) | (mirror > 0)
    np.testing.assert_array_equal(surfaces.colour[~powered[material]], expected[~powered[material]])
    # some processors give numpy powers that are rounded otherwise
    np.testing.assert_allclose(surfaces.colour, expected, rtol=2e-6)
