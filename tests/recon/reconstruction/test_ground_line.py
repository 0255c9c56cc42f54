"""Ground line: its place and its points in closed form."""

import numpy as np
import pytest

from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.errors import Failure, Reason
from recon.reconstruction.ground_line import GroundLine, GroundLineConfig, ground_line
from recon.reconstruction.part_labels import PartLabels

CAMERA = PinholeCamera(700.0, 700.0, 320.0, 240.0, 641, 481)
GROUND = GroundPlane(1.5)
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
FREE = GroundLineConfig(slope_from_view=0.0)
# the left foot is the front one, both feet at the same depth
FEET = {1: np.array([-1.0, 0.0, 0.0]), 2: np.array([1.0, 0.0, 0.0])}


def window(left_bottom: int = 40, right_bottom: int = 40) -> np.ndarray:
    """A body (3) on two feet (1 and 2): columns 5 to 14 and 65 to 74, down to the given last rows."""
    labels = np.zeros((60, 80), np.uint8)
    labels[10:35, :] = 3
    labels[30 : left_bottom + 1, 5:15] = 1
    labels[30 : right_bottom + 1, 65:75] = 2
    return labels


def test_level_feet_in_closed_form() -> None:
    line = ground_line(PartLabels(280, 270, window()), FEET, SEEN_FROM, FREE)
    assert isinstance(line, GroundLine)
    # last row 40 of a window at row 270, its lower edge: v = 310.5; the window spans columns 280 to 359
    np.testing.assert_allclose(line.line_px, [[280, 310.5], [359, 310.5]])
    # z = f h / (v - cy) = 700 * 1.5 / 70.5; the left foot's middle column is 280 + 9.5 = 289.5
    z = 700 * 1.5 / 70.5
    np.testing.assert_allclose(line.points_m[1], [(289.5 - 320) / 700 * z, 1.5, z])
    np.testing.assert_allclose(line.points_m[2], [(349.5 - 320) / 700 * z, 1.5, z])


def test_sloping_line_fits_both_feet() -> None:
    line = ground_line(PartLabels(280, 270, window(40, 44)), FEET, SEEN_FROM, FREE)
    assert isinstance(line, GroundLine)
    # 4 rows over 60 columns; at the left foot v = 310.5
    slope = 4 / 60
    np.testing.assert_allclose(line.line_px[:, 1], [310.5 - 9.5 * slope, 310.5 + 69.5 * slope])
    assert line.points_m[1][2] > line.points_m[2][2]


def test_slope_of_the_view_evens_out_the_feet() -> None:
    line = ground_line(
        PartLabels(280, 270, window(40, 44)), FEET, SEEN_FROM, GroundLineConfig(slope_from_view=1.0)
    )
    assert isinstance(line, GroundLine)
    # the feet stand at one depth, so that the line is level, in the middle of 310.5 and 314.5
    np.testing.assert_allclose(line.line_px[:, 1], 312.5, atol=1e-6)
    assert line.points_m[1][2] == pytest.approx(line.points_m[2][2])


def test_slope_of_a_turned_view_is_that_of_the_ground() -> None:
    # feet along a direction that goes away to the right: the ends found must lie along it on the ground
    feet = {1: np.array([0.0, 0.0, 0.0]), 2: np.array([2.0, 0.0, 0.5])}
    line = ground_line(PartLabels(280, 270, window()), feet, SEEN_FROM, GroundLineConfig(slope_from_view=1.0))
    assert isinstance(line, GroundLine)
    along = line.points_m[2] - line.points_m[1]
    assert along[2] / along[0] == pytest.approx(0.25, rel=1e-3)


def test_one_foot_gives_a_level_line() -> None:
    labels = window()
    labels[labels == 2] = 3
    line = ground_line(PartLabels(280, 270, labels), FEET, SEEN_FROM, GroundLineConfig())
    assert isinstance(line, GroundLine)
    assert set(line.points_m) == {1}
    assert line.line_px[0, 1] == line.line_px[1, 1] == 310.5


