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


def test_names_go_around_the_car() -> None:
    bins = ViewBins(12)
    names = [bins.name(b) for b in range(12)]
    assert [names[b] for b in (0, 3, 6, 9)] == ["front", "left", "rear", "right"]
    assert (names[1], names[2], names[11], names[10]) == (
        "front left", "left front", "front right", "right front",
    )  # fmt: skip
    assert len(set(names)) == 12
    assert ViewBins(8).name(1) == "45 degrees"
    with pytest.raises(RescoreError, match="expected 0 to 11, got 12"):
        bins.name(12)


def test_shares_of_intervals() -> None:
    shares = ViewBins(12).shares(np.deg2rad([0.0, 15.0, 357.0, 20.0]), np.deg2rad(15))
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    assert shares[0, 0] == pytest.approx(1)
    # on the border of two bins, half in each
    assert shares[1, :2] == pytest.approx([0.5, 0.5])
    assert shares[2, 0] == pytest.approx(1)
    # from 12.5 to 27.5 degrees, of which 2.5 lie below the border at 15
    assert shares[3, :2] == pytest.approx([1 / 6, 5 / 6])


def test_unknown_bin_is_refused() -> None:
    with pytest.raises(RescoreError, match="expected 0 to 11, got 12"):
        ViewBins().view_from_object(12)
    with pytest.raises(RescoreError, match="at least one bin"):
        ViewBins(0)
