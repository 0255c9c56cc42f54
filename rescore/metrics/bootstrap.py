"""Intervals of the figures of match tables by a paired bootstrap over images.

Images are drawn with replacement, never candidates: those of one image share its street, light and depth, and
are not independent. All tables speak of the same images, and one draw serves them all, so that what two of
them share cancels in their difference.

What is not finite in a resample:

- A recall that is never reached takes infinitely many false positives an image, so an interval may end in
  infinity.
- The reduction factor is FPPI before / FPPI after, nothing added: no false positive after is a factor of
  infinity, none before and none after is 1, a recall that is reached only after is infinity, only before 0.
- Undefined are the area without hits or without false positives, average precision and recall without cars,
  and a comparison at a recall that neither table reaches (infinity less infinity). Such a resample may hide
  any value, so it counts as the least possible one for the lower end and as the largest for the upper end.

``Interval`` says how many resamples were infinite, and how many undefined.

How the ends are taken, for confidence c: let z be the normal quantile of (1 + c) / 2, and z0 that of the
share of resamples below the figure itself. The ends are the quantiles Phi(s z0 - k z) and Phi(s z0 + k z) of
the resamples: the plain percentile interval for s = 0, Efron's bias-corrected one for s = 2, and k = 1 in
both. ``KINDS`` has s and k of each kind of figure, chosen by the coverage of intervals of 95 % on simulated
sets of 50 to 250 images whose candidates are correlated (tests/rescore/interval_coverage.py):

- Areas and average precisions are averages, whose resamples spread too little where images are few: k > 1.
- Average precision takes the best precision beyond each recall, so it is too high in a small set, and more so
  in a resample: s = 0 covers 90 to 92 %. The resamples show half of that bias only, hence the larger k.
  In a difference the bias cancels.
- Readings of one staircase are covered well by percentiles, also near the recall ceiling, where s = 2 covers
  85 %.
- Of the difference of two readings the resamples spread 10 to 15 % too much, since steps do not cancel. s = 0
  covers 98 to 99 %; s = 2, which shifts by a z0 that is itself uncertain, 92 to 93 %; s = 1.5 lies between.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, ndtri

from recon.arrays import FloatArray, IntArray
from recon.errors import RescoreError
from rescore.metrics.matching import MatchTable
from rescore.metrics.resampled import Levels, Weights, weighted_figures


@dataclass(frozen=True)
class Kind:
    """How the interval of a kind of figure is taken."""

    least: float
    """Smallest possible value of the figure."""
    most: float
    shift: float = 0.0
    """s of the formula in the docstring of this module."""
    widening: float = 0.0
    """k of the formula in the docstring of this module is 1 + widening / sqrt(number of images)."""


KINDS = {
    "auc": Kind(0, 1, shift=2.0, widening=0.4),
    "average_precision": Kind(0, 1, shift=2.0, widening=1.1),
    "recall": Kind(0, 1),
    "fppi": Kind(0, np.inf),
    "auc_difference": Kind(-1, 1, widening=0.4),
    "average_precision_difference": Kind(-1, 1, widening=0.4),
    "recall_difference": Kind(-1, 1, shift=1.5),
    "fppi_difference": Kind(-np.inf, np.inf, shift=1.5),
    "reduction": Kind(0, np.inf, shift=1.5),
}


MAX_DRAWN = 200_000_000
"""Candidates in all resamples together, from which there are fewer of them."""


@dataclass(frozen=True)
class BootstrapConfig:
    """What is measured, and how finely."""

    n_resamples: int = 2000
    confidence: float = 0.95
    levels: Levels = field(default_factory=Levels)

    @staticmethod
    def for_candidates(n: int) -> "BootstrapConfig":
        """The settings for tables of n candidates: fewer resamples where there are so many that 2000 take
        minutes and gigabytes; their intervals are narrow, and 200 still tell the ends."""
        return BootstrapConfig(n_resamples=int(np.clip(MAX_DRAWN // max(n, 1), 200, 2000)))

    def __post_init__(self) -> None:
        if self.n_resamples < 100:
            raise RescoreError(
                f"bootstrap: expected at least 100 resamples, got {self.n_resamples}; 2000 is usual"
            )
        if not 0 < self.confidence < 1:
            raise RescoreError(
                f"bootstrap: expected a confidence in (0, 1), got {self.confidence:g}; 0.95 is usual"
            )


@dataclass(frozen=True)
class Interval:
    """One figure and where it may lie."""

    value: float
    """The figure on the images as they are: NaN where undefined, infinity where its recall is never
    reached."""
    low: float
    """Lower end; NaN where the value is undefined."""
    high: float
    n_undefined: int
    """Resamples in which the figure is undefined."""
    n_infinite: int
    """Resamples in which the figure is infinite."""


@dataclass(frozen=True)
class FigureIntervals:
    """The figures of one table, or the differences of two."""

    auc: Interval
    """Area under the candidate ROC."""
    average_precision: Interval
    recall_at_fppi: dict[float, Interval]
    """Recall at each level of false positives an image."""
    fppi_at_recall: dict[float, Interval]
    """False positives an image at each level of recall."""


@dataclass(frozen=True)
class Comparison:
    """What changes from one table to another of the same images."""

    difference: FigureIntervals
    """Figures of the second table less those of the first."""
    reduction: dict[float, Interval]
    """FPPI before / FPPI after by recall: above 1 where the second table has fewer false positives."""


@dataclass(frozen=True)
class Bootstrap:
    """Everything that one set of resamples gives."""

    tables: dict[str, FigureIntervals]
    comparisons: dict[tuple[str, str], Comparison]
    """What changes from one table to another, by (before, after)."""


def bootstrap(
    tables: Mapping[str, MatchTable],
    cars_of_image: IntArray,
    pairs: Sequence[tuple[str, str]],
    rng: np.random.Generator,
    config: BootstrapConfig,
) -> Bootstrap:
    """Intervals of every table's figures, and of the differences and reduction factors of pairs of tables.

    Args:
        tables: match tables of the same images, by name.
        cars_of_image: annotated cars of each image, shape (n_images,); ``TruthTable.cars_of_image``.
        pairs: names of the tables to compare, (before, after).
        rng: draws the images.
        config: resamples, confidence and levels.

    Raises:
        RescoreError: fewer than two images, or a pair names a table that is not there.
        ValueError: a table has other images or cars than ``cars_of_image``.
    """
    check_tables(tables, cars_of_image, pairs)
    n_images = len(cars_of_image)
    # the images as they are come first, then the resamples
    weight = draw_images(n_images, config.n_resamples, rng, as_they_are=True)
    # one table may have several names
    figures = {id(m): weighted_figures(m, cars_of_image, weight, config.levels) for m in _once(tables)}
    return of_figures({name: figures[id(m)] for name, m in tables.items()}, pairs, n_images, config)


def of_figures(
    rows: Mapping[str, FloatArray], pairs: Sequence[tuple[str, str]], n_images: int, config: BootstrapConfig
) -> Bootstrap:
    """Intervals of figures that are known on the images as they are and on resamples of them.

    Args:
        rows: of each table by name, a row a resample, the images as they are first, (1 + r, 2 + f + q),
            columns as ``rescore.metrics.resampled.weighted_figures`` has them; the same resamples for all.
        pairs: names of the tables to compare, (before, after).
        n_images: images of the set.
        config: confidence and levels.
    """
    ends = _Ends(config, n_images)
    return Bootstrap(
        {name: ends.figures(r) for name, r in rows.items()},
        {(before, after): ends.comparison(rows[before], rows[after]) for before, after in pairs},
    )


def _once(tables: Mapping[str, MatchTable]) -> list[MatchTable]:
    return list({id(m): m for m in tables.values()}.values())


def draw_images(
    n_images: int, n_resamples: int, rng: np.random.Generator, *, as_they_are: bool = False
) -> Weights:
    """How often each image is drawn in each resample, shape (n_resamples, n_images); rows sum to n_images.

    With ``as_they_are`` a first row has each image once.
    """
    weight = np.ones((as_they_are + n_resamples, n_images), np.int32)
    share = np.full(n_images, 1 / n_images)
    # a row at a time: numpy draws numbers of twice the size
    for row in weight[int(as_they_are) :]:
        row[:] = rng.multinomial(n_images, share)
    return weight


def interval(figure: FloatArray, kind: Kind, confidence: float, n_images: int) -> Interval:
    """The interval of a figure (1 + r,): its value on the images as they are, then on r resamples."""
    value, sample = float(figure[0]), figure[1:]
    undefined = np.isnan(sample)
    counts = int(undefined.sum()), int(np.isinf(sample).sum())
    if np.isnan(value):
        return Interval(value, np.nan, np.nan, *counts)
    # an equal or undefined resample lies half below; one is kept on each side, so that z0 is finite
    below = ((sample < value) + ((sample == value) | undefined) / 2).mean()
    z0 = ndtri(np.clip(below, 1 / len(sample), 1 - 1 / len(sample)))
    reach = (1 + kind.widening / np.sqrt(n_images)) * ndtri((1 + confidence) / 2)
    low = _quantile(np.where(undefined, kind.least, sample), float(ndtr(kind.shift * z0 - reach)))
    high = _quantile(np.where(undefined, kind.most, sample), float(ndtr(kind.shift * z0 + reach)))
    return Interval(value, low, high, *counts)


def reduction_factor(before: FloatArray, after: FloatArray) -> FloatArray:
    """FPPI before / FPPI after, same shape; see the module's docstring for zeros and infinities."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((before == 0) & (after == 0), 1.0, before / after)


