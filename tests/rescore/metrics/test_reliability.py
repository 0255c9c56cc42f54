import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest
from sklearn.calibration import calibration_curve
from sklearn.metrics import brier_score_loss

from recon.errors import RescoreError
from rescore.metrics.reliability import clopper_pearson, equal_count_bins, reliability


def calibrated(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Likelihoods that are true."""
    rng = np.random.default_rng(seed)
    likelihood = rng.beta(0.5, 2, n)
    return likelihood, rng.random(n) < likelihood


def test_two_bins_by_hand() -> None:
    found = reliability(np.array([0.9, 0.1, 0.2, 0.6]), np.array([True, False, True, False]), n_bins=2)
    np.testing.assert_allclose(found.likelihood, [0.15, 0.75])
    np.testing.assert_allclose(found.hit_rate, [0.5, 0.5])
    assert found.count.tolist() == [2, 2]
    assert found.brier_score == pytest.approx((0.01 + 0.01 + 0.64 + 0.36) / 4)
    assert found.calibration_error == pytest.approx((0.35 + 0.25) / 2)


def test_equals_scikit_learn() -> None:
    likelihood, hit = calibrated(1000, 0)
    found = reliability(likelihood, hit)
    rate, mean = calibration_curve(hit, likelihood, n_bins=10, strategy="quantile")
    np.testing.assert_allclose(found.hit_rate, rate)
    np.testing.assert_allclose(found.likelihood, mean)
    assert found.brier_score == pytest.approx(brier_score_loss(hit, likelihood))


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 200), st.data())
def test_intervals_equal_scipys_exact_test(count: int, data: st.DataObject) -> None:
    hits = data.draw(st.integers(0, count))
    expected = binomtest(hits, count).proportion_ci(0.9, method="exact")
    low, high = clopper_pearson(np.array([hits]), np.array([count]), 0.9)
    assert (low[0], high[0]) == (pytest.approx(expected.low), pytest.approx(expected.high))


def test_true_likelihoods_lie_in_their_intervals_and_false_ones_do_not() -> None:
    inside = []
    for seed in range(60):
        found = reliability(*calibrated(400, seed))
        inside += ((found.low <= found.likelihood) & (found.likelihood <= found.high)).tolist()
    # 600 exact intervals: at least 95 % in expectation
    assert np.mean(inside) > 0.92
    likelihood, hit = calibrated(4000, 0)
    sure = reliability(np.sqrt(likelihood), hit)
    assert (sure.likelihood > sure.high).sum() >= 8
    assert sure.calibration_error > 3 * reliability(likelihood, hit).calibration_error
    assert sure.brier_score > reliability(likelihood, hit).brier_score


def test_equal_likelihoods_stay_together() -> None:
    value = np.array([0.5, 0.1, 0.5, 0.5, 0.5, 0.9])
    assert equal_count_bins(value, 6).tolist() == [1, 0, 1, 1, 1, 2]
    # the second of six falls into the first of three bins, and its equals follow
    assert equal_count_bins(value, 3).tolist() == [0, 0, 0, 0, 0, 1]
    constant = reliability(np.full(7, 0.3), np.arange(7) < 3)
    assert (constant.count.tolist(), constant.hit_rate[0]) == ([7], pytest.approx(3 / 7))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.integers(1, 12), st.integers(1, 60))
def test_bins_rise_without_gaps(seed: int, n: int, n_bins: int, n_levels: int) -> None:
    value = np.random.default_rng(seed).integers(0, n_levels, n) / n_levels
    bins = equal_count_bins(value, n_bins)
    assert set(bins.tolist()) == set(range(bins.max() + 1))
    assert len(set(bins.tolist())) <= n_bins
    assert (np.diff(bins[np.argsort(value, kind="stable")]) >= 0).all()
    assert all(len(set(bins[value == v].tolist())) == 1 for v in np.unique(value))


def test_refuses_no_candidates_and_scores() -> None:
    with pytest.raises(RescoreError, match="expected candidates"):
        reliability(np.zeros(0), np.zeros(0, bool))
    with pytest.raises(RescoreError, match=r"likelihoods in \[0, 1\], got -1 to 2"):
        reliability(np.array([-1.0, 2.0]), np.array([True, False]))
    with pytest.raises(RescoreError, match="likelihoods in"):
        reliability(np.array([np.nan, 0.5]), np.array([True, False]))
