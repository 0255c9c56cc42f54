import cv2
import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.detectors.base import Detections
from rescore.detectors.uiuc_rule import hits, lone, recall_precision
from rescore.formats.uiuc import CARS_PATTERN, STREET_PATTERN, read_locations, read_uiuc

NO_CARS = np.zeros((0, 2))


def moved(cars, down_px):
    score = np.ones(len(cars))
    return score, hits(cars + np.array([0, down_px]), score, cars, 100, 40), len(cars)


def written(tmp_path, text, pictures=()):
    (tmp_path / "TestImages").mkdir()
    for number in pictures:
        cv2.imwrite(str(tmp_path / "TestImages" / f"test-{number}.pgm"), np.zeros((60, 120), np.uint8))
    (tmp_path / "trueLocations.txt").write_text(text)
    return tmp_path


def test_rows_hold_row_and_column_of_each_car(tmp_path):
    root = written(tmp_path, "0: (48,26)\n1: (61,-20) (63,140) \n2:\n", (0, 1, 2))
    pictures = read_uiuc(root)
    assert [p.path.name for p in pictures] == ["test-0.pgm", "test-1.pgm", "test-2.pgm"]
    assert [p.left_top_px.tolist() for p in pictures] == [[[26, 48]], [[-20, 61], [140, 63]], []]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("0: (1,2)\n1: (3,4\n", 2),
        ("0: (1,2)\n\n0: (3,4)\n", 3),
        ("0 (1,2)\n", 1),
        ("0: (1,2) x\n", 1),
        # int itself refuses so many digits
        (f"{'1' * 5000}: (1,2)\n", 1),
    ],
)
def test_a_row_of_another_form_is_named(tmp_path, text, line):
    with pytest.raises(RescoreError, match=f"trueLocations.txt, line {line}: expected"):
        read_locations(written(tmp_path, text) / "trueLocations.txt")


def test_rows_and_pictures_must_fit(tmp_path):
    root = written(tmp_path, "0: (1,2)\n1: (1,2)\n", (0,))
    with pytest.raises(RescoreError, match=r"test-1.pgm: expected the picture of row 1"):
        read_uiuc(root)
    (root / "trueLocations.txt").write_text("")
    with pytest.raises(RescoreError, match="expected a row for every picture of TestImages, 1 have none"):
        read_uiuc(root)
    with pytest.raises(RescoreError, match="found none; give its folder"):
        read_uiuc(root / "TestImages")


@pytest.mark.parametrize(
    ("offset", "right"),
    [
        ((25, 0), True),
        ((26, 0), False),
        ((0, 10), True),
        ((0, 11), False),
        ((-17, 7), True),
        ((18, 8), False),
    ],
)
def test_right_places_are_an_ellipse_of_a_quarter_of_the_car(offset, right):
    # (17/25)^2 + (7/10)^2 = 0.95, (18/25)^2 + (8/10)^2 = 1.16
    car = np.array([[40.0, -5]])
    assert hits(car + offset, np.ones(1), car, 100, 40).tolist() == [right]


def test_one_hit_a_car_the_best_score_first():
    cars = np.array([[0.0, 0], [30, 0]])
    found = np.array([[1.0, 0], [2, 0], [29, 0], [200, 0]])
    # the second best find of car 0 is farther than 25 px from car 1
    assert hits(found, np.array([0.5, 0.9, 0.7, 1.0]), cars, 100, 40).tolist() == [False, True, True, False]
    # within reach of both, the second takes the car that is left
    assert hits(np.array([[14.0, 0], [13, 0]]), np.array([2.0, 1]), cars, 100, 40).tolist() == [True, True]
    assert hits(found, np.ones(4), NO_CARS, 100, 40).tolist() == [False] * 4
    assert hits(NO_CARS, np.zeros(0), cars, 100, 40).tolist() == []


def test_recall_and_precision_over_all_pictures():
    first = np.array([0.9, 0.5]), np.array([True, False]), 2
    second = np.array([0.8, 0.4, 0.3]), np.array([False, True, True]), 2
    curve = recall_precision([first, second])
    # by score: 0.9 hit, 0.8 false, 0.5 false, 0.4 hit, 0.3 hit, of 4 cars
    assert curve.recall.tolist() == [0.25, 0.25, 0.25, 0.5, 0.75]
    assert curve.precision == pytest.approx([1, 1 / 2, 1 / 3, 2 / 4, 3 / 5])
    assert curve.equal_error_recall == 0.5
    assert curve.recall_at_precision(0.6) == 0.75
    assert curve.recall_at_precision(0.7) == 0.25
    assert "4 cars, recall 50.0% at equal error" in curve.summary()


def test_a_tie_never_flatters_and_missing_detections_count():
    curve = recall_precision([(np.array([1.0, 1.0]), np.array([True, False]), 1)])
    assert curve.equal_error_recall == 0
    assert recall_precision([(np.ones(1), np.array([True]), 4)]).equal_error_recall == 0.25
    nothing = recall_precision([(np.zeros(0), np.zeros(0, bool), 3)])
    assert (nothing.equal_error_recall, nothing.recall_at_precision(0.5)) == (0, 0)


def test_second_windows_on_a_car_go_and_corners_stay():
    boxes = np.array([[-20.0, 0, 80, 40], [10, 0, 110, 40], [60, 0, 160, 40]])
    # overlaps of 70 / 130 and of 20 / 180 of the first
    kept = lone(Detections(boxes, np.array([3.0, 2, 1])))
    assert kept.xyxy_px.tolist() == [[-20, 0, 80, 40], [60, 0, 160, 40]]


def test_the_real_set_has_200_cars(uiuc):
    pictures = read_uiuc(uiuc)
    assert len(pictures) == 170
    assert sum(len(p.left_top_px) for p in pictures) == 200
    assert len(list(uiuc.glob(CARS_PATTERN))) == 550
    assert len(list(uiuc.glob(STREET_PATTERN))) == 500
    # the truth itself is found whole, and moved by more than the tolerance not at all
    for shift, recall in ((0, 1.0), (11, 0.0)):
        assert recall_precision(moved(p.left_top_px, shift) for p in pictures).equal_error_recall == recall
