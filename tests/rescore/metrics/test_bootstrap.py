import time
from typing import Any

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.metrics.bootstrap import (
    KINDS,
    BootstrapConfig,
    Interval,
    Kind,
    bootstrap,
    draw_images,
    interval,
    reduction_factor,
)
from rescore.metrics.curves import RECALL_LEVELS, summarise
from rescore.metrics.matching import FALSE_ALARM, HIT, MatchTable
from rescore.metrics.resampled import Levels, weighted_figures
from tests.rescore.interval_coverage import PAIR, named, names, plain_figures
from tests.rescore.simulated_matches import simulate

QUICK = BootstrapConfig(n_resamples=300)


def table(
    image: list[int], ranking: list[float], outcome: list[int], n_images: int, n_cars: int
) -> MatchTable:
    codes = np.array(outcome, np.int8)
    return MatchTable(
        n_images, n_cars, np.array(image, np.int64), np.array(ranking, float), codes, np.full(len(image), -1)
    )


def test_values_are_the_figures_of_the_table_itself() -> None:
    data = simulate(40, np.random.default_rng(0))
    found = bootstrap(data.tables, data.cars_of_image, [PAIR], np.random.default_rng(1), QUICK)
    before, after = summarise(data.before), summarise(data.after)
    one = found.tables["before"]
    assert one.auc.value == pytest.approx(before.auc)
    assert one.average_precision.value == pytest.approx(before.average_precision)
    for level in RECALL_LEVELS:
        b, a = before.fppi_at_recall[level], after.fppi_at_recall[level]
        assert b is not None
        assert a is not None
        assert one.fppi_at_recall[level].value == pytest.approx(b)
        compared = found.comparisons[PAIR]
        assert compared.difference.fppi_at_recall[level].value == pytest.approx(a - b)
        assert compared.reduction[level].value == pytest.approx(b / a)
    for name, i in named(found).items():
        assert i.low <= i.value <= i.high, name


def test_same_seed_same_intervals_and_other_seed_others() -> None:
    data = simulate(30, np.random.default_rng(0))

    def run(seed: int) -> object:
        return bootstrap(data.tables, data.cars_of_image, [PAIR], np.random.default_rng(seed), QUICK)

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_a_table_compared_with_itself_shows_no_change() -> None:
    data = simulate(30, np.random.default_rng(0))
    twice = {"before": data.before, "after": data.before}
    found = bootstrap(twice, data.cars_of_image, [PAIR], np.random.default_rng(1), QUICK)
    compared = found.comparisons[PAIR]
    assert (compared.difference.auc.low, compared.difference.auc.high) == (0, 0)
    assert (compared.reduction[0.5].low, compared.reduction[0.5].high) == (1, 1)


def test_images_are_drawn_and_not_candidates() -> None:
    # ten cars and ten false alarms, but two images only: a resample is both once, or one of them twice
    image = [0] * 10 + [1] * 10
    all_in_one = table(image, list(range(20)), [FALSE_ALARM] * 10 + [HIT] * 10, 2, 10)
    found = bootstrap({"one": all_in_one}, np.array([0, 10]), [], np.random.default_rng(0), QUICK).tables[
        "one"
    ]
    # each single image lacks hits or false alarms: half of the resamples are undefined
    assert found.auc.value == 1
    assert 110 < found.auc.n_undefined < 190
    assert (found.auc.low, found.auc.high) == (0, 1)


def test_draws_sum_to_the_number_of_images() -> None:
    draws = draw_images(7, 500, np.random.default_rng(0))
    assert (draws.sum(axis=1) == 7).all()
    assert draws.mean(axis=0) == pytest.approx(np.ones(7), abs=0.2)


def test_a_recall_that_resamples_miss_ends_in_infinity() -> None:
    # of four cars three are found; without the image of the missed one the rate is 1
    image, outcome = [0, 1, 2, 3], [HIT, HIT, HIT, FALSE_ALARM]
    one = table(image, [4, 3, 2, 1], outcome, 4, 4)
    config = BootstrapConfig(n_resamples=300, levels=Levels(recalls=(0.7, 0.9)))
    found = bootstrap({"a": one}, np.ones(4, int), [], np.random.default_rng(0), config).tables["a"]
    assert (found.fppi_at_recall[0.7].value, found.fppi_at_recall[0.7].high) == (0, np.inf)
    assert found.fppi_at_recall[0.9].value == np.inf
    assert 0 < found.fppi_at_recall[0.7].n_infinite < found.fppi_at_recall[0.9].n_infinite < 300
    assert found.fppi_at_recall[0.7].n_undefined == 0


def test_reduction_factor_of_zeros_and_infinities() -> None:
    inf = np.inf
    before = np.array([3.0, 2.0, 0.0, 0.0, inf, 1.0, inf])
    after = np.array([1.5, 0.0, 2.0, 0.0, 1.0, inf, inf])
    np.testing.assert_array_equal(reduction_factor(before, after), [2, inf, 0, 1, inf, 0, np.nan])


def test_percentile_interval_by_hand() -> None:
    # 199 resamples: the 5th of (199 + 1) from each end hold 95 %
    figure = np.concatenate([[1.0], np.random.default_rng(0).permutation(np.arange(1, 200)) / 100])
    found = interval(figure, KINDS["fppi"], 0.95, 100)
    assert (found.low, found.high) == (0.05, 1.95)


