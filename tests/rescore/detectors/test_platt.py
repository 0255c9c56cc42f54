import numpy as np
import pytest
from scipy.optimize import minimize

from recon.errors import RescoreError
from rescore.data.frames import Truth
from rescore.detectors.base import Detections
from rescore.detectors.platt import PlattScaling, fit_platt, label_candidates


def sample(n, a, b, seed=0):
    rng = np.random.default_rng(seed)
    score = rng.normal(0, 1.5, n)
    return score, rng.random(n) < 1 / (1 + np.exp(a * score + b))


def test_recovers_the_scaling_that_made_the_labels():
    score, is_car = sample(40_000, -1.7, 0.6)
    fitted = fit_platt(score, is_car)
    assert fitted.a == pytest.approx(-1.7, abs=0.05)
    assert fitted.b == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_equals_a_plain_minimisation_of_platts_objective(seed):
    score, is_car = sample(60, -1.2, 0.4, seed)
    n_cars = is_car.sum()
    target = np.where(is_car, (n_cars + 1) / (n_cars + 2), 1 / (len(score) - n_cars + 2))

    def loss(ab):
        z = ab[0] * score + ab[1]
        return float((target * np.logaddexp(0, z) + (1 - target) * np.logaddexp(0, -z)).sum())

    best = minimize(loss, [-1.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12}).x
    fitted = fit_platt(score, is_car)
    assert (fitted.a, fitted.b) == pytest.approx(tuple(best), abs=2e-3)


def test_smoothed_targets_keep_separable_scores_finite():
    fitted = fit_platt(np.array([-2.0, -1.0, 1.0, 2.0]), np.array([False, False, True, True]))
    likelihood = fitted.likelihood(np.array([-2.0, 2.0]))
    assert 0.05 < likelihood[0] < 0.5 < likelihood[1] < 0.95


def test_likelihood_by_hand_and_at_extremes():
    platt = PlattScaling(-2.0, 1.0)
    # 1 / (1 + exp(-2 * 1 + 1)) = 1 / (1 + e^-1)
    assert platt.likelihood(np.array([1.0])) == pytest.approx([1 / (1 + np.exp(-1))])
    assert platt.likelihood(np.array([-1e6, 1e6])).tolist() == [0.0, 1.0]
    score = np.linspace(-5, 5, 50)
    assert (np.diff(platt.likelihood(score)) > 0).all()


@pytest.mark.parametrize(
    ("score", "is_car", "message"),
    [
        ([0.0, 1.0], [False, False], "got 0 cars of 2"),
        ([0.0, 1.0], [True, True], "got 2 cars of 2"),
        ([], [], "got 0 cars of 0"),
        ([0.0, np.nan], [False, True], "expected as many finite scores as labels"),
        ([0.0, 1.0, 2.0, 3.0], [True, True, False, False], "expected a finite slope a < 0"),
    ],
)
def test_bad_samples_are_refused(score, is_car, message):
    with pytest.raises(RescoreError, match=message):
        fit_platt(np.array(score), np.array(is_car, dtype=bool))


def test_labels_of_candidates():
    truth = Truth(
        np.array([1, 2]),
        np.array([[0.0, 0, 100, 40], [200, 0, 300, 40]]),
        np.array([False, True]),
        np.array([1.0, 0.3]),
        ("", ""),
    )
    boxes = np.array(
        [
            [0.0, 0, 100, 40],  # the car
            [10, 0, 110, 40],  # the car again: 90 / 110
            [40, 0, 140, 40],  # too far from the car: 60 / 140
            [205, 0, 305, 40],  # the ignored car
            [260, 10, 290, 20],  # inside the ignored car
            [400, 0, 500, 40],  # street
        ]
    )
    is_car, counts = label_candidates(Detections(boxes, np.arange(6.0)), truth)
    assert is_car.tolist() == [True, True, False, False, False, False]
    assert counts.tolist() == [True, True, True, False, False, True]


def test_labels_without_truth_or_detections():
    nothing = Truth(np.empty(0, np.int64), np.empty((0, 4)), np.empty(0, bool), np.empty(0), ())
    is_car, counts = label_candidates(Detections(np.array([[0.0, 0, 9, 9]]), np.zeros(1)), nothing)
    assert (is_car.tolist(), counts.tolist()) == ([False], [True])
    is_car, counts = label_candidates(Detections(np.empty((0, 4)), np.empty(0)), nothing)
    assert is_car.shape == counts.shape == (0,)
