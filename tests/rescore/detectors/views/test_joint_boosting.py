"""Shared stumps against a search of all subsets, and what they share."""

import itertools

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.detectors.views.joint_boosting import JointBoostConfig, Steps, best_shared_stump, joint_boost


def problem(n=400, bins=3, seed=0):
    """Features (6, n), of which number ``b`` tells bin b and number 4 bins 0 and 1 alike, and labels."""
    rng = np.random.default_rng(seed)
    shown = rng.integers(-1, bins, n)
    features = rng.normal(size=(6, n)).astype(np.float32)
    for b in range(bins):
        features[b, shown == b] += 1.2
    features[4, (shown == 0) | (shown == 1)] += 2
    return features, np.where(shown[:, None] == np.arange(bins), 1, -1)


def test_sums_above_each_threshold():
    features, label = problem()
    steps = Steps.of(features, 5)
    sums = steps.sums_above(np.array([1, 4]), label.astype(float))
    for i, k in enumerate((1, 4)):
        for t in range(5):
            assert sums[i, t] == pytest.approx(label[features[k] > steps.threshold[k, t]].sum(axis=0))


def test_steps_of_some_samples_are_those_of_all_without_the_others():
    features, label = problem()
    chosen = (label == 1).any(axis=1)
    values = np.random.default_rng(2).uniform(size=(400, 2))
    steps, rows = Steps.of(features, 5), np.arange(6)
    some = steps.among(chosen)
    assert some.count.sum(axis=1).tolist() == [chosen.sum()] * 6
    sums = some.sums_above(rows, values[chosen])
    assert sums == pytest.approx(steps.sums_above(rows, values * chosen[:, None]))


# with 20 thresholds of six features, the bound spares most
@pytest.mark.parametrize("thresholds", [5, 20])
def test_the_best_stump_is_that_of_a_search_of_all_subsets(thresholds):
    features, label = problem()
    weight = np.random.default_rng(1).uniform(0.1, 1, label.shape)
    steps = Steps.of(features, thresholds)

    def error(above, low, high):
        return (weight * (label - np.where(above[:, None], high, low)) ** 2).sum()

    def constants(rows, bins):
        return (weight * label)[rows][:, bins].sum() / weight[rows][:, bins].sum()

    least = np.inf
    everyone = np.ones(len(label), bool)
    for k, t in itertools.product(range(6), range(thresholds)):
        above = features[k] > steps.threshold[k, t]
        for subset in itertools.product([False, True], repeat=3):
            shares = np.array(subset)
            low = np.array([constants(everyone, [b]) for b in range(3)])
            high = low.copy()
            if shares.any():
                low[shares], high[shares] = constants(~above, shares), constants(above, shares)
            least = min(least, error(above, low, high))
    k, t, low, high = best_shared_stump(
        steps, steps.among((label == 1).any(axis=1)), np.arange(6), label, weight
    )
    assert error(features[k] > steps.threshold[k, t], low, high) == pytest.approx(least)
    assert k == 4
    assert (low != high).tolist() == [True, True, False]


def test_bins_are_told_apart_and_files_hold_what_is_used():
    features, label = problem(n=1500)
    draws = JointBoostConfig(rounds=30, features_per_round=6).draws(6, np.random.default_rng(0))
    stumps = joint_boost(features, label, draws, 8)
    fresh, truth = problem(n=1500, seed=9)
    street = (truth == -1).all(axis=1)
    for score, label in zip(stumps.score(fresh), truth.T, strict=True):
        # a threshold midway between normal values 1.2 apart is right for 73 % of either kind
        assert (score[label == 1] > 0).mean() + (score[street] < 0).mean() > 2 * 0.68
    assert stumps.score(fresh[:, :0]).shape == (3, 0)
    used = stumps.used()
    np.testing.assert_array_equal(stumps.renumbered(used).score(fresh[used]), stumps.score(fresh))
    moved = stumps.shifted(np.array([1.0, 0.0, -2.0]))
    np.testing.assert_allclose(
        moved.score(fresh) - stumps.score(fresh), [[1], [0], [-2]] * np.ones(1500), atol=1e-4
    )


def test_a_sample_of_label_0_says_nothing_of_a_bin():
    features, label = problem(n=1500)
    draws = JointBoostConfig(rounds=30, features_per_round=6).draws(6, np.random.default_rng(0))
    doubtful = label[:, 2] == 1
    # as cars of bin 0, these would teach that all that is not one of bin 0 is
    wrong = np.where(doubtful[:, None] & [True, False, False], 1, label)
    silent = np.where(doubtful[:, None] & [True, False, False], 0, label)
    shares = []
    for taught in (silent, wrong):
        score = joint_boost(features, taught, draws, 8).score(features)[0]
        shares.append((score[doubtful] > 0).mean())
    assert shares[0] < 0.3
    assert shares[1] > 0.6


def test_a_bin_without_cars_is_refused():
    features, label = problem()
    with pytest.raises(RescoreError, match=r"for each bin, got \[0, "):
        joint_boost(features, np.minimum(label, [-1, 1, 1]), np.arange(6)[None], 12)