def test_shift_moves_the_interval_against_the_bias_of_the_resamples() -> None:
    # resamples are 0.02 too high with a spread of 0.05, so the value is taken to be too: 0.5 - 0.02
    rng = np.random.default_rng(0)
    figure = np.concatenate([[0.5], 0.52 + 0.05 * rng.normal(size=40_000)])
    found = interval(figure, Kind(0, 1, shift=2), 0.95, 100)
    assert found.low == pytest.approx(0.48 - 1.96 * 0.05, abs=0.003)
    assert found.high == pytest.approx(0.48 + 1.96 * 0.05, abs=0.003)
    widened = interval(figure, Kind(0, 1, shift=2, widening=1), 0.95, 100)
    assert widened.low == pytest.approx(0.48 - 1.1 * 1.96 * 0.05, abs=0.003)


def test_undefined_resamples_widen_both_ends() -> None:
    def found(value: float, undefined_every: int) -> Interval:
        sample = np.linspace(1, 2, 1000)
        sample[undefined_every // 2 :: undefined_every] = np.nan
        return interval(np.append(value, sample), KINDS["reduction"], 0.95, 100)

    whole, few, many = found(1.5, 2000), found(1.5, 100), found(1.5, 20)
    assert (whole.n_undefined, few.n_undefined, many.n_undefined) == (0, 10, 50)
    assert few.low < whole.low < whole.high < few.high
    assert (many.low, many.high) == (0, np.inf)
    unknown = found(np.nan, 2000)
    assert np.isnan([unknown.low, unknown.high]).all()


def test_pairing_narrows_the_difference() -> None:
    data = simulate(80, np.random.default_rng(0))
    found = bootstrap(data.tables, data.cars_of_image, [PAIR], np.random.default_rng(1), QUICK)

    def width(name: str) -> float:
        i = named(found)[name]
        return i.high - i.low

    # unpaired, the widths would add up in squares
    assert width("difference: area") < 0.8 * np.hypot(width("before: area"), width("after: area"))


def test_no_candidates_at_all() -> None:
    empty = table([], [], [], 3, 3)
    found = bootstrap({"a": empty}, np.ones(3, int), [], np.random.default_rng(0), QUICK).tables["a"]
    assert (found.average_precision.value, found.average_precision.high) == (0, 0)
    assert np.isnan(found.auc.value)
    assert found.auc.n_undefined == 300
    assert found.fppi_at_recall[0.5].value == np.inf


def test_refuses_other_images_unknown_pairs_and_single_images() -> None:
    data = simulate(10, np.random.default_rng(0))
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="cars_of_image"):
        bootstrap(data.tables, data.cars_of_image[:-1], [], rng, QUICK)
    with pytest.raises(RescoreError, match="expected pairs among before, after, got later"):
        bootstrap(data.tables, data.cars_of_image, [("before", "later")], rng, QUICK)
    with pytest.raises(RescoreError, match="at least two images"):
        bootstrap({}, np.ones(1, int), [], rng, QUICK)
    with pytest.raises(RescoreError, match="at least 100"):
        BootstrapConfig(n_resamples=10)
    with pytest.raises(RescoreError, match="confidence"):
        BootstrapConfig(confidence=95)


def test_names_of_the_coverage_table_match_its_figures() -> None:
    data = simulate(30, np.random.default_rng(0))
    found = named(bootstrap(data.tables, data.cars_of_image, [PAIR], np.random.default_rng(1), QUICK))
    before, after = plain_figures(data, Levels())
    expected = [*before, *after, *(after - before), *reduction_factor(before[5:], after[5:])]
    assert list(found) == names(Levels())
    np.testing.assert_allclose([i.value for i in found.values()], expected)


def test_two_tables_of_the_reports_size_take_under_two_seconds() -> None:
    rng = np.random.default_rng(0)
    image = np.repeat(np.arange(109), 15)
    outcome = np.where(rng.random(len(image)) < 0.07, HIT, FALSE_ALARM).astype(np.int8)
    cars = np.bincount(image[outcome == HIT], minlength=109) + 1
    pair = {
        name: MatchTable(109, int(cars.sum()), image, rng.random(len(image)), outcome, image) for name in PAIR
    }
    start = time.process_time()
    bootstrap(pair, cars, [PAIR], rng, BootstrapConfig())
    assert time.process_time() - start < 2


@pytest.mark.parametrize(
    ("n", "resamples"), [(0, 2000), (3270, 2000), (100_000, 2000), (10**6, 200), (10**7, 200)]
)
def test_very_many_candidates_have_fewer_resamples(n: int, resamples: int) -> None:
    assert BootstrapConfig.for_candidates(n).n_resamples == resamples


def test_draws_row_by_row_are_those_of_one_call() -> None:
    whole = np.random.default_rng(3).multinomial(9, np.full(9, 1 / 9), size=200)
    np.testing.assert_array_equal(draw_images(9, 200, np.random.default_rng(3)), whole)
    with_first = draw_images(9, 200, np.random.default_rng(3), as_they_are=True)
    np.testing.assert_array_equal(with_first, np.concatenate([np.ones((1, 9)), whole]))


def test_a_table_of_two_names_is_weighted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = simulate(30, np.random.default_rng(0))
    weighed: list[MatchTable] = []

    def counted(match: MatchTable, *rest: Any) -> np.ndarray:
        weighed.append(match)
        return weighted_figures(match, *rest)

    monkeypatch.setattr("rescore.metrics.bootstrap.weighted_figures", counted)
    tables = {"a": made.before, "b": made.after, "c": made.before}
    found = bootstrap(tables, made.cars_of_image, [("a", "b"), ("c", "b")], np.random.default_rng(0), QUICK)
    assert weighed == [made.before, made.after]
    assert found.tables["a"] == found.tables["c"]
    assert found.comparisons["a", "b"] == found.comparisons["c", "b"]
