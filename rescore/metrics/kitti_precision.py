"""Average precision and orientation similarity as KITTI's benchmark computes them.

Precision is read where the detector's own hits pass 40 recalls (Geiger, Lenz, Urtasun 2012; 40 recalls in
place of 11, without that of 0, after Simonelli et al. 2019). Cars and detections may be left out: a hit on a
car that is left out, or by a detection that is, counts neither for nor against.
"""

from collections.abc import Sequence
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

    def by_car(self) -> "Touching":
        """The pairs by car, those of one car by detection."""
        before, after = slice(None, -1), slice(1, None)
        falls = (self.car[after] < self.car[before]) | (
            (self.car[after] == self.car[before]) & (self.detection[after] < self.detection[before])
        )
        return self[np.lexsort((self.detection, self.car))] if falls.any() else self

    @staticmethod
    def joined(parts: "Sequence[Touching]") -> "Touching":
        """The pairs of one part below those of the other."""
        names = ("detection", "car", "overlap", "similarity")
        return Touching(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))

    def __getitem__(self, pairs: BoolArray | IntArray | slice) -> "Touching":
        """The pairs of a mask, an index or a slice."""
        return Touching(self.detection[pairs], self.car[pairs], self.overlap[pairs], self.similarity[pairs])


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
    from rescore.metrics.kitti_loops import counts_at, hits_of_all, passed_recalls  # noqa: PLC0415 (compiles)

    if not judged.n_cars:
        return KittiPrecision(np.nan, np.nan)
    pairs = pairs.by_car()
    found = hits_of_all(pairs.car, pairs.detection, judged.ranking, judged.left_out, judged.car_left_out)
    best_first = np.sort(judged.ranking[found])[::-1]
    thresholds = best_first[passed_recalls(len(best_first), judged.n_cars, N_RECALLS)]
    hits, similarity, false = counts_at(
        thresholds,
        pairs.car,
        pairs.detection,
        pairs.overlap,
        pairs.similarity,
        judged.ranking,
        judged.left_out,
        judged.excused,
        judged.car_left_out,
    )
    accepted = np.maximum(hits + false, 1)
    return KittiPrecision(_mean_beyond(hits / accepted), _mean_beyond(similarity / accepted))


def _mean_beyond(values: FloatArray) -> float:
    """Mean over 40 recalls of the highest value at or beyond each."""
    best = np.maximum.accumulate(values[::-1])[::-1]
    return float(best[1:].sum() / N_RECALLS)
