"""How much of each pixel of a picture is the object: colours decide what an outline has lost or taken in.

The outline of the level set is smooth; legs, spokes and handlebars are not. So the pixels of the box are told
apart by their colours and by edges between them (C. Rother, V. Kolmogorov and A. Blake, "GrabCut", SIGGRAPH
2004), from the outline on, and the border follows the picture to a share of a pixel (K. He, J. Sun and
X. Tang, "Guided image filtering", ECCV 2010).
"""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array

_MARGIN = 0.3
"""Share of the box beyond each side that shows the surroundings."""
_ROUNDS = 5
_SLACK_PX = 2.0
"""A box drawn tightly may be off by this much."""
_REACH = 0.35
"""Nothing farther than this from the outline, in roots of the box's area, is the object."""
_BAND = 0.06
"""Half the width of the band around a fitted silhouette where colours decide, in roots of the box's area."""
_RADIUS_PX = 2
_SMOOTH = 1e-4
"""Variances of the guide below this, in squares of full scale, are noise."""
_SAMPLES = 20_000
"""Pixels of the surroundings that those of a box are compared with."""
_NEIGHBOURS = 8
"""The nearest of these in colour and place says how strange a colour is."""
_PLACE = 5.0
"""Units of Lab that a way of one root of the box's area counts as: walls lie beside walls."""
_GRAIN_PX = 0.7
"""Standard deviation of the Gaussian that takes the noise of the camera from colours."""
_STRANGE = 0.995
"""Surroundings are less strange than the object with this probability."""
_SPECK = 0.02
"""Pieces whose area has a root smaller than this, in roots of the box's area, are noise."""
_OPEN = 0.75
"""An object is seen through where less of its matte than this is unlike the surroundings."""
_LIMB_REACH = 0.1
"""Limbs lie no farther than this from a fitted silhouette, in roots of the box's area: beyond is shadow."""


