"""Bands of 95 % around the curves of a match table, by the bootstrap of ``rescore.metrics.bootstrap``.

A band holds each point of a curve by itself, not the curve as a whole: of a curve that is drawn again from
other images, one point in twenty lies outside.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, IntArray
from rescore.metrics.bootstrap import KINDS, draw_images, interval
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable
from rescore.metrics.resampled import CELLS

N_RESAMPLES = 500
N_POINTS = 60
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Band:
    """Where a curve may lie, at some x. All of shape (g,)."""

    x: FloatArray
    """Places on the horizontal axis, rising."""
    low: FloatArray
    """Lower end of the curve's interval at each x."""
    high: FloatArray
    """Upper end of the curve's interval at each x."""


@dataclass(frozen=True, eq=False)
class CurveBands:
    """The bands of the three curves of ``rescore.metrics.curves``."""

    candidate: Band
    """Band of the candidate ROC: share of the hits over share of the false candidates."""
    cars: Band
    """Band of the share of all annotated cars over false positives an image, at x even on a log axis."""
    precision: Band
    """Band of the precision where a share of all cars is reached, over that share; up to the share that the
    candidates hold. Images drawn again that never reach it count as precision 0 there, as for average
    precision."""


def curve_bands(match: MatchTable, cars_of_image: IntArray, seed: int) -> CurveBands | None:
    """The bands of the curves of a table; None where images, cars, hits or false positives are too few.

    Args:
        match: the table.
        cars_of_image: annotated cars of each image, shape (n_images,), in the order of ``match.image``.
        seed: draws the images; tables of the same images and seed are resampled alike.
    """
    n_images = len(cars_of_image)
    if n_images < 2 or not cars_of_image.sum():
        return None
    drawn = draw_images(n_images, N_RESAMPLES, np.random.default_rng(seed))
    weight = np.concatenate([np.ones((1, n_images), np.int32), drawn])
    whole = _Curves.of(match, cars_of_image, weight[:1])
    if np.isnan(whole.kept).any():
        return None
    shares = np.linspace(0, 1, N_POINTS)
    levels = np.geomspace(0.5 / n_images, whole.alarms[0, -1], N_POINTS)
    recalls = np.linspace(1 / N_POINTS, whole.rate[0, -1], N_POINTS)
    step = max(1, CELLS // max(len(match.image), 1))
    parts = []
    for first in range(0, len(weight), step):
        curves = _Curves.of(match, cars_of_image, weight[first : first + step])
        parts.append(
            (
                _last_within(curves.kept[1], curves.kept[0], shares),
                _last_within(curves.alarms, curves.rate, levels),
                _first_reaching(curves.rate, curves.precision, recalls),
            )
        )
    readings = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    places = (shares, levels, recalls)
    return CurveBands(*(_band(x, y, n_images) for x, y in zip(places, readings, strict=True)))


@dataclass(frozen=True, eq=False)
class _Curves:
    """The curves of some sets of weights, a row a set, (r, t)."""

    kept: FloatArray
    """Shares of the hits, and of the false positives, (2, r, t)."""
    rate: FloatArray
    alarms: FloatArray
    precision: FloatArray

    @staticmethod
    def of(match: MatchTable, cars_of_image: IntArray, weight: NDArray[np.int32]) -> "_Curves":
        hits, false = _running(match, weight)
        cars, images = weight @ cars_of_image, weight.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return _Curves(
                np.stack([hits / hits[:, -1:], false / false[:, -1:]]),
                hits / cars[:, None],
                false / images[:, None],
                hits / (hits + false),
            )


def _running(match: MatchTable, weight: NDArray[np.int32]) -> tuple[IntArray, IntArray]:
    """Weighted hits and false positives at and above each distinct ranking, (r, t), from none."""
    hit, false = match.outcome == HIT, (match.outcome == FALSE_ALARM) | (match.outcome == DUPLICATE)
    order = np.argsort(-match.ranking, kind="stable")
    ranking = match.ranking[order]
    last_of_tie = np.append(np.diff(ranking) != 0, True) if len(ranking) else np.zeros(0, bool)
    of_candidate = weight[:, match.image[order]]
    none = np.zeros((len(weight), 1), np.int64)

    def running(counted: BoolArray) -> IntArray:
        total = np.cumsum(of_candidate * counted[order], axis=1, dtype=np.int64)[:, last_of_tie]
        return np.concatenate([none, total], axis=1)

    return running(hit), running(false)


def _last_within(x: FloatArray, y: FloatArray, levels: FloatArray) -> FloatArray:
    """The y of each row's last point whose x is at most each level, (r, g)."""
    at = [np.searchsorted(row, levels + 1e-12, side="right") - 1 for row in x]
    return np.take_along_axis(y, np.maximum(at, 0), axis=1)


def _first_reaching(x: FloatArray, y: FloatArray, levels: FloatArray) -> FloatArray:
    """The y of each row's first point whose x is at least each level, (r, g); 0 where none is."""
    padded = np.concatenate([y, np.zeros((len(y), 1))], axis=1)
    at = [np.searchsorted(row, levels - 1e-12, side="left") for row in x]
    return np.take_along_axis(padded, np.array(at), axis=1)


def _band(x: FloatArray, y: FloatArray, n_images: int) -> Band:
    """The band of readings (1 + r, g): on the images as they are, then on r resamples."""
    ends = [interval(column, KINDS["recall"], CONFIDENCE, n_images) for column in y.T]
    use = np.array([not np.isnan(e.value) for e in ends])
    low, high = (np.array([getattr(e, end) for e in ends]) for end in ("low", "high"))
    return Band(x[use], low[use], high[use])
