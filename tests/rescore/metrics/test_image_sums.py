"""The bootstrap by sums over images against the exact one, which goes through every resample."""

from collections.abc import Iterator

import numpy as np
import pytest

from rescore.metrics.bootstrap import BootstrapConfig, Interval, bootstrap
from rescore.metrics.image_sums import FINENESS, bootstrap_by_sums, drawn_blocks, steps_of
from rescore.metrics.matching import FALSE_ALARM, HIT, MatchTable
from tests.rescore.simulated_matches import simulate

CONFIG = BootstrapConfig(n_resamples=2000)


def intervals(found: object) -> Iterator[Interval]:
    """All intervals within a result, in one order."""
    if isinstance(found, Interval):
        yield found
    elif isinstance(found, dict):
        for value in found.values():
            yield from intervals(value)
    else:
        for name in vars(found):
            yield from intervals(getattr(found, name))


def test_within_what_resamples_vary_by() -> None:
    made = simulate(400, np.random.default_rng(3))
    both = [
        f(made.tables, made.cars_of_image, [("before", "after")], np.random.default_rng(i), CONFIG)
        for i, f in enumerate((bootstrap, bootstrap_by_sums))
    ]
    exact, summed = (list(intervals(b)) for b in both)
    assert len(exact) == len(summed) == 2 * 9 + 9 + 4
    for a, b in zip(exact, summed, strict=True):
        assert b.value == a.value
        # an end of 2000 resamples varies by 2 % of the width, both ends by 3 %, times four
        if np.isfinite([a.low, a.high]).all():
            assert np.abs([a.low - b.low, a.high - b.high]).max() < 0.12 * (a.high - a.low)
        assert a.n_infinite == pytest.approx(b.n_infinite, abs=4 * np.sqrt(a.n_infinite + 1))


def test_ties_and_tables_of_nothing() -> None:
    outcome = np.array([HIT, FALSE_ALARM, FALSE_ALARM], np.int8)
    image = np.array([1, 0, 1])
    equal = MatchTable(2, 1, image, np.full(3, 0.5), outcome, np.full(3, -1))
    none = MatchTable(2, 1, image[:0], np.zeros(0), outcome[:0], image[:0])
    found = bootstrap_by_sums(
        {"equal": equal, "none": none}, np.array([0, 1]), [], np.random.default_rng(0), CONFIG
    ).tables
    # all at one score: a hit beats half of each false alarm
    assert found["equal"].auc.value == 0.5
    # the one car is drawn in none of two draws in a quarter of the resamples
    assert found["equal"].auc.n_undefined == pytest.approx(500, abs=80)
    assert found["equal"].fppi_at_recall[0.7].value == 1.0
    assert found["none"].recall_at_fppi[1.0].value == 0.0
    assert found["none"].fppi_at_recall[0.7].value == np.inf


def test_steps_are_fine_and_cut_no_tie() -> None:
    ranking = np.random.default_rng(0).integers(0, 30_000, 50_000).astype(float)
    step = steps_of(ranking)
    order = np.argsort(-ranking, kind="stable")
    assert (np.diff(step[order]) >= 0).all()
    assert len(set(zip(ranking.tolist(), step.tolist(), strict=True))) == len(set(ranking.tolist()))
    first = np.searchsorted(step[order], np.arange(step.max() + 1), side="left")
    in_step = np.bincount(step)
    # no larger than its share of those above, but for what one tie holds
    assert (
        in_step <= np.maximum(first / FINENESS, 1) + np.unique(ranking, return_counts=True)[1].max()
    ).all()


def test_blocks_together_are_multinomial() -> None:
    n, r = 2500, 400
    weight = np.concatenate([w for _, w in drawn_blocks(n, r, np.random.default_rng(1))])
    assert weight.shape == (n, r)
    assert (weight.sum(axis=0) == n).all()
    # each image is drawn once on average, with the variance 1 - 1 / n of a multinomial
    assert weight.mean() == 1
    assert weight.var() == pytest.approx(1 - 1 / n, rel=0.02)
    halves = weight[: n // 2].sum(axis=0)
    assert halves.var() == pytest.approx(n / 4, rel=0.3)
