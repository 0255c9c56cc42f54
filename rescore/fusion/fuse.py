"""Eq. 7: the posterior likelihood of a candidate from its detector likelihood and its depth difference."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray
from rescore.data.splits import ValidationSet
from rescore.evidence.candidates import CandidateTable
from rescore.metrics.matching import HIT, IGNORED, TruthTable, greedy_match, ranking_of

SMALLEST = 1e-6
"""What is smaller is taken for this before its logarithm."""


def fuse(likelihood: FloatArray, depth_difference: FloatArray, w: float) -> FloatArray:
    """``exp(w log l + (1 - w) log(1 - D))``, shape (n,), in [0, 1].

    Where D is NaN the likelihood is kept: only mode paper leaves D so, for candidates without depth evidence.
    The limits are exact: ``0^0 = 1``, so w = 1 returns l itself and w = 0 returns 1 - D itself; for w
    between, l = 0 or D = 1 gives 0. Never NaN.

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
        from scipy.special import expit  # noqa: PLC0415 (a third of a second)

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
    from sklearn.linear_model import LogisticRegression  # noqa: PLC0415 (takes a second; fitting alone needs it)

    fitted = LogisticRegression(max_iter=5000, tol=1e-8).fit(features, is_hit)
    on_likelihood, on_depth = fitted.coef_[0].tolist()
    return LearnedFusion(float(fitted.intercept_[0]), on_likelihood, on_depth)


@dataclass(frozen=True)
class FusionRule:
    """A way of putting likelihood and depth difference together."""

    words: str
    """What it does, for tables."""
    score: Callable[[FloatArray, FloatArray, float | None, LearnedFusion | None], FloatArray | None]
    """From l (n,), D (n,), the tuned w and the learned fusion to scores (n,); None where it needs what is
    unknown."""


RULES: dict[str, FusionRule] = {
    "depth": FusionRule("depth alone, 1 − D", lambda lik, d, _w, _learned: fuse(lik, d, 0.0)),
    "product": FusionRule("product, l (1 − D)", lambda lik, d, _w, _learned: lik * (1 - d)),
    "maximum": FusionRule("maximum of l and 1 − D", lambda lik, d, _w, _learned: np.maximum(lik, 1 - d)),
    "eq7": FusionRule("eq. 7", lambda lik, d, w, _learned: None if w is None else fuse(lik, d, w)),
    "learned": FusionRule(
        "learned from log l and log(1 − D)",
        lambda lik, d, _w, learned: None if learned is None else learned.posterior(lik, d),
    ),
}
"""The rules that eq. 7 is held against, and eq. 7 itself, by the name that metrics.json uses."""


def posteriors(
    table: CandidateTable, w: float | None, learned: LearnedFusion | None
) -> dict[str, FloatArray]:
    """The score (n,) of every candidate under each of ``RULES``, by name.

    A rule whose numbers are unknown is left out. A candidate without a D keeps its likelihood.
    """
    scores = {n: posterior_of(n, table.likelihood, table.depth_difference, w, learned) for n in RULES}
    return {name: score for name, score in scores.items() if score is not None}


def posterior_of(
    rule: str,
    likelihood: FloatArray,
    depth_difference: FloatArray,
    w: float | None,
    learned: LearnedFusion | None,
) -> FloatArray | None:
    """The score (n,) of every candidate under one of ``RULES``; None where its numbers are unknown."""
    score = RULES[rule].score(likelihood, depth_difference, w, learned)
    return None if score is None else np.where(np.isnan(depth_difference), likelihood, score)


def _logarithms(likelihood: FloatArray, depth_difference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """log l and log(1 - D), each (n,)."""
    return np.log(np.maximum(likelihood, SMALLEST)), np.log(np.maximum(1 - depth_difference, SMALLEST))
