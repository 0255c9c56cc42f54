from dataclasses import replace

import cv2
import numpy as np
import pytest

from datasets_synth.meshes.grade import Grade
from datasets_synth.meshes.mesh import Imaging, Light, Material, Placed
from datasets_synth.render.render import FEW_SUBSAMPLES_PX, SUBSAMPLES_PX, render_pair, render_rgb
from datasets_synth.render.scene_rays import build_scene_rays
from recon.camera import GroundPlane, PinholeCamera, StereoCamera
from recon.pixels import linear_from_srgb
from recon.stereo.sgbm import SgbmConfig, compute_disparity
from tests.datasets_synth.simple_scenes import (
    CAMERA,
    CLEAN,
    ball,
    box,
    ground,
    noise_texture,
    pose,
    quad,
    scene,
    unit,
    wall,
)


def grid_px(camera):
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
    return np.stack([u, v], axis=-1)


def pixel_of(xyz_world, s):
    """Nearest pixel (row, column) of a world point."""
    xyz = s.left_from_world[:3, :3] @ np.array(xyz_world) + s.left_from_world[:3, 3]
    u, v = s.camera.left.project(xyz)
    return round(float(v)), round(float(u))


def linear(rgb):
    return linear_from_srgb(rgb)


def test_depth_of_the_ground_is_the_closed_form_at_pixel_centres():
    # recon.camera meets the same ground by eqs. 2 to 5. Half a pixel of shift would change the depth of the
    # row 20 below the horizon by 2.5 %, ray length instead of z by up to 9 % in the corners.
    s = scene(ground(), height_m=1.5, pitch_rad=0.1)
    expected = GroundPlane(1.5, 0.1).intersect(CAMERA.left.rays(grid_px(CAMERA.left)))[..., 2]
    depth = render_pair(s, np.random.default_rng(0)).depth_m
    near = expected < 100
    assert near.sum() > 6000
    np.testing.assert_allclose(depth[near], expected[near], rtol=2e-5)
    assert np.isnan(depth[:10]).all()


def test_depth_of_a_slanted_wall():
    # the wall y = 10 + 0.5 x: z = 10 + 0.5 x_cam with x_cam = z (u - cx) / fx, giving
    # z = 10 / (1 - 0.5 (u - cx) / fx)
    mesh = quad([(-15, 2.5, -9), (30, 25, -9), (30, 25, 20), (-15, 2.5, 20)])
    depth = render_pair(scene(Placed(mesh, np.eye(4), "wall")), np.random.default_rng(0)).depth_m
    expected = 10 / (1 - 0.5 * (np.arange(160) - 79.5) / 200)
    np.testing.assert_allclose(depth, np.broadcast_to(expected, depth.shape), rtol=2e-5)


def test_silhouette_of_a_ball():
    # a ray meets a ball when its distance from the centre is below the radius
    centre, radius = np.array([0.4, -0.3, 6.0]), 1.1  # camera frame
    s = scene(Placed(ball(radius), pose(0.4, 6.0, 1.5 + 0.3), "ball"))
    rays = CAMERA.left.rays(grid_px(CAMERA.left))
    along = rays @ centre / np.linalg.norm(rays, axis=-1)
    distance = np.sqrt(centre @ centre - along**2)
    seen = render_pair(s, np.random.default_rng(0)).instance == 1
    assert seen[distance < 0.995 * radius].all()
    assert not seen[distance > radius].any()


def test_texture_is_upright_and_not_mirrored():
    red, green, blue, white = (200, 0, 0), (0, 200, 0), (0, 0, 200), (200, 200, 200)
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:32, :32], texture[:32, 32:], texture[32:, :32], texture[32:, 32:] = red, green, blue, white
    mesh = quad([(-1, 5, 0.5), (1, 5, 0.5), (1, 5, 2.5), (-1, 5, 2.5)], Material("t", (1, 1, 1), texture))
    picture = render_rgb(scene(Placed(mesh, np.eye(4), "sign")))
    # 200 px / 5 m: the sign covers 80 x 80 pixels around the middle
    corners = {"top left": (40, 60), "top right": (40, 100), "low left": (80, 60), "low right": (80, 100)}
    lit = {k: tuple((picture[rc] > 100).tolist()) for k, rc in corners.items()}
    assert lit == {
        "top left": (True, False, False),
        "top right": (False, True, False),
        "low left": (False, False, True),
        "low right": (True, True, True),
    }


