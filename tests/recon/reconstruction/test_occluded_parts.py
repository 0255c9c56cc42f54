"""The transform from the class model to an instance: closed form, a bad part, too few parts."""

from dataclasses import replace

import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.class_model import ClassModel
from recon.depth_map import DepthMap
from recon.errors import Failure, Reason
from recon.learning.learn import LearnConfig, learn_class_model
from recon.reconstruction.occluded_parts import (
    ClassToInstance,
    TransformConfig,
    _labelled_image_in_units,
    _on_class_plane,
    class_to_instance,
    model_hull,
    part_correspondences,
)
from recon.reconstruction.part_registration import PreparedView, RegistrationConfig, prepare_view
from recon.reconstruction.place_parts import feet
from recon.reconstruction.reconstruct import Reconstruction
from recon.view_bins import ViewBins, rotation
from tests.recon.box_car import PART_NAMES, box_car, labelled_view

BINS = ViewBins(12, np.deg2rad(5))
CAMERA = PinholeCamera(700.0, 700.0, 319.5, 200.0, 640, 480)
GROUND = GroundPlane(1.6)
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
BIN = 2
SCALE = np.array([4.5, 4.0, 5.0])
TURN = rotation(BINS.azimuth_rad(BIN), 0.0)


@pytest.fixture(scope="module")
def model() -> ClassModel:
    views = [labelled_view(box_car(), b, BINS) for b in (1, 2, 3, 4)]
    return learn_class_model(views, "car", PART_NAMES, LearnConfig(bins=BINS))


@pytest.fixture(scope="module")
def view(model: ClassModel) -> PreparedView:
    return prepare_view(model, BIN, RegistrationConfig())


def placed(
    model: ClassModel,
    view: PreparedView,
    labels: tuple[int, ...] | None = None,
    scale: FloatArray = SCALE,
) -> tuple[Reconstruction, FloatArray]:
    """An instance made by a known transform, with exact regions and planes; and the shift in metres."""
    low = min(float(p[2]) for p in feet(model).values())
    # the origin 12 m ahead; the feet on the ground at y = 1.6, which is z = -1.6 of the object's axes
    shift = TURN.T @ np.array([0.3, 0.0, 12.0])
    shift[2] = -1.6 - scale[2] * low
    true = ClassToInstance(TURN, scale, shift, 0.0, {})
    turn = model.bins.view_from_object(BIN)
    empty = Reconstruction(
        outline_px=np.zeros((3, 2)),
        initial_outline_px=np.zeros((3, 2)),
        x0_px=0,
        y0_px=0,
        part_labels=np.zeros((2, 2), np.uint8),
        part_planes={p.label: true.plane(p.plane) for p in model.parts},
        unplaced_parts={},
        depth=DepthMap(0, 0, np.full((2, 2), np.nan, np.float32)),
        ground_line_px=np.zeros((2, 2)),
        cam_from_object=TURN,
        registration_cost=0.0,
        placed_share=1.0,
        part_regions=tuple((k, np.zeros((rows.stop - rows.start, 2))) for k, rows in view.rings),
        ground_points_m={k: np.zeros(3) for k in feet(model)},
    )
    # where the class side lifts the regions to, carried by the transform and projected
    fit = _labelled_image_in_units(view, turn)
    assert fit is not None
    regions = []
    for label, rows in view.rings:
        points = _on_class_plane(view.region_points[rows] * fit[0] + fit[1], model.part(label).plane, turn)
        regions.append((label, CAMERA.project(true.points(points))))
    planes = {k: p for k, p in empty.part_planes.items() if labels is None or k in labels}
    return replace(empty, part_regions=tuple(regions), part_planes=planes), shift


def test_a_similarity_comes_back(model: ClassModel, view: PreparedView) -> None:
    scale = np.full(3, 4.5)
    found, shift = placed(model, view, scale=scale)
    # learned feet are not quite level, which the ground would level
    level = TransformConfig(ground_weight=1e-9)
    moved = class_to_instance(found, view, SEEN_FROM, level)
    assert isinstance(moved, ClassToInstance)
    np.testing.assert_allclose(moved.scale, scale, rtol=1e-3)
    np.testing.assert_allclose(moved.shift_m, shift, atol=0.01)
    assert moved.residual_m < 0.01


def test_scales_of_the_axes_come_back_where_points_spread(model: ClassModel, view: PreparedView) -> None:
    found, shift = placed(model, view)
    free = TransformConfig(own_scale_spread=1e-4, ground_weight=1e-9)
    moved = class_to_instance(found, view, SEEN_FROM, free)
    assert isinstance(moved, ClassToInstance)
    np.testing.assert_allclose(moved.scale, SCALE, rtol=1e-3)
    # by default the width, along which the points spread least, is drawn to the common scale
    drawn = class_to_instance(found, view, SEEN_FROM)
    assert isinstance(drawn, ClassToInstance)
    assert SCALE[1] < drawn.scale[1] < SCALE[0]
    for part in model.parts:
        true = TURN @ (part.centroid * SCALE + shift)
        assert np.linalg.norm(drawn.points(part.centroid) - true) < 0.15


