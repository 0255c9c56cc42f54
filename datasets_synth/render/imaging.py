"""The model of a cheap stereo head, from radiance to bytes: blur, vignetting, exposure, noise, tone."""

import cv2
import numpy as np

from datasets_synth.meshes.mesh import Imaging
from recon.arrays import Float32Array, UInt8Array
from recon.pixels import bytes_of_linear_16bit


def expose(radiance: Float32Array, imaging: Imaging, eye: int, rng: np.random.Generator) -> UInt8Array:
    """The picture (h, w, 3) sRGB that one eye delivers of linear radiance (h, w, 3).

    In the order of a real camera: the lens blurs and darkens the corners, the sensor counts light (so noise
    grows with the root of the signal, and read noise is added) and saturates, the electronics apply contrast
    and gamma.

    Args:
        radiance: 1 is full scale at a gain of 1.
        imaging: The camera model.
        eye: 0 for the left, 1 for the right.
        rng: Source of the noise; draws h * w * 3 normal numbers.
    """
    from datasets_synth.render.picture_loops import expose_pixels  # noqa: PLC0415 (half a second to import)

    signal = np.ascontiguousarray(radiance)
    sigma = imaging.blur_sigma_px[eye]
    if sigma > 0:
        signal = np.asarray(
            cv2.GaussianBlur(signal, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), np.float32
        )
    height, width = radiance.shape[:2]
    gain = np.float32(imaging.exposure[eye]) * vignette(height, width, imaging.vignetting)
    rgb = np.empty(signal.shape, np.uint8)
    expose_pixels(
        signal,
        gain,
        rng.standard_normal(signal.shape, dtype=np.float32),
        np.float32(imaging.read_noise**2),
        np.float32(imaging.shot_noise**2),
        np.float32(imaging.contrast),
        bytes_of_linear_16bit(),
        rgb,
    )
    return rgb


def vignette(height_px: int, width_px: int, loss: float) -> Float32Array:
    """Share of light (h, w) that arrives: 1 in the middle, 1 - loss in the corners, quadratic."""
    y = np.linspace(-1, 1, height_px, dtype=np.float32)[:, None]
    x = np.linspace(-1, 1, width_px, dtype=np.float32)[None, :]
    aspect = width_px / height_px
    return np.asarray(1 - loss * (y * y + (aspect * x) ** 2) / (1 + aspect**2), np.float32)


def rectification_shift(uv_px: Float32Array, imaging: Imaging, width_px: int, height_px: int) -> Float32Array:
    """Where pixels (n, 2) of the right picture look in an ideal right picture, (n, 2).

    The picture lies ``rectification_error_px[0]`` too low, and is rolled so that this grows by
    ``rectification_error_px[1]`` over half the width. Rays are bent instead of resampling the picture, which
    would blur it.
    """
    from datasets_synth.render.picture_loops import shift_places  # noqa: PLC0415

    offset, growth = imaging.rectification_error_px
    middle = np.array([(width_px - 1) / 2, (height_px - 1) / 2], np.float32)
    moved = uv_px.astype(np.float32)
    shift_places(moved, middle, np.float32(offset), np.float32(growth / (width_px / 2)))
    return moved
