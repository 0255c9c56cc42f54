"""Reconstruction of drawn box cars: depth, failures, batches."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from recon.arrays import FloatArray, UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera, default_camera
from recon.class_model import ClassModel
from recon.errors import Failure, Reason, RescoreError
from recon.learning.learn import LearnConfig, learn_class_model
from recon.reconstruction.canonical_window import _in_one_piece
from recon.reconstruction.part_registration import RegistrationConfig, prepare_view
from recon.reconstruction.place_parts import PlacingConfig
from recon.reconstruction.reconstruct import ReconstructConfig, Reconstruction, reconstruct, view_rotation
from recon.reconstruction.segment import SegmentConfig
from recon.view_bins import ViewBins, rotation
from tests.exact_primitives import exact_library
from tests.recon.box_car import PART_NAMES, box_car, labelled_view

CAMERA = PinholeCamera(700.0, 700.0, 319.5, 200.0, 640, 480)
GROUND = GroundPlane(1.9, 0.03)
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
BINS = ViewBins(12, np.deg2rad(5))


@pytest.fixture(scope="module")
def model() -> ClassModel:
    views = [labelled_view(box_car(), b, BINS) for b in (1, 2, 3, 4)]
    return learn_class_model(views, "car", PART_NAMES, LearnConfig(bins=BINS), exact_library(BINS))


def drawn(
    z_m: float = 12.0, x_m: float = 0.5, azimuth_deg: float = 90.0
) -> tuple[UInt8Array, FloatArray, FloatArray]:
    """A picture of a box car on the ground, its box and its depth; azimuth is that of the ray to it."""
    up = GROUND.up
    forward = np.array([x_m, 0.0, z_m]) - (np.array([x_m, 0.0, z_m]) @ up) * up
    forward /= np.linalg.norm(forward)
    cam_from_view = np.stack([np.cross(-up, forward), -up, forward], axis=1)
    turn = cam_from_view @ rotation(np.deg2rad(azimuth_deg), 0.0)
    origin = np.array([x_m, 0.0, z_m])
    origin = origin - (origin @ up + GROUND.height_m) * up
    rng = np.random.default_rng(0)
    rgb = rng.integers(60, 80, (480, 640, 3)).astype(np.uint8)
    depth = np.full((480, 640), np.nan)
    v, u = np.mgrid[0:480, 0:640].astype(float)
    rays = CAMERA.rays(np.stack([u, v], axis=-1))
    points = []
    for i, polygon in enumerate(box_car().values()):
        corners = polygon @ turn.T + origin
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        points.append(CAMERA.project(corners))
        if normal @ corners[0] > 0:
            continue
        inside = np.zeros((480, 640), np.uint8)
        cv2.fillPoly(inside, [np.round(points[-1] * 16).astype(np.int32)], 1, shift=4)
        z = (normal @ corners[0]) / (rays @ normal)
        nearer = inside.astype(bool) & ~(depth <= z)
        depth[nearer] = z[nearer]
        rgb[nearer] = (150 + 7 * i, 120 + 5 * i, 200 - 6 * i)
    edges = np.concatenate(points) + 0.5
    return rgb, np.concatenate([edges.min(axis=0), edges.max(axis=0)]), depth


@pytest.mark.parametrize("x_m", [0.0, -3.0])
def test_depth_of_a_side_view(model: ClassModel, x_m: float) -> None:
    rgb, box, truth = drawn(x_m=x_m)
    (found,) = reconstruct(rgb, box[None], 3, model, SEEN_FROM)
    assert isinstance(found, Reconstruction)
    true = truth[found.depth.window]
    both = np.isfinite(found.depth.depth) & np.isfinite(true)
    error = np.abs(found.depth.depth[both] - true[both]) / true[both]
    assert np.median(error) < 0.03
    assert both.sum() > 0.6 * np.isfinite(truth).sum()
    assert found.placed_share > 0.6
    body, wheel = PART_NAMES.index("left_body") + 1, PART_NAMES.index("front_left_wheel") + 1
    assert {body, wheel} <= set(found.part_planes)
    # every finite depth lies on the plane of its part
    v, u = np.nonzero(np.isfinite(found.depth.depth))
    uv = np.stack([u + found.x0_px, v + found.y0_px], axis=-1).astype(float)
    points = CAMERA.rays(uv) * found.depth.depth[v, u, None]
    planes = np.stack([found.part_planes[int(k)] for k in found.part_labels[v, u]])
    np.testing.assert_allclose((points * planes[:, :3]).sum(axis=1) + planes[:, 3], 0.0, atol=1e-4)


def test_an_oblique_view_is_deeper_at_the_far_end(model: ClassModel) -> None:
    # bin 2, azimuth 60: nose nearer, and to the left
    rgb, box, truth = drawn(azimuth_deg=60.0)
    (found,) = reconstruct(rgb, box[None], 2, model, SEEN_FROM)
    assert isinstance(found, Reconstruction)
    true = truth[found.depth.window]
    both = np.isfinite(found.depth.depth) & np.isfinite(true)
    assert np.corrcoef(found.depth.depth[both], true[both])[0, 1] > 0.8
    assert np.median(np.abs(found.depth.depth[both] / true[both] - 1)) < 0.08


def test_parts_and_outline_are_where_the_car_is(model: ClassModel) -> None:
    rgb, box, truth = drawn()
    (found,) = reconstruct(rgb, (box + np.array([4, -3, -5, 3]))[None], 3, model, SEEN_FROM)
    assert isinstance(found, Reconstruction)
    labels = np.zeros((480, 640), bool)
    labels[found.depth.window] = found.part_labels > 0
    car = np.isfinite(truth)
    assert (labels & car).sum() / (labels | car).sum() > 0.88
    start = np.zeros((480, 640), np.uint8)
    cv2.fillPoly(start, [np.round(found.initial_outline_px).astype(np.int32)], 1)
    assert (labels & car).sum() / (labels | car).sum() > (start.astype(bool) & car).sum() / (
        start.astype(bool) | car
    ).sum()


def test_batch_equals_one_by_one_and_runs_repeat(model: ClassModel) -> None:
    rgb, box, _ = drawn()
    boxes = box + np.random.default_rng(1).normal(0, 4, (4, 4))
    boxes[2] = [-300, 10, -100, 90]
    together = reconstruct(rgb, boxes, 3, model, SEEN_FROM)
    assert isinstance(together[2], Failure)
    for one, b in zip(together, boxes, strict=True):
        (alone,) = reconstruct(rgb, b[None], 3, model, SEEN_FROM)
        if isinstance(one, Failure):
            assert one == alone
            continue
        assert isinstance(alone, Reconstruction)
        np.testing.assert_array_equal(one.outline_px, alone.outline_px)
        np.testing.assert_array_equal(one.part_labels, alone.part_labels)
        np.testing.assert_array_equal(one.depth.depth, alone.depth.depth)


def test_boxes_of_several_views_are_done_together(model: ClassModel) -> None:
    rgb, box, _ = drawn()
    bins = np.array([2, 3, 4, 3])
    together = reconstruct(rgb, np.tile(box, (4, 1)), bins, model, SEEN_FROM)
    for one, view_bin in zip(together, bins.tolist(), strict=True):
        (alone,) = reconstruct(rgb, box[None], view_bin, model, SEEN_FROM)
        assert isinstance(one, Reconstruction)
        assert isinstance(alone, Reconstruction)
        np.testing.assert_array_equal(one.outline_px, alone.outline_px)
        np.testing.assert_array_equal(one.depth.depth, alone.depth.depth)


def test_no_candidates(model: ClassModel) -> None:
    assert reconstruct(drawn()[0], np.zeros((0, 4)), 3, model, SEEN_FROM) == ()


@pytest.mark.parametrize("centre_px", [60.0, 319.5, 600.0])
def test_view_frame_is_turned_onto_the_ray(model: ClassModel, centre_px: float) -> None:
    box = np.array([centre_px - 30, 230, centre_px + 30, 260])
    turn = view_rotation(prepare_view(model, 3, RegistrationConfig()), box, SEEN_FROM)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    # the object's up is the ground's, and its left side faces along the level part of the ray
    np.testing.assert_allclose(turn @ [0, 0, 1], GROUND.up, atol=1e-12)
    ray = CAMERA.rays(np.array([centre_px - 0.5, 244.5]))
    level = ray - (ray @ GROUND.up) * GROUND.up
    np.testing.assert_allclose(turn @ [0, 1, 0], -level / np.linalg.norm(level), atol=1e-12)


def reason(
    model: ClassModel, box: FloatArray, config: ReconstructConfig, ground: GroundPlane = GROUND
) -> Reason:
    (result,) = reconstruct(drawn()[0], box[None], 3, model, GroundedCamera(CAMERA, ground), config)
    assert isinstance(result, Failure)
    assert result.detail
    return result.reason


def test_every_reason_occurs(model: ClassModel) -> None:
    box, config = drawn()[1], ReconstructConfig()
    assert reason(model, box - np.array([500, 0, 500, 0]), config) is Reason.BOX_OUTSIDE_IMAGE
    assert reason(model, np.array([10.0, 10.0, 12.0, 12.0]), config) is Reason.BOX_OUTSIDE_IMAGE
    assert reason(model, np.array([300.0, 200.0, 200.0, 240.0]), config) is Reason.BOX_OUTSIDE_IMAGE
    shrink = SegmentConfig(steps=200, area_weight=5.0, length_weight=0.1, max_shift=1.0, edge_scale=100.0)
    assert reason(model, box, replace(config, segment=shrink)) is Reason.NO_OUTLINE
    strict = RegistrationConfig(max_cost=0.0)
    assert reason(model, box, replace(config, registration=strict)) is Reason.REGISTRATION_FAILED
    square = np.array([box[0], box[1], box[0] + box[3] - box[1], box[3]])
    assert reason(model, square, config) is Reason.REGISTRATION_FAILED
    assert reason(model, box - np.array([0, 180, 0, 180]), config) is Reason.ABOVE_HORIZON
    steep = PlacingConfig(min_angle_rad=np.deg2rad(89.9))
    assert reason(model, box, replace(config, placing=steep)) is Reason.PARTS_NOT_PLACED


def test_no_ground_contact_where_the_wheels_are_outside_the_picture(model: ClassModel) -> None:
    box = np.array([150.0, 400.0, 500.0, 540.0])
    assert reason(model, box, ReconstructConfig()) is Reason.NO_GROUND_CONTACT


def test_model_side_is_prepared_once(model: ClassModel) -> None:
    config = RegistrationConfig()
    assert prepare_view(model, 3, config) is prepare_view(model, 3, RegistrationConfig())


def test_wrong_arguments(model: ClassModel) -> None:
    rgb, box, _ = drawn()
    with pytest.raises(RescoreError, match="expected 320 x 240 pixels as the camera says"):
        reconstruct(rgb, box[None], 3, model, GroundedCamera(default_camera(320, 240), GROUND))
    with pytest.raises(RescoreError, match="expected a labelled view of bin 9"):
        reconstruct(rgb, box[None], 9, model, SEEN_FROM)


def test_pieces_are_joined_inside_the_start_only() -> None:
    mask = np.zeros((160, 240), bool)
    mask[40:120, 20:100] = mask[40:120, 116:220] = True
    start = np.full((40, 60), 5.0, np.float32)
    # the start has a bar between the two: rows 15 to 24 of the coarse grid, 60 to 99 of the fine one
    start[15:25, 5:55] = -5.0
    joined = _in_one_piece(mask, start)
    assert cv2.connectedComponents(joined.astype(np.uint8))[0] == 2
    assert (joined >= mask).all()
    rows = np.nonzero((joined & ~mask).any(axis=1))[0]
    assert rows.min() >= 56
    assert rows.max() <= 103
    apart = np.full_like(start, 5.0)
    np.testing.assert_array_equal(_in_one_piece(mask, apart), mask)


def test_specks_are_no_pieces() -> None:
    mask = np.zeros((160, 240), bool)
    mask[40:120, 20:200] = mask[60:70, 210:220] = True
    start = np.full((40, 60), -5.0, np.float32)
    assert _in_one_piece(mask, start) is mask