def matte(rgb: UInt8Array, inside: BoolArray, xyxy_px: FloatArray, fitted: bool = False) -> Float32Array:
    """How much of each pixel is the object in a box, shape (h, w), in [0, 1].

    Args:
        rgb: the picture, shape (h, w, 3).
        inside: about where the object is, shape (h, w).
        xyxy_px: the box, shape (4,), pixel edges; nothing outside of it is the object.
        fitted: whether ``inside`` is the silhouette of a fitted shape; then colours decide along its border
            alone.
    """
    window, beyond = _around(rgb, xyxy_px)
    own = inside[window] & ~beyond
    out = np.zeros(rgb.shape[:2], np.float32)
    if not own.any():
        return out
    root = _root_px(xyxy_px)
    marks = np.where(own, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    reach = _BAND if fitted else _REACH
    marks[beyond | (_distance(~own) > reach * root)] = cv2.GC_BGD
    if fitted:
        marks[_distance(own) > reach * root] = cv2.GC_FGD
    crop = np.ascontiguousarray(rgb[window])
    cv2.setRNGSeed(0)
    cv2.grabCut(
        crop, marks, (0, 0, 1, 1), np.zeros((1, 65)), np.zeros((1, 65)), _ROUNDS, cv2.GC_INIT_WITH_MASK
    )
    kept = np.isin(marks, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    out[window] = _guided(crop, kept)
    return out


def open_matte(rgb: UInt8Array, full: Float32Array, xyxy_px: FloatArray) -> Float32Array | None:
    """How much of each pixel (h, w) is an object that is seen through, in [0, 1]; None for other objects.

    Between spokes and tubes most of what an outline holds is street, so that colours of the inside tell
    nothing of the object. Here the surroundings are known instead: what has no like among them is the object.
    It is seen through where most of the matte by colours of the inside has its like there.

    Args:
        rgb: the picture, shape (h, w, 3).
        full: ``matte`` of the same box, shape (h, w).
        xyxy_px: the box, shape (4,), pixel edges; nothing outside of it is the object.
    """
    root = _root_px(xyxy_px)
    window, beyond = _around(rgb, xyxy_px)
    inside = ~beyond
    if inside.all() or not inside.any():
        return None
    crop = np.ascontiguousarray(rgb[window])
    lab = cv2.cvtColor(crop.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    lab = cv2.GaussianBlur(lab, (0, 0), _GRAIN_PX)
    v, u = np.mgrid[window]
    place = np.stack([u, v], axis=-1) * (_PLACE / root)
    described = np.concatenate([lab, place], axis=-1)
    around = described[beyond]
    around = around[np.random.default_rng(0).permutation(len(around))[:_SAMPLES]]
    half = len(around) // 2
    usual = _strangeness(around[half:], around[:half])
    strange = _strangeness(described[inside], around) > np.quantile(usual, _STRANGE)
    own = np.zeros(inside.shape, np.uint8)
    own[inside] = strange
    _, label, stats, _ = cv2.connectedComponentsWithStats(own, connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= (_SPECK * root) ** 2
    large[0] = False
    limbs = large[label]
    if not 0 < np.count_nonzero(limbs) < _OPEN * np.count_nonzero(full > 0.5):
        return None
    out = np.zeros(rgb.shape[:2], np.float32)
    out[window] = _guided(crop, limbs.astype(np.float32))
    return out


def near_silhouette(share: Float32Array, silhouette: BoolArray, xyxy_px: FloatArray) -> Float32Array:
    """A matte (h, w) of limbs without what lies far beside a fitted silhouette (h, w) in a box (4,)."""
    reach = _LIMB_REACH * _root_px(xyxy_px)
    return np.where(_distance(~silhouette) > reach, np.float32(0), share)


def _around(rgb: UInt8Array, xyxy_px: FloatArray) -> tuple[tuple[slice, slice], BoolArray]:
    """The part of a picture (h, w, 3) about a box (4,), rows and columns, and its pixels beyond the box."""
    extent, size = xyxy_px[2:] - xyxy_px[:2], np.array(rgb.shape[1::-1])
    low = np.clip(np.floor(xyxy_px[:2] - _MARGIN * extent), 0, size - 1).astype(int)
    high = np.clip(np.ceil(xyxy_px[2:] + _MARGIN * extent), low + 1, size).astype(int)
    window = slice(low[1], high[1]), slice(low[0], high[0])
    v, u = np.mgrid[window]
    beyond = (u < xyxy_px[0] - _SLACK_PX) | (u >= xyxy_px[2] + _SLACK_PX)
    beyond |= (v < xyxy_px[1] - _SLACK_PX) | (v >= xyxy_px[3] + _SLACK_PX)
    return window, beyond


def _root_px(xyxy_px: FloatArray) -> float:
    """Root of the area of a box (4,)."""
    return float(np.sqrt(np.prod(xyxy_px[2:] - xyxy_px[:2])))


def _strangeness(pixels: FloatArray, around: FloatArray) -> FloatArray:
    """Least difference in colour of pixels (n, 5) from the nearest of their surroundings (m, 5)."""
    _, nearest = cKDTree(around).query(pixels, k=min(_NEIGHBOURS, len(around)))
    near = around[nearest.reshape(len(pixels), -1), :3]
    return np.asarray(np.linalg.norm(near - pixels[:, None, :3], axis=2).min(axis=1))


def _distance(mask: BoolArray) -> Float32Array:
    """Distance in pixels from each pixel of a mask to the nearest one outside; 0 outside the mask."""
    return np.asarray(cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5), np.float32)


def _guided(rgb: UInt8Array, values: Float32Array) -> Float32Array:
    """Values (h, w) in [0, 1] whose borders follow those of a picture (h, w, 3)."""
    guide = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32) / np.float32(255), np.float32)

    def mean(picture: FloatArray | Float32Array) -> Float32Array:
        side = 2 * _RADIUS_PX + 1
        return np.asarray(cv2.blur(picture, (side, side)), np.float32)

    m, v = mean(guide), mean(values)
    slope = (mean(guide * values) - m * v) / (mean(guide * guide) - m * m + np.float32(_SMOOTH))
    return np.asarray(np.clip(mean(slope) * guide + mean(v - slope * m), 0, 1), np.float32)
