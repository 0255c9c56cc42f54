"""Is a likelihood what it says: of candidates given 0.8, are eight in ten hits? Arrays in, arrays out."""

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.errors import RescoreError

N_BINS = 10


@dataclass(frozen=True, eq=False)
class Reliability:
    """How often candidates are hits, by likelihood. Bins (b,), none of them empty, rising."""

    likelihood: FloatArray
    """Mean likelihood in each bin."""
    hit_rate: FloatArray
    """Share of hits in each bin."""
    low: FloatArray
    """Ends of the exact binomial interval of the hit rate (Clopper and Pearson 1934), candidates taken as
    independent."""
    high: FloatArray
    """Upper end of the interval of the hit rate in each bin."""
    count: IntArray
    """Candidates in each bin."""
    brier_score: float
    """Mean square of likelihood less outcome (0 or 1), over candidates; 0 is best, always 1/2 gives 0.25."""
    calibration_error: float
    """Expected calibration error: mean over candidates of |mean likelihood - hit rate| of their bin. Few
    candidates a bin make it larger."""


def reliability(
    likelihood: FloatArray, is_hit: BoolArray, n_bins: int = N_BINS, confidence: float = 0.95
) -> Reliability:
    """The reliability curve over bins of equal count.

    Candidates are sorted by likelihood and cut into ``n_bins`` runs as equal as can be; a run of equal
    likelihoods is never cut, so there may be fewer bins. Equal counts make the intervals of all bins about as
    wide; with bins of equal width most candidates of a detector would fall into the lowest.

    Args:
        likelihood: l, or a posterior, in [0, 1], shape (n,).
        is_hit: whether each is a hit, shape (n,). Leave out ignored candidates.
        n_bins: bins at most.
        confidence: of the intervals.

    Raises:
        RescoreError: no candidates, or likelihoods outside [0, 1].
    """
    lik, hit = np.asarray(likelihood, float), np.asarray(is_hit, bool)
    if not len(lik) or lik.shape != hit.shape:
        raise RescoreError(
            f"reliability: expected candidates with an outcome each, got {lik.shape} and {hit.shape}; "
            "evaluate a set with candidates"
        )
    if not ((lik >= 0) & (lik <= 1)).all():
        raise RescoreError(
            f"reliability: expected likelihoods in [0, 1], got {lik.min():g} to {lik.max():g}; calibrate the "
            "scores first"
        )
    bins = equal_count_bins(lik, n_bins)
    count = np.bincount(bins).astype(np.int64)
    hits = np.bincount(bins, hit).astype(np.int64)
    mean, rate = np.bincount(bins, lik) / count, hits / count
    low, high = clopper_pearson(hits, count, confidence)
    error = float((count * np.abs(mean - rate)).sum() / len(lik))
    return Reliability(mean, rate, low, high, count, float(((lik - hit) ** 2).mean()), error)


def equal_count_bins(value: FloatArray, n_bins: int) -> IntArray:
    """Bin of each value (n,), 0, 1, ... without a gap; see ``reliability``."""
    order = np.argsort(value, kind="stable")
    rising = value[order]
    begins = np.flatnonzero(np.append(True, rising[1:] != rising[:-1]))
    # equal values all go where the first of them goes
    of_run = begins * n_bins // len(value)
    dense = np.cumsum(np.append(0, np.diff(of_run) != 0))
    bins = np.empty(len(value), np.int64)
    bins[order] = np.repeat(dense, np.diff(np.append(begins, len(value))))
    return bins


def clopper_pearson(
    hits: IntArray, count: IntArray, confidence: float = 0.95
) -> tuple[FloatArray, FloatArray]:
    """Ends of the exact binomial interval of a share, each of shape (b,)."""
    tail = (1 - confidence) / 2
    low = betaincinv(hits, count - hits + 1, tail)
    high = betaincinv(hits + 1, count - hits, 1 - tail)
    return np.where(hits == 0, 0.0, low), np.where(hits == count, 1.0, high)
