import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.boxes import iou_matrix
from rescore.metrics import matching
from rescore.metrics.matching import (
    DUPLICATE,
    HIT,
    OUTCOMES,
    TruthTable,
    greedy_match,
    ranked_order,
    ranking_of,
)

CAR = [0.0, 0.0, 10.0, 10.0]


def truth(boxes: list[list[float]], ignore: list[bool] | None = None, n_images: int = 1) -> TruthTable:
    n = len(boxes)
    return TruthTable(
        np.arange(n_images) + 7,
        np.zeros(n, np.int64),
        np.arange(n) + 100,
        np.array(boxes, float).reshape(-1, 4),
        np.array(ignore or [False] * n, bool),
    )


def outcomes(boxes: list[list[float]], ranking: list[float], table: TruthTable) -> list[tuple[str, int]]:
    image = np.full(len(boxes), 7)
    match = greedy_match(image, np.array(boxes, float).reshape(-1, 4), np.array(ranking, float), table)
    return [(OUTCOMES[o].value, int(a)) for o, a in zip(match.outcome, match.annotation_id, strict=True)]


def test_best_ranking_takes_the_car_and_the_other_is_a_duplicate() -> None:
    got = outcomes([[0, 0, 10, 9], CAR], [1, 2], truth([CAR]))
    assert got == [("duplicate", 100), ("hit", 100)]


def test_equal_ranking_goes_to_the_first_row() -> None:
    assert outcomes([CAR, CAR], [1, 1], truth([CAR])) == [("hit", 100), ("duplicate", 100)]


def test_overlap_of_exactly_half_counts() -> None:
    # 10 x 5 inside 10 x 10: 50 / 100
    assert outcomes([[0, 0, 10, 5]], [1], truth([CAR])) == [("hit", 100)]
    assert outcomes([[0, 0, 10, 4.99]], [1], truth([CAR])) == [("false_alarm", -1)]


def test_a_taken_car_leaves_the_next_best_free_one() -> None:
    # both candidates overlap car 100 most; the second takes 101, which it overlaps by 70 / 130 > 0.5
    cars = [[0, 0, 10, 10], [3, 0, 13, 10]]
    got = outcomes([[0, 0, 10, 10], [0.5, 0, 10.5, 10]], [2, 1], truth(cars))
    assert got == [("hit", 100), ("hit", 101)]


def test_ignore_regions_take_any_number_and_come_before_duplicates() -> None:
    region = [0.0, 0.0, 100.0, 100.0]
    got = outcomes([[1, 1, 5, 5], [50, 50, 90, 90], [90, 90, 130, 130]], [3, 2, 1], truth([region], [True]))
    # the third lies in the region by 10 * 10 / 1600 only
    assert got == [("ignored", 100), ("ignored", 100), ("false_alarm", -1)]
    both = outcomes([CAR, CAR], [2, 1], truth([CAR, region], [False, True]))
    assert both == [("hit", 100), ("ignored", 101)]


def test_ignored_cars_do_not_count_and_every_image_does() -> None:
    table = truth([CAR, CAR], [False, True], n_images=5)
    assert (table.n_cars, table.n_images) == (1, 5)
    assert table.cars_of_image.tolist() == [1, 0, 0, 0, 0]


def test_no_candidates_and_no_cars() -> None:
    assert outcomes([], [], truth([CAR])) == []
    assert outcomes([CAR], [1], truth([])) == [("false_alarm", -1)]


def test_refuses_a_candidate_of_an_unknown_image() -> None:
    with pytest.raises(ValueError, match="not among the images"):
        greedy_match(np.array([99]), np.array([CAR]), np.ones(1), truth([CAR]))


