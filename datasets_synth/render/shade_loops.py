"""The loops of shading over rays, compiled: values at the corners of faces, textures, geometry of hits.

They round as whole arrays of numpy and OpenCV's ``remap`` do, so that pictures are the same bytes: no product
and sum is rounded at once, and texels are weighted by thirty-seconds.
"""

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.compiled import exact

_ZERO, _ONE, _HALF, _STEPS = np.float32(0), np.float32(1), np.float32(0.5), np.float32(32)
_TWO, _THREE = np.float32(2), np.float32(3)
_SHORTEST = np.float32(1e-6)
_SIDE_AT_GROUND, _SIDE_GAIN = np.float32(0.6), np.float32(0.4)
"""Sides see this share of the sky at the ground, and all of it from 0.6 m upwards."""
_BEFORE_MAP = np.float32(-9)
_SLOPE_MIN, _SLOPE_POWER = np.float32(0.02), np.float32(0.7)
_LOWEST_CLOUD, _CLOUDS_PER_SLOPE = np.float32(0.02), np.float32(40)
_CLEAR_BELOW, _CLOUD_EDGE, _CLOUD_DENSITY = np.float32(0.45), np.float32(3), np.float32(0.7)
_CLOUDS_FROM, _CLOUDS_RISE = np.float32(0.05), np.float32(6)
"""Clouds fade into the haze of the horizon."""
_BAND_FROM, _BAND_HEIGHT = np.float32(0.02), np.float32(0.2)
"""Slopes of the band of houses and trees, up to some 12 degrees."""
_FRESNEL = np.float32(5)


class Surfaces(NamedTuple):
    """What shading knows of n rays; rows of rays that meet nothing hold zeros or mean nothing."""

    sight: Float32Array
    """Shape (n, 3): unit direction of the ray."""
    distance_m: Float32Array
    """Shape (n,): to what the ray meets, 0 where it meets nothing."""
    point: Float32Array
    """Shape (n, 3): what the ray meets, in the world frame."""
    normal: Float32Array
    """Shape (n, 3): unit smooth normal on the side of the viewer."""
    slope_cos: Float32Array
    """Shape (n,): cosine between the face's own normal and the way to the viewer."""
    sun_cos: Float32Array
    """Shape (n,): cosine of the angle of the sun, 0 in the shade."""
    sky_share: Float32Array
    """Shape (n,): share of the sky's light that contact with the ground lets through."""
    colour: Float32Array
    """Shape (n, 3): albedo, then linear radiance."""


class Materials(NamedTuple):
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


class LightColours(NamedTuple):
    """What lights a scene, each of shape (3,)."""

    to_sun: Float32Array
    """Unit direction."""
    sun: Float32Array
    fill: Float32Array
    """What the sky gives to a surface that faces up."""
    ground: Float32Array
    """What the street throws back upwards."""
    horizon: Float32Array
    zenith: Float32Array
    cloud: Float32Array
    """White of clouds."""


@exact
def _unit_share(value: float) -> Any:
    """The value clipped to [0, 1]."""
    return min(max(value, _ZERO), _ONE)


