"""How sure the figures of an evaluation are: intervals of each row, and what rescoring changes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, IntArray
from rescore.data.rendered_kinds import PICTURE_KINDS, UNKNOWN
from rescore.metrics.bootstrap import (
    Bootstrap,
    BootstrapConfig,
    FigureIntervals,
    Interval,
    bootstrap,
)
from rescore.metrics.delong import compare_areas
from rescore.metrics.matching import FALSE_ALARM, MatchTable
from rescore.results.metrics_file import Ends, Estimate, Intervals, ModeComparison, Reduction, finite

Kinds = NDArray[np.object_]

_NO_PICTURES = " without pictures"
MIN_IMAGES = 2
"""Smallest number of images that gives an interval."""


@dataclass(frozen=True, eq=False)
class Certainty:
    """What a bootstrap over images says of one detector in all its modes."""

    intervals: dict[str, Intervals | None]
    """By mode: ``intervals`` of its row; None where there are too few images."""
    comparisons: tuple[ModeComparison, ...]
    """Comparisons with the first mode, one for each other mode."""


def certainty(
    detector: str,
    tables: Mapping[str, MatchTable],
    kind: Kinds,
    cars_of_image: IntArray,
    seed: int,
    config: BootstrapConfig | None = None,
    by: Callable[..., Bootstrap] = bootstrap,
) -> Certainty:
    """Intervals of each mode, and comparisons of each with the first, the detector alone.

    Detectors that are given the same seed are resampled alike.

    Args:
        detector: its name.
        tables: match tables of the same candidates by mode.
        kind: what fills most of the box of each candidate, shape (n,).
        cars_of_image: annotated cars of each image, shape (n_images,).
        seed: draws the images.
        config: of the bootstrap.
        by: ``rescore.metrics.bootstrap.bootstrap``, or what does as it does with many candidates.
    """
    if len(cars_of_image) < MIN_IMAGES:
        return Certainty(dict.fromkeys(tables), ())
    first, *modes = tables
    bare = {f"{m}{_NO_PICTURES}": without_pictures(t, kind) for m, t in tables.items()}
    everything = {**tables, **bare}
    pairs = [(a + end, b + end) for b in modes for a, end in ((first, ""), (first, _NO_PICTURES))]
    found = by(everything, cars_of_image, pairs, np.random.default_rng(seed), config or BootstrapConfig())
    known = bool((kind != UNKNOWN).any())
    return Certainty(
        {m: _intervals(found.tables[m]) for m in tables},
        tuple(_compared(detector, found, first, m, tables, kind if known else None) for m in modes),
    )


def on_pictures(match: MatchTable, kind: Kinds) -> BoolArray:
    """Whether each candidate (n,) is a false alarm on a picture of a car; hits and duplicates are on cars,
    whatever hides it."""
    shows_one = np.zeros(len(kind), np.bool_)
    # as texts, a million kinds would take long to compare
    for picture in PICTURE_KINDS.intersection(kind.tolist()):
        shows_one |= kind == picture
    return np.asarray((match.outcome == FALSE_ALARM) & shows_one)


def without_pictures(match: MatchTable, kind: Kinds) -> MatchTable:
    """The match table without the false alarms on pictures of cars, the same one where there are none; the
    outcomes of other rows do not change."""
    keep = ~on_pictures(match, kind)
    if keep.all():
        return match
    columns = {name: getattr(match, name)[keep] for name in ("image", "ranking", "outcome", "annotation_id")}
    return replace(match, **columns)


def _compared(
    detector: str,
    found: Bootstrap,
    first: str,
    mode: str,
    tables: Mapping[str, MatchTable],
    kind: Kinds | None,
) -> ModeComparison:
    change = found.comparisons[first, mode]
    bare = first + _NO_PICTURES, mode + _NO_PICTURES
    return ModeComparison(
        detector=detector,
        mode=mode,
        against=first,
        auc_difference=estimate(change.difference.auc),
        auc_p_value=_p_value(tables[first], tables[mode]),
        average_precision_difference=estimate(change.difference.average_precision),
        reduction=reductions(found, first, mode),
        reduction_without_pictures=None if kind is None else reductions(found, *bare),
        n_on_pictures=None if kind is None else int(on_pictures(tables[first], kind).sum()),
    )


def _p_value(before: MatchTable, after: MatchTable) -> float | None:
    """p-value of Obuchowski's test of the areas; None where hits or false positives are in too few images."""
    try:
        return compare_areas(before, after).p_value
    except ValueError:
        return None


def _intervals(figures: FigureIntervals) -> Intervals:
    single = {"auc": figures.auc, "average_precision": figures.average_precision}
    levels = {f"{level:g}": i for level, i in figures.fppi_at_recall.items()}
    return Intervals(
        auc=_ends(figures.auc),
        average_precision=_ends(figures.average_precision),
        fppi_at_recall={name: _ends(i) for name, i in levels.items()},
        n_undefined={name: i.n_undefined for name, i in (single | levels).items()},
        n_infinite={name: i.n_infinite for name, i in levels.items()},
    )


def reductions(found: Bootstrap, before: str, after: str) -> dict[str, Reduction]:
    """How many times fewer false positives one table of a bootstrap has than another, by recall as "0.7"."""
    sides = found.tables[before].fppi_at_recall, found.tables[after].fppi_at_recall
    return {
        f"{level:g}": Reduction(
            **dict(estimate(i)), before=finite(sides[0][level].value), after=finite(sides[1][level].value)
        )
        for level, i in found.comparisons[before, after].reduction.items()
    }


def estimate(i: Interval) -> Estimate:
    """A figure with its interval as files hold it: infinite ends are None."""
    return Estimate(
        value=finite(i.value), interval=_ends(i), n_undefined=i.n_undefined, n_infinite=i.n_infinite
    )


def _ends(i: Interval) -> Ends | None:
    return None if np.isnan(i.value) else (finite(i.low), finite(i.high))