def test_a_foot_off_the_line_is_left_out() -> None:
    labels = window()
    labels[30:35, 36:44] = 4
    feet = {**FEET, 4: np.array([0.0, 0.0, 1.0])}
    line = ground_line(PartLabels(280, 270, labels), feet, SEEN_FROM, FREE)
    assert isinstance(line, GroundLine)
    assert set(line.points_m) == {1, 2}


def test_no_ground_contact() -> None:
    failure = ground_line(PartLabels(280, 270, np.full((9, 9), 3, np.uint8)), FEET, SEEN_FROM, FREE)
    assert isinstance(failure, Failure)
    assert failure.reason is Reason.NO_GROUND_CONTACT


def test_above_horizon() -> None:
    failure = ground_line(PartLabels(280, 100, window()), FEET, SEEN_FROM, FREE)
    assert isinstance(failure, Failure)
    assert failure.reason is Reason.ABOVE_HORIZON
    # a camera that looks down by 20 degrees sees ground there: the horizon is at 240 - 700 tan 20 = -14.8
    assert isinstance(
        ground_line(
            PartLabels(280, 100, window()),
            FEET,
            GroundedCamera(CAMERA, GroundPlane(1.5, np.deg2rad(20))),
            FREE,
        ),
        GroundLine,
    )


def corner(near_bottom: int, side_bottom: int, front_bottom: int) -> np.ndarray:
    """A corner view: the near foot (1) in the middle, one to its right (2), one to its left (3)."""
    labels = np.zeros((80, 140), np.uint8)
    labels[10:40, :] = 4
    places = ((1, 50, near_bottom, 14), (2, 110, side_bottom, 12), (3, 20, front_bottom, 4))
    for label, column, bottom, width in places:
        labels[38 : bottom + 1, column : column + width] = label
    return labels


# two sides of a rectangle of 2.5 by 1.5: the near corner, one away to the right, one away to the left
CORNER = {
    1: np.array([0.0, 0.0, 0.0]),
    2: np.array([2.2, 0.0, 1.2]),
    3: np.array([-0.7, 0.0, 1.3]),
    5: np.array([1.5, 0.0, 2.5]),
}


def test_a_corner_view_has_two_lines() -> None:
    line = ground_line(PartLabels(280, 270, corner(70, 60, 64)), CORNER, SEEN_FROM, GroundLineConfig())
    assert isinstance(line, GroundLine)
    # the side with the larger feet is the line; the small foot on the other side gets its own point
    assert set(line.points_m) == {1, 2, 3}
    near, side, front = (line.points_m[k] for k in (1, 2, 3))
    assert all(p[1] == pytest.approx(1.5) for p in (near, side, front))
    along = side - near
    assert along[2] / along[0] == pytest.approx(1.2 / 2.2, rel=0.05)
    across = front - near
    assert across[2] / across[0] == pytest.approx(-1.3 / 0.7, rel=0.05)
    # l_g ends at its feet, in the middle of their contacts
    np.testing.assert_allclose(line.line_px[:, 0], [280 + 56.5, 280 + 115.5])


def test_feet_of_hidden_sides_get_no_point() -> None:
    labels = corner(70, 60, 64)
    labels[labels == 3] = 5
    line = ground_line(PartLabels(280, 270, labels), CORNER, SEEN_FROM, GroundLineConfig())
    assert isinstance(line, GroundLine)
    assert set(line.points_m) == {1, 2}


def test_contacts_go_down_to_a_known_bottom_together() -> None:
    free = ground_line(PartLabels(280, 270, window(40, 44)), FEET, SEEN_FROM, FREE)
    line = ground_line(PartLabels(280, 270, window(40, 44)), FEET, SEEN_FROM, FREE, bottom_px=320.0)
    assert isinstance(free, GroundLine)
    assert isinstance(line, GroundLine)
    # the lower foot ends at 314.5, 5.5 rows above the bottom
    np.testing.assert_allclose(line.line_px[:, 1], free.line_px[:, 1] + 5.5)