def _quantile(sample: FloatArray, share: float) -> float:
    """The order statistic at ``share`` of (n + 1), the outer one of two: no arithmetic with infinities."""
    place = (len(sample) + 1) * share
    outer = int(np.floor(place) if share < 0.5 else np.ceil(place))
    return float(np.sort(sample)[np.clip(outer, 1, len(sample)) - 1])


@dataclass(frozen=True)
class _Ends:
    """Makes intervals of rows of figures (1 + r, 2 + f + q), columns as in ``weighted_figures``."""

    config: BootstrapConfig
    n_images: int

    def figures(self, rows: FloatArray, suffix: str = "") -> FigureIntervals:
        """Intervals of the figures of one table; with suffix "_difference", of the difference of two
        tables."""
        levels = self.config.levels
        recalls, fppis = rows[:, 2 : 2 + len(levels.fppi)], rows[:, 2 + len(levels.fppi) :]
        return FigureIntervals(
            self._of(rows[:, 0], "auc" + suffix),
            self._of(rows[:, 1], "average_precision" + suffix),
            self._of_each(levels.fppi, recalls, "recall" + suffix),
            self._of_each(levels.recalls, fppis, "fppi" + suffix),
        )

    def comparison(self, before: FloatArray, after: FloatArray) -> Comparison:
        """Intervals of what changes from one table to another."""
        with np.errstate(invalid="ignore"):
            difference = after - before
        first = 2 + len(self.config.levels.fppi)
        factor = reduction_factor(before[:, first:], after[:, first:])
        return Comparison(
            self.figures(difference, "_difference"),
            self._of_each(self.config.levels.recalls, factor, "reduction"),
        )

    def _of_each(self, levels: tuple[float, ...], columns: FloatArray, kind: str) -> dict[float, Interval]:
        return {level: self._of(c, kind) for level, c in zip(levels, columns.T, strict=True)}

    def _of(self, figure: FloatArray, kind: str) -> Interval:
        return interval(figure, KINDS[kind], self.config.confidence, self.n_images)


def check_tables(
    tables: Mapping[str, MatchTable], cars_of_image: IntArray, pairs: Sequence[tuple[str, str]]
) -> None:
    """Raises where tables are not of the same images, or pairs not of the tables; see ``bootstrap``."""
    if len(cars_of_image) < 2:
        raise RescoreError(
            f"bootstrap: expected at least two images, got {len(cars_of_image)}; evaluate more images"
        )
    unknown = sorted({name for pair in pairs for name in pair} - set(tables))
    if unknown:
        raise RescoreError(
            f"bootstrap: expected pairs among {', '.join(tables)}, got {', '.join(unknown)}; "
            "name tables that are there"
        )
    for name, table in tables.items():
        if (table.n_images, table.n_cars) != (len(cars_of_image), int(cars_of_image.sum())):
            raise ValueError(
                f"table {name!r} has {table.n_images} images and {table.n_cars} cars, cars_of_image "
                f"{len(cars_of_image)} and {int(cars_of_image.sum())}"
            )
