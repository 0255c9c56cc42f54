import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.camera import GroundPlane
from recon.localization.standing_box import (
    StandingBox,
    angle_between,
    cam_from_ground,
    clip_convex,
    polygon_area,
    volume_overlap,
)


def box(x: float, y: float, yaw_deg: float, *size: float) -> StandingBox:
    return StandingBox(np.array([x, y], float), float(np.deg2rad(yaw_deg)), np.array(size, float))


def test_overlap_of_shifted_and_higher_boxes() -> None:
    a = box(0, 0, 0, 4, 2, 1)
    assert volume_overlap(a, a) == pytest.approx(1)
    # shifted by half its length: intersection 2 x 2 x 1 = 4, union 8 + 8 - 4 = 12
    assert volume_overlap(a, box(2, 0, 0, 4, 2, 1)) == pytest.approx(4 / 12)
    # twice as high: intersection 8, union 16
    assert volume_overlap(a, box(0, 0, 180, 4, 2, 2)) == pytest.approx(0.5)
    assert volume_overlap(a, box(9, 0, 30, 4, 2, 1)) == 0


def test_overlap_of_turned_squares() -> None:
    # a unit square and one turned by 45 degrees share a regular octagon of area 2 (sqrt 2 - 1)
    shared = 2 * (np.sqrt(2) - 1)
    overlap = volume_overlap(box(0, 0, 0, 1, 1, 1), box(0, 0, 45, 1, 1, 1))
    assert overlap == pytest.approx(shared / (2 - shared))


@given(
    st.tuples(*[st.floats(-1, 1)] * 2, st.floats(-180, 180), *[st.floats(0.5, 3)] * 3),
    st.tuples(*[st.floats(-1, 1)] * 2, st.floats(-180, 180), *[st.floats(0.5, 3)] * 3),
)
def test_overlap_is_symmetric_and_agrees_with_counting(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    p, q = box(*a), box(*b)
    assert volume_overlap(p, q) == pytest.approx(volume_overlap(q, p), abs=1e-9)
    grid = np.stack(np.meshgrid(*[np.arange(-4, 4, 0.05) + 0.025] * 2), axis=-1).reshape(-1, 2)
    both = np.ones(len(grid), bool)
    for one in (p, q):
        c, s = np.cos(one.yaw_rad), np.sin(one.yaw_rad)
        own = (grid - one.xy_m) @ np.array([[c, -s], [s, c]])
        both &= (np.abs(own) <= one.size_m[:2] / 2).all(axis=1)
    area = polygon_area(clip_convex(p.footprint_m, q.footprint_m))
    assert area == pytest.approx(both.sum() * 0.05**2, abs=0.25)


def test_angles_wrap() -> None:
    assert angle_between(np.deg2rad(179), np.deg2rad(-179)) == pytest.approx(np.deg2rad(2))
    assert angle_between(np.deg2rad(100), np.deg2rad(-85), np.pi) == pytest.approx(np.deg2rad(5))


def test_ground_frame_of_a_camera_that_looks_down() -> None:
    ground = GroundPlane(1.0, float(np.deg2rad(45)))
    pose = cam_from_ground(ground)
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    # the optical axis meets the ground one metre ahead, at a distance of sqrt 2
    assert np.allclose(pose[:3, :3] @ [0, 1, 0] + pose[:3, 3], [0, 0, np.sqrt(2)])


def test_box_that_is_none() -> None:
    with pytest.raises(ValueError, match="standing box"):
        box(0, 0, 0, 1, 0, 1)
