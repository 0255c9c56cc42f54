import numpy as np
import pytest

from datasets_synth.meshes.mesh import Placed
from datasets_synth.render.render import render_pair
from datasets_synth.render.truth import azimuth_deg, view_bin, visible_objects, yaw_rad
from tests.datasets_synth.simple_scenes import CAMERA, box, ground, pose, quad, scene


def car(x, y, yaw=0.0, scale=1.0, shape="box"):
    return Placed(box(4.0, 1.8, 1.5), pose(x, y, 0.0, yaw, scale), "car", shape)


def seen(*items, **options):
    s = scene(*items, **options)
    return visible_objects(render_pair(s, np.random.default_rng(0)), s), s


def test_a_car_alone_is_all_visible():
    (found,), _ = seen(ground(), car(0, 10))
    assert found.visible_share == 1.0
    assert found.truncated_share == 0.0
    assert found.item == 1
    assert found.shape_id == "box"


def test_a_car_half_behind_a_wall_is_half_visible():
    # the wall covers all columns left of the middle of the picture, which is the middle of the car
    wall = Placed(quad([(-9, 5, 0), (0, 5, 0), (0, 5, 4), (-9, 5, 4)]), np.eye(4), "wall")
    (found,), _ = seen(ground(), wall, car(0, 12))
    assert found.visible_share == pytest.approx(0.5, abs=0.03)
    assert found.truncated_share == 0.0


def test_the_box_spans_hidden_parts_too_and_nothing_more():
    wall = Placed(quad([(-9, 5, 0), (0, 5, 0), (0, 5, 4), (-9, 5, 4)]), np.eye(4), "wall")
    (hidden,), _ = seen(ground(), wall, car(0, 12))
    (alone,), s = seen(ground(), car(0, 12))
    np.testing.assert_array_equal(hidden.xyxy_px, alone.xyxy_px)
    # near side at y = 11.1: x = -2 .. 2 gives u + 0.5 = 80 -+ 200 * 2 / 11.1; z = 0 gives
    # v + 0.5 = 60 + 200 * 1.5 / 11.1; the top lies at the height of the eye, on the horizon
    np.testing.assert_allclose(
        alone.xyxy_px, [80 - 400 / 11.1, 60, 80 + 400 / 11.1, 60 + 300 / 11.1], atol=1e-3
    )
    rows, columns = np.nonzero(render_pair(s, np.random.default_rng(0)).instance == 2)
    drawn = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(alone.xyxy_px, drawn, atol=1.0)


def test_a_car_across_the_border_is_truncated_but_not_hidden():
    # its near side spans u + 0.5 = 80 + 200 * (2 .. 6) / 9.1 = 124 .. 212 of 160; the far side starts at
    # 80 + 200 * 2 / 10.9 = 116.7: a box 95.2 wide with 43.3 inside
    (found,), _ = seen(ground(), car(4, 10))
    assert found.visible_share == 1.0
    left, right = 80 + 400 / 10.9, 80 + 1200 / 9.1
    assert found.truncated_share == pytest.approx(1 - (160 - left) / (right - left), abs=1e-4)
    assert found.xyxy_px[2] == 160


def test_cars_behind_the_camera_or_beside_the_picture_are_not_listed_and_hidden_ones_are():
    curtain = Placed(quad([(-9, 5, 0), (9, 5, 0), (9, 5, 9), (-9, 5, 9)]), np.eye(4), "wall")
    found, _ = seen(ground(), curtain, car(0, -10), car(30, 10), car(0, 12, shape="hidden"))
    assert [(f.shape_id, f.visible_share) for f in found] == [("hidden", 0.0)]


def test_a_car_that_passes_the_camera_fills_the_picture_up_to_its_border():
    # it reaches from behind the camera to 4.1 m in front of it, to the right of the eye
    (found,), _ = seen(ground(), car(2.0, 2.1, yaw=np.pi / 2, scale=1.0))
    assert found.xyxy_px[2] == 160
    assert found.xyxy_px[3] == 120
    assert 80 < found.xyxy_px[0] < 160
    assert 0 < found.truncated_share < 1


@pytest.mark.parametrize(
    ("yaw_deg", "azimuth"),
    [
        (0, 270),  # nose to the right of the picture: its right side is seen
        (180, 90),  # nose to the left: its left side
        (-90, 0),  # nose towards the camera
        (90, 180),  # seen from behind
        (150, 120),
        (210, 60),
    ],
)
def test_azimuth_of_a_car_straight_ahead(yaw_deg, azimuth):
    # the camera lies in direction -90 degrees of the world, so at -90 - yaw from the nose
    (found,), _ = seen(ground(), car(0, 12, yaw=np.radians(yaw_deg)))
    assert (found.azimuth_deg - azimuth + 180) % 360 - 180 == pytest.approx(0, abs=1e-6)
    assert found.view_bin == azimuth // 30
    assert (np.degrees(found.yaw_rad) - yaw_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-6)


def test_azimuth_follows_the_place_of_the_car():
    # nose left, 45 degrees to the right of the camera: the camera is nearer to its nose, 90 - 45
    s = scene(car(10, 10, yaw=np.pi))
    assert azimuth_deg(s.left_from_world @ s.items[0].world_from_object) == pytest.approx(45)


def test_yaw_does_not_change_with_the_pitch_of_the_camera():
    for pitch in (0.0, 0.3):
        s = scene(car(1, 10, yaw=0.7), pitch_rad=pitch)
        assert yaw_rad(s.left_from_world @ s.items[0].world_from_object) == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("azimuth", "expected"),
    [(0, 0), (14.99, 0), (15, 1), (90, 3), (75, 3), (104.99, 3), (345, 0), (344.99, 11)],
)
def test_view_bins_are_centred_on_multiples_of_30_degrees(azimuth, expected):
    assert view_bin(azimuth) == expected


def test_position_and_size():
    # the camera stands 1.5 m above the ground and looks down by asin(0.28): y_cam of a ground point at 10 m
    # is 1.5 * 0.96 - 10 * 0.28, z is 10 * 0.96 + 1.5 * 0.28
    (found,), _ = seen(ground(), car(1, 10, scale=1.1), pitch_rad=float(np.arcsin(0.28)))
    np.testing.assert_allclose(found.position_cam_m, [1, 1.5 * 0.96 - 2.8, 9.6 + 0.42], atol=1e-9)
    np.testing.assert_allclose(found.size_m, [4.4, 1.98, 1.65], rtol=1e-6)
    assert CAMERA.left.width_px == 160
