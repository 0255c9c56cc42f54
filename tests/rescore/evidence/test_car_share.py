"""D for the share of cars among another detector's candidates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit

from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.car_share import as_used_for, log_odds_shift, share_doubt
from rescore.evidence.cues import CUES, cues_of
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration


def test_shift_of_equal_candidates_is_the_difference_of_log_odds() -> None:
    # all candidates at 0.1: to reach 0.5 on average the log odds move from log(1/9) to 0
    assert log_odds_shift(np.full(7, 0.1), 0.5) == pytest.approx(np.log(9))
    assert log_odds_shift(np.full(7, 0.1), 0.1) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.9])
def test_mean_after_the_shift_is_the_share_and_the_order_stays(share: float) -> None:
    before = np.random.default_rng(0).uniform(0.001, 0.999, 50)
    after = expit(logit(before) + log_odds_shift(before, share))
    assert after.mean() == pytest.approx(share)
    assert np.array_equal(np.argsort(after), np.argsort(before))


def test_known_change_of_share_is_found_back() -> None:
    # two kinds of depth, ten times as frequent among cars as among others and the other way round: with exact
    # posteriors at share 0.1 the shift that fits the mean at share 0.6 gives exact posteriors at 0.6
    kind_given_car, kind_given_other = np.array([10, 1]) / 11, np.array([1, 10]) / 11

    def posterior(share: float) -> np.ndarray:
        car = share * kind_given_car
        return car / (car + (1 - share) * kind_given_other)

    n = 11_000
    of_kind = np.rint(n * (0.6 * kind_given_car + 0.4 * kind_given_other)).astype(int)
    shift = log_odds_shift(np.repeat(posterior(0.1), of_kind), 0.6)
    assert expit(logit(posterior(0.1)) + shift) == pytest.approx(posterior(0.6), abs=1e-4)


def test_the_shift_that_d_was_made_with_is_found_back() -> None:
    rng = np.random.default_rng(1)
    mode = Registration.GUARDED
    knots = {name: np.array([0.0, 1.0]) for name in cues_of(mode)}
    fitted = EvidenceModel(mode, knots, dict.fromkeys(cues_of(mode), np.array([-1.0, 1.0])), -3.0, 0.5, {})
    cues = rng.uniform(size=(20, len(CUES)))
    d = fitted.shifted(2.5).difference(cues)
    d[3] = np.nan
    assert as_used_for(fitted, cues, d).bias == pytest.approx(-0.5)
    assert as_used_for(fitted, cues, fitted.difference(cues)) is fitted


def test_another_share_is_doubted_where_it_matters() -> None:
    rng = np.random.default_rng(2)

    def doubt(mode: Registration, likelihood: float) -> str:
        knots = {name: np.array([0.0, 1.0]) for name in cues_of(mode)}
        model = EvidenceModel(mode, knots, dict.fromkeys(cues_of(mode), np.array([-0.1, 0.1])), -2.2, 0.5, {})
        candidates = Candidates(1, np.tile([0.0, 0, 9, 9], (20, 1)), np.ones(20), np.full(20, likelihood))
        table = CandidateTable.of_candidates([candidates])
        return share_doubt(model, replace(table, cues=rng.uniform(size=(20, len(CUES)))))

    assert doubt(Registration.GUARDED, 0.8).startswith("mode guarded: D takes 10% of the candidates for cars")
    assert "likelihoods say 80%; --adapt-share" in doubt(Registration.GUARDED, 0.8)
    # odds of 1 to 9, less than three times as high
    assert doubt(Registration.GUARDED, 0.2) == ""
    # where likelihoods tell no share there is nothing to compare
    assert doubt(Registration.GUARDED, 1.0) == ""
    assert doubt(Registration.METRIC, 0.8) == ""


def test_nothing_to_shift_is_refused() -> None:
    with pytest.raises(ValueError, match="0 candidates"):
        log_odds_shift(np.zeros(0), 0.5)
    with pytest.raises(ValueError, match="share 1"):
        log_odds_shift(np.full(2, 0.5), 1.0)
