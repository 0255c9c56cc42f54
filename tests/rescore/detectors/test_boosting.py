from itertools import pairwise

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.detectors.boosting import BoostConfig, SortedFeatures, Stumps, fit_stump, gentle_boost


def brute_force_error(features, target, weight):
    """Least weighted squared error over every feature and every threshold midway between values."""
    best = np.inf
    for x in features:
        values = np.unique(x)
        for low, high in pairwise(values):
            above = x > (low + high) / 2
            fit = np.where(
                above,
                np.average(target[above], weights=weight[above]),
                np.average(target[~above], weights=weight[~above]),
            )
            best = min(best, float((weight * (target - fit) ** 2).sum()))
    return best


@pytest.mark.parametrize("seed", range(8))
def test_stump_is_the_best_of_all(seed):
    rng = np.random.default_rng(seed)
    # few distinct values, so that ties between samples occur
    features = rng.integers(0, 6, (5, 40)).astype(np.float32)
    target = rng.choice([-1.0, 1.0], 40)
    weight = rng.uniform(0.1, 1, 40)
    k, threshold, below, above = fit_stump(SortedFeatures.of(features), np.arange(5), target, weight)
    fit = np.where(features[k] > threshold, above, below)
    assert (weight * (target - fit) ** 2).sum() == pytest.approx(brute_force_error(features, target, weight))


def test_stump_by_hand():
    features = np.array([[1, 2, 3, 4]], np.float32)
    # split between 2 and 3: left mean of -1, -1; right weighted mean (1 * 3 - 1 * 1) / 4 = 0.5
    stump = fit_stump(
        SortedFeatures.of(features), np.arange(1), np.array([-1.0, -1, 1, -1]), np.array([2.0, 2, 3, 1])
    )
    assert stump == pytest.approx((0, 2.5, -1.0, 0.5))


def test_stump_looks_only_at_its_columns():
    rng = np.random.default_rng(0)
    target = rng.choice([-1.0, 1.0], 30)
    features = np.stack([target, rng.normal(size=30), rng.normal(size=30)]).astype(np.float32)
    sorted_features = SortedFeatures.of(features)
    assert fit_stump(sorted_features, np.arange(3), target, np.ones(30))[0] == 0
    assert fit_stump(sorted_features, np.array([1, 2]), target, np.ones(30))[0] in (1, 2)


def test_a_feature_of_one_value_gives_the_mean():
    k, _, below, above = fit_stump(
        SortedFeatures.of(np.ones((1, 4), np.float32)), np.arange(1), np.array([1.0, 1, 1, -1]), np.ones(4)
    )
    assert (k, below, above) == (0, 0.5, 0.5)


def test_thresholds_part_neighbouring_floats():
    low = np.float32(1)
    high = np.nextafter(low, np.float32(2))
    features = np.array([[low, high]])
    _, threshold, below, above = fit_stump(
        SortedFeatures.of(features), np.arange(1), np.array([-1.0, 1.0]), np.ones(2)
    )
    assert (features[0] > np.float32(threshold)).tolist() == [False, True]
    assert (below, above) == (-1.0, 1.0)


def plain_gentle_boost_scores(features, is_car, rounds):
    """The algorithm as Friedman, Hastie and Tibshirani print it, stump by brute force."""
    y = np.where(is_car, 1.0, -1.0)
    w = np.where(is_car, 0.5 / is_car.sum(), 0.5 / (~is_car).sum())
    total = np.zeros(len(y))
    for _ in range(rounds):
        best = (np.inf, None)
        for x in features:
            values = np.unique(x)
            for low, high in pairwise(values):
                above = x > (low + high) / 2
                fit = np.where(
                    above, np.average(y[above], weights=w[above]), np.average(y[~above], weights=w[~above])
                )
                error = float((w * (y - fit) ** 2).sum())
                if error < best[0] - 1e-12:
                    best = (error, fit)
        total += best[1]
        w = w * np.exp(-y * best[1])
        w /= w.sum()
    return total


def test_gentle_boost_equals_the_printed_algorithm():
    rng = np.random.default_rng(3)
    is_car = rng.random(60) < 0.3
    features = (rng.normal(size=(6, 60)) + is_car * rng.uniform(0, 1.5, (6, 1))).astype(np.float32)
    stumps = gentle_boost(features, is_car, BoostConfig(rounds=8, features_per_round=6), rng)
    expected = plain_gentle_boost_scores(features.astype(float), is_car, 8)
    assert stumps.score(features) == pytest.approx(expected, abs=1e-5)


def test_boosting_solves_what_no_single_stump_can():
    rng = np.random.default_rng(0)
    features = rng.uniform(-1, 1, (2, 600)).astype(np.float32)
    is_car = features.sum(axis=0) > 0  # a diagonal border
    one = gentle_boost(features, is_car, BoostConfig(1, 2), rng)
    many = gentle_boost(features, is_car, BoostConfig(80, 2), rng)
    fresh = rng.uniform(-1, 1, (2, 2000)).astype(np.float32)
    right = [np.mean((s.score(fresh) > 0) == (fresh.sum(axis=0) > 0)) for s in (one, many)]
    assert right[0] < 0.85
    assert right[1] > 0.95


def test_same_seed_same_stumps():
    rng = np.random.default_rng(1)
    features, is_car = rng.normal(size=(50, 80)).astype(np.float32), rng.random(80) < 0.5
    a, b = (gentle_boost(features, is_car, BoostConfig(20, 10), np.random.default_rng(9)) for _ in range(2))
    assert a.feature.tolist() == b.feature.tolist()
    assert a.threshold.tobytes() == b.threshold.tobytes()
    assert a.above.tobytes() == b.above.tobytes()


def test_renumbered_stumps_score_the_same():
    rng = np.random.default_rng(1)
    features, is_car = rng.normal(size=(50, 80)).astype(np.float32), rng.random(80) < 0.5
    stumps = gentle_boost(features, is_car, BoostConfig(10, 50), rng)
    used = stumps.used()
    assert len(used) < 50
    assert stumps.renumbered(used).score(features[used]) == pytest.approx(stumps.score(features))


def test_score_keeps_the_shape_of_windows():
    stumps = Stumps(np.array([1]), *(np.array([x], np.float32) for x in (0.5, -1, 2)))
    features = np.zeros((2, 3, 4), np.float32)
    features[1, 2, 3] = 1
    expected = np.full((3, 4), -1.0)
    expected[2, 3] = 2
    assert stumps.score(features).tolist() == expected.tolist()


def test_one_class_is_refused():
    with pytest.raises(RescoreError, match="expected crops of cars and of street, got 0 cars of 5 crops"):
        gentle_boost(np.zeros((2, 5), np.float32), np.zeros(5, bool), BoostConfig(), np.random.default_rng(0))
