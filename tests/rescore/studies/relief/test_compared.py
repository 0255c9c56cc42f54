"""A car of known shape beats the plane by what its relief is worth, and a climb finds where it stands."""

from dataclasses import replace

import numpy as np
import pytest

from recon.localization.depth_views import DepthViewsConfig
from recon.localization.disparity_fit import DisparityFit, DisparityFitConfig
from recon.localization.standing_box import StandingBox, cam_from_ground
from recon.shape_space import ShapeSpace
from rescore.studies.relief.compared import SeenCar, compare_car
from rescore.studies.relief.likelihood import MeasurementNoise
from rescore.studies.relief.posed_shapes import (
    ALL_FREE,
    NONE_FREE,
    POSE_FREE,
    Climb,
    PosedShape,
    about_up,
    posed_instance,
)
from rescore.studies.relief.relief_file import SURFACES, ReliefCar, View
from rescore.studies.relief.shown_cars import ShownCar, sampled
from tests.recon.localization import stepped_car as car

NOISE = MeasurementNoise()
BOX = StandingBox(np.array([-2.0, 11.0]), np.radians(50.0), car.SIZE_M)
NOWHERE = StandingBox(np.array([0.0, 400.0]), 0.0, car.SIZE_M)
OTHER_CAB_M = (-1.0, 1.8)


def space() -> ShapeSpace:
    """The stepped car, whose one coefficient moves the cab: 1 is a cab before the middle."""
    rear, front = car.space(), car.space(OTHER_CAB_M)
    return replace(
        rear,
        modes=(front.mean - rear.mean)[..., None],
        log_size_modes=np.zeros((3, 1)),
        outline_modes=np.zeros((0, 4, 3, 1)),
    )


def pose(box: StandingBox) -> np.ndarray:
    ground, found = cam_from_ground(car.RIG.ground), np.eye(4)
    found[:3, :3] = ground[:3, :3] @ about_up(box.yaw_rad)
    found[:3, 3] = ground[:3, :3] @ np.append(box.xy_m, 0.0) + ground[:3, 3]
    return found


def seen_car(fitted: bool = True, noise_px: float = 0.5) -> SeenCar:
    true = car.disparity_of(BOX)
    seen = np.abs(true - car.disparity_of(NOWHERE)) > 0.05
    around = car.silhouette_of(true, car.disparity_of(NOWHERE))
    measured = car.disparity_of(BOX, noise_px=noise_px)
    shown = ShownCar(7, around, seen, pose(BOX), car.SIZE_M, 30.0)
    fit = None
    if fitted:
        config = DisparityFitConfig(views=car.VIEWS_CONFIG)
        fit = DisparityFit(measured, car.RIG, car.views(), config).fit(around[None])[0]
    texture = np.random.default_rng(0).integers(0, 255, (*true.shape, 3)).astype(np.uint8)
    texture[:, :590] = 128
    return SeenCar(shown, texture, measured, true, car.RIG, fit)


def compared(one: SeenCar) -> ReliefCar:
    views = DepthViewsConfig(coefficients=((0.0,), (1.0,)))
    found = compare_car(one, space(), views, NOISE, np.random.default_rng(0))
    assert found is not None
    return found


@pytest.fixture(scope="module")
def found() -> ReliefCar:
    return compared(seen_car())


def test_all_surfaces_are_compared(found: ReliefCar) -> None:
    assert set(found.ratio) == set(SURFACES)
    assert found.view is View.THREE_QUARTER
    assert found.distance_m == pytest.approx(np.hypot(np.hypot(2, 11), 1.65))


def test_the_true_shape_beats_the_plane_and_so_does_what_is_near_it(found: ReliefCar) -> None:
    ratio = found.ratio
    assert ratio["true"] > 30
    # nothing is wrong with this matcher, so that a plane adds nothing, and the space holds the shape
    assert ratio["true_tilted"] == pytest.approx(ratio["true"], abs=2)
    assert ratio["space"] == pytest.approx(ratio["true"], rel=0.1)
    assert ratio["fit_shapes"] == pytest.approx(ratio["true"], rel=0.1)
    assert ratio["framed"] > 0.6 * ratio["true"]
    assert ratio["framed_climbed"] >= ratio["framed"] - 0.5
    assert ratio["framed_strict"] <= ratio["framed"]
    assert found.place_error_m < 0.4
    assert found.heading_error_deg < 8


