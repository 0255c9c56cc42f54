"""Figures of ``rescore.metrics.curves`` for many bootstrap resamples at once.

A resample is given as the number of times that each image was drawn.

The outcome of a candidate depends on its own image alone, so it stays as it is, and so does the ranking:
running sums of weights along it give every curve. Copies of one candidate follow each other; copies of a tie
enter a curve together.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray
from rescore.metrics.curves import COCO_RECALLS, RECALL_LEVELS
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable, best_first

Weights = NDArray[np.int32]

CELLS = 2_000_000
"""Sets of weights times candidates that are held at once."""
_CACHED = 2**15
"""Sets of weights times candidates that stay in the processor's cache."""


@dataclass(frozen=True)
class Levels:
    """Where the curve of true-positive rate over false positives an image is read off."""

    fppi: tuple[float, ...] = (0.1, 0.3, 1.0)
    """False positives an image at which the rate is read off."""
    recalls: tuple[float, ...] = RECALL_LEVELS
    """Rates at which false positives an image are read off, above 0."""


def weighted_figures(
    match: MatchTable, cars_of_image: IntArray, weight: Weights, levels: Levels
) -> FloatArray:
    """A row for each set of weights, shape (r, 2 + f + q).

    Columns: area under the candidate ROC, COCO's average precision, the rate at each of f levels of false
    positives an image (the last threshold with at most so many), and false positives an image at each of q
    rates (infinity where it is never reached). NaN where undefined, as in ``rescore.metrics.curves``.

    Args:
        match: the table.
        cars_of_image: annotated cars of each image, shape (n_images,); ``TruthTable.cars_of_image``.
        weight: how often each image counts, shape (r, n_images).
        levels: where the curve is read.
    """
    standing = _Standing.of(match)
    chunks = _chunks(match, weight)
    return np.concatenate([standing.figures(cars_of_image, chunk, levels) for chunk in chunks])


def average_precisions(match: MatchTable, cars_of_image: IntArray, weight: Weights) -> FloatArray:
    """COCO's average precision for each set of weights (r, n_images), shape (r,); NaN where there is no car.

    The second column of ``weighted_figures``, which takes twice as long.
    """
    standing = _Standing.of(match)
    return np.concatenate([standing.precision(cars_of_image, chunk) for chunk in _chunks(match, weight)])


