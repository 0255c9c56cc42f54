from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.errors import RescoreError
from rescore.metrics.curves import index_at_fppi, index_at_recall, recall_ceiling, recall_curve
from rescore.metrics.matching import (
    DUPLICATE,
    FALSE_ALARM,
    HIT,
    IGNORED,
    MatchTable,
    TruthTable,
    greedy_match,
)
from rescore.results.changes import GAINS, LOSSES, Changes, Group, OperatingPoint, default_point

N_IMAGES = 4


def table(ranking, outcome, annotation, n_cars=4, image=None) -> MatchTable:
    n = len(ranking)
    where = np.zeros(n, int) if image is None else np.asarray(image)
    outcome = np.asarray(outcome, np.int8)
    return MatchTable(N_IMAGES, n_cars, where, np.asarray(ranking, float), outcome, np.asarray(annotation))


def groups(before: MatchTable, after: MatchTable, point: OperatingPoint) -> list[str]:
    return [str(g) for g in Changes.between(before, after, point).group]


@st.composite
def scenes(draw: st.DrawFn) -> tuple[MatchTable, MatchTable]:
    """Boxes on a line of overlapping cars and ignore regions, matched under two rankings with many ties.

    Annotation ids are unique in an image only.
    """
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_cars, n = draw(st.integers(0, 9)), draw(st.integers(1, 40))
    levels = draw(st.sampled_from([2, 5, 1000]))

    def boxes(count: int) -> np.ndarray:
        left = rng.integers(0, 60, count)
        return np.stack([left, np.zeros(count), left + rng.integers(20, 30, count), np.full(count, 20)], 1)

    car_image = np.sort(rng.integers(0, N_IMAGES, n_cars))
    first = np.searchsorted(car_image, car_image)
    truth = TruthTable(
        np.arange(N_IMAGES) + 7,
        car_image,
        np.arange(n_cars) - first + 1,
        boxes(n_cars).astype(float),
        rng.random(n_cars) < 0.2,
    )
    image_id, xyxy = rng.integers(0, N_IMAGES, n) + 7, boxes(n).astype(float)
    one, two = (greedy_match(image_id, xyxy, rng.integers(0, levels, n) + 0.0, truth) for _ in range(2))
    return one, two


def cars_found(match: MatchTable, threshold: float) -> dict[tuple[int, int], int]:
    """Who finds each car, by a loop, as a second implementation."""
    return {
        (int(match.image[i]), int(match.annotation_id[i])): i
        for i in range(len(match.image))
        if match.outcome[i] == HIT and match.ranking[i] >= threshold
    }


@given(scenes(), st.one_of(st.none(), st.floats(0, 8)))
def test_the_changes_add_up_to_the_two_points_of_the_curves(
    tables: tuple[MatchTable, MatchTable], limit: float | None
) -> None:
    point = default_point(*tables) if limit is None else OperatingPoint(false_positives=limit)
    changes = Changes.between(*tables, point)
    ends = []
    for match in tables:
        curve = recall_curve(match)
        if point.recall is None:
            at = index_at_fppi(curve, point.false_positives)
        else:
            at = index_at_recall(curve, point.recall)
        hits = 0 if not match.n_cars else round(curve.y[at] * match.n_cars)
        ends.append((hits, round(curve.x[at] * N_IMAGES), cars_found(match, curve.threshold[at])))
    (hits_before, false_before, cars_before), (hits_after, false_after, cars_after) = ends

    t, count = changes.tally, Counter(changes.group.tolist())
    assert (t.cars_before, t.false_before) == (hits_before, false_before)
    assert (t.cars_after, t.false_after) == (hits_after, false_after)
    assert t.gained == sum(count[g] for g in GAINS) == len(cars_after.keys() - cars_before)
    assert t.lost == sum(count[g] for g in LOSSES) == len(cars_before.keys() - cars_after)
    assert t.gained - t.lost == hits_after - hits_before
    assert t.newly_rejected == count[Group.REJECTED_FALSE_ALARM]
    assert t.newly_accepted == count[Group.ACCEPTED_FALSE_ALARM]
    moved = t.became_false - t.became_hit
    assert false_after - false_before == t.newly_accepted - t.newly_rejected + moved
    assert t.moved == sum(cars_before[c] != cars_after[c] for c in cars_before.keys() & cars_after)
    # the same ranking changes nothing
    same = Changes.between(tables[0], tables[0], OperatingPoint(false_positives=2.0)).group
    assert not set(same) & {Group.LOST_CAR, Group.GAINED_CAR, Group.MOVED_HIT, Group.REJECTED_FALSE_ALARM}