def test_a_whole_outline_sets_the_size(model: ClassModel, view: PreparedView) -> None:
    scale = np.full(3, 4.5)
    found, _ = placed(model, view, scale=scale)
    points = ClassToInstance(TURN, scale, placed(model, view, scale=scale)[1], 0.0, {}).points(
        np.concatenate([p.outline for p in model.parts])
    )
    uv = CAMERA.project(points)
    low, high = uv.min(axis=0), uv.max(axis=0)
    # an outline nine tenths as wide as the model carried over, and as high
    outline = np.array([[low[0], low[1]], [low[0] + 0.9 * (high - low)[0], high[1]], [low[0], high[1]]])
    moved = class_to_instance(replace(found, outline_px=outline), view, SEEN_FROM)
    assert isinstance(moved, ClassToInstance)
    np.testing.assert_allclose(moved.scale, [0.9 * 4.5, 0.9 * 4.5, 4.5], rtol=0.03)


def test_on_a_calibrated_ground_the_model_fills_the_outline(model: ClassModel, view: PreparedView) -> None:
    found, _ = placed(model, view, scale=np.full(3, 4.5))
    # the same outline as of a longer, narrower, lower car
    true = np.array([4.8, 4.3, 4.2])
    outline = CAMERA.project(
        ClassToInstance(TURN, true, placed(model, view, scale=true)[1], 0.0, {}).points(model_hull(model))
    )
    table = TransformConfig(calibrated_ground=True)
    moved = class_to_instance(replace(found, outline_px=outline), view, SEEN_FROM, table)
    assert isinstance(moved, ClassToInstance)
    np.testing.assert_allclose(moved.scale, true, rtol=0.05)
    carried = moved.points(np.concatenate([p.outline for p in model.parts]))
    assert carried[:, 1].max() == pytest.approx(1.6)
    uv = CAMERA.project(carried)
    np.testing.assert_allclose(uv.min(axis=0), outline.min(axis=0), atol=3)
    np.testing.assert_allclose(uv.max(axis=0), outline.max(axis=0), atol=3)
    # an aerial makes it higher by less than half of what it stands out
    top = outline[np.argmin(outline[:, 1])] - [0, 0.25 * np.ptp(outline[:, 1])]
    aerial = replace(found, outline_px=np.vstack([outline, top]))
    higher = class_to_instance(aerial, view, SEEN_FROM, table)
    assert isinstance(higher, ClassToInstance)
    assert higher.scale[2] < 1.1 * moved.scale[2]


def test_one_bad_part_does_not_carry_the_others_away(model: ClassModel, view: PreparedView) -> None:
    found, shift = placed(model, view)
    label = PART_NAMES.index("left_windows") + 1
    planes = dict(found.part_planes)
    planes[label] = planes[label] * np.array([1, 1, 1, 1.3])
    moved = class_to_instance(replace(found, part_planes=planes), view, SEEN_FROM)
    assert isinstance(moved, ClassToInstance)
    assert moved.part_residual_m[label] == max(moved.part_residual_m.values())
    assert moved.part_residual_m[label] > 5 * moved.residual_m
    true = TURN @ (model.part(8).centroid * SCALE + shift)
    assert np.linalg.norm(moved.points(model.part(8).centroid) - true) < 0.2


def test_too_few_parts_are_a_failure(model: ClassModel, view: PreparedView) -> None:
    found, _ = placed(model, view, labels=(8,))
    failure = class_to_instance(found, view, SEEN_FROM)
    assert isinstance(failure, Failure)
    assert failure.reason is Reason.PARTS_NOT_PLACED
    assert "at least 2 placed parts" in failure.detail


def test_correspondences_lie_on_both_planes(model: ClassModel, view: PreparedView) -> None:
    found, _ = placed(model, view)
    pairs = part_correspondences(found, view, CAMERA)
    assert len(pairs) >= 5
    for label, pair in pairs.items():
        plane, on_class = found.part_planes[label], model.part(label).plane
        np.testing.assert_allclose(pair.model @ on_class[:3] + on_class[3], 0, atol=1e-9)
        np.testing.assert_allclose(pair.instance @ TURN.T @ plane[:3] + plane[3], 0, atol=1e-9)


def test_planes_and_points_move_together() -> None:
    # scale 2, 3, 4 and a shift by (1, 0, 0); the plane x + z = 1 of the model holds (1, 0, 0) and (0, 5, 1)
    moved = ClassToInstance(np.eye(3), np.array([2.0, 3.0, 4.0]), np.array([1.0, 0.0, 0.0]), 0.0, {})
    plane = moved.plane(np.array([1.0, 0.0, 1.0, -1.0]) / np.sqrt(2))
    points = moved.points(np.array([[1.0, 0.0, 0.0], [0.0, 5.0, 1.0]]))
    np.testing.assert_allclose(points, [[3, 0, 0], [1, 15, 4]])
    np.testing.assert_allclose(points @ plane[:3] + plane[3], 0, atol=1e-12)
    assert np.linalg.norm(plane[:3]) == pytest.approx(1.0)
