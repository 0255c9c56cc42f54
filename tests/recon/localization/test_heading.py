"""The heading of an object, the end that is its front, from how the surface looks."""

import numpy as np
import pytest

from recon.arrays import Float32Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.localization.heading import HeadingConfig, Posed, learn_heading, read_surface
from recon.localization.standing_box import StandingBox, cam_from_ground
from recon.outlines import fill_polygon

CAMERA = PinholeCamera(600.0, 600.0, 399.5, 299.5, 800, 600)
GROUND = GroundPlane(14.5, float(np.deg2rad(35)))
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
REACH = (0.56, 0.68, 1.08)
SIZE_M = np.array([4.4, 1.8, 1.5])
CONFIG = HeadingConfig()


def box_hull() -> Float32Array:
    """Signed distance to the sides of a box in metres, roughly, on a grid (56, 20, 24)."""
    x = np.abs(np.linspace(-REACH[0], REACH[0], 56)) - 0.5
    y, z = np.linspace(0, REACH[1], 20) - 0.5, np.linspace(0, REACH[2], 24) - 1.0
    x, y, z = x * SIZE_M[0], y * SIZE_M[1], z * SIZE_M[2]
    return np.maximum(np.maximum(x[:, None, None], y[:, None]), z).astype(np.float32)


def photo(box: StandingBox) -> np.ndarray:
    """Linear light of a grey box whose rear third is red, on a dark ground."""
    pose = cam_from_ground(GROUND)
    light = np.full((CAMERA.height_px, CAMERA.width_px, 3), 0.05, np.float32)
    unit = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.5

    def paint(low: float, high: float, colour: tuple[float, float, float]) -> None:
        c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
        corners = np.concatenate([unit, unit + np.array([0, 0, 1])]) * box.size_m
        corners[:, 0] = np.where(corners[:, 0] < 0, low, high) * box.size_m[0]
        xy = corners[:, :2] @ np.array([[c, s], [-s, c]]) + box.xy_m
        uv = CAMERA.project(np.insert(xy, 2, corners[:, 2], axis=1) @ pose[:3, :3].T + pose[:3, 3])
        for face in ([0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]):
            light[fill_polygon(uv[face], CAMERA.height_px, CAMERA.width_px)] = colour

    # the farther third first
    parts = [(-0.5, -0.17, (0.5, 0.05, 0.05)), (-0.17, 0.5, (0.4, 0.4, 0.4))]
    for low, high, colour in parts if np.sin(box.yaw_rad) < 0 else parts[::-1]:
        paint(low, high, colour)
    return light


def reading(yaw_deg: float, taken_deg: float) -> np.ndarray:
    """The look of a box of one direction, taken for one of another."""
    box = StandingBox(np.array([0.4, 20.0]), float(np.deg2rad(yaw_deg)), SIZE_M)
    taken = StandingBox(box.xy_m, float(np.deg2rad(taken_deg)), SIZE_M)
    return read_surface(photo(box), Posed(box_hull(), REACH, taken), SEEN_FROM, CONFIG)


@pytest.mark.parametrize("yaw_deg", [25.0, 70.0, 110.0, -20.0, -75.0, 200.0])
def test_the_nose_is_found_at_the_end_that_looks_like_one(yaw_deg: float) -> None:
    learned = learn_heading([reading(y, y) for y in (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0)], CONFIG)
    right = learned.log_odds(reading(yaw_deg, yaw_deg))
    turned = learned.log_odds(reading(yaw_deg, yaw_deg + 180))
    assert right > 0.5
    # the surface is symmetric, so that it is the same question asked the other way round
    assert turned == pytest.approx(-right, abs=0.15 * right)


def test_what_looks_alike_at_both_ends_tells_nothing() -> None:
    learned = learn_heading([reading(y, y) for y in (30.0, 150.0, 260.0)], CONFIG)
    box = StandingBox(np.array([0.4, 20.0]), 0.7, SIZE_M)
    plain = np.full((CAMERA.height_px, CAMERA.width_px, 3), 0.4, np.float32)
    same = read_surface(plain, Posed(box_hull(), REACH, box), SEEN_FROM, CONFIG)
    assert learned.log_odds(same) == pytest.approx(0, abs=1e-6)
