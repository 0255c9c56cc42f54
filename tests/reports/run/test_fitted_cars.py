import numpy as np
import pytest

from recon.camera import GroundPlane
from reports.run.fitted_cars import (
    box_axes,
    dashes,
    instance_depth,
    nose_marks,
    shown_area,
    solid_corners,
)
from reports.run.frame_view import FrameView, frame_views
from rescore.data.boxes3d import Boxes3D
from rescore.results.run_folder import Run
from tests.reports.instance_run import FRAMED_PX, NO_FIT, SEEN_PX, box_of


@pytest.fixture(scope="module")
def view(instance_run: Run) -> FrameView:
    return next(frame_views(instance_run, "instance"))


def test_candidates_have_fits_and_3d_boxes_in_mode_instance_alone(instance_run: Run, view: FrameView) -> None:
    for c in view.candidates["hog"]:
        if c.rank == NO_FIT:
            assert c.fit is None
            assert c.box3d is None
            continue
        assert c.fit is not None
        assert c.box3d is not None
        assert c.registered is None
        np.testing.assert_allclose(c.box3d.values[0], box_of(c.rank))
    other = next(frame_views(instance_run, "paper")).candidates["hog"]
    assert all(c.fit is None for c in other)
    assert any(c.registered is not None for c in other)
    assert any(c.box3d is not None for c in other)


def test_the_depth_of_a_fitted_car_lies_within_its_silhouette(view: FrameView) -> None:
    focal_baseline = view.seen_from.camera.fx_px * view.baseline
    for c in view.candidates["hog"]:
        if c.fit is None:
            continue
        for one, disparity in ((c.fit.framed, FRAMED_PX), (c.fit.seen, SEEN_PX)):
            depth = instance_depth(view, c.fit, one)
            assert depth.shape == view.measured.shape
            rows, columns = np.nonzero(np.isfinite(depth))
            np.testing.assert_allclose(depth[rows, columns], focal_baseline / disparity, rtol=1e-5)
            ends = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
            h, w = depth.shape
            step = c.fit.column_px[1] - c.fit.column_px[0], c.fit.row_px[1] - c.fit.row_px[0]
            expected = np.clip(one.silhouette_px, 0, [w, h, w, h])
            assert (np.abs(ends - expected) <= np.tile(step, 2) + 1).all()


def test_what_is_shown_holds_box_and_car(view: FrameView) -> None:
    for c in view.candidates["hog"]:
        x0, y0, x1, y1 = c.xyxy_px
        wider = 0 if c.fit is None else (x1 - x0) / 2
        np.testing.assert_allclose(shown_area(c), [x0, y0, x1 + wider, y1])


def test_dashes_lie_on_the_sides_and_make_half_of_them() -> None:
    strips = dashes(np.array([10.0, 20.0, 110.0, 60.0]), 5.0)
    length = np.linalg.norm(strips[:, 1] - strips[:, 0], axis=1)
    assert length.sum() == pytest.approx(0.5 * 280)
    x, y = strips.reshape(-1, 2).T
    assert (np.isclose(x, 10) | np.isclose(x, 110) | np.isclose(y, 20) | np.isclose(y, 60)).all()


def test_boxes_stand_upright_on_a_tilted_ground_with_the_nose_ahead() -> None:
    # a car on the ground 10 m ahead that faces the camera, and one that faces right
    ground = GroundPlane(1.6, pitch_rad=0.05, roll_rad=0.02)
    foot = ground.intersect(np.array([[0.0, 0.16, 1.0]]))
    boxes = Boxes3D.of_kitti(
        np.repeat(foot, 2, axis=0), np.array([[1.5, 1.8, 4.2]] * 2), np.array([np.pi / 2, 0.0]), ground.up
    )
    centre, axes = box_axes(boxes, ground)
    np.testing.assert_allclose(centre[:, 2], 0.75, atol=1e-9)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), [np.eye(3)] * 2, atol=1e-9)
    np.testing.assert_allclose(axes[:, :, 2], [[0, 0, 1]] * 2)
    np.testing.assert_allclose(axes[0, :, 0], [0, -1, 0], atol=0.05)
    np.testing.assert_allclose(axes[1, :, 0], [1, 0, 0], atol=0.05)
    marks = nose_marks(boxes, ground)
    np.testing.assert_allclose(marks[..., 2], 0, atol=1e-9)
    # the tip lies three quarters of the length ahead of the middle
    np.testing.assert_allclose(marks[:, 1, :2] - centre[:, :2], 0.75 * 4.2 * axes[:, :2, 0], atol=1e-9)


def test_corners_of_a_box_are_around_its_foot_and_a_height_above_it() -> None:
    # 10 m ahead on level ground 1.6 m below the camera, nose to the right: x along its length, z across
    ground = GroundPlane(1.6)
    box = Boxes3D.of_kitti(np.array([[1.0, 1.6, 10.0]]), np.array([[1.5, 1.8, 4.2]]), np.zeros(1))
    corners = solid_corners(box, ground)
    assert corners.shape == (1, 8, 3)
    # left of a nose that points along +x is away from the camera
    foot = [[3.1, 1.6, 10.9], [3.1, 1.6, 9.1], [-1.1, 1.6, 9.1], [-1.1, 1.6, 10.9]]
    np.testing.assert_allclose(corners[0, :4], foot, atol=1e-9)
    np.testing.assert_allclose(corners[0, 4:], np.array(foot) - [0, 1.5, 0], atol=1e-9)
