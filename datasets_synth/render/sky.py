"""Radiance of the sky in a direction: a gradient, soft clouds, and the far ground below the horizon."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from datasets_synth.meshes.mesh import Light
from recon.arrays import Float32Array

if TYPE_CHECKING:
    from datasets_synth.render.shade_loops import LightColours

CLOUD_PX = 512


def light_colours(light: Light) -> "LightColours":
    """The colours of a light as the loops of shading take them."""
    from datasets_synth.render.shade_loops import LightColours  # noqa: PLC0415 (half a second to import)

    horizon, sun = np.array(light.sky_horizon_rgb, np.float32), np.array(light.sun_rgb, np.float32)
    return LightColours(
        to_sun=np.array(light.sun_direction, np.float32),
        sun=sun,
        fill=np.float32(light.ambient) * mean_sky(light),
        ground=ground_radiance(light),
        horizon=horizon,
        zenith=np.array(light.sky_zenith_rgb, np.float32),
        # clouds take their white from the sun
        cloud=np.float32(0.55) * horizon + np.float32(0.35) * sun,
    )


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


def cloud_shift(light: Light) -> Float32Array:
    """How far the layer of clouds is moved in the picture of clouds, shape (2,): by the place of the sun."""
    return np.array(light.sun_direction[:2], np.float32) * np.float32(1013)


@lru_cache(maxsize=1)
def cloud_noise() -> Float32Array:
    """Tiling fractal noise in [0, 1], the same in every run."""
    rng = np.random.default_rng(20090601)
    frequency = np.fft.fftfreq(CLOUD_PX)
    radius = np.hypot(*np.meshgrid(frequency, frequency))
    radius[0, 0] = 1
    spectrum = np.fft.fft2(rng.standard_normal((CLOUD_PX, CLOUD_PX))) / radius**1.7
    spectrum[0, 0] = 0
    noise = np.fft.ifft2(spectrum).real
    return np.asarray(np.clip(0.5 + noise / (5 * noise.std()), 0, 1), np.float32)
