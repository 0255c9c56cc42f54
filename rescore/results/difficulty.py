"""How hard a data set is for a detector, and what makes it hard: the figures by which scenes are set."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, IntArray
from rescore.data.frames import DataSet
from rescore.data.rendered_kinds import kinds_of_table
from rescore.detectors.base import Detections
from rescore.metrics.curves import Curve, fppi_at_recall, recall_ceiling, recall_curve
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, MatchTable, TruthTable, greedy_match

CAR_LEVEL = 0.7
"""True-positive rate at which false positives are counted."""
MIN_VISIBILITY = 0.6
"""Visible share from which a car counts as seen."""


@dataclass(frozen=True)
class Difficulty:
    """What a detector makes of the cars of a data set that are seen well enough."""

    n_images: int
    """Number of all images, with and without a car."""
    n_cars: int
    """Cars seen well enough."""
    recall_ceiling: float
    """Share of the well-seen cars found when every candidate counts; NaN where there is no such car."""
    fppi_at_70: float | None
    """False positives an image where 70 % of the well-seen cars are found; None where they never are."""
    share_by_kind: Mapping[str, float]
    """Share of the false positives of ``fppi_at_70`` that each kind of thing makes, largest first; "" is
    ground or sky."""
    missed: tuple[int, ...]
    """Annotation ids of the cars that no candidate found."""


def difficulty(
    data: DataSet, detections_by_image: Mapping[int, Detections], min_visibility: float = MIN_VISIBILITY
) -> Difficulty:
    """The difficulty of ``data`` for a detector with these candidates; an image without any may be left out.

    Cars seen less than ``min_visibility`` are neither missed nor false alarms when found; cars of unknown
    visibility count as seen.
    """
    found = {f.image_id: detections_by_image.get(f.image_id, _NONE) for f in data.frames}
    image_id = np.repeat(np.array(list(found), np.int64), [len(d) for d in found.values()])
    boxes = np.concatenate([np.empty((0, 4)), *(d.xyxy_px for d in found.values())])
    score = np.concatenate([np.empty(0), *(d.score for d in found.values())])
    return difficulty_of_table(data, image_id, boxes, score, min_visibility)


def difficulty_of_table(
    data: DataSet,
    image_id: IntArray,
    boxes: FloatArray,
    score: FloatArray,
    min_visibility: float = MIN_VISIBILITY,
    alone: MatchTable | None = None,
) -> Difficulty:
    """The difficulty as ``difficulty`` has it, for a detector's candidates in one table.

    Args:
        data: the frames.
        image_id: image of each candidate, shape (n,).
        boxes: shape (n, 4), pixel edges.
        score: shape (n,).
        min_visibility: share from which a car counts as seen.
        alone: the match table of these scores against all cars, at the usual overlap; it serves where every
            car is seen. None where there is none.
    """
    truth = TruthTable.of(data)
    visibility = np.concatenate([np.zeros(0), *(data.truth[f.image_id].visibility for f in data.frames)])
    # a comparison with NaN is false: unknown visibility counts as seen
    hidden = ~truth.ignore & (visibility < min_visibility)
    truth = replace(truth, ignore=truth.ignore | hidden)
    match = greedy_match(image_id, boxes, score, truth) if alone is None or hidden.any() else alone
    curve = recall_curve(match)
    counted = _counted(match, curve)
    kind = np.full(len(image_id), "", dtype=object)
    kind[counted] = kinds_of_table(data.frames, image_id[counted], boxes[counted])
    cars = truth.annotation_id[~truth.ignore]
    return Difficulty(
        truth.n_images,
        truth.n_cars,
        recall_ceiling(curve),
        fppi_at_recall(curve, CAR_LEVEL),
        share_by_kind(match, curve, kind),
        tuple(int(a) for a in cars[~np.isin(cars, match.annotation_id)]),
    )


_NONE = Detections(np.empty((0, 4)), np.empty(0))


def share_by_kind(match: MatchTable, curve: Curve, kind: NDArray[np.object_]) -> dict[str, float]:
    """The share of each kind among the false positives where ``CAR_LEVEL`` of the cars are found, the largest
    first; ``kind`` is that of each candidate (n,)."""
    counts = Counter(kind[_counted(match, curve)].tolist())
    total = counts.total()
    return {name: n / total for name, n in sorted(counts.items(), key=lambda item: (-item[1], item[0]))}


def _counted(match: MatchTable, curve: Curve) -> BoolArray:
    """Mask of the false positives (n,) where ``CAR_LEVEL`` of the cars are found; none if that never is."""
    reached = np.flatnonzero(curve.y >= CAR_LEVEL - 1e-12)
    wrong = (match.outcome == FALSE_ALARM) | (match.outcome == DUPLICATE)
    least = curve.threshold[reached[0]] if len(reached) else np.inf
    return np.asarray(wrong & (match.ranking >= least))