def test_texture_lies_where_its_coordinates_say():
    # a 4-texel ramp over a wall; texel i is centred at u = (i + 0.5) / 4,
    # and colours are linear between centres
    ramp = np.tile(np.array([40, 80, 160, 240], np.uint8)[None, :, None], (4, 1, 3))
    s = scene(wall(10.0, ramp, half_width=4.0))
    row = linear(render_rgb(s))[60, :, 0]
    column = 79.5 + 200 * (-4 + 8 * np.array([0.375, 0.5, 0.625])) / 10  # x = -4 + 8 u at z = 10
    seen = np.interp(column, np.arange(160), row) / row[80:84].mean()
    srgb = np.array([80, 120, 160])  # bytes are interpolated: the middle of 80 and 160 is 120
    middle = linear(np.array([120], np.uint8))[0]
    np.testing.assert_allclose(seen, linear(srgb.astype(np.uint8)) / middle, rtol=0.08)


def test_far_fine_texture_fades_to_its_mean_instead_of_aliasing():
    # one-texel checks of 0 and 255 average to a linear 0.5; the wall shows 4000 / 160 texels a pixel
    checks = np.kron([[0, 1] * 32, [1, 0] * 32] * 32, np.ones((1, 1))).astype(np.uint8)[..., None] * 255
    texture = np.repeat(checks, 3, axis=2)
    fine = linear(render_rgb(scene(wall(25.0, texture, uv_scale=60.0))))[20:70, :, 0]
    plain = linear(render_rgb(scene(wall(25.0))))[20:70, :, 0]
    assert np.abs(fine / plain - 0.5).max() < 0.03


def test_right_eye_sees_things_further_left_by_the_disparity():
    # 200 px * 0.5 m / 5 m = 20 px
    render = render_pair(scene(wall(5.0, noise_texture(256))), np.random.default_rng(0))
    left, right = render.left_rgb.astype(int), render.right_rgb.astype(int)
    assert np.abs(right[:, :-20] - left[:, 20:]).max() <= 2
    assert np.abs(right[:, 20:] - left[:, :-20]).mean() > 5


LARGE = StereoCamera(PinholeCamera(800.0, 800.0, 319.5, 239.5, 640, 480), 0.5)


def matched(s):
    """Measured minus true disparity of a noisy rendered pair, where there is a measurement."""
    render = render_pair(s, np.random.default_rng(1))
    disparity = compute_disparity(render.left_rgb, render.right_rgb, SgbmConfig(num_disparities=48))
    truth = s.camera.disparity_px(render.depth_m)
    measured = ~np.isnan(disparity)
    assert measured.mean() > 0.7
    return (disparity - truth)[measured]


STEREO = StereoCamera(PinholeCamera(420.0, 420.0, 159.5, 119.5, 320, 240), 0.5)
NOISY = Imaging((1.0, 1.05), (0.5, 0.5), 0.2, 0.003, 0.005, (0.0, 0.0))


@pytest.mark.parametrize("disparity_px", [30.0, 14.0, 7.0])
def test_matching_a_rendered_wall_measures_its_disparity(disparity_px):
    # whole disparities, since sub-pixel matching is drawn towards them
    s = scene(wall(210 / disparity_px, noise_texture(512), uv_scale=3.0), camera=STEREO, imaging=NOISY)
    assert abs(np.median(matched(s))) < 0.05


def test_matching_a_slanted_wall_has_no_bias():
    # disparities from 8 to 31 with all fractions: what draws them to whole pixels cancels, half a pixel of
    # shift between the eyes or between picture and truth would not
    material = Material("wall", (1, 1, 1), noise_texture(512))
    corners = [(-12, 2.5, -10), (24, 34.5, -10), (24, 34.5, 24), (-12, 2.5, 24)]
    mesh = quad(corners, material, uv=((0, 0), (6, 0), (6, 4), (0, 4)))
    error = matched(scene(Placed(mesh, np.eye(4), "wall"), camera=STEREO, imaging=NOISY))
    assert abs(np.median(error)) < 0.1
    assert np.percentile(np.abs(error), 90) < 1.0