def _chunks(match: MatchTable, weight: Weights) -> Iterator[Weights]:
    step = max(1, CELLS // max(len(match.image), 1))
    return (weight[i : i + step] for i in range(0, len(weight), step))


@dataclass(frozen=True, eq=False)
class _Standing:
    """Hits (k,) and false positives (m,) of a table, best first, and where the hits stand among both."""

    hit_image: IntArray
    false_image: IntArray
    false_ahead: IntArray
    """False positives before each hit, equal rankings in the order given, shape (k,)."""
    false_above: IntArray
    """False positives of higher ranking than each hit, shape (k,)."""
    false_reached: IntArray
    """False positives of each hit's ranking or higher, shape (k,)."""
    hits_reached: IntArray
    """Hits of each hit's ranking or higher, shape (k,)."""

    @staticmethod
    def of(match: MatchTable) -> "_Standing":
        order = best_first(match.ranking)
        fall, outcome, image = -match.ranking[order], match.outcome[order], match.image[order]
        hit, false = outcome == HIT, (outcome == FALSE_ALARM) | (outcome == DUPLICATE)
        return _Standing(
            image[hit],
            image[false],
            false_ahead=np.cumsum(false)[hit],
            false_above=np.searchsorted(fall[false], fall[hit], side="left"),
            false_reached=np.searchsorted(fall[false], fall[hit], side="right"),
            hits_reached=np.searchsorted(fall[hit], fall[hit], side="right"),
        )

    def figures(self, cars_of_image: IntArray, weight: Weights, levels: Levels) -> FloatArray:
        """Figures for sets of image weights, as ``weighted_figures`` returns them."""
        hits, false = _running(weight, self.hit_image), _running(weight, self.false_image)
        cars, images = weight @ cars_of_image, weight.sum(axis=1)
        # no car, no hit or no false positive makes 0 / 0, which is NaN as it should be
        with np.errstate(invalid="ignore", divide="ignore"):
            columns = [
                self._area(hits, false),
                self._average_precision(hits, false, cars),
                *self._readings(hits, false, cars, images, levels),
            ]
        return np.stack(columns, axis=1)

    def precision(self, cars_of_image: IntArray, weight: Weights) -> FloatArray:
        """Average precision for sets of image weights, as ``average_precisions`` returns it."""
        hits, false = _running(weight, self.hit_image), _running(weight, self.false_image)
        with np.errstate(invalid="ignore", divide="ignore"):
            return self._average_precision(hits, false, weight @ cars_of_image)

    def _area(self, hits: Weights, false: Weights) -> FloatArray:
        """How often a hit ranks above a false positive, ties half, shape (r,)."""
        all_hits, all_false = hits[:, -1].astype(float), false[:, -1].astype(float)
        beaten = all_false[:, None] - (false[:, self.false_above] + false[:, self.false_reached]) / 2
        won = (np.diff(hits, axis=1) * beaten).sum(axis=1)
        return np.asarray(won / (all_hits * all_false))

    def _average_precision(self, hits: Weights, false: Weights, cars: IntArray) -> FloatArray:
        """Mean of the highest precision at or beyond COCO's recalls, shape (r,).

        Precision is best at hits, and among the copies of a hit at the last one.
        """
        found = hits[:, 1:]
        seen = found + false[:, self.false_ahead]
        precision = np.divide(found, seen, out=np.zeros(found.shape), where=seen > 0)
        best_beyond = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
        levels_reached = np.searchsorted(COCO_RECALLS, found / cars[:, None], side="right")
        newly_reached = np.diff(levels_reached, axis=1, prepend=0)
        mean = (best_beyond * newly_reached).sum(axis=1) / len(COCO_RECALLS)
        return np.where(cars > 0, mean, np.nan)

    def _readings(
        self, hits: Weights, false: Weights, cars: IntArray, images: IntArray, levels: Levels
    ) -> Iterator[FloatArray]:
        """The rate at each level of false positives an image, then the reverse, each of shape (r,)."""
        rate = hits[:, self.hits_reached] / cars[:, None]
        fppi = false[:, self.false_reached] / images[:, None]
        rows = np.arange(len(rate))
        none_yet = np.where(cars > 0, 0.0, np.nan)[:, None]
        rate_from_none = np.concatenate([none_yet, rate], axis=1)
        fppi_to_never = np.concatenate([fppi, np.full((len(fppi), 1), np.inf)], axis=1)
        for level in levels.fppi:
            yield rate_from_none[rows, [np.searchsorted(row, level, side="right") for row in fppi]]
        for level in levels.recalls:
            # the same allowance for rounding as in rescore.metrics; no car: the rate is NaN and never reached
            reached = [np.searchsorted(row, level - 1e-12) for row in rate]
            yield fppi_to_never[rows, np.where(cars > 0, reached, rate.shape[1])]


def _running(weight: Weights, image: IntArray) -> Weights:
    """Running sums of the weights of rows (n,) of the given images, from 0, shape (r, n + 1)."""
    total = np.zeros((len(weight), len(image) + 1), np.int32)
    step = max(1, min(_CACHED // max(len(image), 1), len(weight)))
    drawn = np.empty((step, len(image)), np.int32)
    for start in range(0, len(weight), step):
        rows = total[start : start + step, 1:]
        np.take(weight[start : start + step], image, axis=1, out=drawn[: len(rows)], mode="clip")
        np.cumsum(drawn[: len(rows)], axis=1, out=rows)
    return total
