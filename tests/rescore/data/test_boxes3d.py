"""3D boxes as arrays: rows without a box, KITTI's order, angles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.camera import GroundPlane
from recon.errors import RescoreError
from recon.localization.standing_box import wrapped
from rescore.data.boxes3d import Boxes3D

CAR = (1.0, 0.5, 10.0, 4.0, 1.6, 1.5, 0.25)
DEVIATIONS = (0.1, 0.2, 0.3, 0.4, 0.05, 0.06, 0.07)


def test_rows_as_files_have_them_there_and_back() -> None:
    boxes = Boxes3D.of_rows([None, CAR], [None, DEVIATIONS])
    assert boxes is not None
    np.testing.assert_array_equal(boxes.known, [False, True])
    np.testing.assert_array_equal(boxes.values[1], CAR)
    assert np.isnan(boxes.values[0]).all()
    np.testing.assert_array_equal(boxes.deviations, [[np.nan] * 7, DEVIATIONS])
    assert Boxes3D.of_rows([None, None]) is None
    plain = Boxes3D.of_rows([CAR], [None])
    assert plain is not None
    assert plain.deviations is None


def test_kittis_bottom_centre_and_order() -> None:
    # a car of 1.5 m whose wheels stand 1.7 m below the camera has its middle at 1.7 - 0.75 = 0.95 m
    location, hwl, turn = np.array([[1.0, 1.7, 20.0]]), np.array([[1.5, 1.6, 4.0]]), np.array([0.3])
    boxes = Boxes3D.of_kitti(location, hwl, turn)
    np.testing.assert_allclose(boxes.values, [[1.0, 0.95, 20.0, 4.0, 1.6, 1.5, 0.3]])
    np.testing.assert_allclose(boxes.kitti_location_m(), location)
    np.testing.assert_array_equal(boxes.kitti_size_m, hwl)


def test_up_may_be_that_of_the_ground() -> None:
    up = GroundPlane(height_m=1.65, pitch_rad=0.1).up
    location, hwl = np.array([[1.0, 1.7, 20.0]]), np.array([[1.5, 1.6, 4.0]])
    boxes = Boxes3D.of_kitti(location, hwl, np.array([0.3]), up)
    # a camera that looks down sees the top of a box nearer than its bottom
    np.testing.assert_allclose(
        boxes.centre_cam_m, [[1.0, 1.7 - 0.75 * np.cos(0.1), 20.0 - 0.75 * np.sin(0.1)]]
    )
    np.testing.assert_allclose(boxes.kitti_location_m(up), location)


def test_nose_and_observation_angle() -> None:
    # straight ahead: to the right, towards the camera, away from it; then away, 45 degrees to the right
    values = np.array([[0, 0, 10, 4, 2, 1.5, t] for t in (0, np.pi / 2, -np.pi / 2)])
    boxes = Boxes3D.of_values(np.vstack([values, [[10, 0, 10, 4, 2, 1.5, -np.pi / 2]]]))
    np.testing.assert_allclose(boxes.nose_cam[:3], [[1, 0, 0], [0, 0, -1], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(boxes.alpha_rad, [0, np.pi / 2, -np.pi / 2, -3 * np.pi / 4])
    np.testing.assert_allclose(boxes.distance_m, [10, 10, 10, np.sqrt(200)])


@given(st.floats(-20, 20))
def test_wrapped_angles_are_the_same_angles(angle: float) -> None:
    (found,) = wrapped(np.array([angle]))
    assert -np.pi <= found < np.pi
    assert np.cos(found) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(found) == pytest.approx(np.sin(angle), abs=1e-9)


def test_rows_are_picked_and_joined() -> None:
    boxes = Boxes3D.of_rows([CAR, None, (*CAR[:6], 1.0)], [DEVIATIONS, None, None])
    assert boxes is not None
    np.testing.assert_array_equal(boxes[[2, 0]].rotation_y_rad, [1.0, 0.25])
    np.testing.assert_array_equal(boxes[boxes.known].values, boxes.values[[0, 2]])
    # a part that has no deviations says so
    assert boxes[1:].deviations is None
    joined = Boxes3D.concatenate([boxes[1:], boxes[:1]])
    np.testing.assert_array_equal(joined.values, boxes.values[[1, 2, 0]])
    np.testing.assert_array_equal(joined.deviations, [[np.nan] * 7, [np.nan] * 7, DEVIATIONS])
    assert len(Boxes3D.concatenate([])) == 0


@pytest.mark.parametrize(
    ("row", "deviations", "match"),
    [
        ((*CAR[:3], 4.0, 0.0, 1.5, 0.0), None, "expected length, width and height above 0, got"),
        ((*CAR[:6], np.nan), None, "expected seven finite numbers, or none"),
        ((np.inf, *CAR[1:]), None, "expected seven finite numbers, or none"),
        (CAR, (*DEVIATIONS[:6], -0.1), "expected 0 or more, got -0.1"),
        (CAR, (*DEVIATIONS[:6], np.nan), "deviations of a 3D box: expected seven finite numbers"),
    ],
)
def test_refuses(row: tuple[float, ...], deviations: tuple[float, ...] | None, match: str) -> None:
    with pytest.raises(RescoreError, match=match):
        Boxes3D.of_rows([row], [deviations])


def test_refuses_columns_of_other_lengths() -> None:
    boxes = Boxes3D.of_values(np.array([CAR, CAR]))
    with pytest.raises(ValueError, match="3D boxes"):
        Boxes3D(boxes.centre_cam_m, boxes.size_m[:1], boxes.rotation_y_rad)
    with pytest.raises(ValueError, match="3D boxes"):
        Boxes3D(boxes.centre_cam_m, boxes.size_m, boxes.rotation_y_rad, deviations=boxes.size_m)


def test_rows_without_a_box_take_that_of_another() -> None:
    nothing = (np.nan,) * 7
    own = Boxes3D.of_values(np.array([CAR, nothing, nothing]), np.array([DEVIATIONS, nothing, nothing]))
    moved = (2.0, *CAR[1:])
    other = Boxes3D.of_values(np.array([moved, moved, nothing]))
    both = own.or_else(other)
    np.testing.assert_array_equal(both.values, [CAR, moved, nothing])
    np.testing.assert_array_equal(both.deviations_or_nan, [DEVIATIONS, nothing, nothing])
    assert own.or_else(None) is own
