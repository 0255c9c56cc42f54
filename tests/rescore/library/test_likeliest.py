"""The view of an object is the one that agrees best, and what is not to be believed is said."""

from dataclasses import replace

import numpy as np
import pytest

from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.localization.shape_fit import Agreement
from recon.reconstruction.view_selection import ViewChoice
from rescore.library import likeliest
from rescore.library.likeliest import choose_view, doubt_of, find_likeliest
from rescore.library.single_picture import FoundObject, Photo, find_object
from tests.recon.localization.stepped_car import space
from tests.single_car import CarPicture, car_from, quick_car_model

CAMERA = PinholeCamera(300.0, 300.0, 99.5, 79.5, 200, 160)
INSIDE = np.array([20.0, 20.0, 180.0, 140.0])


@pytest.fixture(scope="module")
def car() -> CarPicture:
    return car_from(60, seed=3, width_px=320)


@pytest.fixture(scope="module")
def model() -> ClassModel:
    return replace(quick_car_model(), shape_space=space())


@pytest.fixture(scope="module")
def found(car: CarPicture, model: ClassModel) -> FoundObject:
    plain = replace(model, shape_space=None)
    one = find_object(Photo(car.rgb, car.seen_from), car.box_px, 2, plain)
    assert isinstance(one, FoundObject)
    return one


def test_good_shapes_are_believed_and_others_are_not(found: FoundObject) -> None:
    good = replace(found, agreement=Agreement(0.95, 0.02), closed_failure=None)
    assert doubt_of(good, INSIDE, CAMERA) is None
    assert "cuts the box" in str(doubt_of(good, np.array([0.0, 20.0, 180.0, 140.0]), CAMERA))
    assert "cuts the box" in str(doubt_of(good, np.array([20.0, 20.0, 200.0, 140.0]), CAMERA))
    poor = replace(good, agreement=Agreement(0.78, 0.09))
    told = str(doubt_of(poor, INSIDE, CAMERA))
    assert "78%" in told
    assert "9%" in told
    lost = replace(good, agreement=None, closed_failure=Failure(Reason.REGISTRATION_FAILED, "got 60%"))
    assert doubt_of(lost, INSIDE, CAMERA) == "no closed shape fits: got 60%"
    assert doubt_of(replace(lost, closed_failure=None), INSIDE, CAMERA) is None


def test_a_shape_whose_borders_no_edges_meet_is_unlikely(found: FoundObject) -> None:
    good = replace(found, agreement=Agreement(0.95, 0.02), closed_failure=None, borders=0.3)
    assert doubt_of(good, INSIDE, CAMERA) is None
    told = str(doubt_of(replace(good, borders=0.02), INSIDE, CAMERA))
    assert told.startswith("unlikely to be a car: ")
    assert "0.02" in told


def test_a_box_of_road_is_doubted_and_a_car_is_not(car: CarPicture, model: ClassModel) -> None:
    noise = np.random.default_rng(0).integers(90, 110, car.rgb.shape).astype(np.uint8)
    on_car, on_road = (
        find_object(Photo(rgb, car.seen_from), car.box_px, 2, model) for rgb in (car.rgb, noise)
    )
    assert isinstance(on_car, FoundObject)
    assert isinstance(on_road, FoundObject)
    camera = car.seen_from.camera
    assert "unlikely" not in str(doubt_of(on_car, car.box_px, camera))
    assert "unlikely" in str(doubt_of(on_road, car.box_px, camera))


def test_red_lamps_turn_a_front_into_a_rear(car: CarPicture, model: ClassModel) -> None:
    plain = choose_view(car.rgb, car.box_px, model)
    red = car.rgb.copy()
    left, top, right, bottom = car.box_px.round().astype(int)
    row = (top + bottom) // 2
    for column in (left + 8, right - 16):
        red[row : row + 8, column : column + 8] = (230, 20, 20)
    lit = choose_view(red, car.box_px, model)
    assert isinstance(plain, ViewChoice)
    assert isinstance(lit, ViewChoice)
    assert lit.probability[4:9].sum() > plain.probability[4:9].sum()


def turned(found: FoundObject, view_bin: int, overlap: float) -> FoundObject:
    """The object seen from the middle of a bin, with a shape that agrees so well."""
    angle = 2 * np.pi * view_bin / 12
    pose = np.eye(4)
    # the camera, at the origin, lies at this azimuth before the object
    c, s = np.cos(angle), np.sin(angle)
    pose[:3, :3] = [[-s, c, 0], [0, 0, -1], [-c, -s, 0]]
    pose[:3, 3] = [0, 0, 8]
    moved = replace(found.instance, cam_from_object=pose, view_bin=view_bin)
    assert moved.azimuth_rad == pytest.approx(angle)
    return replace(found, instance=moved, agreement=Agreement(overlap, 0.02))


@pytest.mark.parametrize(
    ("overlaps", "best"), [({1: 0.80, 2: 0.95, 7: 0.97}, 2), ({1: 0.9, 2: 0.9, 7: 0.9}, 1)]
)
def test_shapes_and_views_are_weighed(
    found: FoundObject,
    car: CarPicture,
    model: ClassModel,
    monkeypatch: pytest.MonkeyPatch,
    overlaps: dict[int, float],
    best: int,
) -> None:
    cost = np.full(12, 30.0)
    cost[[1, 2, 7]] = 0.0, 2.0, 5.0
    choice = ViewChoice(1, cost, np.zeros((12, 4)), {})
    tried = []

    def fit(photo: Photo, xyxy_px: object, view_bin: int, *others: object) -> FoundObject:
        tried.append(view_bin)
        return turned(found, view_bin, overlaps[view_bin])

    monkeypatch.setattr(likeliest, "find_object", fit)
    one = find_likeliest(Photo(car.rgb, car.seen_from), car.box_px, choice, model)
    assert isinstance(one, FoundObject)
    assert one.instance.view_bin == best
    # bins that cost far more are not tried
    assert tried == [1, 2, 7]
