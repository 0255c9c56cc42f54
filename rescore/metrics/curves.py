"""Curves and figures of a match table. Arrays in, arrays out; drawing is elsewhere.

Hits are cars found; false alarms and duplicates are false positives; ignored candidates count nowhere. Every
image and every annotated car counts, those without candidates too. Candidates of equal ranking enter a curve
together.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, IntArray
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable, best_first, kept_rows

RECALL_LEVELS = (0.5, 0.6, 0.7, 0.8)
"""Where false positives per image are read off."""
COCO_RECALLS = np.linspace(0, 1, 101)


@dataclass(frozen=True, eq=False)
class Curve:
    """A step curve: one point for each threshold between distinct rankings, from none to all candidates."""

    x: FloatArray
    """Shape (t,), rising."""
    y: FloatArray
    """Shape (t,), rising."""
    threshold: FloatArray
    """Ranking of the worst candidate that counts, shape (t,); infinity at the first point."""


@dataclass(frozen=True)
class Summary:
    """The figures of one match table."""

    auc: float
    """Area under the candidate ROC; NaN where there are only hits or only false alarms."""
    average_precision: float
    """Average precision, NaN where no car is annotated."""
    recall_ceiling: float
    """Share of the cars found when every candidate counts."""
    fppi_at_recall: dict[float, float | None]
    """False positives an image at each recall level; None where it is never reached."""


@dataclass(frozen=True)
class Ties:
    """How far average precision depends on the order of candidates of equal ranking."""

    n: int
    """Candidates that have the ranking of another, where one is a hit and one a false positive."""
    lowest: float
    """Average precision where the hits of each ranking come last; NaN where no car is annotated."""
    highest: float
    """Average precision where they come first."""


def candidate_roc(match: MatchTable) -> Curve:
    """The ROC over candidates alone: x, share of the false ones kept; y, share of the hits kept.

    Cars that no candidate found do not appear here; see ``recall_curve``.
    """
    return _roc(*_cumulative(match))


def recall_curve(match: MatchTable) -> Curve:
    """Recall over all images and all annotated cars: x, false positives per image; y, true-positive rate."""
    return _recall(match, *_cumulative(match))


def area_under_roc(curve: Curve) -> float:
    """Area under a candidate ROC by trapezoids: how often a hit ranks above a false one, ties half.

    NaN where there are only hits, only false ones, or nothing.
    """
    if np.isnan(curve.x[-1] + curve.y[-1]):
        return float("nan")
    # as np.trapezoid, in place: curves may have many million points
    areas = np.diff(curve.x)
    areas *= curve.y[1:] + curve.y[:-1]
    areas /= 2
    return float(areas.sum())


def average_precision(match: MatchTable) -> float:
    """COCO's average precision: mean of the highest precision at or beyond 101 recalls from 0 to 1.

    Recalls that are never reached give 0, so missed cars count. NaN where no car is annotated. Candidates of
    equal ranking count one after another in the order given, and recalls are compared exactly, as in
    COCO's own tool.
    """
    hit, false = _kinds(match.outcome[best_first(match.ranking)])
    return _precision(np.cumsum(false, dtype=np.int64)[hit], match.n_cars)


def ties(match: MatchTable) -> Ties:
    """What depends on the order in which hits and false positives of equal ranking are given."""
    hits, falses, _ = _cumulative(match)
    # of each distinct ranking that a candidate has which counts
    n_hits, n_falses = np.diff(hits).astype(np.int64), np.diff(falses).astype(np.int64)
    mixed = (n_hits > 0) & (n_falses > 0)
    hits_first, hits_last = (np.repeat(ahead, n_hits) for ahead in (falses[:-1], falses[1:]))
    return Ties(
        int((n_hits + n_falses)[mixed].sum()),
        _precision(hits_last, match.n_cars),
        _precision(hits_first, match.n_cars),
    )


def _precision(false_ahead: FloatArray | IntArray, n_cars: int) -> float:
    """Average precision where so many false positives count before each hit (k,), the best hit first.

    Precision falls from one hit to the next, so that of the hits alone is looked at.
    """
    if not n_cars:
        return float("nan")
    hits = np.arange(1, len(false_ahead) + 1)
    best_beyond = np.maximum.accumulate((hits / (hits + false_ahead))[::-1])[::-1]
    at = np.searchsorted(hits / n_cars, COCO_RECALLS, side="left")
    return float(np.append(best_beyond, 0.0)[at].mean())


def index_at_recall(curve: Curve, recall: float) -> int | None:
    """Point of a recall curve where the true-positive rate first reaches ``recall``; None if never."""
    # a rate of 0.7 is a quotient of integers: allow for its rounding
    reached = np.flatnonzero(curve.y >= recall - 1e-12)
    return int(reached[0]) if len(reached) else None


def index_at_fppi(curve: Curve, fppi: float) -> int:
    """Last point of a recall curve with at most ``fppi`` false positives per image."""
    return int(np.flatnonzero(curve.x <= fppi + 1e-12)[-1])


def fppi_at_recall(curve: Curve, recall: float) -> float | None:
    """False positives per image where the true-positive rate first reaches ``recall``; None if never."""
    at = index_at_recall(curve, recall)
    return None if at is None else float(curve.x[at])


def recall_ceiling(curve: Curve) -> float:
    """Share of the cars found when every candidate counts."""
    return float(curve.y[-1])


def summarise(match: MatchTable) -> Summary:
    """The figures of one match table."""
    # one curve after the other: of very many candidates each takes hundreds of megabytes
    counted = _cumulative(match)
    ceiling, fppi = _readings(_recall(match, *counted))
    return Summary(area_under_roc(_roc(*counted)), average_precision(match), ceiling, fppi)


def _readings(recall: Curve) -> tuple[float, dict[float, float | None]]:
    """The recall ceiling, and false positives an image at each recall level."""
    return recall_ceiling(recall), {level: fppi_at_recall(recall, level) for level in RECALL_LEVELS}


def _kinds(outcome: NDArray[np.int8]) -> tuple[BoolArray, BoolArray]:
    """Masks of the rows that are hits, and of those that are false positives."""
    return outcome == HIT, (outcome == FALSE_ALARM) | (outcome == DUPLICATE)


def _roc(hits: FloatArray, false: FloatArray, threshold: FloatArray) -> Curve:
    """The ROC, in the arrays that are given."""
    with np.errstate(invalid="ignore"):
        hits /= hits[-1]
        false /= false[-1]
    return Curve(false, hits, threshold)


def _recall(match: MatchTable, hits: FloatArray, false: FloatArray, threshold: FloatArray) -> Curve:
    cars = match.n_cars or np.nan
    return Curve(false / max(match.n_images, 1), hits / cars, threshold)


def _cumulative(match: MatchTable) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hits and false positives at and above each distinct ranking (t,), with a first point of none."""
    hit, false = _kinds(match.outcome)
    counts = kept_rows(hit | false)
    ranking = match.ranking[counts]
    order = best_first(ranking)
    ranking = ranking[order]
    last_of_tie = np.append(ranking[1:] != ranking[:-1], True) if len(ranking) else np.zeros(0, bool)
    hits = np.cumsum(hit[counts][order])[last_of_tie]
    falses = np.cumsum(false[counts][order])[last_of_tie]
    return (
        np.concatenate([[0.0], hits]),
        np.concatenate([[0.0], falses]),
        np.concatenate([[np.inf], ranking[last_of_tie]]),
    )
