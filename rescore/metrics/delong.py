"""Variances and test of areas under candidate ROCs without resampling: DeLong 1988, Obuchowski 1997.

An area is a mean over pairs of a hit and a false positive. Its variance comes from the placement of each hit
(the share of false positives that it beats, ties half) and of each false positive (the share of hits that
beat it). DeLong's formula takes all candidates as independent; those of one image are not, and Obuchowski's
sums placements over images first. With one candidate an image the two are equal.

The two tables of a comparison may differ in their candidates and in what became of them: where a car has two
candidates, the better ranked one is the hit. Only the images must be the same.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from recon.arrays import BoolArray, FloatArray, IntArray
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable, best_first, kept_rows


@dataclass(frozen=True, eq=False)
class AreaTest:
    """Two paired areas and the test of their being equal."""

    area: FloatArray
    """Areas before and after, shape (2,)."""
    covariance: FloatArray
    """Covariance of the two areas, shape (2, 2)."""
    difference: float
    """Area after less area before."""
    z: float
    """Difference in standard errors; 0 for equal rankings."""
    p_value: float
    """Two-sided p-value of the two areas being equal."""


def compare_areas(before: MatchTable, after: MatchTable) -> AreaTest:
    """Obuchowski's test for two match tables of the same images, candidates of one image correlated.

    Raises:
        ValueError: tables of different numbers of images, or hits or false positives in fewer than two
        images.
    """
    if before.n_images != after.n_images:
        raise ValueError(f"expected tables of the same images, got {before.n_images} and {after.n_images}")
    return _test(_of_table(before), _of_table(after))


@dataclass(frozen=True, eq=False)
class _Placements:
    """Placements of one table, summed over clusters, less the area for each: shape (n_clusters,) each."""

    area: float
    hits: FloatArray
    false: FloatArray
    n_hits: int
    n_false: int
    clusters_with_hits: int
    clusters_with_false: int


def _of_table(match: MatchTable) -> _Placements:
    is_hit = match.outcome == HIT
    counts = kept_rows(is_hit | (match.outcome == FALSE_ALARM) | (match.outcome == DUPLICATE))
    return _placements(match.ranking[counts], is_hit[counts], match.image[counts], match.n_images)


def _placements(ranking: FloatArray, is_hit: BoolArray, cluster: IntArray, n_clusters: int) -> _Placements:
    """A hit beats as many false positives as its rank among all is higher than that among hits."""
    of_hits, of_false = cluster[is_hit], cluster[~is_hit]
    with_hits, with_false = _n_of(of_hits), _n_of(of_false)
    if with_hits < 2 or with_false < 2:
        raise ValueError(
            f"area test: expected hits and false positives in at least two images each, got {with_hits} and "
            f"{with_false}"
        )
    rank = _ranks(ranking)
    beaten = (rank[is_hit] - _ranks(ranking[is_hit])) / len(of_false)
    beaten_by = 1 - (rank[~is_hit] - _ranks(ranking[~is_hit])) / len(of_hits)
    area = float(beaten.mean())
    return _Placements(
        area,
        _sums(of_hits, beaten - area, n_clusters),
        _sums(of_false, beaten_by - area, n_clusters),
        len(of_hits),
        len(of_false),
        with_hits,
        with_false,
    )


def _ranks(value: FloatArray) -> FloatArray:
    """Ranks of the values (n,) from 1, equal ones the mean of theirs."""
    n, order = len(value), best_first(value)
    falling = value[order]
    begins = np.flatnonzero(np.append(True, falling[1:] != falling[:-1]))
    count = np.diff(begins, append=n)
    # twice the mean place of each level, counted from 0; in place, since levels may be many millions
    begins *= 2
    begins += count - 1
    of_level = begins / 2
    ranks = np.repeat(np.subtract(n, of_level, out=of_level), count)
    if isinstance(order, slice):
        return ranks
    found = np.empty(n)
    found[order] = ranks
    return found


def _n_of(cluster: IntArray) -> int:
    """Number of different clusters."""
    return int(np.count_nonzero(np.bincount(cluster)))


def _sums(cluster: IntArray, value: FloatArray, n_clusters: int) -> FloatArray:
    """Sums of the values (n,) of each cluster, shape (n_clusters,)."""
    return np.bincount(cluster, value, n_clusters).astype(float)


def _test(a: _Placements, b: _Placements) -> AreaTest:
    covariance = np.array([[_covariance(x, y) for y in (a, b)] for x in (a, b)])
    difference = b.area - a.area
    # equal rankings leave a variance of rounding errors, which may be negative
    spread = np.sqrt(max(covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1], 1e-20))
    z = float(difference / spread)
    return AreaTest(np.array([a.area, b.area]), covariance, difference, z, float(2 * ndtr(-abs(z))))


def _covariance(a: _Placements, b: _Placements) -> float:
    """Covariance of two areas: hits with hits, false with false, and in an image hits with false, both
    ways."""
    n_hits, n_false = a.n_hits * b.n_hits, a.n_false * b.n_false
    hits = _corrected(min(a.clusters_with_hits, b.clusters_with_hits)) * (a.hits @ b.hits) / n_hits
    false = _corrected(min(a.clusters_with_false, b.clusters_with_false)) * (a.false @ b.false) / n_false
    mixed = a.hits @ b.false / (a.n_hits * b.n_false) + a.false @ b.hits / (a.n_false * b.n_hits)
    return float(hits + false + _corrected(len(a.hits)) * mixed)


def _corrected(n: int) -> float:
    """Factor for a variance of n sums whose mean was taken off."""
    return n / (n - 1)
