"""Second boxes of one car, found in 3D after rescoring: the best one stays, the others rank below all.

Detectors drop boxes that overlap much in the picture. What is left are boxes on parts of a car and looser
ones around it, which overlap less; in 3D their fitted instances stand at the same place. Cars that stand side
by side or behind each other overlap in the picture too, but not on the ground.
"""

from dataclasses import dataclass, replace

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.boxes import paired_overlap
from recon.errors import Reason
from rescore.evidence.candidates import CandidateTable, RescoredTable
from rescore.metrics.boxes3d import footprint_shares

SECOND_BOX_FACTOR = 1e-15
"""Posteriors of second boxes are multiplied by this: they keep their order below every posterior that a box
which stays has in practice, and are still told apart in single precision."""


@dataclass(frozen=True)
class SuppressConfig:
    """When two boxes are taken to show the same car. Chosen on 61 frames of the KITTI road benchmark
    (docs/boxes3d.md)."""

    footprint: float = 0.4
    """Share of the smaller of the two footprints that both have in common, above which it is one car."""
    picture: float = 0.3
    """Share of the smaller of the two boxes in the picture that both must have in common."""


def suppress_second_boxes(rescored: RescoredTable, config: SuppressConfig | None = None) -> RescoredTable:
    """The candidates, row by row, with second boxes of the same car ranked below all others.

    In each image the best posterior goes first. A later box whose 3D box shows the same car as that of one
    that stays gets status "second_box", a reason that names the one that stays, and
    ``SECOND_BOX_FACTOR`` times its posterior. A candidate without a 3D box stays.
    """
    table, posterior = rescored.candidates, rescored.posterior.copy()
    status, detail = table.status.copy(), table.reason_detail.copy()
    for image_id in np.unique(table.image_id):
        rows = np.flatnonzero(table.image_id == image_id)
        one = table.take(rows)
        for second, first in _second_boxes(one, posterior[rows], config or SuppressConfig()).items():
            i = rows[second]
            posterior[i] *= SECOND_BOX_FACTOR
            status[i] = Reason.SECOND_BOX.value
            edges = ", ".join(f"{edge:.0f}" for edge in one.xyxy_px[first])
            detail[i] = f"the same car as candidate {one.rank[first] + 1} at {edges}"
    return RescoredTable(replace(table, status=status, reason_detail=detail), posterior)


def _second_boxes(table: CandidateTable, posterior: FloatArray, config: SuppressConfig) -> dict[int, int]:
    """For each row of one image that is a second box, the row that stays in its place."""
    found: dict[int, int] = {}
    stay: list[int] = []
    for i in np.argsort(-posterior, kind="stable").tolist():
        same = np.flatnonzero(_same_car(table, i, stay, config))
        if len(same):
            found[i] = stay[same[0]]
        else:
            stay.append(i)
    return found


def _same_car(table: CandidateTable, row: int, others: list[int], config: SuppressConfig) -> BoolArray:
    """Whether a candidate shows the same car as each of others of its image, shape (len(others),)."""
    if table.boxes3d is None:
        return np.zeros(len(others), np.bool_)
    box, theirs = table.xyxy_px[row], table.xyxy_px[others]
    in_picture = np.maximum(paired_overlap(box, theirs)[1], paired_overlap(theirs, box)[1])
    on_ground = footprint_shares(table.boxes3d[[row] * len(others)], table.boxes3d[others])
    return np.asarray((in_picture > config.picture) & (on_ground > config.footprint))
