"""Errors of estimates against boxes, with the numbers worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from recon.camera import GroundPlane
from recon.localization.single_plane import SinglePlane
from rescore.studies.instance_accuracy import BoxTruth, instance_errors, surface_errors

# x forward (to the right of the picture), y left (away), z up
TURN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def truth() -> BoxTruth:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = TURN, [1.0, 1.5, 8.0]
    return BoxTruth(pose, np.array([-2.0, -1.0, 0.0]), np.array([2.0, 1.0, 1.0]))


def turned(deg: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg))
    pose = np.eye(4)
    pose[:3, :3] = TURN @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return pose


def test_middle_of_the_true_box() -> None:
    # half a metre above the ground, which is 1.5 m below the camera
    np.testing.assert_allclose(truth().centroid_m, [1, 1, 8])


@pytest.mark.parametrize("deg", [0.0, 10.0, -10.0, 180.0])
def test_an_instance(deg: float) -> None:
    found = SimpleNamespace(
        centroid_m=np.array([1.0, 1.0, 8.4]), size_m=np.array([4.4, 1.0, 1.0]), cam_from_object=turned(deg)
    )
    errors = instance_errors(found, truth())  # type: ignore[arg-type]
    # 0.4 m of the largest size, 4 m
    assert errors.centroid_share == pytest.approx(0.1)
    np.testing.assert_allclose(errors.size_share, [0.1, -0.5, 0])
    assert errors.orientation_deg == pytest.approx(abs(deg))


@pytest.mark.parametrize(("yaw_deg", "expected"), [(0.0, 0.0), (30.0, 30.0), (-30.0, 30.0), (-90.0, 90.0)])
def test_a_surface_has_no_front(yaw_deg: float, expected: float) -> None:
    surface = SinglePlane(
        np.array([0, 0, -1.0, 7]), np.zeros((3, 3)), np.array([1.0, 1, 7]), np.deg2rad(yaw_deg)
    )
    errors = surface_errors(surface, truth(), GroundPlane(1.5))
    assert errors.centroid_share == pytest.approx(0.25)
    assert errors.size_share is None
    assert errors.orientation_deg == pytest.approx(expected)
