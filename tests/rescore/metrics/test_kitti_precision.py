"""KITTI's average precision on cases small enough to follow; whole sets: tests/rescore/results."""

import numpy as np
import pytest

from rescore.metrics.kitti_precision import (
    N_RECALLS,
    Judged,
    Touching,
    kitti_precision,
    orientation_similarity,
)


def touching(*pairs: tuple[int, int, float], similarity: float = 1.0) -> Touching:
    detection, car, overlap = (np.array(c) for c in zip(*pairs, strict=True))
    return Touching(detection, car, overlap, np.full(len(pairs), similarity))


def judged(ranking: list[float], n_cars: int, **masks: list[int]) -> Judged:
    def mask(name: str, n: int) -> np.ndarray:
        return np.isin(np.arange(n), masks.get(name, []))

    n = len(ranking)
    return Judged(
        np.array(ranking, float), mask("left_out", n), mask("excused", n), mask("car_left_out", n_cars)
    )


def every_car_found(n_cars: int, n_false: int) -> tuple[list[float], Touching]:
    """Rankings of as many hits as cars, after so many better-ranked detections on nothing."""
    n = n_false + n_cars
    return list(range(n, 0, -1)), touching(*((n_false + i, i, 0.9) for i in range(n_cars)))


def test_all_found_and_nothing_else_is_one() -> None:
    ranking, pairs = every_car_found(80, 0)
    found = kitti_precision(judged(ranking, 80), pairs)
    assert found.average_precision == pytest.approx(1)
    assert found.orientation_similarity == pytest.approx(1)


def test_false_positives_before_the_first_hit() -> None:
    ranking, pairs = every_car_found(80, 20)
    # all 80 hits are among 100: the precision at full recall, 0.8, is the highest at or beyond every recall
    assert kitti_precision(judged(ranking, 80), pairs).average_precision == pytest.approx(0.8)
    # excused or left out they do not count
    for name in ("excused", "left_out"):
        free = judged(ranking, 80, **{name: list(range(20))})
        assert kitti_precision(free, pairs).average_precision == pytest.approx(1)


def test_half_of_the_cars_are_half_of_the_recalls() -> None:
    ranking, pairs = every_car_found(80, 0)
    # 40 hits of 80 cars reach recalls 0, 1/40 ... 20/40: 21 thresholds, the first of which is not averaged
    half = Touching(*(x[:40] for x in (pairs.detection, pairs.car, pairs.overlap, pairs.similarity)))
    found = kitti_precision(judged(ranking[:40], 80), half)
    assert found.average_precision == pytest.approx(20 / N_RECALLS)


def test_fewer_cars_than_recalls_cannot_reach_one() -> None:
    ranking, pairs = every_car_found(4, 0)
    # four hits are read at recalls 0, 1/40, 2/40 and 3/40
    assert kitti_precision(judged(ranking, 4), pairs).average_precision == pytest.approx(3 / N_RECALLS)


def test_cars_left_out_take_a_detection_without_counting() -> None:
    ranking, pairs = every_car_found(81, 0)
    found = kitti_precision(judged(ranking, 81, car_left_out=[0]), pairs)
    assert found.average_precision == pytest.approx(1)
    # a second detection on such a car is false: 80 hits of 81
    more = touching(*((i, i, 0.9) for i in range(81)), (81, 0, 0.8))
    second = kitti_precision(judged([*ranking, 100.0], 81, car_left_out=[0]), more)
    assert second.average_precision == pytest.approx(80 / 81)


def test_a_detection_left_out_takes_a_car_only_where_there_is_no_other() -> None:
    ranking, pairs = every_car_found(80, 0)
    small = list(range(20))
    # 60 of 80 cars are found: 30 recalls of 40 are reached
    found = kitti_precision(judged(ranking, 80, left_out=small), pairs)
    assert found.average_precision == pytest.approx(30 / N_RECALLS)
    # better-ranked detections on these cars that overlap them less are the hits, and none is false
    more = touching(*((i, i, 0.9) for i in range(80)), *((80 + i, i, 0.6) for i in small))
    found = kitti_precision(judged([*ranking, *(100.0 + i for i in small)], 80, left_out=small), more)
    assert found.average_precision == pytest.approx(1)


def test_a_car_takes_the_accepted_detection_that_overlaps_it_most() -> None:
    ranking, _ = every_car_found(80, 0)
    # car 0 has a second detection of lower rank and larger overlap: one of the two is false at the lowest
    # threshold, where 81 are accepted
    two = touching(*((i, i, 0.9) for i in range(80)), (80, 0, 0.95))
    found = kitti_precision(judged([*ranking, 0.5], 80), two)
    assert found.average_precision == pytest.approx(1)
    # the threshold lies above the second one: it is never accepted; above all others it is always false
    found = kitti_precision(judged([*ranking, 1000.0], 80), two)
    assert found.average_precision == pytest.approx(80 / 81)


def test_similarity_weighs_the_hits() -> None:
    np.testing.assert_allclose(
        orientation_similarity(np.array([0, 0, 0.0, np.nan]), np.array([0, np.pi, np.pi / 2, 0])),
        [1, 0, 0.5, 0],
    )
    ranking, pairs = every_car_found(80, 0)
    half = Touching(pairs.detection, pairs.car, pairs.overlap, np.full(80, 0.5))
    found = kitti_precision(judged(ranking, 80), half)
    assert (found.average_precision, found.orientation_similarity) == pytest.approx((1, 0.5))


def test_nothing_to_find_is_undefined_and_nothing_found_is_nought() -> None:
    ranking, pairs = every_car_found(3, 0)
    assert np.isnan(kitti_precision(judged(ranking, 3, car_left_out=[0, 1, 2]), pairs).average_precision)
    none = Touching(*(np.zeros(0, int) for _ in range(2)), *(np.zeros(0) for _ in range(2)))
    assert kitti_precision(judged([], 3), none).average_precision == 0
    assert kitti_precision(judged(ranking, 3), none).average_precision == 0
