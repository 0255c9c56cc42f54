"""The single-plane baseline in closed form."""

import numpy as np
import pytest

from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.errors import Failure, Reason
from recon.localization.single_plane import SinglePlane, lower_edge, single_plane
from recon.localization.standing_box import cam_from_ground
from recon.outlines import fill_polygon, largest_outline

CAMERA = PinholeCamera(400.0, 400.0, 199.5, 149.5, 400, 300)
GROUND = GroundPlane(1.5, 0.1)
SEEN_FROM = GroundedCamera(CAMERA, GROUND)


def seen(xyz_object: np.ndarray, yaw_rad: float) -> np.ndarray:
    """Pixels of points (along, up) of an upright plane 8 m ahead that is turned by a yaw."""
    forward = np.array([0.0, 0, 1]) - GROUND.up[2] * GROUND.up
    forward /= np.linalg.norm(forward)
    along = np.cos(yaw_rad) * np.array([1.0, 0, 0]) + np.sin(yaw_rad) * forward
    base = 8 * forward - GROUND.height_m * GROUND.up
    return CAMERA.project(base + xyz_object[:, :1] * along + xyz_object[:, 1:] * GROUND.up)


RECTANGLE = np.array([[-2.0, 0], [2, 0], [2, 1.2], [-2, 1.2]])


@pytest.mark.parametrize("yaw_deg", [0.0, 35.0, -50.0])
def test_an_upright_rectangle_comes_back(yaw_deg: float) -> None:
    yaw = np.deg2rad(yaw_deg)
    outline = seen(RECTANGLE, yaw)
    found = single_plane(outline, outline[:2], SEEN_FROM)
    assert isinstance(found, SinglePlane)
    assert found.yaw_rad == pytest.approx(yaw, abs=1e-9)
    # level normal that faces the camera; the outline as large as it was, its middle at (0, 0.6)
    assert found.plane[:3] @ GROUND.up == pytest.approx(0, abs=1e-12)
    assert found.plane[3] > 0
    sides = np.linalg.norm(np.diff(found.outline_m, axis=0), axis=1)
    np.testing.assert_allclose(sides, [4, 1.2, 4], rtol=1e-9)
    middle = found.outline_m.mean(axis=0)
    assert np.linalg.norm(found.centroid_m - middle) < 0.03


def test_a_ground_line_above_the_horizon_is_a_failure() -> None:
    outline = seen(RECTANGLE, 0.0)
    failure = single_plane(outline, np.array([[10.0, 20.0], [50.0, 20.0]]), SEEN_FROM)
    assert isinstance(failure, Failure)
    assert failure.reason is Reason.ABOVE_HORIZON


def test_a_single_point_is_no_line() -> None:
    outline = seen(RECTANGLE, 0.0)
    failure = single_plane(outline, outline[[0, 0]], SEEN_FROM)
    assert isinstance(failure, Failure)
    assert failure.reason is Reason.NO_GROUND_CONTACT


def test_a_line_along_the_ray_shows_no_surface() -> None:
    outline = seen(RECTANGLE, 0.0)
    failure = single_plane(outline, np.array([[199.5, 200.0], [199.5, 290.0]]), SEEN_FROM)
    assert isinstance(failure, Failure)
    assert failure.reason is Reason.PARTS_NOT_PLACED


def test_a_wall_comes_back_from_its_mask() -> None:
    # from (-2, 8) to (2, 9), 1.2 m high: its ground line is the lower edge of its mask
    ends = np.array([[-2.0, 8.0], [2.0, 9.0]])
    wall = np.array([[*ends[0], 0], [*ends[1], 0], [*ends[1], 1.2], [*ends[0], 1.2]])
    pose = cam_from_ground(GROUND)
    mask = fill_polygon(CAMERA.project(wall @ pose[:3, :3].T + pose[:3, 3]), 300, 400)
    line, ring = lower_edge(mask), largest_outline(mask)
    assert not isinstance(line, Failure)
    assert ring is not None
    found = single_plane(ring, line, SEEN_FROM)
    assert isinstance(found, SinglePlane)
    surface = found.on_ground(GROUND)
    assert surface.yaw_rad == pytest.approx(np.arctan2(1, 4), abs=0.02)
    np.testing.assert_allclose(surface.centroid_m, [0, 8.5, 0.6], atol=0.05)


def test_a_region_without_columns_has_no_lower_edge() -> None:
    nothing = lower_edge(np.zeros((30, 40), bool))
    assert isinstance(nothing, Failure)
    assert nothing.reason is Reason.NO_OUTLINE
