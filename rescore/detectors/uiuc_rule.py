"""The evaluation rule of the UIUC car set (Agarwal, Awan and Roth 2004), for windows of one size."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.boxes import suppress
from rescore.detectors.base import Detections

TOLERANCE = 0.25
"""Half axes of the ellipse of right places around a car's, as shares of the car's width and height."""

MAX_IOU = 0.3
"""Overlap of windows above which the worse one is a second find of the same car."""


@dataclass(frozen=True, eq=False)
class RecallPrecision:
    """Recall and precision at every number of detections, best score first over all pictures."""

    n_cars: int
    score: FloatArray
    """Shape (n,), descending."""
    hit: BoolArray
    """Shape (n,): the detection found a car that no better one has found."""

    @property
    def recall(self) -> FloatArray:
        """Shape (n,): cars found over all cars."""
        return np.cumsum(self.hit) / self.n_cars

    @property
    def precision(self) -> FloatArray:
        """Shape (n,): cars found over detections."""
        return np.cumsum(self.hit) / np.arange(1, len(self.hit) + 1)

    @property
    def equal_error_recall(self) -> float:
        """Recall where it equals precision: with as many detections as cars, or all where there are fewer."""
        return float(self.hit[: self.n_cars].sum() / self.n_cars)

    def summary(self) -> str:
        """The curve in a line."""
        return (
            f"{self.n_cars} cars, recall {self.equal_error_recall:.1%} at equal error, "
            f"{self.recall_at_precision(0.9):.1%} at precision 90 %, "
            f"{self.recall_at_precision(0.99):.1%} at 99 %, {self.hit.sum() / self.n_cars:.1%} at most"
        )

    def recall_at_precision(self, least: float) -> float:
        """The greatest recall with at least this precision; 0 where there is none."""
        return float(self.recall[self.precision >= least].max(initial=0.0))


def hits(
    found_px: FloatArray, score: FloatArray, cars_px: FloatArray, width_px: float, height_px: float
) -> BoolArray:
    """For each detection (n, 2) of a picture: is it the one that found a car (m, 2).

    Corners are x, y. A detection is right within the ellipse of ``TOLERANCE``; one hit a car, the best score
    first; where several cars are near, the nearest that is still free.
    """
    axes = TOLERANCE * np.array([width_px, height_px])
    distance = (((found_px[:, None] - cars_px[None]) / axes) ** 2).sum(axis=2)
    hit = np.zeros(len(found_px), bool)
    for i in np.argsort(-score, kind="stable"):
        if distance.shape[1] and distance[i].min() <= 1:
            hit[i] = True
            distance[:, distance[i].argmin()] = np.inf
    return hit


def recall_precision(pictures: Iterable[tuple[FloatArray, BoolArray, int]]) -> RecallPrecision:
    """The curve over pictures, each (scores (n,), hits (n,), number of its cars).

    At equal scores false alarms come first, so that a tie never flatters.
    """
    everything = list(pictures)
    score = np.concatenate([np.zeros(0), *(s for s, _, _ in everything)])
    hit = np.concatenate([np.zeros(0, bool), *(h for _, h, _ in everything)])
    order = np.lexsort((hit, -score))
    return RecallPrecision(sum(n for _, _, n in everything), score[order], hit[order])


def lone(found: Detections) -> Detections:
    """The windows that no better one overlaps by more than ``MAX_IOU``; not cut at the picture's edge.

    The rule compares corners, which a cut would move.
    """
    keep = suppress(found.xyxy_px, found.score, MAX_IOU)
    return Detections(found.xyxy_px[keep], found.score[keep])
