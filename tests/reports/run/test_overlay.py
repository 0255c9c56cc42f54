import numpy as np
import pytest

from recon.camera import GroundPlane, PinholeCamera
from recon.depth_map import DepthMap
from reports.run.overlay import (
    apply_transform,
    merge_meshes,
    part_mesh,
    points_of_depth,
    registered_depth,
    stereo_points,
    world_from_camera,
)
from rescore.evidence.align_depth import AlignConfig, DepthAlignment, align_depth
from tests.reports.fake_run import CAMERA, HEIGHT, WIDTH, car_box, ground_depth, predicted


@pytest.mark.parametrize("pitch", [-0.2, 0.0, 0.3])
def test_the_world_stands_on_the_ground_under_the_camera(pitch: float):
    ground = GroundPlane(1.6, pitch)
    world = world_from_camera(ground)
    np.testing.assert_allclose(world[:3, :3] @ world[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(world[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(apply_transform(world, np.zeros(3)), [0, 0, 1.6], atol=1e-12)
    feet = ground.intersect(np.array([[0.0, 0.6, 1.0], [0.5, 0.7, 1.0], [-0.4, 0.9, 1.0]]))
    in_world = apply_transform(world, feet)
    np.testing.assert_allclose(in_world[:, 2], 0, atol=1e-12)
    # right in the picture is right in the world, and what is ahead is ahead
    np.testing.assert_allclose(in_world[:, 0], feet[:, 0], atol=1e-12)
    assert (in_world[:, 1] > 0).all()


def test_registration_is_eq_6_with_the_normalisation_undone():
    predicted_depth = DepthMap(0, 0, np.array([[1.2, np.nan]], np.float32))
    alignment = DepthAlignment(0.5, 0.1, 0.0, 1.0, stereo_low=8.0, stereo_span=4.0)
    registered = registered_depth(predicted_depth, alignment)
    # (0.5 * 1.2 + 0.1) * 4 + 8 = 10.8
    assert registered[0, 0] == pytest.approx(10.8)
    assert np.isnan(registered[0, 1])


def test_a_perfect_prediction_lies_on_the_stereo_points():
    box = car_box(9.0, 0.2)
    prediction, labels = predicted(box)
    measured = ground_depth().astype(np.float32)
    seen = labels > 0
    # any affine map of the true depth is a perfect prediction: eq. 6 takes scale and offset out
    measured[prediction.window][seen] = 9.0 + 1.5 * (prediction.depth[seen] - 3)
    solved = align_depth(prediction, measured, box, AlignConfig(percentiles=(0.0, 100.0)))
    assert isinstance(solved, DepthAlignment)
    assert solved.difference < 1e-6
    registered = registered_depth(prediction, solved)
    np.testing.assert_allclose(registered[seen], measured[prediction.window][seen], rtol=1e-5)

    mesh = part_mesh(
        registered, labels, CAMERA.left, (prediction.x0_px, prediction.y0_px), max_vertices=10**6
    )
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    points, _ = stereo_points(measured, rgb, CAMERA.left, np.zeros((0, 4)), max_points=10**6)
    assert len(mesh.xyz_m) == seen.sum()
    rays = {tuple(np.round(p[:2] / p[2], 5)): p for p in points}
    for vertex in mesh.xyz_m[:: len(mesh.xyz_m) // 50]:
        np.testing.assert_allclose(vertex, rays[tuple(np.round(vertex[:2] / vertex[2], 5))], atol=2e-4)


def test_points_of_depth_project_back_to_their_pixels():
    camera = PinholeCamera(200, 210, 31.5, 20.0, 64, 48)
    depth = np.linspace(3, 9, 30).reshape(5, 6)
    uv = camera.project(points_of_depth(depth, camera, 10, 20))
    v, u = np.mgrid[20:25, 10:16]
    np.testing.assert_allclose(uv, np.stack([u, v], -1), atol=1e-9)


def test_a_mesh_is_torn_at_depth_jumps_and_keeps_its_labels():
    depth = np.full((6, 8), 10.0)
    depth[:, 4:] = 20.0
    labels = np.repeat([[1, 1, 1, 1, 2, 2, 2, 2]], 6, 0).astype(np.uint8)
    mesh = part_mesh(depth, labels, CAMERA.left)
    # 5 rows of 3 quads on either side, 2 triangles each: 5 * 3 * 2 * 2 = 60
    assert mesh.triangles.shape == (60, 3)
    assert (np.ptp(mesh.xyz_m[mesh.triangles][..., 2], axis=1) == 0).all()
    assert set(mesh.label[mesh.xyz_m[:, 2] < 15]) == {1}
    both = merge_meshes([mesh, mesh])
    assert len(both.xyz_m) == 96
    np.testing.assert_array_equal(both.xyz_m[both.triangles[60:]], mesh.xyz_m[mesh.triangles])


def test_a_mesh_is_thinned_to_the_number_of_vertices_asked_for():
    depth = np.full((80, 200), 7.0)
    mesh = part_mesh(depth, np.ones((80, 200), np.uint8), CAMERA.left, max_vertices=400)
    assert 200 < len(mesh.xyz_m) <= 400


def test_points_far_away_and_holes_are_left_out():
    depth = np.array([[5.0, np.nan], [80.0, 9.0]], np.float32)
    rgb = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    points, colours = stereo_points(depth, rgb, CAMERA.left, np.zeros((0, 4)), max_depth_m=60)
    np.testing.assert_allclose(points[:, 2], [5, 9])
    np.testing.assert_array_equal(colours, [[0, 1, 2], [9, 10, 11]])
