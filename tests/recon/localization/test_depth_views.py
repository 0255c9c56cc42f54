"""Maps of a class's depth: sizes and depths of a car made of two boxes, from all sides."""

import numpy as np
import pytest

from recon.localization.depth_views import DepthViews
from tests.recon.localization import stepped_car as car

LEFT, AWAY, RIGHT, TOWARDS = 24, 12, 0, 36
"""Headings of 48: the nose to the left, away from the camera, and so on."""


@pytest.fixture(scope="module")
def views() -> DepthViews:
    return car.views()


def test_silhouettes_have_the_size_of_the_car(views: DepthViews) -> None:
    far = len(views.distance_m) - 1
    step = views.step_m
    left, right, foot, top = views.extent_m[0, far, RIGHT]
    # from 40 m the side 0.9 m before the plane is seen 2 % larger, and its foot 4 cm below
    assert right - left == pytest.approx(car.SIZE_M[0] * 1.02, abs=1.5 * step)
    assert (foot, top) == pytest.approx((-0.04, car.SIZE_M[2]), abs=step)
    # at 8.4 m the rear stands 6.2 m away: its foot is seen 1.65 (8.4 / 6.2 - 1) = 0.59 m below the ground
    assert views.extent_m[0, 2, AWAY, 2] == pytest.approx(-0.59, abs=step)
    left, right, _, _ = views.extent_m[0, far, AWAY]
    assert right - left == pytest.approx(car.SIZE_M[1] * 1.05, abs=1.5 * step)


def test_depths_are_those_of_the_surfaces(views: DepthViews) -> None:
    far = len(views.distance_m) - 1
    middle = views.relief_m.shape[-1] // 2
    low = views.ground_row + round(0.5 / views.step_m)
    # half the width before the middle; the rear, and the front, half the length before it
    assert views.relief_m[0, far, RIGHT, low, middle] == pytest.approx(-0.9, abs=0.05)
    assert views.relief_m[0, far, AWAY, low, middle] == pytest.approx(-2.2, abs=0.05)
    assert views.relief_m[0, far, TOWARDS, low, middle] == pytest.approx(-2.2, abs=0.05)
    high = views.ground_row + round(1.25 / views.step_m)
    # over the hood the cab's front is seen 0.6 m before the middle
    assert views.relief_m[0, far, TOWARDS, high, middle] == pytest.approx(-0.6, abs=0.08)
    assert views.relief_m[0, far, AWAY, high, middle] == pytest.approx(-2.2, abs=0.05)


def test_the_nose_is_where_the_heading_points(views: DepthViews) -> None:
    far = len(views.distance_m) - 1
    high = views.ground_row + round(1.25 / views.step_m)
    for heading, sign in ((RIGHT, 1), (LEFT, -1)):
        columns = np.nonzero(np.isfinite(views.relief_m[0, far, heading, high]))[0]
        middle = columns.mean() - views.relief_m.shape[-1] // 2
        # the cab is from -2.2 to 0.6 along the car
        assert middle * views.step_m == pytest.approx(-0.8 * sign, abs=0.1)


def test_mirrored_headings_have_mirrored_maps(views: DepthViews) -> None:
    for heading in (1, 5, 11):
        other = (24 - heading) % 48
        np.testing.assert_array_equal(views.relief_m[0, 2, heading], views.relief_m[0, 2, other][:, ::-1])
