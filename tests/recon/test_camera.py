import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.camera import (
    DEFAULT_GROUND,
    GroundedCamera,
    GroundedStereo,
    GroundPlane,
    PinholeCamera,
    StereoCamera,
    default_camera,
)
from recon.errors import RescoreError

CAMERA = PinholeCamera(700.0, 690.0, 320.0, 250.0, 640, 480)


def test_projection_is_the_matrix_product():
    point = np.array([1.2, -0.4, 8.0])
    u, v, w = CAMERA.matrix @ point
    np.testing.assert_allclose(CAMERA.project(point), [u / w, v / w], rtol=1e-14)
    # 700 * 1.2 / 8 + 320 = 425; 690 * -0.4 / 8 + 250 = 215.5
    np.testing.assert_allclose(CAMERA.project(point), [425, 215.5])


@given(st.floats(0, 640), st.floats(0, 480), st.floats(0.1, 200))
def test_depth_times_ray_projects_back_to_the_pixel(u, v, depth):
    ray = CAMERA.rays(np.array([u, v]))
    assert ray[2] == 1
    np.testing.assert_allclose(CAMERA.project(depth * ray), [u, v], atol=1e-9)


def test_rays_keep_the_shape_of_their_pixels():
    assert CAMERA.rays(np.zeros((3, 4, 2))).shape == (3, 4, 3)


def test_disparity_of_a_depth_and_back():
    # 700 px * 0.5 m / 14 m = 25 px
    stereo = StereoCamera(CAMERA, 0.5)
    assert stereo.disparity_px(np.array([14.0]))[0] == pytest.approx(25)
    depth = np.array([[2.0, 14.0, 80.0]])
    np.testing.assert_allclose(stereo.depth_m(stereo.disparity_px(depth)), depth, rtol=1e-6)


def test_nothing_measured_has_no_depth():
    stereo = StereoCamera(CAMERA, 0.5)
    assert np.isnan(stereo.depth_m(np.array([np.nan, 0.0, -1.0]))).all()
    assert np.isnan(stereo.disparity_px(np.array([np.nan, 0.0, -1.0]))).all()


def test_disparity_is_the_difference_of_the_columns_of_the_two_eyes():
    stereo = StereoCamera(CAMERA, 0.5)
    point = np.array([1.0, 0.3, 9.0])
    left, right = CAMERA.project(point), CAMERA.project(point - [0.5, 0, 0])
    assert left[0] - right[0] == pytest.approx(float(stereo.disparity_px(point[2:])[0]), rel=1e-6)


def test_focal_length_times_baseline():
    # 700 px * 0.5 m
    assert StereoCamera(CAMERA, 0.5).focal_baseline == 350


def test_disparity_of_the_ground_at_a_row():
    # level, 1.6 m high: 100 rows below the middle z = 690 * 1.6 / 100 = 11.04 m, so 350 / 11.04 px
    seen_from = GroundedStereo(StereoCamera(CAMERA, 0.5), GroundPlane(1.6))
    uv = np.array([[[37.0, 350.0], [600.0, 450.0]], [[320.0, 250.0], [0.0, 10.0]]])
    found = seen_from.ground_disparity_px(uv)
    np.testing.assert_allclose(found[0], [350 / 11.04, 2 * 350 / 11.04])
    assert np.isnan(found[1]).all()


def test_disparity_of_the_ground_is_that_of_its_points():
    seen_from = GroundedStereo(StereoCamera(CAMERA, 0.4), GroundPlane(1.5, 0.08))
    uv = np.stack([np.linspace(37, 600, 5), np.linspace(260, 470, 5)], axis=1)
    assert seen_from.left == GroundedCamera(CAMERA, seen_from.ground)
    depth = seen_from.left.ground_points_m(uv)[:, 2]
    expected = seen_from.stereo.exact_disparity_px(depth)
    np.testing.assert_allclose(seen_from.ground_disparity_px(uv), expected)


def test_rays_of_disparity_give_that_of_a_plane():
    stereo, normal, distance_m = StereoCamera(CAMERA, 0.4), np.array([0.48, -0.6, -0.64]), 9.0
    uv = np.array([[37.0, 300.0], [500.0, 120.0]])
    points = CAMERA.rays(uv) * (-distance_m / (CAMERA.rays(uv) @ normal))[:, None]
    found = -(stereo.disparity_rays(uv) @ normal) / distance_m
    np.testing.assert_allclose(found, stereo.exact_disparity_px(points[:, 2]))


def test_height_above_the_ground_of_points_in_the_picture():
    seen_from = GroundedCamera(CAMERA, GroundPlane(1.6))
    # level: 100 rows below the middle at 6.9 m is 1 m below the camera, 100 rows above it 1 m above
    uv, depth = np.array([[20.0, 350.0], [500.0, 150.0]]), np.array([6.9, 6.9])
    np.testing.assert_allclose(seen_from.height_above_ground_m(uv, depth), [0.6, 2.6])
    pitched = GroundedCamera(CAMERA, GroundPlane(1.6, 0.2))
    points = pitched.ground_points_m(uv[:1])
    np.testing.assert_allclose(pitched.height_above_ground_m(uv[:1], points[:, 2]), 0, atol=1e-12)