@exact
def find_surfaces(
    rays: Float32Array,
    t: Float32Array,
    face: NDArray[np.int32],
    barycentric: Float32Array,
    face_normal: Float32Array,
    corner_normals: Float32Array,
    to_sun: Float32Array,
    shadow_offset: float,
    out: Surfaces,
    facing: IntArray,
    shadow_rays: Float32Array,
) -> int:
    """How many of the hits face the sun, after writing all of ``out`` but the shade of contact and colours.

    ``facing`` and ``shadow_rays`` begin with the hits that face the sun and their rays to it.
    """
    n_facing = 0
    for i in range(len(face)):
        dx, dy, dz = rays[i, 3], rays[i, 4], rays[i, 5]
        per_t = np.float32(sqrt(dx * dx + dy * dy + dz * dz))
        vx, vy, vz = dx / per_t, dy / per_t, dz / per_t
        out.sight[i, 0], out.sight[i, 1], out.sight[i, 2] = vx, vy, vz
        out.sun_cos[i] = _ZERO
        if face[i] < 0:
            out.distance_m[i] = _ZERO
            for k in range(3):
                out.point[i, k] = out.normal[i, k] = _ZERO
            continue
        out.distance_m[i] = t[i] * per_t
        px, py, pz = rays[i, 0] + dx * t[i], rays[i, 1] + dy * t[i], rays[i, 2] + dz * t[i]
        out.point[i, 0], out.point[i, 1], out.point[i, 2] = px, py, pz

        corners = corner_normals[face[i]]
        u, v = barycentric[i, 0], barycentric[i, 1]
        a = corners[0, 0] + u * (corners[1, 0] - corners[0, 0]) + v * (corners[2, 0] - corners[0, 0])
        b = corners[0, 1] + u * (corners[1, 1] - corners[0, 1]) + v * (corners[2, 1] - corners[0, 1])
        c = corners[0, 2] + u * (corners[1, 2] - corners[0, 2]) + v * (corners[2, 2] - corners[0, 2])
        x, y, z = face_normal[i, 0], face_normal[i, 1], face_normal[i, 2]
        if x * vx + y * vy + z * vz > _ZERO:
            x, y, z = -x, -y, -z
        length = max(np.float32(sqrt(a * a + b * b + c * c)), _SHORTEST)
        # the smooth normal lies on the side of the flat one
        by = (-_ONE if a * x + b * y + c * z < _ZERO else _ONE) / length
        a, b, c = a * by, b * by, c * by
        out.normal[i, 0], out.normal[i, 1], out.normal[i, 2] = a, b, c
        out.slope_cos[i] = -(x * vx + y * vy + z * vz)

        cosine = _unit_share(a * to_sun[0] + b * to_sun[1] + c * to_sun[2])
        if cosine > _ZERO:
            out.sun_cos[i] = cosine
            facing[n_facing] = i
            ray = shadow_rays[n_facing]
            ray[0], ray[1], ray[2] = px + x * shadow_offset, py + y * shadow_offset, pz + z * shadow_offset
            ray[3], ray[4], ray[5] = to_sun[0], to_sun[1], to_sun[2]
            n_facing += 1
    return n_facing


@exact
def shade(facing: IntArray, shadowed: BoolArray, sun_cos: Float32Array, sunlit: BoolArray) -> None:
    """Note which of the hits that face the sun it reaches, and take its light from the others."""
    sunlit[:] = False
    for k in range(len(facing)):
        if shadowed[k]:
            sun_cos[facing[k]] = _ZERO
        else:
            sunlit[facing[k]] = True


@exact
def find_contact(
    point: Float32Array,
    normal: Float32Array,
    ground_m: FloatArray,
    near_ground_m: float,
    low_xy_m: Float32Array,
    cell_m: float,
    furthest: float,
    share: Float32Array,
    at: IntArray,
    cell: Float32Array,
) -> int:
    """How many points lie on the ground, after writing their cells of the map, and the sky of all others."""
    n_ground = 0
    for i in range(len(point)):
        height = np.float32(np.float64(point[i, 2]) - ground_m[i])
        if normal[i, 2] < _HALF:
            share[i] = _SIDE_AT_GROUND + _SIDE_GAIN * _unit_share(height / _SIDE_AT_GROUND)
            continue
        share[i] = _ONE
        if height < near_ground_m:
            at[n_ground] = i
            for k in range(2):
                place = (point[i, k] - low_xy_m[k]) / cell_m
                # far points must not overflow OpenCV's fixed point
                cell[n_ground, k] = min(max(place, _BEFORE_MAP), furthest)
            n_ground += 1
    return n_ground


