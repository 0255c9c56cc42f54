"""Ways to spoil the input of depth evidence, a dial each: pictures, disparity, or the camera as believed.

The picture that the detector and the reconstruction see stays as it is. So a curve over a dial shows what the
measured depth, or the calibration, is worth, and nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, UInt8Array
from recon.camera import GroundPlane, StereoCamera
from recon.errors import RescoreError

Pair = tuple[UInt8Array, UInt8Array]
Calibration = tuple[StereoCamera | None, GroundPlane | None]
Rng = np.random.Generator

BLOB_PX = 24
"""Diameter of the blobs in which disparity is removed or replaced."""
BLOCK_PX = 32
"""Side of the blocks that are exchanged for one another."""
READ_NOISE = 0.006
"""Noise of a black pixel in units of full scale, added where a picture is made dark."""


@dataclass(frozen=True)
class Dial:
    """One way to spoil the input. At level 0 nothing is changed; exactly one of the functions is given."""

    name: str
    what: str
    """Description of the dial for people, with the unit of the level."""
    levels: tuple[float, ...]
    """Levels of a sweep, without 0."""
    pictures: Callable[[Pair, float, Rng], Pair] | None = None
    """Changes the two pictures that the matcher sees."""
    disparity: Callable[[Float32Array, float, Rng], Float32Array] | None = None
    """Changes the measured disparity; NaN are holes."""
    calibration: Callable[[Calibration, float], Calibration] | None = None
    """Changes what is believed of camera and ground, not what they are."""


def _noise(pair: Pair, sigma: float, rng: Rng) -> Pair:
    left, right = (p + sigma * rng.standard_normal(p.shape, np.float32) for p in pair)
    return _bytes(left), _bytes(right)


def _exposure(pair: Pair, stops: float, rng: Rng) -> Pair:
    return pair[0], _bytes(255 * _encode(_decode(pair[1]) * 2.0**stops))


def _vertical(pair: Pair, shift_px: float, rng: Rng) -> Pair:
    return pair[0], _moved(pair[1], np.array([[1, 0, 0], [0, 1, shift_px]]))


def _roll(pair: Pair, edge_px: float, rng: Rng) -> Pair:
    h, w = pair[1].shape[:2]
    angle = np.degrees(np.arctan2(edge_px, w / 2))
    return pair[0], _moved(pair[1], cv2.getRotationMatrix2D(((w - 1) / 2, (h - 1) / 2), float(angle), 1.0))


def _blur(pair: Pair, sigma_px: float, rng: Rng) -> Pair:
    left, right = (np.asarray(cv2.GaussianBlur(p, (0, 0), sigma_px), np.uint8) for p in pair)
    return left, right


def _dark(pair: Pair, stops: float, rng: Rng) -> Pair:
    def darkened(p: UInt8Array) -> UInt8Array:
        signal = _decode(p) * 2.0**-stops
        return _bytes(255 * _encode(signal + READ_NOISE * rng.standard_normal(p.shape, np.float32)))

    return darkened(pair[0]), darkened(pair[1])


def _holes(disparity: Float32Array, share: float, rng: Rng) -> Float32Array:
    return np.where(_blobs(disparity.shape, share, rng), np.float32(np.nan), disparity)


def _bias(disparity: Float32Array, offset_px: float, rng: Rng) -> Float32Array:
    moved = disparity + np.float32(offset_px)
    return np.where(moved > 0, moved, np.float32(np.nan))


def _streaks(disparity: Float32Array, sigma_px: float, rng: Rng) -> Float32Array:
    # bands of 4 rows, as scanline matchers leave them
    rows = disparity.shape[0]
    offset = np.repeat(rng.standard_normal(-(-rows // 4), np.float32), 4)[:rows, None]
    moved = disparity + np.float32(sigma_px) * offset
    return np.where(moved > 0, moved, np.float32(np.nan))


def _noise_for_depth(disparity: Float32Array, share: float, rng: Rng) -> Float32Array:
    noise = rng.uniform(1, _largest(disparity), disparity.shape).astype(np.float32)
    return np.where(_blobs(disparity.shape, share, rng) & np.isfinite(disparity), noise, disparity)


def _exchanged(disparity: Float32Array, share: float, rng: Rng) -> Float32Array:
    h, w = disparity.shape
    corners = np.array(
        [(y, x) for y in range(0, h - BLOCK_PX + 1, BLOCK_PX) for x in range(0, w - BLOCK_PX + 1, BLOCK_PX)]
    )
    order = rng.permutation(len(corners))[: round(share * len(corners))]
    out = disparity.copy()
    for to, source in zip(corners[order], corners[np.roll(order, 1)], strict=True):
        (y, x), (b, a) = to, source
        out[y : y + BLOCK_PX, x : x + BLOCK_PX] = disparity[b : b + BLOCK_PX, a : a + BLOCK_PX]
    return out


def _constant(disparity: Float32Array, share: float, rng: Rng) -> Float32Array:
    """Each blob takes one random disparity: smooth, as a matcher delivers, and wrong."""
    value = rng.uniform(1, _largest(disparity), disparity.shape).astype(np.float32)
    cells = cv2.resize(
        value[:: 2 * BLOB_PX, :: 2 * BLOB_PX], disparity.shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    wrong = np.maximum(np.asarray(cells, np.float32), np.float32(0.5))
    return np.where(_blobs(disparity.shape, share, rng) & np.isfinite(disparity), wrong, disparity)


def _pitch(known: Calibration, degrees: float) -> Calibration:
    camera, ground = known
    if ground is None:
        return known
    return camera, replace(ground, pitch_rad=ground.pitch_rad + float(np.radians(degrees)))


def _height(known: Calibration, per_cent: float) -> Calibration:
    camera, ground = known
    if ground is None:
        return known
    return camera, replace(ground, height_m=ground.height_m * (1 + per_cent / 100))


def _focal(known: Calibration, per_cent: float) -> Calibration:
    camera, ground = known
    if camera is None:
        return known
    left = camera.left
    factor = 1 + per_cent / 100
    wrong = replace(left, fx_px=left.fx_px * factor, fy_px=left.fy_px * factor)
    return replace(camera, left=wrong), ground


def _baseline(known: Calibration, per_cent: float) -> Calibration:
    camera, ground = known
    if camera is None:
        return known
    return replace(camera, baseline_m=camera.baseline_m * (1 + per_cent / 100)), ground


_SHARES = (0.25, 0.5, 0.75, 0.9, 1.0)
_PER_CENT = (-40.0, -20.0, -10.0, 10.0, 20.0, 40.0)
DIALS: dict[str, Dial] = {
    d.name: d
    for d in (
        Dial("noise", "noise of both eyes, grey values", (5, 10, 20, 40, 80), pictures=_noise),
        Dial("exposure", "exposure of the right eye, stops", (-3, -2, -1, 1, 2, 3), pictures=_exposure),
        Dial("vertical", "right picture too low, pixels", (0.5, 1, 2, 4, 8), pictures=_vertical),
        Dial("roll", "roll of the right picture, pixels at its edge", (1, 2, 4, 8, 16), pictures=_roll),
        Dial("blur", "blur of both eyes, pixels", (1, 2, 4, 8), pictures=_blur),
        Dial("dark", "both eyes too dark, stops", (1, 2, 4, 6, 8), pictures=_dark),
        Dial("holes", "share of the picture without disparity", _SHARES, disparity=_holes),
        Dial("bias", "disparity off by a constant, pixels", (-4, -2, -1, 1, 2, 4), disparity=_bias),
        Dial("streaks", "rows off by random amounts, pixels", (0.5, 1, 2, 4, 8), disparity=_streaks),
        Dial("destroyed", "share replaced by noise", _SHARES, disparity=_noise_for_depth),
        Dial("invented", "share replaced by smooth wrong disparity", _SHARES, disparity=_constant),
        Dial("exchanged", "share of blocks put elsewhere", _SHARES, disparity=_exchanged),
        Dial("pitch", "ground plane pitched wrongly, degrees", (-4, -2, -1, 1, 2, 4), calibration=_pitch),
        Dial("height", "camera height taken too large, per cent", _PER_CENT, calibration=_height),
        Dial("focal", "focal length taken too large, per cent", _PER_CENT, calibration=_focal),
        Dial("baseline", "baseline taken too large, per cent", _PER_CENT, calibration=_baseline),
    )
}
"""The dials by name."""


def dials_named(names: str | None, levels: str | None) -> tuple[Dial, ...]:
    """The dials of a comma-separated list, all for None; levels, comma-separated too, replace those of one.

    Raises:
        RescoreError: an unknown dial, or levels that are not numbers or not of one dial.
    """
    asked = list(DIALS) if names is None else [n.strip() for n in names.split(",") if n.strip()]
    unknown = [n for n in asked if n not in DIALS]
    if unknown or not asked:
        raise RescoreError(
            f"--dials: expected some of {', '.join(DIALS)}, got {', '.join(unknown) or 'none'}; name these"
        )
    chosen = tuple(DIALS[n] for n in asked)
    if levels is None:
        return chosen
    if len(chosen) != 1:
        raise RescoreError(
            f"--levels: expected one dial to set levels of, got {len(chosen)}; give --dials one name"
        )
    return (replace(chosen[0], levels=_numbers(levels)),)


def _numbers(levels: str) -> tuple[float, ...]:
    try:
        found = tuple(float(v) for v in levels.split(","))
    except ValueError:
        found = ()
    if not found or not np.isfinite(found).all() or 0 in found:
        raise RescoreError(
            f"--levels: expected numbers other than 0, which is always there, got {levels!r}; "
            "write for example 0.25,0.5"
        )
    return found


def _blobs(shape: tuple[int, ...], share: float, rng: Rng) -> BoolArray:
    """Blobs that cover a share of the picture, shape (h, w); the blobs of a smaller share lie within them."""
    if share >= 1:
        return np.ones(shape, np.bool_)
    field: NDArray[Any] = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), BLOB_PX / 3)
    return np.asarray(field < np.quantile(field, share))


def _largest(disparity: Float32Array) -> float:
    known = disparity[np.isfinite(disparity)]
    return float(known.max()) if len(known) else 2.0


def _moved(picture: UInt8Array, matrix: NDArray[Any]) -> UInt8Array:
    h, w = picture.shape[:2]
    moved = cv2.warpAffine(
        picture, matrix.astype(float), (w, h), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(moved, np.uint8)


def _decode(picture: UInt8Array) -> Float32Array:
    """Linear light in [0, 1], by a gamma of 2.2."""
    return np.asarray((picture.astype(np.float32) / 255) ** 2.2, np.float32)


def _encode(light: Float32Array) -> Float32Array:
    return np.asarray(np.clip(light, 0, 1) ** (1 / 2.2), np.float32)


def _bytes(values: Float32Array) -> UInt8Array:
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)
