from functools import lru_cache

import numpy as np
import pytest

from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.errors import Failure, Reason, RescoreError
from recon.localization.joint_fit import JointFitConfig, OutlineFit, joint_fits
from recon.localization.learn_shapes import (
    InstanceShape,
    ShapeSpaceConfig,
    TrainingInstance,
    instance_shape,
    object_views,
    principal_shapes,
)
from recon.localization.localize import FitConfig, FitLocalization, localize_by_fit
from recon.localization.outline_edges import OutlinePoints, outline_points
from recon.localization.standing_box import StandingBox, cam_from_ground, turn, volume_overlap
from recon.outlines import fill_polygon, largest_outline
from recon.shape_space import ShapeSpace
from recon.view_bins import ViewBins
from rescore.parallel import one_thread
from tests.exact_primitives import exact_library
from tests.recon.box_car import PART_NAMES, box_car, labelled_view

BINS = ViewBins(12, float(np.deg2rad(35)))
CAMERA = PinholeCamera(600.0, 600.0, 399.5, 299.5, 800, 600)
GROUND = GroundPlane(14.5, float(np.deg2rad(35)))
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
CONFIG = ShapeSpaceConfig(cells=(64, 24, 28), modes=2)
SIZES = ((4.0, 1.7, 1.4), (4.4, 1.8, 1.5), (4.8, 1.9, 1.45), (4.2, 1.75, 1.6))


def instance(size: tuple[float, float, float]) -> TrainingInstance:
    car = box_car(*size)
    views = tuple(labelled_view(car, b, BINS, 240, f"car {size}") for b in range(BINS.count))
    return TrainingInstance(views, (BINS,) * BINS.count, size)


@lru_cache(maxsize=4)
def shape_of(size: tuple[float, float, float]) -> InstanceShape:
    with one_thread():
        return instance_shape(instance(size), PART_NAMES, CONFIG, exact_library(BINS))


@lru_cache(maxsize=1)
def space() -> ShapeSpace:
    return principal_shapes([shape_of(s) for s in SIZES], CONFIG)


def silhouette(truth: StandingBox) -> np.ndarray:
    """The mask of a box car that fills a box, by projecting its polygons."""
    pose = cam_from_ground(GROUND)
    mask = np.zeros((CAMERA.height_px, CAMERA.width_px), bool)
    for polygon in box_car(*truth.size_m.tolist()).values():
        xyz = polygon.copy()
        xyz[:, :2] = xyz[:, :2] @ turn(truth.yaw_rad).T + truth.xy_m
        cam = xyz @ pose[:3, :3].T + pose[:3, 3]
        mask |= fill_polygon(CAMERA.project(cam), CAMERA.height_px, CAMERA.width_px)
    return mask


def outline_of(mask: np.ndarray) -> OutlinePoints:
    ring = largest_outline(mask)
    assert ring is not None
    return OutlinePoints(outline_points(ring, 120)[0], np.ones(120), np.ones(120))


def test_views_are_put_together_from_their_silhouettes() -> None:
    placed = object_views(instance(SIZES[1]), len(PART_NAMES))
    # every view was drawn with 240 pixels along its longer side
    for v, scale in enumerate(placed.scale):
        points = np.concatenate(list(box_car(*SIZES[1]).values())) @ placed.rotation[v].T
        expected = np.ptp(points[:, :2], axis=0).max() / 240
        assert scale == pytest.approx(expected, rel=0.03)
    # the middle of the roof and of the ground below project to the same column in all views
    top, foot = (np.array([placed.project(v, np.array([0.0, 0, z])) for v in range(12)]) for z in (1.5, 0))
    assert np.allclose(top[:, 0], foot[:, 0])
    assert np.allclose((foot - top)[:, 1] * placed.scale, 1.5 * np.cos(BINS.elevation_rad), atol=1e-9)


@pytest.mark.parametrize("yaw_deg", [20.0, 110.0, -75.0])
def test_a_box_car_is_recovered(yaw_deg: float) -> None:
    truth = StandingBox(np.array([0.6, 20.3]), float(np.deg2rad(yaw_deg)), np.array([4.5, 1.83, 1.5]))
    outline = outline_of(silhouette(truth))
    best = joint_fits(outline, space(), SEEN_FROM, BINS, JointFitConfig())[0].box(space(), 1.0)
    assert np.rad2deg(abs(np.angle(np.exp(1j * (best.yaw_rad - truth.yaw_rad))))) < 1.5
    assert np.linalg.norm(best.centroid_m - truth.centroid_m) < 0.08
    assert volume_overlap(best, truth) > 0.9