@exact
def find_texels(
    face: NDArray[np.int32],
    barycentric: Float32Array,
    face_material: NDArray[np.int32],
    materials: Materials,
    corner_uv: Float32Array,
    uv_per_m: Float32Array,
    focal_px: float,
    surfaces: Surfaces,
    ends: IntArray,
    order: IntArray,
    uv: Float32Array,
    level: Float32Array,
) -> None:
    """Write the plain albedo of all hits, and what textures are sampled by where there are any.

    Args:
        face: index into the table of faces (n,), negative for none.
        barycentric: weights of the second and the third corner.
        face_material: material of each face.
        materials: the materials.
        corner_uv: texture coordinates of the corners of each face.
        uv_per_m: density of texture coordinates on each face.
        focal_px: focal length.
        surfaces: what the rays meet; the albedo is written into ``colour``.
        ends: where the hits of each texture begin in ``order``, and of the last end; shape (textures + 1,).
        order: hits with a texture, those of one texture side by side.
        uv: texture coordinates (n, 2) of hits with a texture.
        level: mip level (n,) of hits with a texture, for the pixel's footprint.
    """
    ends[:] = 0
    for i in range(len(face)):
        if face[i] < 0:
            continue
        material = face_material[face[i]]
        for k in range(3):
            surfaces.colour[i, k] = materials.rgb[material, k]
        if materials.texture[material] < 0:
            continue
        ends[materials.texture[material] + 1] += 1
        # the footprint is cos times longer along the slope than across; a level between the two keeps
        # some of the texture of a road without much aliasing
        slope = max(surfaces.slope_cos[i], _SLOPE_MIN) ** _SLOPE_POWER
        footprint_m = surfaces.distance_m[i] / focal_px / slope
        texels_per_m = uv_per_m[face[i]] * materials.texture_px[material]
        level[i] = np.log2(max(texels_per_m * footprint_m, _ONE))
        corners = corner_uv[face[i]]
        for k in range(2):
            first = corners[0, k]
            uv[i, k] = (
                first
                + barycentric[i, 0] * (corners[1, k] - first)
                + barycentric[i, 1] * (corners[2, k] - first)
            )
    for k in range(1, len(ends)):
        ends[k] += ends[k - 1]
    next_at = ends.copy()
    for i in range(len(face)):
        if face[i] >= 0:
            texture = materials.texture[face_material[face[i]]]
            if texture >= 0:
                order[next_at[texture]] = i
                next_at[texture] += 1


@exact
def _cloud_at(x: float, y: float, z: float, shift: Float32Array, size: float, out: Float32Array) -> None:
    """Write where in the picture of clouds, of a size, a direction looks."""
    height = z if z > _LOWEST_CLOUD else _LOWEST_CLOUD
    place = x / height * _CLOUDS_PER_SLOPE + shift[0]
    out[0] = place - np.floor(place / size) * size
    place = y / height * _CLOUDS_PER_SLOPE + shift[1]
    out[1] = place - np.floor(place / size) * size


@exact
def find_sky(
    face: NDArray[np.int32],
    view: Float32Array,
    shift: Float32Array,
    size: float,
    at: IntArray,
    cloud: Float32Array,
) -> int:
    """How many rays meet nothing; ``at`` begins with these, ``cloud`` with their places in the clouds."""
    n_sky = 0
    for i in range(len(face)):
        if face[i] < 0:
            at[n_sky] = i
            _cloud_at(view[i, 0], view[i, 1], view[i, 2], shift, size, cloud[n_sky])
            n_sky += 1
    return n_sky


@exact
def _sky(z: float, noise: float, light: LightColours, channel: int) -> Any:
    """Radiance of the sky in one channel, at an upward slope and a noise of the clouds."""
    clear = light.horizon[channel] + (light.zenith[channel] - light.horizon[channel]) * np.float32(
        sqrt(_unit_share(z))
    )
    cover = _unit_share((noise - _CLEAR_BELOW) * _CLOUD_EDGE)
    cover = cover * _unit_share((z - _CLOUDS_FROM) * _CLOUDS_RISE)
    return np.float32(clear + cover * (light.cloud[channel] - clear) * _CLOUD_DENSITY)