def plain_greedy(boxes: np.ndarray, ranking: np.ndarray, cars: np.ndarray, ignore: np.ndarray) -> list[str]:
    """The rule as a loop over one image: the second implementation."""
    iou = iou_matrix(boxes, cars)
    free = ~ignore
    result = [""] * len(boxes)
    for i in sorted(range(len(boxes)), key=lambda k: -ranking[k]):
        best = max(
            (j for j in range(len(cars)) if free[j] and iou[i, j] >= 0.5),
            key=lambda j: (iou[i, j], j),
            default=-1,
        )
        low, high = np.maximum(boxes[i, :2], cars[:, :2]), np.minimum(boxes[i, 2:], cars[:, 2:])
        share = np.prod(np.clip(high - low, 0, None), axis=1) / np.prod(boxes[i, 2:] - boxes[i, :2])
        if best >= 0:
            free[best] = False
            result[i] = "hit"
        elif (share[ignore] >= 0.5).any():
            result[i] = "ignored"
        else:
            result[i] = "duplicate" if (iou[i, ~ignore] >= 0.5).any() else "false_alarm"
    return result


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_many_images_at_once_equal_a_loop_over_each(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n_images = 6
    car_image = np.sort(rng.integers(0, n_images, 14))
    corner = rng.uniform(0, 12, (14, 2))
    cars = np.concatenate([corner, corner + rng.uniform(6, 10, (14, 2))], axis=1)
    table = TruthTable(np.arange(n_images) * 3, car_image, np.arange(14), cars, rng.random(14) < 0.2)
    image = rng.integers(0, n_images, 40)
    corner = rng.uniform(0, 12, (40, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(6, 10, (40, 2))], axis=1)
    ranking = rng.integers(0, 10, 40).astype(float)
    match = greedy_match(image * 3, boxes, ranking, table)
    assert match.image.tolist() == image.tolist()
    for i in range(n_images):
        rows, own = np.flatnonzero(image == i), car_image == i
        expected = plain_greedy(boxes[rows], ranking[rows], cars[own], table.ignore[own])
        assert [OUTCOMES[o].value for o in match.outcome[rows]] == expected
    hits = match.annotation_id[match.outcome == 0]
    assert len(set(hits.tolist())) == len(hits)


def test_ranking_breaks_ties_by_detector_score() -> None:
    ranking = ranking_of(np.array([0.5, 1.0, 1.0, 0.5, 1.0]), np.array([9.0, 2.0, 3.0, 9.0, 2.0]))
    assert ranking.tolist() == [0, 1, 2, 0, 1]
    assert ranking_of(np.zeros(0), np.zeros(0)).shape == (0,)


@pytest.mark.parametrize("n", [0, 1, 7, 3000])
def test_order_is_that_of_a_sort_by_keys(n: int) -> None:
    rng = np.random.default_rng(n)
    close = 0.5 + rng.integers(0, 50, n) * 2.0**-50
    for first in (close, np.round(rng.normal(size=n), 2), -0.0 * close, np.where(close > 0.5, close, np.nan)):
        second = rng.integers(0, 5, n).astype(float)
        order, fresh = ranked_order(first, second)
        np.testing.assert_array_equal(order, np.lexsort((np.arange(n), -second, -first)))
        rows = list(zip(np.nan_to_num(first[order], nan=9).tolist(), second[order].tolist(), strict=True))
        assert fresh.tolist() == [i == 0 or rows[i] != rows[i - 1] for i in range(n)]


def test_pairs_some_at_a_time_match_as_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    ids = np.arange(6)
    truth = TruthTable(
        ids,
        np.repeat(ids, 3),
        np.arange(18),
        boxes_at(rng.uniform(0, 30, (18, 2))),
        rng.random(18) < 0.3,
    )
    image, boxes, score = rng.integers(0, 6, 200), boxes_at(rng.uniform(0, 30, (200, 2))), rng.random(200)
    for min_iou in (0.0, 0.3):
        whole = greedy_match(image, boxes, score, truth, min_iou)
        monkeypatch.setattr(matching, "AT_A_TIME", 7)
        parts = greedy_match(image, boxes, score, truth, min_iou)
        monkeypatch.undo()
        assert set(whole.outcome.tolist()) >= {HIT, DUPLICATE}
        np.testing.assert_array_equal(parts.outcome, whole.outcome)
        np.testing.assert_array_equal(parts.annotation_id, whole.annotation_id)


def boxes_at(corner: np.ndarray) -> np.ndarray:
    return np.concatenate([corner, corner + 15], axis=1)
