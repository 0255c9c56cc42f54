"""Checks whether measured disparity can be believed at all, before it is taken as evidence.

A matcher that has failed still delivers numbers: noise, streaks, or smooth surfaces that are not there. The
evidence model has never seen cues computed from such disparity, so its output for them is meaningless. Two
checks need no truth:

- real surfaces are smooth nearly everywhere, so neighbours agree;
- before the camera lies the ground, and a calibrated camera says at which disparity.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import GroundedStereo

CHECKS = ("agreement", "ground_agreement")
"""Columns of ``plausibility``."""


@dataclass(frozen=True)
class PlausibilityConfig:
    """What counts as agreement."""

    neighbour_px: int = 2
    """Distance of the neighbours that are compared; next ones share most of the matched block."""
    neighbour_tolerance_px: float = 1.0
    min_pairs: int = 40
    """A box with fewer pairs of measured neighbours is not checked."""
    ground_share: float = 0.15
    """Relative tolerance for lying on the ground, as a share of the ground's disparity: two degrees of pitch
    are more."""
    ground_px: float = 1.5
    """Absolute tolerance in pixels for lying on the ground; the larger of this and ``ground_share``
    applies."""
    farthest_px: float = 8.0
    """Pixels where the ground has a smaller disparity are not looked at: too much stands before it."""
    min_ground: int = 2000
    """A picture with fewer measurements in the pixels that are looked at is not checked."""


def plausibility(
    disparity_px: Float32Array,
    xyxy_px: FloatArray,
    seen_from: GroundedStereo | None,
    config: PlausibilityConfig,
) -> FloatArray:
    """The checks of boxes (n, 4), shape (n, 2), columns ``CHECKS``; NaN where one cannot be made.

    - ``agreement``: share of the pairs of measured neighbours in the box that have one disparity.
    - ``ground_agreement``: share of the measurements in the lower part of the whole picture that lie on the
      ground plane; the same for all boxes. None for ``seen_from`` leaves it out.
    """
    agree = _agreement(disparity_px, xyxy_px, config)
    on_ground = np.nan if seen_from is None else _on_ground(disparity_px, seen_from, config)
    return np.stack([agree, np.full(len(xyxy_px), on_ground)], axis=1)


def _agreement(disparity_px: Float32Array, xyxy_px: FloatArray, config: PlausibilityConfig) -> FloatArray:
    if not len(xyxy_px):
        return np.zeros(0)
    h, w = disparity_px.shape
    step = config.neighbour_px
    boxes = np.clip(np.rint(xyxy_px).astype(int), 0, [w, h, w, h])
    # the part of the picture that holds all boxes
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0) + step
    boxes = boxes - np.tile(low, 2)
    seen = disparity_px[low[1] : high[1], low[0] : high[0]]
    pairs, agreeing = np.zeros(seen.shape, np.uint8), np.zeros(seen.shape, np.uint8)
    for other, of in ((seen[:, step:], np.s_[:, :-step]), (seen[step:], np.s_[:-step])):
        difference = np.abs(other - seen[of])
        pairs[of] += np.isfinite(difference)
        agreeing[of] += difference <= config.neighbour_tolerance_px
    n, good = _sums(pairs, boxes), _sums(agreeing, boxes)
    return np.where(n >= config.min_pairs, good / np.maximum(n, 1), np.nan)


def _sums(values: UInt8Array, boxes: IntArray) -> FloatArray:
    """Sums over boxes (n, 4) of whole pixels, shape (n,)."""
    total = cv2.integral(values).astype(float)
    x0, y0, x1, y1 = boxes.T
    return np.asarray(total[y1, x1] - total[y0, x1] - total[y1, x0] + total[y0, x0])


def _on_ground(disparity_px: Float32Array, seen_from: GroundedStereo, config: PlausibilityConfig) -> float:
    expected = seen_from.ground_disparity_of_picture()
    # rows in which the ground is near enough somewhere
    rows = np.flatnonzero((expected[:, [0, -1]] >= config.farthest_px).any(axis=1))
    if not len(rows):
        return float("nan")
    expected, seen = expected[rows[0] :], disparity_px[rows[0] :]
    looked_at = (expected >= config.farthest_px) & np.isfinite(seen)
    known = np.count_nonzero(looked_at)
    if known < config.min_ground:
        return float("nan")
    near = np.abs(seen - expected) <= np.maximum(config.ground_px, config.ground_share * expected)
    return float(np.count_nonzero(near & looked_at) / known)