@exact
def paint_sky(
    at: IntArray, view: Float32Array, noise: Float32Array, light: LightColours, colour: Float32Array
) -> None:
    """Write the radiance of the sky for some rays."""
    for k in range(len(at)):
        for channel in range(3):
            colour[at[k], channel] = _sky(view[at[k], 2], noise[k], light, channel)


@exact
def light_surfaces(
    face: NDArray[np.int32],
    face_material: NDArray[np.int32],
    materials: Materials,
    light: LightColours,
    shift: Float32Array,
    cloud_size: float,
    surfaces: Surfaces,
    at: IntArray,
    mirrored: Float32Array,
    cloud: Float32Array,
) -> int:
    """How many hits mirror, after turning albedo into radiance without what is mirrored.

    ``at`` begins with those that do, ``mirrored`` with the upward slope of what they show and their share of
    it, ``cloud`` with its places in the clouds.
    """
    n_mirrors = 0
    view, normal, colour = surfaces.sight, surfaces.normal, surfaces.colour
    for i in range(len(face)):
        if face[i] < 0:
            continue
        material = face_material[face[i]]
        sun_cos, sky_share = surfaces.sun_cos[i], _HALF + _HALF * normal[i, 2]
        for k in range(3):
            fill = (light.fill[k] * sky_share + light.ground[k] * (_ONE - sky_share)) * surfaces.sky_share[i]
            colour[i, k] *= fill + light.sun[k] * sun_cos
        if sun_cos > _ZERO and materials.specular[material] > _ZERO:  # Blinn-Phong
            x, y, z = light.to_sun[0] - view[i, 0], light.to_sun[1] - view[i, 1], light.to_sun[2] - view[i, 2]
            length = np.float32(sqrt(x * x + y * y + z * z))
            x, y, z = x / length, y / length, z / length
            along = _unit_share(x * normal[i, 0] + y * normal[i, 1] + z * normal[i, 2])
            shine = materials.specular[material] * along ** materials.shininess[material]
            for k in range(3):
                colour[i, k] += shine * light.sun[k]
        if materials.mirror[material] > _ZERO:  # Schlick's Fresnel
            cosine = _unit_share(
                -(view[i, 0] * normal[i, 0] + view[i, 1] * normal[i, 1] + view[i, 2] * normal[i, 2])
            )
            base = materials.mirror[material]
            twice = _TWO * cosine
            x, y, z = (
                view[i, 0] + twice * normal[i, 0],
                view[i, 1] + twice * normal[i, 1],
                view[i, 2] + twice * normal[i, 2],
            )
            length = np.float32(sqrt(x * x + y * y + z * z))
            x, y, z = x / length, y / length, z / length
            at[n_mirrors] = i
            mirrored[n_mirrors, 0] = z
            mirrored[n_mirrors, 1] = base + (_ONE - base) * (_ONE - cosine) ** _FRESNEL
            _cloud_at(x, y, z, shift, cloud_size, cloud[n_mirrors])
            n_mirrors += 1
    return n_mirrors


@exact
def add_mirrored(
    at: IntArray, mirrored: Float32Array, noise: Float32Array, light: LightColours, colour: Float32Array
) -> None:
    """Mix in what surfaces mirror: sky above, street below, and a soft band of houses and trees between."""
    for k in range(len(at)):
        z, share = mirrored[k, 0], mirrored[k, 1]
        above = _unit_share((z - _BAND_FROM) / _BAND_HEIGHT)
        above = above * above * (_THREE - _TWO * above)
        for channel in range(3):
            street, before = light.ground[channel], colour[at[k], channel]
            seen = street + (_sky(z, noise[k], light, channel) - street) * above
            colour[at[k], channel] = before + share * (seen - before)


