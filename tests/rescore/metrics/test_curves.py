import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score, roc_curve

from rescore.metrics.curves import (
    area_under_roc,
    average_precision,
    candidate_roc,
    fppi_at_recall,
    recall_ceiling,
    recall_curve,
    summarise,
    ties,
)
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, IGNORED, MatchTable


def table(ranking: list[float], outcome: list[int], n_images: int = 2, n_cars: int = 4) -> MatchTable:
    n = len(ranking)
    return MatchTable(
        n_images,
        n_cars,
        image=np.arange(n) % n_images,
        ranking=np.array(ranking, float),
        outcome=np.array(outcome, np.int8),
        annotation_id=np.full(n, -1, np.int64),
    )


# by falling ranking: hit, false, ignored, hit, duplicate; 4 cars, 2 images
MIXED = table([5, 4, 3.5, 3, 2], [HIT, FALSE_ALARM, IGNORED, HIT, DUPLICATE])


def test_recall_curve_counts_all_cars_and_images() -> None:
    curve = recall_curve(MIXED)
    assert curve.x.tolist() == [0, 0, 0.5, 0.5, 1.0]  # false positives 0, 0, 1, 1, 2 over 2 images
    assert curve.y.tolist() == [0, 0.25, 0.25, 0.5, 0.5]  # hits 0, 1, 1, 2, 2 over 4 cars
    assert recall_ceiling(curve) == 0.5
    assert fppi_at_recall(curve, 0.25) == 0
    assert fppi_at_recall(curve, 0.5) == 0.5
    assert fppi_at_recall(curve, 0.6) is None


def test_average_precision_by_hand() -> None:
    # precision at recall 0.25 is 1, at 0.5 it is 2/3; 26 recalls 0 .. 0.25 get 1, 25 get 2/3, 50 get 0
    assert average_precision(MIXED) == pytest.approx((26 + 25 * 2 / 3) / 101)


def test_ties_enter_a_curve_together() -> None:
    curve = candidate_roc(table([1, 1, 1, 1], [HIT, FALSE_ALARM, HIT, FALSE_ALARM]))
    assert (curve.x.tolist(), curve.y.tolist()) == ([0, 1], [0, 1])
    assert area_under_roc(curve) == 0.5


def test_a_car_free_image_with_one_false_alarm_makes_the_curve_worse() -> None:
    more = table([5, 4, 3.5, 3, 2, 4.5], [*MIXED.outcome.tolist(), FALSE_ALARM], n_images=3)
    before, after = summarise(MIXED), summarise(more)
    assert after.average_precision < before.average_precision
    assert after.auc < before.auc
    # 1 / 2 false positives an image before, 2 / 3 after
    assert (before.fppi_at_recall[0.5], after.fppi_at_recall[0.5]) == (0.5, pytest.approx(2 / 3))


def test_a_missed_car_lowers_the_rate() -> None:
    missed = table(MIXED.ranking.tolist(), MIXED.outcome.tolist(), n_cars=8)
    assert recall_ceiling(recall_curve(missed)) == 0.25
    assert average_precision(missed) < average_precision(MIXED)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_roc_equals_scikit_learn(seed: int, n_levels: int) -> None:
    rng = np.random.default_rng(seed)
    outcome = rng.choice([HIT, FALSE_ALARM, DUPLICATE, IGNORED], 60)
    outcome[:2] = HIT, FALSE_ALARM
    ranking = rng.integers(0, n_levels, 60).astype(float)
    counts = outcome != IGNORED
    is_hit = outcome[counts] == HIT
    curve = candidate_roc(table(ranking.tolist(), outcome.tolist()))
    fpr, tpr, _ = roc_curve(is_hit, ranking[counts], drop_intermediate=False)
    np.testing.assert_allclose(curve.x, fpr)
    np.testing.assert_allclose(curve.y, tpr)
    assert area_under_roc(curve) == pytest.approx(roc_auc_score(is_hit, ranking[counts]))


def plain_average_precision(match: MatchTable) -> float:
    """COCO's rule as a loop: the second implementation."""
    rows = [
        o
        for _, o in sorted(zip(-match.ranking, match.outcome, strict=True), key=lambda r: r[0])
        if o != IGNORED
    ]
    points, hits = [], 0
    for seen, outcome in enumerate(rows, start=1):
        hits += outcome == HIT
        points.append((hits / match.n_cars, hits / seen))
    return float(
        np.mean([max((p for r, p in points if r >= level), default=0.0) for level in np.linspace(0, 1, 101)])
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_average_precision_equals_a_plain_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outcome = rng.choice([HIT, FALSE_ALARM, DUPLICATE, IGNORED], 30)
    match = table(rng.normal(size=30).tolist(), outcome.tolist(), n_cars=int((outcome == HIT).sum()) + 3)
    assert average_precision(match) == pytest.approx(plain_average_precision(match))


def test_no_candidates_and_no_cars() -> None:
    none = summarise(table([], []))
    assert (none.average_precision, none.recall_ceiling, none.fppi_at_recall[0.5]) == (0, 0, None)
    assert np.isnan(none.auc)
    no_cars = summarise(table([1], [FALSE_ALARM], n_cars=0))
    assert np.isnan(no_cars.average_precision)


def test_perfect_detector() -> None:
    perfect = summarise(table([4, 3, 2, 1, 0], [HIT] * 4 + [FALSE_ALARM]))
    assert (perfect.auc, perfect.average_precision, perfect.recall_ceiling) == (1, 1, 1)
    assert set(perfect.fppi_at_recall.values()) == {0.0}


def test_ties_of_a_hit_and_a_false_alarm_bound_average_precision() -> None:
    # one car; the hit has the score of one of two false alarms
    match = table([0.5, 0.5, 0.2], [FALSE_ALARM, HIT, FALSE_ALARM], n_images=1, n_cars=1)
    found = ties(match)
    # hit second: precision 1/2 at every recall; hit first: 1
    assert (found.n, found.lowest, found.highest) == (2, 0.5, 1.0)
    # in the order given the false alarm comes first
    assert average_precision(match) == 0.5
    # equal scores of one kind decide nothing, nor does an ignored candidate
    assert ties(table([0.5, 0.5, 0.2], [FALSE_ALARM, FALSE_ALARM, HIT], n_images=1, n_cars=1)).n == 0
    assert ties(table([0.5, 0.5], [IGNORED, HIT], n_images=1, n_cars=1)).n == 0
    assert ties(table([], [], n_images=1, n_cars=1)).n == 0
