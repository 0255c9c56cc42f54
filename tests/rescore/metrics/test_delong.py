import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm
from sklearn.metrics import roc_auc_score

from rescore.metrics.bootstrap import draw_images
from rescore.metrics.delong import AreaTest, compare_areas
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, IGNORED, MatchTable
from rescore.metrics.resampled import Levels, weighted_figures
from tests.rescore.simulated_matches import simulate


def wins(hit: float, false: float) -> float:
    return 1.0 if hit > false else 0.5 if hit == false else 0.0


def delong_test(ranking: np.ndarray, is_hit: np.ndarray) -> AreaTest:
    """The test of candidates (n,) ranked twice (2, n), each in an image of its own and so independent."""
    image, outcome = np.arange(len(is_hit)), np.where(is_hit, HIT, FALSE_ALARM).astype(np.int8)
    n_cars = int(is_hit.sum())
    return compare_areas(*(MatchTable(len(image), n_cars, image, r, outcome, image) for r in ranking))


def plain_delong(ranking: np.ndarray, is_hit: np.ndarray) -> np.ndarray:
    """DeLong's covariance (2, 2) from every pair, as a loop: the second implementation."""
    of_hits, of_false = [], []
    for r in ranking:
        pairs = np.array([[wins(h, f) for f in r[~is_hit]] for h in r[is_hit]])
        of_hits.append(pairs.mean(axis=1))
        of_false.append(pairs.mean(axis=0))
    return np.cov(of_hits) / is_hit.sum() + np.cov(of_false) / (~is_hit).sum()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 30))
def test_delong_equals_a_loop_over_all_pairs(seed: int, n_levels: int) -> None:
    rng = np.random.default_rng(seed)
    is_hit = rng.permutation(np.arange(25) < 9)
    ranking = rng.integers(0, n_levels, (2, 25)).astype(float)
    test = delong_test(ranking, is_hit)
    np.testing.assert_allclose(test.covariance, plain_delong(ranking, is_hit), atol=1e-12)
    np.testing.assert_allclose(test.area, [roc_auc_score(is_hit, r) for r in ranking])