def test_every_kind_of_change_has_its_group() -> None:
    # 0: car 1 kept; 1: false alarm that falls; 2: false alarm that rises; 3: car 2 lost; 4: car 3 gained;
    # 5 on an ignore region; 6: false before and after; 7: never accepted
    outcome = [HIT, FALSE_ALARM, FALSE_ALARM, HIT, HIT, IGNORED, FALSE_ALARM, FALSE_ALARM]
    car = [1, -1, -1, 2, 3, 9, -1, -1]
    before = table([9, 8, 1, 7, 0.5, 6, 5, 0], outcome, car)
    after = table([9, 1, 8, 0.5, 7, 6, 5, 0], outcome, car)
    # two false positives in four images: 9 8 7 6 5 are accepted
    assert groups(before, after, OperatingPoint(false_positives=0.5)) == [
        *("kept_car", "newly_rejected_false_alarm", "newly_accepted_false_alarm", "lost_car", "gained_car"),
        *("ignored", "kept_false_alarm", "rejected"),
    ]


def test_a_car_that_another_box_finds_is_neither_gained_nor_lost() -> None:
    # both boxes lie on car 1 and are accepted; the second one ranks first after
    before = table([9, 8, 1], [HIT, DUPLICATE, FALSE_ALARM], [1, 1, -1])
    after = table([8, 9, 1], [DUPLICATE, HIT, FALSE_ALARM], [1, 1, -1])
    changes = Changes.between(before, after, OperatingPoint(false_positives=0.25))
    assert [str(g) for g in changes.group] == ["flip", "flip", "rejected"]
    t = changes.tally
    assert (t.moved, t.gained, t.lost, t.became_false, t.became_hit) == (1, 0, 0, 1, 1)


def test_a_first_box_that_falls_below_the_threshold_leaves_its_car_to_the_second() -> None:
    before = table([9, 2, 5], [HIT, DUPLICATE, FALSE_ALARM], [1, 1, -1])
    after = table([2, 9, 5], [DUPLICATE, HIT, FALSE_ALARM], [1, 1, -1])
    changes = Changes.between(before, after, OperatingPoint(false_positives=0.0))
    assert [str(g) for g in changes.group] == ["flip", "flip", "rejected"]
    assert (changes.tally.became_false, changes.tally.became_hit) == (0, 0)


def test_a_box_on_two_cars_can_lose_one_and_gain_the_other() -> None:
    # before, 0 takes car 1; after, 1 would come first but is below the threshold, and 0 takes car 2
    before = table([9, 1], [HIT, FALSE_ALARM], [1, -1])
    after = table([9, 1], [HIT, FALSE_ALARM], [2, -1])
    changes = Changes.between(before, after, OperatingPoint(false_positives=0.0))
    assert [str(g) for g in changes.group] == ["swapped_car", "rejected"]
    assert (changes.tally.gained, changes.tally.lost, changes.tally.moved) == (1, 1, 0)


def test_cars_of_two_images_with_one_annotation_id_are_two_cars() -> None:
    before = table([9, 1, 5], [HIT, HIT, FALSE_ALARM], [1, 1, -1], image=[0, 1, 1])
    after = table([1, 9, 5], [HIT, HIT, FALSE_ALARM], [1, 1, -1], image=[0, 1, 1])
    point = OperatingPoint(false_positives=0.0)
    assert groups(before, after, point) == ["lost_car", "gained_car", "rejected"]


def test_candidates_tied_at_the_threshold_are_accepted_together() -> None:
    before = table([5, 5, 5, 1], [HIT, FALSE_ALARM, FALSE_ALARM, HIT], [1, -1, -1, 2])
    after = table([9, 5, 4, 3], [HIT, FALSE_ALARM, FALSE_ALARM, HIT], [1, -1, -1, 2])
    # one of four cars: before, two false alarms come along
    assert groups(before, after, OperatingPoint(recall=0.25)) == [
        *("kept_car", "newly_rejected_false_alarm", "newly_rejected_false_alarm", "rejected")
    ]


def test_the_default_point_is_70_per_cent_or_the_next_tenth_that_both_reach() -> None:
    def reaching(n: int, n_cars: int) -> MatchTable:
        return table(np.arange(n), np.full(n, HIT), np.arange(n), n_cars)

    assert default_point(reaching(9, 10), reaching(8, 10)) == OperatingPoint(recall=0.7)
    assert default_point(reaching(9, 10), reaching(6, 10)) == OperatingPoint(recall=0.6)
    assert default_point(reaching(3, 10)) == OperatingPoint(recall=0.3)
    assert default_point(reaching(0, 10)) == OperatingPoint(false_positives=1.0)
    assert default_point(table([1.0], [FALSE_ALARM], [-1], n_cars=0)).false_positives == 1.0


def test_a_recall_out_of_reach_is_refused() -> None:
    one = table([1.0], [HIT], [1])
    assert recall_ceiling(recall_curve(one)) == 0.25
    with pytest.raises(RescoreError, match=r"at most 0\.250, .* got 0\.7; choose less"):
        Changes.between(one, one, OperatingPoint(recall=0.7))


@pytest.mark.parametrize("wrong", [{"recall": 0.0}, {"recall": 1.2}, {"false_positives": -1.0}])
def test_no_point_of_a_curve_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(RescoreError, match=r"expected .*, got"):
        OperatingPoint(**wrong)
