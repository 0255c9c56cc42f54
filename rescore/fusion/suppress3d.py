"""Second boxes of one car, found in 3D after rescoring: the best one stays, the others rank below all.

Which boxes show the same car is told by ``rescore.cues.rivals``.
"""

from dataclasses import replace

import numpy as np

from recon.arrays import FloatArray, rows_by_value
from recon.errors import Reason
from rescore.cues.rivals import same_car
from rescore.data.boxes3d import Boxes3D
from rescore.evidence.candidates import RescoredTable

SECOND_BOX_FACTOR = 1e-15
"""Posteriors of second boxes are multiplied by this: they keep their order below every posterior that a box
which stays has in practice, and are still told apart in single precision."""


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
    for rows in rows_by_value(table.image_id).values():
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
    same = same_car(xyxy_px, boxes3d)
    for i in np.argsort(-posterior, kind="stable").tolist():
        first = np.flatnonzero(same[i, stay])
        if len(first):
            found[i] = stay[first[0]]
        else:
            stay.append(i)
    return found
