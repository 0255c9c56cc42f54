"""Where the curves of a run may lie: pointwise intervals by a bootstrap over images.

Images are drawn with replacement, as for the figures (``rescore.bootstrap``), and each draw gives a curve. At
every place of the horizontal axis the plain percentile interval of the heights is taken. It shows the spread;
the figures' own intervals, which are corrected for bias, are those of metrics.json.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rescore.bootstrap import draw_images
from rescore.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

N_RESAMPLES = 400
CONFIDENCE = 0.95
_STEPS = 120


@dataclass(frozen=True, eq=False)
class Band:
    """Lower and upper end of a curve over its horizontal axis."""

    x: FloatArray
    """Shape (k,), rising."""
    low: FloatArray
    """Shape (k,)."""
    high: FloatArray
    """Shape (k,)."""


@dataclass(frozen=True, eq=False)
class CurveBands:
    """The bands of one match table."""

    candidate: Band
    """x: share of the false candidates kept; height: share of the hits kept."""
    cars: Band
    """x: false positives an image; height: share of all annotated cars found."""
    precision: Band
    """x: share of all annotated cars found; height: precision. Ends where some resamples never get."""


def curve_bands(
    match: MatchTable, cars_of_image: IntArray, seed: int, fppi: tuple[float, float]
) -> CurveBands:
    """The bands of a match table.

    Args:
        match: the table.
        cars_of_image: annotated cars of each image, in the table's order of images, shape (n_images,).
        seed: draws the images.
        fppi: left and right end of the axis of false positives an image, above 0.
    """
    drawn = draw_images(match.n_images, N_RESAMPLES, np.random.default_rng(seed))
    order = np.argsort(-match.ranking, kind="stable")
    ranking = match.ranking[order]
    # candidates of equal ranking enter together
    ends = np.append(np.diff(ranking) != 0, True)[: len(ranking)]
    weight = drawn[:, match.image[order]]
    hits = _running(weight * (match.outcome[order] == HIT), ends)
    false = _running(weight * np.isin(match.outcome[order], (FALSE_ALARM, DUPLICATE)), ends)
    cars = np.maximum(drawn @ cars_of_image, 1)[:, None]
    shares, rates = np.linspace(0, 1, _STEPS), np.geomspace(*fppi, _STEPS)
    with np.errstate(invalid="ignore", divide="ignore"):
        roc = _heights(_last_at_most, false / false[:, -1:], hits / hits[:, -1:], shares)
        found = _heights(_last_at_most, false / match.n_images, hits / cars, rates)
        precision = _heights(_first_at_least, hits / cars, hits / (hits + false), shares)
    whole = np.isfinite(precision).all(axis=0)
    return CurveBands(_band(shares, roc), _band(rates, found), _band(shares[whole], precision[:, whole]))


def _running(counts: NDArray[np.int32], ends: NDArray[np.bool_]) -> FloatArray:
    """Running sums (r, t + 1) at the ends of ties, from nothing accepted to all."""
    total = np.cumsum(counts, axis=1)[:, ends]
    return np.concatenate([np.zeros((len(counts), 1)), total], axis=1)


def _last_at_most(x: FloatArray, at: FloatArray) -> IntArray:
    return np.asarray(np.searchsorted(x, at + 1e-12, side="right") - 1)


def _first_at_least(x: FloatArray, at: FloatArray) -> IntArray:
    return np.asarray(np.searchsorted(x, at - 1e-12, side="left"))


def _heights(find, x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:  # type: ignore[no-untyped-def]
    """Heights (r, k) of curves (r, t) at places (k,); NaN where a curve does not get."""
    rows = np.empty((len(x), len(at)))
    for row, x_row, y_row in zip(rows, x, y, strict=True):
        index = find(x_row, at)
        row[:] = np.append(y_row, np.nan)[np.minimum(index, len(y_row))]
    return rows


def _band(x: FloatArray, heights: FloatArray) -> Band:
    tail = (1 - CONFIDENCE) / 2
    usable = heights[np.isfinite(heights).all(axis=1)]
    if not len(usable):
        return Band(x[:0], x[:0], x[:0])
    low, high = np.quantile(usable, [tail, 1 - tail], axis=0)
    return Band(x, low, high)
