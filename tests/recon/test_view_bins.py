"""View bins: T_alpha is a rotation, and the bins go around the car as documented."""

import numpy as np
import pytest

from recon.errors import RescoreError
from recon.view_bins import ViewBins, rotation

FRONT, LEFT, UP = np.eye(3)


@pytest.mark.parametrize("view_bin", range(12))
def test_view_rotations_are_proper(view_bin: int) -> None:
    t = ViewBins().view_from_object(view_bin)
    np.testing.assert_allclose(t @ t.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(t) == pytest.approx(1.0)


def test_bin_0_shows_the_front() -> None:
    t = ViewBins(12, 0.0).view_from_object(0)
    # the nose points at the camera (against z forward), the car's left is right in the picture, up is up
    np.testing.assert_allclose(t @ FRONT, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(t @ LEFT, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(t @ UP, [0, -1, 0], atol=1e-12)


def test_bin_3_shows_the_left_side_with_the_nose_to_the_left() -> None:
    t = ViewBins(12, 0.0).view_from_object(3)
    np.testing.assert_allclose(t @ LEFT, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(t @ FRONT, [-1, 0, 0], atol=1e-12)


def test_a_raised_camera_sees_the_top() -> None:
    t = rotation(0.7, np.deg2rad(30))
    # the camera's forward axis goes down by sin 30 = 0.5: up is turned towards the camera by as much
    assert (t @ UP)[2] == pytest.approx(-0.5)
    assert (t @ UP)[0] == pytest.approx(0.0)


def test_nearest_bin() -> None:
    bins = ViewBins(12)
    assert [bins.containing(np.deg2rad(a)) for a in (0, 14, 16, 76, 104, 345.5, -14, 720 + 90)] == [
        0, 0, 1, 3, 3, 0, 0, 3,
    ]  # fmt: skip
    assert all(bins.containing(bins.azimuth_rad(b)) == b for b in range(12))


def test_unknown_bin_is_refused() -> None:
    with pytest.raises(RescoreError, match="expected 0 to 11, got 12"):
        ViewBins().view_from_object(12)
    with pytest.raises(RescoreError, match="at least one bin"):
        ViewBins(0)
