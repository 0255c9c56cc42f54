"""The bootstrap over images of very many candidates, by sums over blocks of images.

What ``rescore.metrics.bootstrap`` draws is drawn here too: how many images of a block a resample holds is
multinomial over the blocks, and which, multinomial within. But no resample is gone through candidate by
candidate. Those of neighbouring places in the ranking share a step, and each block adds its weighted hits and
false positives to the sums of the steps.

A step is at most 1 / ``FINENESS`` of the candidates that rank above it, and a tie is never cut. So wherever a
curve is read, its place is off by no more than that share, far less than what images vary by. What is left is
taken off: every resample is moved by as much as the figures of the steps differ from the exact ones on the
images as they are.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, Int32Array, IntArray
from rescore.metrics.bootstrap import Bootstrap, BootstrapConfig, check_tables, of_figures
from rescore.metrics.curves import COCO_RECALLS
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable, best_first, kept_rows
from rescore.metrics.resampled import Levels, weighted_figures

Counts = NDArray[np.integer]

FINENESS = 4000
"""Candidates above a step for each candidate in it."""
BLOCK = 1000
"""Images whose weights are drawn at once."""


def bootstrap_by_sums(
    tables: Mapping[str, MatchTable],
    cars_of_image: IntArray,
    pairs: Sequence[tuple[str, str]],
    rng: np.random.Generator,
    config: BootstrapConfig,
) -> Bootstrap:
    """Intervals as those of ``rescore.metrics.bootstrap.bootstrap``, within what their resamples vary by.

    Arguments and errors are those of that function.
    """
    check_tables(tables, cars_of_image, pairs)
    unique = {id(m): m for m in tables.values()}
    steps = {key: Steps.of(m, config.n_resamples) for key, m in unique.items()}
    cars, images = np.zeros(config.n_resamples, np.int64), np.zeros(config.n_resamples, np.int64)
    for first, weight in drawn_blocks(len(cars_of_image), config.n_resamples, rng):
        own = cars_of_image[first : first + weight.shape[0]]
        cars += own @ weight
        images += weight.sum(axis=0)
        for one in steps.values():
            one.add(first, weight)
    ones = np.ones((1, len(cars_of_image)), np.int32)
    rows = {}
    for key, match in unique.items():
        exact = weighted_figures(match, cars_of_image, ones, config.levels)
        rows[key] = steps[key].figures(exact, cars_of_image, cars, images, config.levels)
    return of_figures({n: rows[id(m)] for n, m in tables.items()}, pairs, len(cars_of_image), config)


def drawn_blocks(
    n_images: int, n_resamples: int, rng: np.random.Generator
) -> Iterator[tuple[int, Int32Array]]:
    """How often each image of a block is drawn in each resample, (block, n_resamples), and its first image.

    All blocks together are multinomial: ``n_images`` drawn with replacement in each resample.
    """
    starts = np.arange(0, n_images, BLOCK)
    sizes = np.diff(np.append(starts, n_images))
    totals = rng.multinomial(n_images, sizes / n_images, size=n_resamples)
    for first, size, total in zip(starts.tolist(), sizes.tolist(), totals.T, strict=True):
        resample = np.repeat(np.arange(n_resamples), total)
        cell = rng.integers(0, size, len(resample)) * n_resamples + resample
        counts = np.bincount(cell, minlength=size * n_resamples)
        yield first, counts.reshape(size, n_resamples).astype(np.int32)


@dataclass(frozen=True, eq=False)
class Steps:
    """Hits and false positives of a match table by steps of its ranking, the best first, weighted."""

    cell: Int32Array
    """Twice the step of each candidate that counts, one more for a false positive, by image, shape (k,)."""
    first: IntArray
    """Place in ``cell`` of the first candidate of each image, and ``k``, shape (n_images + 1,)."""
    sums: Int32Array
    """Weighted candidates of each cell in each resample, shape (2 steps, r)."""
    whole: IntArray
    """Candidates of each cell on the images as they are, shape (2 steps,)."""

    @staticmethod
    def of(match: MatchTable, n_resamples: int) -> "Steps":
        """The steps of a table, with sums of nothing yet."""
        from rescore.metrics.image_sum_loops import by_image  # noqa: PLC0415 (compiles a loop)

        false = (match.outcome == FALSE_ALARM) | (match.outcome == DUPLICATE)
        counts = kept_rows(false | (match.outcome == HIT))
        cell = steps_of(match.ranking[counts])
        cell *= 2
        cell += false[counts]
        n_cells = 2 * (int(cell.max()) // 2 + 1) if len(cell) else 0
        whole = np.bincount(cell, minlength=n_cells).astype(np.int64)
        sums = np.zeros((n_cells, n_resamples), np.int32)
        cell, first = by_image(match.image[counts], cell, match.n_images)
        return Steps(cell, first, sums, whole)

    def add(self, first: int, weight: Int32Array) -> None:
        """Add the candidates of a block of images that begins with ``first``, by their weights (block, r)."""
        from rescore.metrics.image_sum_loops import add_weighted  # noqa: PLC0415 (compiles a loop)

        add_weighted(self.sums, self.cell, self.first[first : first + len(weight) + 1], weight)

    def figures(
        self, exact: FloatArray, cars_of_image: IntArray, cars: IntArray, images: IntArray, levels: Levels
    ) -> FloatArray:
        """The exact figures (1, 2 + f + q), and below them those of each resample, moved by what the steps
        are off by."""
        n_cars, n_images = np.array([cars_of_image.sum()]), np.array([len(cars_of_image)])
        whole = _figures(self.whole[:, None], n_cars, n_images, levels)
        sampled = _figures(self.sums, cars, images, levels)
        with np.errstate(invalid="ignore"):
            off = exact - whole
        return np.concatenate([exact, np.where(np.isfinite(off), sampled + off, sampled)])


def steps_of(ranking: FloatArray) -> Int32Array:
    """Step of each candidate (n,), 0 the best; those of equal ranking share one."""
    n = len(ranking)
    order = best_first(ranking)
    falling = ranking[order]
    fresh = np.append(True, falling[1:] != falling[:-1])[:n]
    # a step begins with the first fresh candidate at or after each place where the level rises
    begins = np.flatnonzero(fresh)
    at = np.searchsorted(begins, _rises(n))
    starts = np.zeros(n, np.bool_)
    starts[begins[at[(at > 0) & (at < len(begins))]]] = True
    step = np.empty(n, np.int32)
    step[order] = np.cumsum(starts, dtype=np.int32)
    return step


def _rises(n: int) -> IntArray:
    """Places of a ranking (n,) where the level rises: single candidates first, then ever more of them."""
    # the level at a place k >= F is F + floor(F log(k / F)), so the place of a level l is F exp((l - F) / F)
    last = FINENESS + int(FINENESS * np.log(max(n / FINENESS, 1))) + 1
    level = np.arange(last + 1)
    place = np.ceil(FINENESS * np.exp(np.maximum(level - FINENESS, 0) / FINENESS))
    return np.where(level < FINENESS, level, place).astype(np.int64)


def _figures(sums: Counts, cars: IntArray, images: IntArray, levels: Levels) -> FloatArray:
    """Figures of weighted cells (2 steps, r), columns as ``weighted_figures`` has them, (r, 2 + f + q).

    A resample at a time: the running sums of all would take gigabytes.
    """
    rows = [
        _row(sums[0::2, i], sums[1::2, i], int(c), int(n), levels)
        for i, (c, n) in enumerate(zip(cars, images, strict=True))
    ]
    return np.array(rows)


def _row(hit: Counts, alarm: Counts, cars: int, images: int, levels: Levels) -> list[float]:
    """Figures of the hits and false positives of each step."""
    hits = np.cumsum(hit, dtype=np.int64)
    false = np.cumsum(alarm, dtype=np.int64)
    n_hits, n_false = (int(s[-1]) if len(s) else 0 for s in (hits, false))
    beaten = n_false - false + alarm / 2
    area = float((hit * beaten).sum() / (n_hits * n_false)) if n_hits and n_false else np.nan
    found = [area, np.nan if not cars else _precision(hits, false, cars)]
    fppi, rate = false / max(images, 1), hits / (cars or np.nan)
    for level in levels.fppi:
        at = int(np.searchsorted(fppi, level, side="right"))
        found.append(float(rate[at - 1]) if at else 0.0 if cars else np.nan)
    for level in levels.recalls:
        at = int(np.searchsorted(rate, level - 1e-12)) if cars else len(rate)
        found.append(float(fppi[at]) if at < len(rate) else np.inf)
    return found


def _precision(hits: IntArray, false: IntArray, cars: int) -> float:
    """COCO's average precision, each step a tie."""
    precision = hits / np.maximum(hits + false, 1)
    best_beyond = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return float(best_beyond[np.searchsorted(hits / cars, COCO_RECALLS, side="left")].mean())