def test_the_matcher_is_judged_where_there_is_texture_and_where_there_is_none() -> None:
    one = seen_car(fitted=False)
    low = np.where(one.textured, one.measured_px, one.measured_px - 3).astype(np.float32)
    low[:, 480:500] = np.nan
    spoilt = compared(replace(one, measured_px=low))
    assert spoilt.textured.bias_px == pytest.approx(0, abs=0.1)
    assert spoilt.textured.low_share < 0.01
    assert spoilt.blank.bias_px == pytest.approx(-3, abs=0.1)
    assert spoilt.blank.low_share > 0.9
    assert spoilt.blank.measured_share < 1
    assert spoilt.textured.measured_share == 1
    assert 0 < spoilt.textured_share < 1
    assert spoilt.ratio["true"] < compared(one).ratio["true"] - 30


def test_a_car_without_a_fit_has_the_other_figures(found: ReliefCar) -> None:
    bare = compared(seen_car(fitted=False))
    assert not any(name.startswith(("framed", "seen")) for name in bare.ratio)
    assert bare.ratio["true"] == pytest.approx(found.ratio["true"])
    assert np.isnan(bare.place_error_m)


def test_a_car_of_which_nothing_is_measured_is_left_out() -> None:
    one = seen_car(fitted=False)
    gone = replace(one, measured_px=np.full_like(one.measured_px, np.nan))
    assert compare_car(gone, space(), DepthViewsConfig(((0.0,),)), NOISE, np.random.default_rng(0)) is None


def test_a_posed_instance_predicts_what_the_fit_does() -> None:
    one = seen_car()
    assert one.fit is not None
    placed = one.fit.framed
    shape = posed_instance(placed, car.space(), car.VIEWS_CONFIG, car.RIG)
    by_maps = placed.explained.disparity_px
    inside = np.isfinite(by_maps)
    predicted = shape.disparity_px(one.fit.samples.uv_px[inside], car.RIG.stereo)
    off = (predicted - by_maps[inside])[np.isfinite(predicted)]
    assert np.isfinite(predicted).mean() > 0.9
    # maps are of the nearest distance and of samples 10 cm apart
    assert np.median(np.abs(off)) < 0.15


def climb_of(one: SeenCar) -> Climb:
    at = sampled(one.car.inner, 600)
    row, column = at.T
    measured = one.measured_px[row, column].astype(float)
    return Climb(at[:, ::-1].astype(float), measured, 0.2, car.RIG.stereo, NOISE)


def test_a_climb_finds_the_pose() -> None:
    one = seen_car(fitted=False)
    true = PosedShape(space(), one.car.cam_from_object, np.zeros(1), car.SIZE_M)
    start = true.moved(np.array([0.3, -0.15, 0.08, 0, 0, 0, 0, 0]))
    found = climb_of(one).climbed(start, POSE_FREE, 0.0)
    off = found.cam_from_object[:3, 3] - true.cam_from_object[:3, 3]
    assert np.linalg.norm(off) < 0.12
    assert found.coefficients == pytest.approx(np.zeros(1))


def test_a_climb_bends_the_shape_and_holds_what_is_held() -> None:
    other = car.disparity_of(BOX, noise_px=0.3, shape=car.space(OTHER_CAB_M))
    one = replace(seen_car(fitted=False), measured_px=other)
    start = PosedShape(space(), one.car.cam_from_object, np.zeros(1), car.SIZE_M)
    found = climb_of(one).climbed(start, NONE_FREE, 1.0)
    assert found.coefficients[0] > 0.6
    assert np.array_equal(found.cam_from_object, start.cam_from_object)
    assert np.array_equal(found.size_m, start.size_m)
    free = climb_of(one).climbed(start, ALL_FREE, 1.0)
    assert not np.array_equal(free.size_m, start.size_m)
