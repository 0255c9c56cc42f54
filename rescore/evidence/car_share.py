"""D for another detector: the share of cars among its candidates in place of the share D was fitted to.

``1 - D`` of the learned modes is a probability, and so depends on how many of the candidates are cars. A
model fitted to 15 candidates an image of a weak detector takes nearly every candidate for a false alarm; a
strong detector gives few boxes, most of them cars, and D near 1 for all of them would let depth outvote it.
The odds of a car are those of the evidence times those of the share (Saerens, Latinne and Decaestecker 2002),
so a shift of the log odds, the same for all, turns one share into another. The order that D gives stays.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit, logit

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.model import EvidenceModel

LIMIT = 30.0
"""No shift is larger, in log odds either way: a factor of 1e13."""

DOUBTED = float(np.log(3))
"""From a shift of the log odds of so much on the share of cars is doubted: odds three times as high."""


@dataclass(frozen=True, eq=False)
class Adapted:
    """An evidence model for another share of cars."""

    model: EvidenceModel
    share: float
    """Share of cars among the candidates with depth evidence, in (0, 1)."""
    log_odds_shift: float
    """Number added to the log odds of every candidate."""


def log_odds_shift(car_given_depth: FloatArray, share: float) -> float:
    """What to add to the log odds of probabilities (n,) so that their mean is ``share``.

    Args:
        car_given_depth: 1 - D of each candidate, in (0, 1).
        share: in (0, 1).

    Raises:
        ValueError: no candidates, or a share outside (0, 1).
    """
    if not len(car_given_depth) or not 0 < share < 1:
        raise ValueError(f"{len(car_given_depth)} candidates and share {share}")
    log_odds = logit(car_given_depth)
    return float(brentq(lambda s: expit(log_odds + s).mean() - share, -LIMIT, LIMIT, xtol=1e-12))


def with_share_of(model: EvidenceModel, table: CandidateTable) -> Adapted:
    """The model for the share of cars that the candidates' likelihoods say.

    The share is the mean likelihood of the candidates with depth evidence. No annotation is looked at.

    Raises:
        RescoreError: no candidate with depth evidence, or likelihoods that are all 0 or all 1.
    """
    d = model.difference(table.cues)
    has = np.isfinite(d)
    share = float(table.likelihood[has].mean()) if has.any() else 0.0
    if not 0 < share < 1:
        raise RescoreError(
            f"--adapt-share: expected candidates with depth evidence and likelihoods between 0 and 1, got "
            f"{int(has.sum())} with a mean likelihood of {share:g}; leave the option out"
        )
    shift = log_odds_shift(1 - d[has], share)
    return Adapted(model.shifted(shift), share, shift)


def share_doubt(model: EvidenceModel, table: CandidateTable) -> str:
    """Why D may be wrong for the candidates: a sentence; empty where the share of cars does not matter.

    It matters in the mode whose D is fitted with the share of cars as it was, where the candidates'
    likelihoods say another one.
    """
    if model.registration.even_odds:
        return ""
    try:
        adapted = with_share_of(model, table)
    except RescoreError:
        return ""
    if abs(adapted.log_odds_shift) < DOUBTED:
        return ""
    taken = float(np.nanmean(1 - model.difference(table.cues)))
    return (
        f"mode {model.registration}: D takes {taken:.0%} of the candidates for cars, their likelihoods say "
        f"{adapted.share:.0%}; --adapt-share brings them together"
    )


def as_used_for(model: EvidenceModel, cues: FloatArray, d: FloatArray) -> EvidenceModel:
    """The model with the shift that D was made with, where D is this model's but for a shift.

    Args:
        model: as it was fitted.
        cues: of the candidates, shape (n, k).
        d: their D, shape (n,), NaN where there is none. Where no shift explains it the shift is that of the
            median candidate, and ``rescore.results.explain`` refuses the model.
    """
    own = model.difference(cues)
    both = np.isfinite(own) & np.isfinite(d) & (d > 0) & (d < 1)
    shift = float(np.median(logit(own[both]) - logit(d[both]))) if both.any() else 0.0
    # D is kept with all its digits, so what is no shift differs by less than this
    return model.shifted(shift) if abs(shift) > 1e-6 else model
