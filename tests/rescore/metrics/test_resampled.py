import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score

from rescore.metrics.curves import summarise
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, IGNORED, MatchTable
from rescore.metrics.resampled import Levels, average_precisions, weighted_figures

LEVELS = Levels(fppi=(0.25, 1.0), recalls=(0.3, 0.5, 0.8))


def random_table(rng: np.random.Generator, n_images: int, n: int) -> tuple[MatchTable, np.ndarray]:
    """Candidates with ties, some ignored, and the cars of each image: its hits and some missed."""
    image = np.sort(rng.integers(0, n_images, n))
    outcome = rng.choice(np.array([HIT, FALSE_ALARM, DUPLICATE, IGNORED], np.int8), n)
    cars = np.bincount(image[outcome == HIT], minlength=n_images) + rng.integers(0, 2, n_images)
    ranking = rng.integers(0, max(n // 2, 1), n).astype(float)
    return MatchTable(n_images, int(cars.sum()), image, ranking, outcome, np.full(n, -1)), cars


def repeated(match: MatchTable, cars: np.ndarray, weight: np.ndarray) -> MatchTable:
    """The table in which every image appears as often as its weight, copies of a candidate in a row."""
    times = weight[match.image]
    return MatchTable(
        int(weight.sum()),
        int((cars * weight).sum()),
        image=np.repeat(match.image, times),
        ranking=np.repeat(match.ranking, times),
        outcome=np.repeat(match.outcome, times),
        annotation_id=np.repeat(match.annotation_id, times),
    )


def plain_rate(match: MatchTable, fppi: float) -> float:
    """Best true-positive rate of all thresholds with at most ``fppi`` false positives an image, as a loop."""
    best = 0.0
    for threshold in np.unique(match.ranking):
        kept = match.outcome[match.ranking >= threshold]
        if np.isin(kept, (FALSE_ALARM, DUPLICATE)).sum() / match.n_images <= fppi:
            best = max(best, (kept == HIT).sum() / match.n_cars)
    return best


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(0, 40))
def test_weights_equal_repeated_images(seed: int, n_images: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    match, cars = random_table(rng, n_images, n)
    weight = rng.multinomial(n_images, np.full(n_images, 1 / n_images), size=3).astype(np.int32)
    figures = weighted_figures(match, cars, weight, LEVELS)
    np.testing.assert_array_equal(average_precisions(match, cars, weight), figures[:, 1])
    for row, w in zip(figures, weight, strict=True):
        copy = repeated(match, cars, w)
        if not copy.n_cars:
            assert np.isnan(row[:4]).all()
            assert np.isinf(row[4:]).all()
            continue
        expected = summarise(copy)
        np.testing.assert_allclose(row[:2], [expected.auc, expected.average_precision])
        np.testing.assert_allclose(row[2:4], [plain_rate(copy, v) for v in LEVELS.fppi])
        assert (row[5] == np.inf) == (expected.fppi_at_recall[0.5] is None)
        assert row[5] == np.inf or row[5] == pytest.approx(expected.fppi_at_recall[0.5])


def test_many_weights_at_once_equal_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    match, cars = random_table(rng, 12, 60)
    weight = rng.multinomial(12, np.full(12, 1 / 12), size=20).astype(np.int32)
    whole = weighted_figures(match, cars, weight, LEVELS)
    monkeypatch.setattr("rescore.metrics.resampled.CELLS", 7 * 60)
    np.testing.assert_array_equal(weighted_figures(match, cars, weight, LEVELS), whole)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_area_equals_scikit_learn_with_sample_weights(seed: int) -> None:
    rng = np.random.default_rng(seed)
    match, cars = random_table(rng, 10, 50)
    weight = (1 + rng.integers(0, 3, (1, 10))).astype(np.int32)
    counts = match.outcome != IGNORED
    is_hit = match.outcome[counts] == HIT
    expected = roc_auc_score(is_hit, match.ranking[counts], sample_weight=weight[0][match.image[counts]])
    assert weighted_figures(match, cars, weight, LEVELS)[0, 0] == pytest.approx(expected)
