"""Compiled loops of ``rescore.metrics.kitti_precision``.

Pairs of a detection and a car come by car, those of one car by detection.
"""

import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.compiled import exact


@exact
def hits_of_all(
    car: IntArray, detection: IntArray, ranking: FloatArray, left_out: BoolArray, car_left_out: BoolArray
) -> BoolArray:
    """Mask of the detections (n,) that find a car when all are accepted: each car takes the best-ranked free
    one that touches it. A hit on a car that is left out, or by a detection that is, does not count."""
    used, counts = np.zeros(len(ranking), np.bool_), np.zeros(len(ranking), np.bool_)
    first = 0
    while first < len(car):
        end, best = first, -1
        while end < len(car) and car[end] == car[first]:
            d = detection[end]
            if not used[d] and (best < 0 or ranking[d] > ranking[best]):
                best = d
            end += 1
        if best >= 0:
            used[best] = True
            counts[best] = not (car_left_out[car[first]] or left_out[best])
        first = end
    return counts


@exact
def passed_recalls(n_hits: int, n_cars: int, n_recalls: int) -> IntArray:
    """The hits, counted from 0 as the best, whose recall comes closest to each of 0, 1/n, ... 1."""
    kept = np.zeros(n_recalls + 2, np.int64)
    n_kept, wanted = 0, 0.0
    for i in range(n_hits):
        here, following = (i + 1) / n_cars, (i + 2) / n_cars
        if i < n_hits - 1 and following - wanted < wanted - here:
            continue
        if n_kept < len(kept):
            kept[n_kept] = i
            n_kept += 1
        wanted += 1 / n_recalls
    return kept[:n_kept]


@exact
def _accepted(rising: FloatArray, ranking: FloatArray, but: BoolArray) -> FloatArray:
    """Detections (n,) at or above each threshold, whose negatives (t,) rise, but for some; t is 64 at most.

    A search of six halvings in a padded array has no branch that depends on the ranking: a processor guesses
    those of ``np.searchsorted`` wrong half of the time, which takes several times as long.
    """
    padded = np.full(64, np.inf)
    padded[: len(rising)] = rising
    found = np.zeros(65)
    for d in range(len(ranking)):
        at, own = 0, -ranking[d]
        for half in (32, 16, 8, 4, 2, 1):
            at += half * (padded[at + half - 1] < own)
        found[at] += 1 - but[d]
    return np.cumsum(found[: len(rising)])


@exact
def counts_at(
    threshold: FloatArray,
    car: IntArray,
    detection: IntArray,
    overlap: FloatArray,
    similarity: FloatArray,
    ranking: FloatArray,
    left_out: BoolArray,
    excused: BoolArray,
    car_left_out: BoolArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hits, their orientation similarity and false positives at each threshold (t,), falling, each (t,).

    Each car takes the accepted free detection that overlaps it most, or the first one that is left out where
    there is no other. There are 64 thresholds at most.
    """
    n, rising = len(threshold), -threshold
    hits, similar = np.zeros(n), np.zeros(n)
    false = _accepted(rising, ranking, left_out | excused)
    used = np.zeros(len(ranking), np.uint64)
    first = 0
    while first < len(car):
        end, lowest = first, n
        while end < len(car) and car[end] == car[first]:
            lowest = min(lowest, np.searchsorted(rising, -ranking[detection[end]]))
            end += 1
        for t in range(lowest, n):
            bit, best, closest = np.uint64(1) << np.uint64(t), -1, 0.0
            for k in range(first, end):
                d = detection[k]
                if ranking[d] >= threshold[t] and not used[d] & bit:
                    close = 1 / (k - first + 2) if left_out[d] else 1 + overlap[k]
                    if close > closest:
                        best, closest = k, close
            if best >= 0:
                d = detection[best]
                used[d] |= bit
                if not (left_out[d] or excused[d]):
                    false[t] -= 1
                if not (car_left_out[car[first]] or left_out[d]):
                    hits[t] += 1
                    similar[t] += similarity[best]
        first = end
    return hits, similar, false