def plain_obuchowski(match: MatchTable) -> float:
    """Obuchowski's variance of one area, image by image, as a loop."""
    rows = [
        (i, r, o == HIT)
        for i, r, o in zip(match.image, match.ranking, match.outcome, strict=True)
        if o != IGNORED
    ]
    hits = [(i, r) for i, r, h in rows if h]
    false = [(i, r) for i, r, h in rows if not h]
    area = np.mean([wins(h, f) for _, h in hits for _, f in false])
    total_10 = total_01 = total_11 = 0.0
    for image in range(match.n_images):
        x = sum(np.mean([wins(h, f) for _, f in false]) - area for i, h in hits if i == image)
        y = sum(np.mean([wins(h, f) for _, h in hits]) - area for i, f in false if i == image)
        total_10, total_01, total_11 = total_10 + x * x, total_01 + y * y, total_11 + x * y
    i10, i01, m, n = len({i for i, _ in hits}), len({i for i, _ in false}), len(hits), len(false)
    s10 = i10 / ((i10 - 1) * m) * total_10
    s01 = i01 / ((i01 - 1) * n) * total_01
    s11 = match.n_images / (match.n_images - 1) * total_11
    return float(s10 / m + s01 / n + 2 * s11 / (m * n))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_clustered_variance_equals_a_loop_over_images(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outcome = rng.choice(np.array([HIT, FALSE_ALARM, DUPLICATE, IGNORED], np.int8), 40)
    image = rng.integers(0, 8, 40)
    image[:4], outcome[:4] = [0, 1, 0, 1], [HIT, HIT, FALSE_ALARM, FALSE_ALARM]
    tables = [
        MatchTable(8, 40, image, rng.integers(0, 15, 40).astype(float), outcome, np.full(40, -1))
        for _ in range(2)
    ]
    expected = [plain_obuchowski(m) for m in tables]
    np.testing.assert_allclose(np.diag(compare_areas(*tables).covariance), expected, atol=1e-12)


def one_candidate_an_image(rng: np.random.Generator, n: int) -> tuple[MatchTable, MatchTable]:
    hit = rng.random(n) < 0.4
    outcome = np.where(hit, HIT, FALSE_ALARM).astype(np.int8)
    shared = rng.normal(size=n) + hit

    def table(gain: float) -> MatchTable:
        ranking = shared + gain * hit + 0.7 * rng.normal(size=n)
        return MatchTable(n, n, np.arange(n), ranking, outcome, np.full(n, -1))

    return table(0.0), table(0.4)


def test_one_candidate_an_image_is_delong() -> None:
    before, after = one_candidate_an_image(np.random.default_rng(0), 200)
    clustered = compare_areas(before, after)
    plain = plain_delong(np.stack([before.ranking, after.ranking]), before.outcome == HIT)
    np.testing.assert_allclose(clustered.covariance, plain)
    z = (clustered.area[1] - clustered.area[0]) / np.sqrt(plain[0, 0] + plain[1, 1] - 2 * plain[0, 1])
    assert (clustered.z, clustered.p_value) == (pytest.approx(z), pytest.approx(2 * norm.sf(abs(z))))


def bootstrap_covariance(before: MatchTable, after: MatchTable, cars: np.ndarray) -> np.ndarray:
    draws = draw_images(before.n_images, 4000, np.random.default_rng(1))
    return np.cov([weighted_figures(m, cars, draws, Levels())[:, 0] for m in (before, after)])


def test_delong_equals_the_bootstrap_of_independent_candidates() -> None:
    before, after = one_candidate_an_image(np.random.default_rng(0), 400)
    test = delong_test(np.stack([before.ranking, after.ranking]), before.outcome == HIT)
    expected = bootstrap_covariance(before, after, np.ones(400, int))
    # 4000 resamples know a variance to 2.2 %
    np.testing.assert_allclose(test.covariance, expected, rtol=0.08)


def test_clustered_variance_equals_the_bootstrap_over_images() -> None:
    data = simulate(200, np.random.default_rng(2))
    expected = bootstrap_covariance(data.before, data.after, data.cars_of_image)
    np.testing.assert_allclose(compare_areas(data.before, data.after).covariance, expected, rtol=0.1)


def unchanged(n_images: int, rng: np.random.Generator) -> tuple[MatchTable, MatchTable]:
    """Eight candidates an image, ranked twice and equally well; each ranking errs for an image as a whole.

    Whole images are full of hits or empty of them, so that such an error makes many wrong pairs at once.
    """
    image = np.repeat(np.arange(n_images), 8)
    hit = rng.random(len(image)) < np.where(rng.random(n_images) < 0.3, 0.8, 0.05)[image]
    outcome = np.where(hit, HIT, FALSE_ALARM).astype(np.int8)
    shared = hit + rng.normal(size=len(image))
    errors = rng.normal(size=(2, len(image))) + rng.normal(size=(2, n_images))[:, image]
    before, after = (MatchTable(n_images, len(image), image, shared + e, outcome, image) for e in errors)
    return before, after


def test_rejects_at_the_rate_it_says_where_nothing_changed() -> None:
    rng = np.random.default_rng(0)
    rejected = independent = 0
    for _ in range(300):
        before, after = unchanged(60, rng)
        rejected += compare_areas(before, after).p_value < 0.05
        rankings = np.stack([before.ranking, after.ranking])
        independent += delong_test(rankings, before.outcome == HIT).p_value < 0.05
    # 300 sets at 5 %: 15, spread 4; a little more, since 60 images are few for a normal approximation
    assert 5 <= rejected <= 30
    # candidates taken as independent seem to say more than they do
    assert independent > 45


def test_the_better_table_shows_and_equal_ones_do_not() -> None:
    data = simulate(150, np.random.default_rng(0), gain=1.5)
    better = compare_areas(data.before, data.after)
    assert better.difference == pytest.approx(better.area[1] - better.area[0])
    assert better.z > 3
    assert better.p_value < 0.003
    assert compare_areas(data.after, data.before).z == pytest.approx(-better.z)
    same = compare_areas(data.before, data.before)
    assert (same.difference, same.z, same.p_value) == (0, 0, 1)


def test_refuses_what_has_no_variance() -> None:
    data = simulate(20, np.random.default_rng(0))
    with pytest.raises(ValueError, match="same images, got 20 and 30"):
        compare_areas(data.before, simulate(30, np.random.default_rng(0)).before)
    with pytest.raises(ValueError, match="at least two images each, got 1 and 3"):
        delong_test(np.zeros((2, 4)), np.array([True, False, False, False]))