def test_a_level_direction_leads_along_the_ground():
    ground = GroundPlane(2.0, 0.2)
    seen_from = GroundedCamera(CAMERA, ground)
    ahead = seen_from.level_direction(np.array([320.0, 100.0]))
    np.testing.assert_allclose(ahead, [0, -np.sin(0.2), np.cos(0.2)], atol=1e-12)
    aside = seen_from.level_direction(np.array([600.0, 400.0]))
    assert aside @ ground.up == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(aside) == pytest.approx(1)
    # the point of the ground at the pixel lies above the direction's line from the foot of the camera
    point = seen_from.ground_points_m(np.array([600.0, 400.0])) + 2.0 * ground.up
    np.testing.assert_allclose(point / np.linalg.norm(point), aside, atol=1e-12)


def test_ground_points_lie_on_the_plane_and_project_back():
    ground = GroundPlane(1.6, 0.05)
    uv = np.stack(np.meshgrid([0.0, 320, 639], [300.0, 400, 479]), axis=-1)
    points = ground.intersect(CAMERA.rays(uv))
    np.testing.assert_allclose(points @ ground.up, -1.6, atol=1e-12)
    np.testing.assert_allclose(CAMERA.project(points), uv, atol=1e-9)


def test_ground_below_a_level_camera():
    # 100 rows below the middle: z = fy * height / 100 = 690 * 1.6 / 100 = 11.04 m
    point = GroundPlane(1.6).intersect(CAMERA.rays(np.array([320.0, 350.0])))
    np.testing.assert_allclose(point, [0, 1.6, 11.04])


def test_ground_straight_ahead_of_a_pitched_camera():
    # looking down by 30 degrees from 2 m: the middle of the picture meets the ground after 2 / sin 30 = 4 m
    point = GroundPlane(2.0, np.pi / 6).intersect(CAMERA.rays(np.array([320.0, 250.0])))
    np.testing.assert_allclose(point, [0, 0, 4.0], atol=1e-12)


def test_no_ground_on_and_above_the_horizon():
    # the horizon of a camera pitched down by p lies fy tan p above the principal point
    ground = GroundPlane(1.5, 0.1)
    horizon = 250 - 690 * np.tan(0.1)
    points = ground.intersect(
        CAMERA.rays(np.array([[320, horizon - 50], [320, horizon], [320, horizon + 5]]))
    )
    np.testing.assert_array_equal(np.isnan(points[:, 2]), [True, True, False])


def test_default_camera_sees_41_degrees_and_looks_at_the_middle():
    # 2 atan(1 / 2.8) = 39.3 degrees
    camera = default_camera(640, 480)
    assert (camera.cx_px, camera.cy_px) == (319.5, 239.5)
    assert np.degrees(2 * np.arctan(240 / camera.fy_px)) == pytest.approx(39.3, abs=0.05)
    assert DEFAULT_GROUND.up @ [0, -1, 0] == 1


@pytest.mark.parametrize(
    "build", [lambda: PinholeCamera(0, 1, 0, 0, 2, 2), lambda: PinholeCamera(1, 1, 0, 0, 0, 2)]
)
def test_impossible_cameras_are_refused(build):
    with pytest.raises(RescoreError, match="must be positive"):
        build()


def test_a_negative_baseline_names_swapped_eyes():
    with pytest.raises(RescoreError, match="left and right may be swapped"):
        StereoCamera(CAMERA, -0.5)


def test_a_camera_under_the_ground_is_refused():
    with pytest.raises(RescoreError, match="must be above the ground, got height_m=-1"):
        GroundPlane(-1.0)


def test_a_height_in_millimetres_is_refused():
    with pytest.raises(RescoreError, match="expected height_m up to 200 m, got 1500; write metres"):
        GroundPlane.stated(1500.0, None, None)


def test_a_camera_that_leans_to_its_right_sees_the_ground_nearer_there():
    ground = GroundPlane(1.6, pitch_rad=0.02, roll_rad=0.03)
    pair = GroundedStereo(StereoCamera(CAMERA, 0.5), ground)
    left, middle, right = pair.ground_disparity_px(np.array([[100.0, 400.0], [320.0, 400.0], [600.0, 400.0]]))
    assert left < middle < right
    # the camera turned about its own axis by the roll sees a level ground turned the other way
    c, s = np.cos(0.03), np.sin(0.03)
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ GroundPlane(1.6).up
    np.testing.assert_allclose(GroundPlane(1.6, roll_rad=0.03).up, turned, atol=1e-15)


@given(st.floats(-0.3, 0.5), st.floats(-0.2, 0.2))
def test_up_and_right_of_the_ground_are_perpendicular_units(pitch_rad, roll_rad):
    ground = GroundPlane(1.6, pitch_rad, roll_rad)
    assert np.linalg.norm(ground.up) == pytest.approx(1)
    assert np.linalg.norm(ground.right) == pytest.approx(1)
    assert ground.up @ ground.right == pytest.approx(0, abs=1e-15)
    assert ground.right[0] > 0
