"""Filling in what an object hides with texture from beside it.

Walls and pavements repeat themselves: a hidden place is filled from the place a shift away, where a few
shifts serve all. Shifts are those for which the border of the hidden region looks like what lies a shift away
from it. After K. He and J. Sun, "Statistics of patch offsets for image completion", ECCV 2012, without the
graph cut: each hidden pixel takes the shift that suits the border nearest to it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array

Shift = tuple[int, int]

_MOST_PX = 640
"""Larger pictures are filled in at this size: what is hidden needs no fine detail."""
_LEVEL_PX = 2
"""Largest shift up or down, in pixels."""
_BORDER_PX = 12
"""Width of the border that shifts are judged by."""
_LEAST_BORDER = 0.1
"""Share of the border for which a shift must have something to compare."""
_SHIFTS = 40
"""Number of shifts that are kept."""
_APART_PX = 3
"""Kept shifts differ by more than this many pixels."""
_REACH = 0.25
"""How far a place of the border counts, in roots of the hidden area."""
_SEAM_PX = 1.5
"""Width of the seams between regions of different shifts."""


def filled_from_beside(
    rgb: UInt8Array, hidden: BoolArray, seen: BoolArray, known: BoolArray
) -> tuple[UInt8Array, BoolArray]:
    """A picture (h, w, 3) with hidden pixels filled in, and those which could not be, (h, w).

    Args:
        rgb: the picture.
        hidden: what to fill, shape (h, w).
        seen: what the picture shows, shape (h, w).
        known: the part of it that texture may come from, shape (h, w).

    Shifts are level, give or take a few pixels: what lies at one height of a wall, or in one row of the
    ground seen from above, looks alike.
    """
    height, width = hidden.shape
    scale = _MOST_PX / max(height, width)
    if scale >= 1:
        return _filled(rgb, hidden, seen, known)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))

    def share(mask: BoolArray) -> Float32Array:
        return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA))

    small = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
    # a coarse pixel is seen, or known, where all of it is
    coarse = (share(hidden) > 0, share(seen) > 0.999, share(known) > 0.999)
    made, missing = _filled(small, *coarse)
    back = cv2.resize(made, (width, height), interpolation=cv2.INTER_LINEAR)
    left = cv2.resize(missing.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    left &= hidden
    return np.where((hidden & ~left)[..., None], back, rgb).astype(np.uint8), np.asarray(left)


def _filled(
    rgb: UInt8Array, hidden: BoolArray, seen: BoolArray, known: BoolArray
) -> tuple[UInt8Array, BoolArray]:
    border = seen & _grown(hidden, _BORDER_PX)
    if not hidden.any() or not border.any():
        return rgb, hidden
    light = rgb.astype(np.float32)
    shifts = _good_shifts(light, border, known, hidden)
    if not shifts:
        return rgb, hidden
    sigma = max(_REACH * float(np.sqrt(hidden.sum())), 3.0)
    chosen = _chosen(light, border, known, shifts, sigma)
    filled = (chosen >= 0) & hidden
    made = _composed(light, chosen, known, shifts)
    # what the border tells about light and shade
    lit = border & known & (chosen >= 0)
    made += _spread(np.where(lit[..., None], light - made, 0), lit, sigma / 2)
    out = np.where(filled[..., None], np.clip(np.round(made), 0, 255), rgb).astype(np.uint8)
    return out, hidden & ~filled


def _grown(mask: BoolArray, by_px: int) -> BoolArray:
    size = 2 * by_px + 1
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def _good_shifts(light: Float32Array, border: BoolArray, known: BoolArray, hidden: BoolArray) -> list[Shift]:
    """Shifts (rows, columns) of least mean squared difference over the border, best first."""
    height, width = known.shape
    shape = (next_fast_len(2 * height), next_fast_len(2 * width))

    def spectrum(values: NDArray[np.floating]) -> NDArray[np.complexfloating]:
        return np.asarray(rfft2(values, shape))

    def summed(here: NDArray[np.complexfloating], there: NDArray[np.complexfloating]) -> FloatArray:
        """Sum over q of here(q) there(q + s) for every shift s, wrapped around."""
        return np.asarray(irfft2(np.conj(here) * there, shape))

    known_f, border_f = spectrum(known.astype(float)), spectrum(border.astype(float))
    count = summed(border_f, known_f)
    energy = (light**2).sum(axis=2)
    cost = summed(spectrum(border * energy), known_f) + summed(border_f, spectrum(known * energy))
    for k in range(3):
        cost -= 2 * summed(spectrum(border * light[..., k]), spectrum(known * light[..., k]))
    rows = np.minimum(np.arange(shape[0]), shape[0] - np.arange(shape[0]))
    useful = (
        (rows <= _LEVEL_PX)[:, None]
        & (count > _LEAST_BORDER * border.sum())
        & (summed(spectrum(hidden.astype(float)), known_f) > 0.5)
    )
    mean = np.where(useful, cost / np.maximum(count, 1), np.inf)
    # a shift of nothing explains everything and fills nothing
    _forbid(mean, (0, 0), 2 * _APART_PX)
    shifts: list[Shift] = []
    while len(shifts) < _SHIFTS:
        row, column = np.unravel_index(int(np.argmin(mean)), shape)
        if not np.isfinite(mean[row, column]):
            break
        one = (int(row), int(column))
        _forbid(mean, one, _APART_PX)
        shifts.append((_signed(one[0], shape[0]), _signed(one[1], shape[1])))
    return shifts


def _signed(shift: int, size: int) -> int:
    return shift - size if shift > size // 2 else shift


def _forbid(mean: FloatArray, at: Shift, by_px: int) -> None:
    rows, columns = (
        np.arange(k - by_px, k + by_px + 1) % size for k, size in zip(at, mean.shape, strict=True)
    )
    mean[np.ix_(rows, columns)] = np.inf


def _moved(values: Float32Array, shift: Shift) -> Float32Array:
    """What lies a shift away from each place of (h, w) or (h, w, 3), 0 beyond the border."""
    affine = np.array([[1.0, 0, shift[1]], [0, 1.0, shift[0]]])
    height, width = values.shape[:2]
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(values, affine, (width, height), flags=flags), np.float32)


def _blurred(values: Float32Array, sigma_px: float) -> Float32Array:
    """Gaussian blur; a wide one of a smaller picture, which is as good and much quicker."""
    shrink = max(1, int(sigma_px / 4))
    height, width = values.shape[:2]
    size = (-(-width // shrink), -(-height // shrink))
    small = cv2.resize(values, size, interpolation=cv2.INTER_AREA) if shrink > 1 else values
    soft = cv2.GaussianBlur(small, (0, 0), sigma_px / shrink)
    if shrink > 1:
        soft = cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(soft, np.float32)


def _chosen(
    light: Float32Array, border: BoolArray, known: BoolArray, shifts: list[Shift], sigma_px: float
) -> IntArray:
    """Index (h, w) of the shift that suits the border around each place; -1 where none has a source."""
    cost = np.full((len(shifts), *known.shape), np.inf, np.float32)
    for i, shift in enumerate(shifts):
        source = _moved(known.astype(np.float32), shift) > 0
        both = (border & source).astype(np.float32)
        error = both * ((light - _moved(light, shift)) ** 2).sum(axis=2)
        mean = float(error.sum() / max(both.sum(), 1))
        # far from the border that it can be compared with a shift counts as it does on the whole
        near = (_blurred(error, sigma_px) + 0.02 * mean) / (_blurred(both, sigma_px) + 0.02)
        cost[i] = np.where(source, near, np.inf)
    return np.where(np.isfinite(cost).any(axis=0), np.argmin(cost, axis=0), -1)


def _composed(light: Float32Array, chosen: IntArray, known: BoolArray, shifts: list[Shift]) -> Float32Array:
    """The picture (h, w, 3) that the chosen shifts give, with soft seams."""
    total = np.zeros_like(light)
    weight = np.full(known.shape, 1e-6, np.float32)
    for i, shift in enumerate(shifts):
        own = _blurred((chosen == i).astype(np.float32), _SEAM_PX) * _moved(known.astype(np.float32), shift)
        total += own[..., None] * _moved(light, shift)
        weight += own
    return np.asarray(total / weight[..., None], np.float32)


def _spread(values: Float32Array, where: BoolArray, sigma_px: float) -> Float32Array:
    """Values (h, w, 3) known in some places, spread smoothly, and fading out far from them."""
    weight = _blurred(where.astype(np.float32), sigma_px)
    return _blurred(values.astype(np.float32), sigma_px) / (weight[..., None] + np.float32(0.02))


def filled_in(rgb: UInt8Array, hidden: BoolArray) -> UInt8Array:
    """The picture (h, w, 3) with hidden pixels (h, w) filled smoothly from around them."""
    # a smooth fill needs no detail, and costs much on large pictures
    height, width = rgb.shape[:2]
    scale = min(1.0, 400 / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    mask = hidden.astype(np.uint8)
    small_hidden = (cv2.resize(mask * 255, size, interpolation=cv2.INTER_AREA) > 0).astype(np.uint8)
    filled = cv2.inpaint(small, small_hidden, 5, cv2.INPAINT_TELEA)
    back = cv2.resize(filled, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.where(hidden[..., None], back, rgb).astype(np.uint8)
