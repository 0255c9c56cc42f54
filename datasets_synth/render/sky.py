"""Radiance of the sky in a direction: a gradient, soft clouds, and the far ground below the horizon."""

from functools import lru_cache

import cv2
import numpy as np

from datasets_synth.meshes.mesh import Light
from recon.arrays import Float32Array
from recon.pixels import sample_bilinear

_CLOUD_PX = 512


def sky_radiance(direction: Float32Array, light: Light) -> Float32Array:
    """Linear radiance (n, 3) seen along unit world directions (n, 3)."""
    # one row a channel, since operations along three channels are slow
    horizon = np.array(light.sky_horizon_rgb, np.float32)[:, None]
    zenith = np.array(light.sky_zenith_rgb, np.float32)[:, None]
    clear = horizon + (zenith - horizon) * np.sqrt(np.clip(direction[:, 2], 0, 1))
    cover = _cloud_cover(direction, light)
    # clouds take their white from the sun and fade into the haze of the horizon
    white = 0.55 * horizon + 0.35 * np.array(light.sun_rgb, np.float32)[:, None]
    return np.asarray(clear + cover * (white - clear) * 0.7, np.float32).T


def environment_radiance(direction: Float32Array, light: Light) -> Float32Array:
    """Radiance (n, 3) that a mirror shows along unit world directions (n, 3): sky above, street below."""
    sky = sky_radiance(direction, light).T
    street = ground_radiance(light)[:, None]
    # a soft band of houses and trees stands between the two, up to some 12 degrees
    share = np.clip((direction[:, 2] - 0.02) / 0.2, 0, 1)
    return np.asarray(street + (sky - street) * (share * share * (3 - 2 * share)), np.float32).T


def mean_sky(light: Light) -> Float32Array:
    """Mean colour (3,) of the sky: what lights a surface in the shade."""
    return 0.5 * (np.array(light.sky_zenith_rgb, np.float32) + np.array(light.sky_horizon_rgb, np.float32))


def ground_radiance(light: Light) -> Float32Array:
    """Colour (3,) that the street throws back upwards: a grey that reflects a fifth."""
    sun_up = max(light.sun_direction[2], 0.0)
    return np.float32(0.2) * (
        np.float32(0.5 * sun_up) * np.array(light.sun_rgb, np.float32)
        + np.float32(light.ambient) * mean_sky(light)
    )


def _cloud_cover(direction: Float32Array, light: Light) -> Float32Array:
    """Share of cloud (n,) in [0, 1]: fractal noise on a flat layer, moved by the position of the sun."""
    height = np.maximum(direction[:, 2], 0.02)
    shift = np.array(light.sun_direction[:2], np.float32) * 1013.0
    xy = direction.T[:2] / height * 40.0 + shift[:, None]
    xy = (xy - np.floor(xy / _CLOUD_PX) * _CLOUD_PX).astype(np.float32)
    noise = sample_bilinear(_cloud_noise(), xy.T, cv2.BORDER_WRAP)
    cover = np.clip((noise - 0.45) * 3, 0, 1)
    return np.asarray(cover * np.clip((direction[:, 2] - 0.05) * 6, 0, 1), np.float32)


@lru_cache(maxsize=1)
def _cloud_noise() -> Float32Array:
    """Tiling fractal noise in [0, 1], the same in every run."""
    rng = np.random.default_rng(20090601)
    frequency = np.fft.fftfreq(_CLOUD_PX)
    radius = np.hypot(*np.meshgrid(frequency, frequency))
    radius[0, 0] = 1
    spectrum = np.fft.fft2(rng.standard_normal((_CLOUD_PX, _CLOUD_PX))) / radius**1.7
    spectrum[0, 0] = 0
    noise = np.fft.ifft2(spectrum).real
    return np.asarray(np.clip(0.5 + noise / (5 * noise.std()), 0, 1), np.float32)
