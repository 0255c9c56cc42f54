"""Second boxes of one car, found in 3D after rescoring: the best one stays, the others rank below all.

Detectors drop boxes that overlap much in the picture. What is left are boxes on parts of a car and looser
ones around it, which overlap less; in 3D their fitted instances stand at the same place. Cars that stand side
by side or behind each other overlap in the picture too, but not on the ground.
"""

from dataclasses import replace

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.boxes import paired_overlap
from recon.errors import Reason
from rescore.data.boxes3d import Boxes3D
from rescore.evidence.candidates import RescoredTable
from rescore.metrics.boxes3d import footprint_shares

SECOND_BOX_FACTOR = 1e-15
"""Posteriors of second boxes are multiplied by this: they keep their order below every posterior that a box
which stays has in practice, and are still told apart in single precision."""


FOOTPRINT_SHARE = 0.4
"""Share of the smaller of two footprints that both have in common, above which it is one car. This and the
next were chosen on 61 frames of the KITTI road benchmark (docs/boxes3d.md)."""
PICTURE_SHARE = 0.3
"""Share of the smaller of two boxes in the picture that both must have in common."""


def suppress_second_boxes(rescored: RescoredTable) -> RescoredTable:
    """The candidates, row by row, with second boxes of the same car ranked below all others.

    In each image the best posterior goes first. A later box whose 3D box shows the same car as that of one
    that stays gets status "second_box", a reason that names the one that stays, and
    ``SECOND_BOX_FACTOR`` times its posterior. A candidate without a 3D box stays.
    """
    table, posterior = rescored.candidates, rescored.posterior.copy()
    if table.boxes3d is None:
        return rescored
    status, detail = table.status.copy(), table.reason_detail.copy()
    for image_id in np.unique(table.image_id):
        rows = np.flatnonzero(table.image_id == image_id)
        one, boxes3d = table.take(rows), table.boxes3d[rows]
        for second, first in _second_boxes(one.xyxy_px, boxes3d, posterior[rows]).items():
            i = rows[second]
            posterior[i] *= SECOND_BOX_FACTOR
            status[i] = Reason.SECOND_BOX.value
            edges = ", ".join(f"{edge:.0f}" for edge in one.xyxy_px[first])
            detail[i] = f"the same car as candidate {one.rank[first] + 1} at {edges}"
    return RescoredTable(replace(table, status=status, reason_detail=detail), posterior)


def _second_boxes(xyxy_px: FloatArray, boxes3d: Boxes3D, posterior: FloatArray) -> dict[int, int]:
    """For each row of one image that is a second box, the row that stays in its place."""
    found: dict[int, int] = {}
    stay: list[int] = []
    same_car = _same_car(xyxy_px, boxes3d)
    for i in np.argsort(-posterior, kind="stable").tolist():
        same = np.flatnonzero(same_car[i, stay])
        if len(same):
            found[i] = stay[same[0]]
        else:
            stay.append(i)
    return found


def _same_car(xyxy_px: FloatArray, boxes3d: Boxes3D) -> BoolArray:
    """Whether each two of the n boxes of one image show the same car, shape (n, n)."""
    of_own = paired_overlap(xyxy_px[:, None], xyxy_px[None])[1]
    a, b = np.indices(of_own.shape).reshape(2, -1)
    on_ground = footprint_shares(boxes3d[a], boxes3d[b]).reshape(of_own.shape)
    return np.asarray((np.maximum(of_own, of_own.T) > PICTURE_SHARE) & (on_ground > FOOTPRINT_SHARE))
