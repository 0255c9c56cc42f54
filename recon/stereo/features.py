"""Features of a left picture matched in the right one."""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array

MAX_FEATURES = 1500


RATIO = 0.75
"""A feature is matched where its best partner is nearer than this times the second best (Lowe 2004)."""


MAX_ROW_SHARE = 0.1
"""Matches farther apart in rows than this share of the height are taken for wrong ones."""


@dataclass(frozen=True, eq=False)
class PairMatches:
    """Features of a left picture with their partners in the right one."""

    row_px: FloatArray
    """Right row less left row, shape (n,)."""
    disparity_px: FloatArray
    """Left column less right column, shape (n,)."""
    left_uv_px: FloatArray
    """Column and row in the left picture, shape (n, 2)."""


def match_pair(left_rgb: UInt8Array, right_rgb: UInt8Array) -> PairMatches:
    """SIFT features that choose each other and pass the ratio test; no use is made of rows being equal."""
    sift = cv2.SIFT.create(MAX_FEATURES)
    (points, own), (others, theirs) = (
        sift.detectAndCompute(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), None) for rgb in (left_rgb, right_rgb)
    )
    if own is None or theirs is None or len(own) < 2 or len(theirs) < 2:
        return PairMatches(np.zeros(0), np.zeros(0), np.zeros((0, 2)))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {m.queryIdx: m.trainIdx for m in matcher.match(theirs, own)}
    good = [
        first
        for first, second in matcher.knnMatch(own, theirs, k=2)
        if first.distance < RATIO * second.distance and back.get(first.trainIdx) == first.queryIdx
    ]
    a = np.array([points[m.queryIdx].pt for m in good]).reshape(-1, 2)
    b = np.array([others[m.trainIdx].pt for m in good]).reshape(-1, 2)
    rows = b[:, 1] - a[:, 1]
    near = np.abs(rows) <= MAX_ROW_SHARE * left_rgb.shape[0]
    return PairMatches(rows[near], (a[:, 0] - b[:, 0])[near], a[near])
