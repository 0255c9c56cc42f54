"""Eq. 7: the posterior likelihood of a candidate from its detector likelihood and its depth difference."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import expit
from sklearn.linear_model import LogisticRegression

from recon.arrays import FloatArray
from rescore.data.splits import ValidationSet
from rescore.evidence.candidates import CandidateTable
from rescore.metrics.matching import HIT, IGNORED, TruthTable, greedy_match, ranking_of


def fuse(likelihood: FloatArray, depth_difference: FloatArray, w: float) -> FloatArray:
    """``exp(w log l + (1 - w) log(1 - D))``, shape (n,), in [0, 1].

    A candidate without depth evidence (D is NaN) keeps its likelihood. The limits are exact: ``0^0 = 1``, so
    w = 1 returns l itself and w = 0 returns 1 - D itself; for w between, l = 0 or D = 1 gives 0. Never NaN.

    Args:
        likelihood: l in [0, 1], shape (n,).
        depth_difference: D in [0, 1], shape (n,); NaN where there is none.
        w: weight of the detector in [0, 1].
    """
    if not 0 <= w <= 1:
        raise ValueError(f"w must lie in [0, 1], got {w}")
    lik, d = np.broadcast_arrays(np.asarray(likelihood, float), np.asarray(depth_difference, float))
    if w == 1:
        # not through exp(log(l)): rounding there could merge two neighbours of the detector's ranking
        return lik.copy()
    if w == 0:
        return np.where(np.isnan(d), lik, 1 - d)
    with np.errstate(divide="ignore"):
        log_posterior = w * np.log(lik) + (1 - w) * np.log1p(-d)
    return np.where(np.isnan(d), lik, np.exp(log_posterior))


SMALLEST = 1e-6
"""What is smaller is taken for this before its logarithm."""


@dataclass(frozen=True)
class LearnedFusion:
    """Log odds that are linear in log l and log(1 - D); eq. 7 has two weights that sum to 1 and no bias."""

    bias: float
    on_likelihood: float
    """Weight of log l."""
    on_depth: float
    """Weight of log(1 - D)."""

    def posterior(self, likelihood: FloatArray, depth_difference: FloatArray) -> FloatArray:
        """Posterior of candidates (n,) with the learned weights, in [0, 1]."""
        log_l, log_d = _logarithms(likelihood, depth_difference)
        fused = expit(self.bias + self.on_likelihood * log_l + self.on_depth * log_d)
        return np.where(np.isnan(depth_difference), likelihood, fused)


def fit_fusion(
    table: CandidateTable, validation: ValidationSet, min_iou: float = 0.5
) -> LearnedFusion | None:
    """Logistic regression on the validation set, as the weight of eq. 7 is chosen there.

    Hits are those of the detector alone; candidates on ignore regions or without a D are left out.
    The regression has scikit-learn's usual penalty (C = 1). None where all that is left is of one kind.

    Raises:
        ValueError: ``table`` holds a candidate of another image.
    """
    truth = TruthTable.of(validation.data)
    ranking = ranking_of(table.score, table.score)
    match = greedy_match(table.image_id, table.xyxy_px, ranking, truth, min_iou)
    use = (match.outcome != IGNORED) & np.isfinite(table.depth_difference)
    is_hit = match.outcome[use] == HIT
    if is_hit.all() or not is_hit.any():
        return None
    features = np.stack(_logarithms(table.likelihood[use], table.depth_difference[use]), axis=1)
    fitted = LogisticRegression(max_iter=5000, tol=1e-8).fit(features, is_hit)
    on_likelihood, on_depth = fitted.coef_[0].tolist()
    return LearnedFusion(float(fitted.intercept_[0]), on_likelihood, on_depth)


def posteriors(
    table: CandidateTable, w: float | None, learned: LearnedFusion | None
) -> dict[str, FloatArray]:
    """The score (n,) of every candidate under each rule, by name; a rule whose numbers are unknown is left
    out."""
    rules: Mapping[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
        "depth": lambda lik, d: fuse(lik, d, 0.0),
        "product": lambda lik, d: lik * (1 - d),
        "maximum": lambda lik, d: np.maximum(lik, 1 - d),
        **({} if w is None else {"eq7": lambda lik, d: fuse(lik, d, w)}),
        **({} if learned is None else {"learned": learned.posterior}),
    }
    lik, d = table.likelihood, table.depth_difference
    return {name: np.where(np.isnan(d), lik, rule(lik, d)) for name, rule in rules.items()}


def _logarithms(likelihood: FloatArray, depth_difference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """log l and log(1 - D), each (n,)."""
    return np.log(np.maximum(likelihood, SMALLEST)), np.log(np.maximum(1 - depth_difference, SMALLEST))
