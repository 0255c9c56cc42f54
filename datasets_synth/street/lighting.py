"""Draws the weather and the state of the stereo head."""

import numpy as np

from datasets_synth.meshes.mesh import Imaging, Light
from datasets_synth.presets import LightConfig, SensorConfig


def sample_light(config: LightConfig, rng: np.random.Generator) -> tuple[Light, float]:
    """A light, and the brightness that the picture shall have (1 is well exposed)."""
    weights = np.array([config.sunny, config.overcast, config.dusk])
    weather = ("sunny", "overcast", "dusk")[int(rng.choice(3, p=weights / weights.sum()))]
    haze = float(rng.uniform(*config.haze_per_m))
    brightness = float(rng.uniform(*(config.dusk_level if weather == "dusk" else config.level)))
    elevation = float(np.radians(rng.uniform(18, 62) if weather == "sunny" else rng.uniform(6, 40)))
    # mostly from the side or from behind the camera: looking into the sun happens, but less often
    azimuth = float(np.radians(rng.uniform(150, 390)))
    direction = (
        float(np.cos(elevation) * np.cos(azimuth)),
        float(np.cos(elevation) * np.sin(azimuth)),
        float(np.sin(elevation)),
    )
    if weather == "sunny":
        warm = 1 - elevation
        sun = (2.6, 2.5 - 0.3 * warm, 2.25 - 0.7 * warm)
        light = Light(direction, sun, (0.35, 0.55, 0.95), (0.85, 0.95, 1.05), 0.75, haze * 0.4)
    elif weather == "overcast":
        grey = float(rng.uniform(0.8, 1.0))
        light = Light(
            direction, (0.12, 0.12, 0.12), (0.9 * grey, 0.95 * grey, grey), (0.95, 0.97, 1.0), 1.0, haze
        )
    else:
        light = Light(direction, (0.5, 0.3, 0.16), (0.22, 0.3, 0.5), (0.8, 0.6, 0.45), 0.8, haze)
    return light, brightness


def ground_irradiance(light: Light) -> float:
    """Mean light that falls on open ground."""
    sky = (np.array(light.sky_zenith_rgb) + np.array(light.sky_horizon_rgb)) / 2
    sun = np.array(light.sun_rgb) * max(light.sun_direction[2], 0.0)
    return float((light.ambient * sky + sun).mean())


def sample_imaging(
    config: SensorConfig, light: Light, brightness: float, rng: np.random.Generator
) -> Imaging:
    """The stereo head of one frame; its gain brings grey ground to the wanted brightness."""
    gain = brightness / ground_irradiance(light)
    right = gain * float(np.exp(rng.normal(0, config.eye_gain_spread)))
    blur = float(rng.uniform(*config.blur_sigma_px))
    return Imaging(
        exposure=(gain, right),
        blur_sigma_px=(blur, blur * float(rng.uniform(0.9, 1.25))),
        vignetting=float(rng.uniform(*config.vignetting)),
        read_noise=float(rng.uniform(*config.read_noise)),
        shot_noise=float(rng.uniform(*config.shot_noise)),
        rectification_error_px=(
            float(rng.normal(0, config.row_error_px)),
            float(rng.normal(0, config.roll_error_px)),
        ),
        contrast=config.contrast,
    )
