"""How much of each pixel of a picture is the object: colours decide what an outline has lost or taken in.

The outline of the level set is smooth; legs, spokes and handlebars are not. So the pixels of the box are told
apart by their colours and by edges between them (C. Rother, V. Kolmogorov and A. Blake, "GrabCut", SIGGRAPH
2004), from the outline on, and the border follows the picture to a share of a pixel (K. He, J. Sun and
X. Tang, "Guided image filtering", ECCV 2010).
"""

import cv2
import numpy as np

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


def matte(rgb: UInt8Array, inside: BoolArray, xyxy_px: FloatArray, fitted: bool = False) -> Float32Array:
    """How much of each pixel is the object in a box, shape (h, w), in [0, 1].

    Args:
        rgb: the picture, shape (h, w, 3).
        inside: about where the object is, shape (h, w).
        xyxy_px: the box, shape (4,), pixel edges; nothing outside of it is the object.
        fitted: whether ``inside`` is the silhouette of a fitted shape; then colours decide along its border
            alone.
    """
    (x0, y0), extent = xyxy_px[:2], xyxy_px[2:] - xyxy_px[:2]
    size = np.array(rgb.shape[1::-1])
    low = np.clip(np.floor(xyxy_px[:2] - _MARGIN * extent), 0, size - 1).astype(int)
    high = np.clip(np.ceil(xyxy_px[2:] + _MARGIN * extent), low + 1, size).astype(int)
    window = np.s_[low[1] : high[1], low[0] : high[0]]
    v, u = np.mgrid[window]
    beyond = (u < x0 - _SLACK_PX) | (u >= xyxy_px[2] + _SLACK_PX)
    beyond |= (v < y0 - _SLACK_PX) | (v >= xyxy_px[3] + _SLACK_PX)
    own = inside[window] & ~beyond
    out = np.zeros(rgb.shape[:2], np.float32)
    if not own.any():
        return out
    root = float(np.sqrt(np.prod(extent)))
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
