"""Average precision and orientation similarity as KITTI's benchmark computes them.

Precision is read where the detector's own hits pass 40 recalls (Geiger, Lenz, Urtasun 2012; 40 recalls in
place of 11, without that of 0, after Simonelli et al. 2019). Cars and detections may be left out: a hit on a
car that is left out, or by a detection that is, counts neither for nor against.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray

N_RECALLS = 40


@dataclass(frozen=True, eq=False)
class Judged:
    """What is judged: n detections against m cars, of any number of images."""

    ranking: FloatArray
    """What detections are ranked by, larger is better, shape (n,)."""
    left_out: BoolArray
    """Detections that are neither right nor wrong, as those that are too small, shape (n,)."""
    excused: BoolArray
    """Detections that are no false positives where they find no car, as those on an ignore region, shape
    (n,)."""
    car_left_out: BoolArray
    """Cars that need not be found, shape (m,)."""

    @property
    def n_cars(self) -> int:
        """Cars that are to be found."""
        return int((~self.car_left_out).sum())


@dataclass(frozen=True, eq=False)
class Touching:
    """The p pairs of a detection and a car of one image that overlap enough."""

    detection: IntArray
    """Row of the detection, shape (p,)."""
    car: IntArray
    """Row of the car, shape (p,)."""
    overlap: FloatArray
    """Shape (p,), above 0."""
    similarity: FloatArray
    """Orientation similarity of the two in [0, 1], shape (p,); 0 where the detection says nothing of it."""

    def by_car(self) -> Iterator[tuple[int, IntArray]]:
        """Each car that has a pair, in order, with its pairs by detection."""
        order = np.lexsort((self.detection, self.car))
        cars, first = np.unique(self.car[order], return_index=True)
        yield from zip(cars.tolist(), np.split(order, first[1:]), strict=False)


@dataclass(frozen=True)
class KittiPrecision:
    """Means over 40 recalls, recalls that are never reached counting 0; NaN where no car is to be found."""

    average_precision: float
    orientation_similarity: float
    """As the average precision, each hit counted by its orientation similarity."""


def orientation_similarity(a_rad: FloatArray, b_rad: FloatArray) -> FloatArray:
    """1 where two angles agree, 0 where they are opposite: (1 + cos(a - b)) / 2; 0 where one is NaN."""
    similarity = (1 + np.cos(a_rad - b_rad)) / 2
    return np.where(np.isnan(similarity), 0.0, similarity)


def kitti_precision(judged: Judged, pairs: Touching) -> KittiPrecision:
    """Average precision and orientation similarity of detections against cars."""
    if not judged.n_cars:
        return KittiPrecision(np.nan, np.nan)
    thresholds = _thresholds(_rankings_of_hits(judged, pairs), judged.n_cars)
    hits, similarity, false = _counts(judged, pairs, thresholds)
    accepted = np.maximum(hits + false, 1)
    return KittiPrecision(_mean_beyond(hits / accepted), _mean_beyond(similarity / accepted))


def _rankings_of_hits(judged: Judged, pairs: Touching) -> FloatArray:
    """Rankings of the detections that find a car when all are accepted, best first.

    Each car takes the best-ranked free detection that touches it.
    """
    free = np.ones(len(judged.ranking), bool)
    found: list[float] = []
    for car, rows in pairs.by_car():
        near = pairs.detection[rows]
        near = near[free[near]]
        if not len(near):
            continue
        best = near[np.argmax(judged.ranking[near])]
        free[best] = False
        if not (judged.car_left_out[car] or judged.left_out[best]):
            found.append(float(judged.ranking[best]))
    return np.sort(np.array(found))[::-1]


def _thresholds(rankings: FloatArray, n_cars: int) -> FloatArray:
    """The rankings at which the recall comes closest to each of 0, 1/40, ... 1, as far as it goes."""
    kept: list[float] = []
    wanted, last = 0.0, len(rankings) - 1
    for i, ranking in enumerate(rankings):
        here, following = (i + 1) / n_cars, (i + 2) / n_cars
        if i < last and following - wanted < wanted - here:
            continue
        kept.append(ranking)
        wanted += 1 / N_RECALLS
    return np.array(kept)


def _counts(
    judged: Judged, pairs: Touching, thresholds: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hits, their orientation similarity and false positives at each threshold, shapes (t,).

    Each car takes the accepted free detection that overlaps it most, or the first one that is left out where
    there is no other.
    """
    accepted = judged.ranking >= thresholds[:, None]
    used = np.zeros_like(accepted)
    hits, similarity = np.zeros(len(thresholds)), np.zeros(len(thresholds))
    for car, rows in pairs.by_car():
        near = pairs.detection[rows]
        out = judged.left_out[near]
        first = 1 / np.arange(2, len(near) + 2)
        free = accepted[:, near] & ~used[:, near]
        closeness = free * np.where(out, first, 1 + pairs.overlap[rows])
        best = np.argmax(closeness, axis=1)
        takes = np.flatnonzero(closeness.max(axis=1) > 0)
        used[takes, near[best[takes]]] = True
        if not judged.car_left_out[car]:
            counts = takes[~out[best[takes]]]
            hits[counts] += 1
            similarity[counts] += pairs.similarity[rows[best[counts]]]
    false = accepted & ~used & ~judged.left_out & ~judged.excused
    return hits, similarity, false.sum(axis=1).astype(float)


def _mean_beyond(values: FloatArray) -> float:
    """Mean over 40 recalls of the highest value at or beyond each."""
    best = np.maximum.accumulate(values[::-1])[::-1]
    return float(best[1:].sum() / N_RECALLS)
