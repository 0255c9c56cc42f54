"""Eq. 7: the posterior likelihood of a candidate from its detector likelihood and its depth difference."""

import numpy as np

from recon.arrays import FloatArray


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