@exact
def add_haze(face: IntArray, haze: Float32Array, horizon: Float32Array, colour: Float32Array) -> None:
    """Fade hits towards the colour of the horizon, each by its share."""
    for i in range(len(face)):
        if face[i] >= 0:
            for k in range(3):
                colour[i, k] += haze[i] * (horizon[k] - colour[i, k])


@exact
def _byte(
    texels: UInt8Array, first: int, right: int, down: int, weight: tuple[int, int, int, int], channel: int
) -> Any:
    """One channel's byte between four texels, in a list of all bytes: the first, and steps to the others."""
    k = first + np.uint64(channel)
    total = weight[0] * texels[k] + weight[1] * texels[k + right]
    total += weight[2] * texels[k + down] + weight[3] * texels[k + down + right]
    return (total + np.uint32(512)) >> np.uint32(10)


@exact
def _rounded(value: float) -> int:
    """The nearest whole number, even where two are as near."""
    return int(np.rint(value))


@exact
def _between_texels(
    texels: UInt8Array,
    width: int,
    height: int,
    box: Float32Array,
    x_share: float,
    y_share: float,
    linear: Float32Array,
) -> tuple[Any, Any, Any]:
    """Linear red, green and blue between the texels of one level, in a list of all bytes of a picture."""
    x32 = _rounded((box[0] + x_share * box[2] - _HALF) * _STEPS)
    y32 = _rounded((box[1] + y_share * box[3] - _HALF) * _STEPS)
    x, y = x32 >> 5, y32 >> 5
    fx, fy = np.uint32(x32 & 31), np.uint32(y32 & 31)
    x1, y1 = min(max(x + 1, 0), width - 1), min(max(y + 1, 0), height - 1)
    x, y = min(max(x, 0), width - 1), min(max(y, 0), height - 1)
    near_x, near_y = np.uint32(32) - fx, np.uint32(32) - fy
    weight = (near_x * near_y, fx * near_y, near_x * fy, fx * fy)
    # unsigned, since of a signed place it is asked at each of 24 texels whether it counts from the end
    first, right = np.uint64(3 * (y * width + x)), np.uint64(3 * (x1 - x))
    down = np.uint64(3 * width * (y1 - y))
    return (
        linear[_byte(texels, first, right, down, weight, 0)],
        linear[_byte(texels, first, right, down, weight, 1)],
        linear[_byte(texels, first, right, down, weight, 2)],
    )


@exact
def tint_by_mip(
    picture: UInt8Array,
    level_box: Float32Array,
    linear: Float32Array,
    at: IntArray,
    uv: Float32Array,
    level: Float32Array,
    colour: Float32Array,
) -> None:
    """Multiply colours (n, 3) of some points by a texture there, between texels and between mip levels.

    Args:
        picture: ``MipTexture.picture``.
        level_box: ``MipTexture.level_box``.
        linear: linear light of each byte, shape (256,).
        at: which of the points lie on this texture.
        uv: coordinates (n, 2) of all points, repeating outside [0, 1]; v = 1 is the top row.
        level: mip level (n,), 0 or more.
        colour: linear colours (n, 3).
    """
    coarsest, (height, width, _) = len(level_box) - 1, picture.shape
    texels = picture.reshape(-1)
    for i in at:
        wanted = min(level[i], np.float32(coarsest))
        lower = int(wanted)
        share = np.float64(wanted) - lower
        x_share = uv[i, 0] - np.floor(uv[i, 0])
        y_flipped = _ONE - uv[i, 1]
        y_share = y_flipped - np.floor(y_flipped)
        r, g, b = _between_texels(texels, width, height, level_box[lower], x_share, y_share, linear)
        if share:
            coarse = _between_texels(texels, width, height, level_box[lower + 1], x_share, y_share, linear)
            r = np.float32(r + share * np.float64(coarse[0] - r))
            g = np.float32(g + share * np.float64(coarse[1] - g))
            b = np.float32(b + share * np.float64(coarse[2] - b))
        colour[i, 0] *= r
        colour[i, 1] *= g
        colour[i, 2] *= b
