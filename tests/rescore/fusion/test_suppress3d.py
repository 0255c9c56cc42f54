"""Second boxes of one car are told from neighbours, rank below all others, and say which box stays."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet
from rescore.evidence.candidates import OK, Candidates, CandidateTable, RescoredTable
from rescore.evidence.registration import Registration
from rescore.formats.coco import read_detections, write_rescored
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.suppress3d import SECOND_BOX_FACTOR, suppress_second_boxes

AWAY = -np.pi / 2
"""The heading of a car that drives away from the camera."""
WHOLE = (100.0, 100.0, 200.0, 180.0)


def table_of(
    boxes: list[tuple[float, float, float, float]],
    places: list[tuple[float, float, float] | None],
    posterior: list[float],
    image_id: int = 1,
) -> RescoredTable:
    """Cars of 4.4 x 1.8 x 1.5 m at x, z with a heading, best detector score first."""
    solid = Boxes3D.of_rows([None if p is None else (p[0], 1, p[1], 4.4, 1.8, 1.5, p[2]) for p in places])
    score = np.linspace(0.9, 0.5, len(boxes))
    found = Candidates(image_id, np.array(boxes), score, score, boxes3d=solid)
    table = CandidateTable.of_candidates([found])
    table.status[:] = OK
    return RescoredTable(table, np.array(posterior))


def second(rescored: RescoredTable) -> list[bool]:
    return [s == "second_box" for s in suppress_second_boxes(rescored).candidates.status]


def test_the_better_box_of_a_car_stays_and_the_other_names_it() -> None:
    part = (110.0, 120.0, 160.0, 180.0)
    given_ = table_of([part, WHOLE], [(0.3, 20.4, AWAY), (0.0, 20.0, AWAY)], [0.3, 0.8])
    found = suppress_second_boxes(given_)
    assert found.candidates.status.tolist() == ["second_box", OK]
    assert found.candidates.reason_detail.tolist() == [
        "the same car as candidate 2 at 100, 100, 200, 180",
        "",
    ]
    assert found.posterior.tolist() == [0.3 * SECOND_BOX_FACTOR, 0.8]
    assert given_.posterior.tolist() == [0.3, 0.8]
    assert given_.candidates.status.tolist() == [OK, OK]


@pytest.mark.parametrize("turned", [AWAY, 0.0])
def test_cars_parked_side_by_side_or_behind_each_other_stay(turned: float) -> None:
    # 2.5 m from middle to middle across, 5.5 m along; the boxes in the picture overlap by half of the smaller
    shifted = (150.0, 100.0, 250.0, 180.0)
    x, z = (2.5, 0.0) if turned == AWAY else (0.0, 2.5)
    assert (
        second(table_of([WHOLE, shifted], [(0, 15, turned), (x, 15 + z, turned)], [0.8, 0.7])) == [False] * 2
    )
    x, z = (5.5, 0.0) if turned != AWAY else (0.0, 5.5)
    assert (
        second(table_of([WHOLE, shifted], [(0, 15, turned), (x, 15 + z, turned)], [0.8, 0.7])) == [False] * 2
    )


def test_boxes_apart_in_the_picture_stay_whatever_3d_says() -> None:
    apart = (180.0, 100.0, 280.0, 180.0)
    same_place: list[tuple[float, float, float] | None] = [(0, 20, AWAY), (0, 20, AWAY)]
    assert second(table_of([WHOLE, apart], same_place, [0.8, 0.7])) == [False, False]
    assert second(table_of([WHOLE, WHOLE], same_place, [0.8, 0.7])) == [False, True]


def test_without_3d_boxes_nothing_is_suppressed() -> None:
    assert second(table_of([WHOLE, WHOLE], [None, (0, 20, AWAY)], [0.8, 0.7])) == [False, False]
    assert second(table_of([WHOLE, WHOLE], [None, None], [0.8, 0.7])) == [False, False]


def test_a_second_box_suppresses_nothing_itself() -> None:
    # the third shares 0.55 of its footprint with the second and 0.09 with the first, which stays
    places: list[tuple[float, float, float] | None] = [(0, 20, AWAY), (0, 22, AWAY), (0, 24, AWAY)]
    assert second(table_of([WHOLE] * 3, places, [0.8, 0.7, 0.6])) == [False, True, False]


def test_images_do_not_mix() -> None:
    both = RescoredTable.concatenate([table_of([WHOLE], [(0, 20, AWAY)], [0.8], image) for image in (1, 2)])
    assert second(both) == [False, False]


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-2, 2), st.floats(8, 14), st.floats(0, 6.3), st.integers(1, 10**6)),
        min_size=1,
        max_size=8,
    )
)
def test_what_stays_keeps_its_posterior_and_ranks_above(
    cars: list[tuple[float, float, float, int]],
) -> None:
    before = table_of([WHOLE] * len(cars), [c[:3] for c in cars], [c[3] / 1e6 for c in cars])
    after = suppress_second_boxes(before)
    gone = after.candidates.status == "second_box"
    assert not gone[np.argmax(before.posterior)]
    np.testing.assert_array_equal(after.posterior[~gone], before.posterior[~gone])
    assert after.posterior[gone].max(initial=0) < before.posterior[~gone].min()
    rank = np.argsort(before.posterior[gone], kind="stable")
    np.testing.assert_array_equal(np.argsort(after.posterior[gone].astype(np.float32), kind="stable"), rank)


def test_rescoring_suppresses_where_it_is_asked_to_and_files_keep_it(tiny_run: Path, tmp_path: Path) -> None:
    data: DataSet = read_dataset(tiny_run / "data").split("test")
    first = data.frames[0].image_id
    given_ = table_of([WHOLE, WHOLE], [(0, 20, AWAY), (0, 20, AWAY)], [0.8, 0.7], first).candidates
    assert Rescoring(w=1.0).fuse(given_).candidates.status.tolist() == [OK, OK]
    found = Rescoring(w=1.0, suppress=True).fuse(given_)
    file = tmp_path / "rescored.json"
    write_rescored(file, "mine", found, data, w=1.0, registration=Registration.PAPER)
    read = read_detections(file, data)
    assert read.posterior is not None
    np.testing.assert_array_equal(read.posterior, found.posterior)
    assert read.table.status.tolist() == [OK, "second_box"]