def test_derivatives_agree_with_differences() -> None:
    truth = StandingBox(np.array([0.6, 20.3]), 0.4, np.array([4.5, 1.83, 1.5]))
    problem = OutlineFit(outline_of(silhouette(truth)), space(), SEEN_FROM, JointFitConfig())
    vector = np.array([0.65, 20.25, 0.43, 0.01, -0.01, 0.02, 0.3, -0.2])

    def least(v: np.ndarray) -> np.ndarray:
        size = space().size_m(v[6:], v[3:6])
        return problem.residuals(v, problem.rays, space().hull(v[6:]), size)[0]

    size, hull = space().size_m(vector[6:], vector[3:6]), space().hull(vector[6:])
    _, unit = problem.residuals(vector, problem.rays, hull, size)
    jacobian = problem.jacobian(vector, unit, hull, size)
    for k in range(len(vector)):
        step = np.zeros(len(vector))
        step[k] = 5e-3
        difference = (least(vector + step) - least(vector - step)) / 1e-2
        # the hull has kinks, where a difference over a step and a slope are not the same
        assert np.median(np.abs(difference - jacobian[:, k])) < 0.04 * max(1, np.abs(difference).max())


def test_an_outline_of_something_else_and_one_above_the_horizon_have_reasons() -> None:
    light = np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.float32)
    mask = np.zeros(light.shape[:2], bool)
    mask[300:306, 60:760] = True
    light[mask] = 0.5
    ring = largest_outline(mask)
    assert ring is not None
    config = FitConfig(outline_points=60)
    found = localize_by_fit(light, np.zeros_like(light), ring, space(), SEEN_FROM, config)
    assert isinstance(found, Failure)
    assert found.reason is Reason.REGISTRATION_FAILED
    level = GroundPlane(1.0, 0.0)
    above = localize_by_fit(
        light, np.zeros_like(light), ring - 200, space(), GroundedCamera(CAMERA, level), config
    )
    assert isinstance(above, Failure)
    assert above.reason is Reason.ABOVE_HORIZON


def test_fit_from_a_picture() -> None:
    truth = StandingBox(np.array([-0.4, 20.0]), 2.0, np.array([4.3, 1.78, 1.5]))
    mask = silhouette(truth)
    light = np.where(mask[..., None], 0.4, 0.05).astype(np.float32) * np.ones(3, np.float32)
    ring = largest_outline(mask)
    assert ring is not None
    found = localize_by_fit(light, np.full_like(light, 0.05), ring, space(), SEEN_FROM, FitConfig())
    assert isinstance(found, FitLocalization)
    assert volume_overlap(found.box, truth) > 0.9
    assert found.fit.parts_m(space(), 1.0).shape[1:] == (40, 3)


def test_too_few_instances() -> None:
    shape = shape_of(SIZES[0])
    with pytest.raises(RescoreError, match="at least 4 training instances"):
        principal_shapes([shape] * 3, CONFIG)


def test_an_object_much_smaller_than_any_learned_is_recovered() -> None:
    truth = StandingBox(np.array([0.6, 20.3]), 0.6, np.array([2.6, 1.7, 1.5]))
    outline = outline_of(silhouette(truth))
    best = joint_fits(outline, space(), SEEN_FROM, BINS, JointFitConfig())[0].box(space(), 1.0)
    assert volume_overlap(best, truth) > 0.8


def test_a_fit_says_when_the_outline_is_of_a_shape_outside_the_space() -> None:
    truth = StandingBox(np.array([-0.4, 20.0]), 2.0, np.array([4.3, 1.78, 1.5]))
    plain = silhouette(truth)
    rows, columns = np.nonzero(plain)
    loaded = plain.copy()
    middle = int(columns.mean())
    loaded[rows.min() - 14 : rows.min() + 10, middle - 20 : middle + 20] = True
    found = []
    for mask in (plain, loaded):
        light = np.where(mask[..., None], 0.4, 0.05).astype(np.float32) * np.ones(3, np.float32)
        ring = largest_outline(mask)
        assert ring is not None
        fit = localize_by_fit(light, np.full_like(light, 0.05), ring, space(), SEEN_FROM, FitConfig())
        assert isinstance(fit, FitLocalization)
        found.append(fit.outside)
    assert found == [False, True]
    # larger errors are expected of the odd outline, so that what is on the roof bends the size less
    free, stiff = (
        joint_fits(outline_of(loaded), space(), SEEN_FROM, BINS, JointFitConfig(misfit_weight=w))[0]
        for w in (1.5, 0.0)
    )
    assert free.cost < 0.1 * free.strain
    assert stiff.cost == stiff.strain
    apart = [volume_overlap(f.box(space(), 1.0), truth) for f in (free, stiff)]
    assert apart[0] > apart[1] + 0.03