def test_rectification_error_lowers_the_right_picture():
    # rays bent by exactly 2 px: the right picture shows the ideal one two rows lower
    items = (wall(5.0, noise_texture(256)),)
    ideal = render_pair(scene(*items), np.random.default_rng(0)).right_rgb.astype(int)
    bent = replace(CLEAN, rectification_error_px=(2.0, 0.0))
    low = render_pair(scene(*items, imaging=bent), np.random.default_rng(0)).right_rgb.astype(int)
    assert np.abs(low[2:] - ideal[:-2]).max() <= 2


def test_same_seed_same_bytes_with_any_number_of_threads():
    items = (
        ground(Material("road", (0.6, 0.6, 0.6), noise_texture(64))),
        Placed(ball(1.0), pose(0, 8, 1), "ball"),
    )
    noisy = replace(CLEAN, read_noise=0.02, shot_noise=0.02, blur_sigma_px=(0.6, 0.8))
    s = scene(
        *items, light=Light(unit(1, -1, 1), (2, 2, 2), (0.3, 0.5, 1), (0.8, 0.9, 1), 0.7), imaging=noisy
    )
    first = render_pair(s, np.random.default_rng(7))
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        again = render_pair(s, np.random.default_rng(7))
    finally:
        cv2.setNumThreads(threads)
    other = render_pair(s, np.random.default_rng(8))
    for name in ("left_rgb", "right_rgb", "depth_m", "instance"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
    assert first.left_rgb.tobytes() != other.left_rgb.tobytes()
    assert first.depth_m.tobytes() == other.depth_m.tobytes()


def test_shadow_of_a_box_ends_where_the_sun_says():
    # sun at (1, 0, 1): a box 1 m high and wide whose left side stands at x = -0.5 throws its shadow
    # 1 m further left, to x = -1.5 on the ground
    sun = Light(unit(1, 0, 1), (2.0, 2.0, 2.0), (0.2, 0.2, 0.2), (0.2, 0.2, 0.2), 1.0)
    crate = Placed(box(1.0, 1.0, 1.0), pose(0.0, 9.0), "crate")
    s = scene(ground(), crate, light=sun, height_m=3.0, pitch_rad=0.3, camera=LARGE)
    bare = linear(render_rgb(scene(ground(), light=sun, height_m=3.0, pitch_rad=0.3, camera=LARGE)))[..., 0]
    ratio = linear(render_rgb(s))[..., 0] / bare
    assert ratio[pixel_of((-1.42, 9.0, 0), s)] < 0.3
    assert ratio[pixel_of((-1.58, 9.0, 0), s)] > 0.9
    assert ratio[pixel_of((-1.2, 8.6, 0), s)] < 0.3  # beside the box, in front of its middle
    assert ratio[pixel_of((-1.2, 8.4, 0), s)] > 0.9
    assert ratio[pixel_of((1.4, 9.0, 0), s)] > 0.9  # on the sunny side


def test_tall_things_that_cast_no_shadow_leave_the_ground_lit():
    sun = Light(unit(1, 0, 1), (2.0, 2.0, 2.0), (0.2, 0.2, 0.2), (0.2, 0.2, 0.2), 1.0)
    ghost = Placed(box(1.0, 1.0, 1.0), pose(0.0, 9.0), "crate", "", False)
    s = scene(ground(), ghost, light=sun, height_m=3.0, pitch_rad=0.3, camera=LARGE)
    bare = linear(render_rgb(scene(ground(), light=sun, height_m=3.0, pitch_rad=0.3, camera=LARGE)))[..., 0]
    picture = linear(render_rgb(s))[..., 0]
    at = pixel_of((-1.2, 9.0, 0), s)
    assert picture[at] == pytest.approx(bare[at], rel=1e-3)
    assert render_pair(s, np.random.default_rng(0)).instance[pixel_of((0, 8.5, 0.5), s)] == 2


def test_ground_that_rises_is_cast_at_together_with_what_stands_on_it():
    # 5 m high at its far end: flat over a grade of 5 %, but not over level ground
    ramp = quad([(-10, 0, 0), (10, 0, 0), (10, 100, 5), (-10, 100, 5)])
    items = (Placed(ramp, np.eye(4), "road", "", False), Placed(box(2, 2, 2), np.eye(4), "box"))
    assert build_scene_rays(items, Grade(0.05)).others.n_faces == 0
    level = build_scene_rays(items)
    assert (level.casters.n_faces, level.others.n_faces) == (len(items[1].mesh.faces), len(ramp.faces))


def test_sunlit_ball_is_lambertian():
    # no sky: radiance = albedo * sun * cos(angle of the sun), with the exact normal (p - centre) / radius
    to_sun = np.array(unit(0.3, -1.0, 0.5))
    light = Light(tuple(to_sun), (1.0, 1.0, 1.0), (0, 0, 0), (0, 0, 0), 0.0)
    s = scene(Placed(ball(1.0, Material("m", (0.8, 0.4, 0.2))), pose(0, 6, 1.5), "ball"), light=light)
    render = render_pair(s, np.random.default_rng(0))
    points = CAMERA.left.rays(grid_px(CAMERA.left)) * render.depth_m[..., None] - np.array([0, 0, 6.0])
    normal = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)  # camera to world axes
    cosine = normal @ to_sun
    inner = (render.instance == 1) & (cosine > 0.2)
    inner = cv2.erode(inner.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert inner.sum() > 1000
    # the street in the sun lights the ball from below with 0.2 * 0.5 * sun_z times the share that
    # faces down, dimmed by at most 40 % near the ground
    bounce = 0.1 * to_sun[2] * (0.5 - 0.5 * normal[..., 2])
    expected = (cosine + bounce)[inner][:, None] * np.array([0.8, 0.4, 0.2])
    np.testing.assert_allclose(linear(render.left_rgb)[inner], expected, atol=0.012)


def test_haze_fades_to_the_horizon():
    # a black wall at 40 m in haze of 0.01 per metre: 1 - exp(-0.4) = 0.3297 of the horizon's 0.5
    light = Light((0, 0, 1), (0, 0, 0), (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), 0.5, haze_per_m=0.01)
    mesh = quad([(-30, 40, -20), (30, 40, -20), (30, 40, 30), (-30, 40, 30)], Material("black", (0, 0, 0)))
    picture = linear(render_rgb(scene(Placed(mesh, np.eye(4), "wall"), light=light)))
    assert picture[60, 80, 1] == pytest.approx(0.5 * (1 - np.exp(-0.4)), rel=0.01)


@pytest.mark.parametrize(("subsamples", "resolved"), [(SUBSAMPLES_PX, 0.3), (FEW_SUBSAMPLES_PX, 0.4)])
def test_edges_are_smooth(subsamples, resolved):
    # the edge x = 0.2 (z - 1.5) of a bright half plane before black: coverage of a pixel is linear in its
    # distance from the edge; four samples resolve it to a quarter, three to a third
    far = quad([(-90, 60, -50), (90, 60, -50), (90, 60, 60), (-90, 60, 60)], Material("black", (0, 0, 0)))
    near = quad([(-1 - 6, 10, -3.5), (-1, 10, -3.5), (1, 10, 6.5), (1 - 8, 10, 6.5)])
    s = scene(Placed(far, np.eye(4), "wall"), Placed(near, np.eye(4), "board"))
    pair = render_pair(s, np.random.default_rng(0), subsamples_px=subsamples)
    picture = linear(pair.left_rgb)[..., 0]
    row, column = np.mgrid[20:75, 60:100]
    x = (column - 79.5) / 200 * 10
    edge_x = 0.2 * (59.5 - row) / 200 * 10
    coverage = np.clip((edge_x - x) * 20 + 0.5, 0, 1)
    bright = picture[60, 50]
    error = picture[20:75, 60:100] / bright - coverage
    assert np.abs(error).max() < resolved
    between = (picture[20:75, 60:100] > 0.1 * bright) & (picture[20:75, 60:100] < 0.9 * bright)
    assert between.sum() >= 30  # about one in each of 55 rows, none without smoothing


def test_instances_number_the_items_of_the_scene():
    render = render_pair(
        scene(ground(), wall(30.0), Placed(box(1, 1, 1), pose(0, 8), "crate")), np.random.default_rng(0)
    )
    assert set(np.unique(render.instance)) == {1, 2, 3}
    assert render.instance[80, 80] == 3
    assert render.instance[119, 5] == 1
    assert render.instance[20, 5] == 2
    assert render.instance.dtype == np.uint16


def test_a_scene_without_things_is_sky():
    s = scene()
    pair = render_pair(s, np.random.default_rng(0))
    assert np.isnan(pair.depth_m).all()
    assert not pair.instance.any()
    # a white sky with clouds of 0.55 that cover up to 0.7 of it: 1 - 0.7 * 0.45 = 0.685, in sRGB 214
    assert pair.left_rgb.min() >= 213
    assert pair.left_rgb.max() == 255
