"""Boxes of one picture that are on the same object: a detector rarely finds a car once.

Detectors drop boxes that overlap much in the picture. What is left are boxes on parts of a car and looser
ones around it, which overlap less; in 3D their fitted instances stand at the same place. Cars that stand side
by side or behind each other overlap in the picture too, but not on the ground.
"""

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.boxes import paired_overlap
from rescore.data.boxes3d import Boxes3D
from rescore.metrics.boxes3d import footprint_shares

FOOTPRINT_SHARE = 0.4
"""Share of the smaller of two footprints that both have in common, above which it is one car. This and the
next were chosen on 61 frames of the KITTI road benchmark (docs/boxes3d.md)."""
PICTURE_SHARE = 0.3
"""Share of the smaller of two boxes in the picture that both must have in common."""


def same_car(xyxy_px: FloatArray, boxes3d: Boxes3D) -> BoolArray:
    """Whether each two of the n boxes of one picture show the same car, shape (n, n); true of a box itself.

    Args:
        xyxy_px: Boxes, shape (n, 4), pixel edges.
        boxes3d: The 3D box of each; one of NaN shows the same car as none.
    """
    of_own = paired_overlap(xyxy_px[:, None], xyxy_px[None])[1]
    a, b = np.indices(of_own.shape).reshape(2, -1)
    on_ground = footprint_shares(boxes3d[a], boxes3d[b]).reshape(of_own.shape)
    return np.asarray((np.maximum(of_own, of_own.T) > PICTURE_SHARE) & (on_ground > FOOTPRINT_SHARE))


def rival(overlap: FloatArray, same: BoolArray) -> FloatArray:
    """How much better the best other box on the same car frames it than each box does, shape (n,).

    In [-1, 1]: the overlap of that box less the own one; 0 where no other box is on the car.

    Args:
        overlap: Expected intersection over union of each box with the instance that the disparity shows in
            it, shape (n,); NaN, for which the cue is silent, where there is none.
        same: Whether each two boxes show the same car, shape (n, n).
    """
    others = np.where(same & np.isfinite(overlap)[None, :], overlap[None, :], -np.inf)
    np.fill_diagonal(others, -np.inf)
    best = others.max(axis=1, initial=-np.inf)
    return np.where(np.isfinite(best), best, overlap) - overlap
