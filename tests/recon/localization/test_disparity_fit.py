"""An instance fitted to a box and disparity stands where the car stands, whatever the box frames."""

import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.camera import GroundedStereo, GroundPlane
from recon.localization.depth_views import DepthViews, render_depth_views
from recon.localization.disparity_fit import BoxFit, DisparityFit, DisparityFitConfig
from recon.localization.standing_box import StandingBox
from tests.recon.localization import stepped_car as car

CONFIG = DisparityFitConfig(views=car.VIEWS_CONFIG)


@pytest.fixture(scope="module")
def views() -> DepthViews:
    return car.views()


def scene(
    x_m: float, y_m: float, yaw_deg: float, seen_from: GroundedStereo = car.RIG
) -> tuple[np.ndarray, FloatArray, StandingBox]:
    """Disparity, the box around the car, and where it stands."""
    box = StandingBox(np.array([x_m, y_m]), np.radians(yaw_deg), car.SIZE_M)
    clean = car.disparity_of(box, seen_from)
    gone = StandingBox(np.array([0.0, 400.0]), 0.0, car.SIZE_M)
    around = car.silhouette_of(clean, car.disparity_of(gone, seen_from))
    return car.disparity_of(box, seen_from, noise_px=0.3), around, box


def fitted(
    disparity: np.ndarray, box: FloatArray, views: DepthViews, rig: GroundedStereo = car.RIG
) -> BoxFit:
    found = DisparityFit(disparity, rig, views, CONFIG).fit(box[None])[0]
    assert found is not None
    return found


def turned_deg(a: StandingBox, b: StandingBox) -> float:
    return float(abs((np.degrees(a.yaw_rad - b.yaw_rad) + 180) % 360 - 180))


@pytest.mark.parametrize("yaw_deg", [0.0, 50.0, 90.0, 130.0, 180.0, 235.0, 270.0])
def test_place_and_heading_are_found(yaw_deg: float, views: DepthViews) -> None:
    disparity, around, true = scene(-2.0, 12.0, yaw_deg)
    found = fitted(disparity, around, views)
    for placed in (found.framed, found.seen):
        assert np.linalg.norm(placed.box.xy_m - true.xy_m) < 0.35
        assert turned_deg(placed.box, true) < 8
    assert found.overlap > 0.75


def test_a_camera_that_leans(views: DepthViews) -> None:
    rig = GroundedStereo(car.RIG.stereo, GroundPlane(1.65, 0.01, np.radians(3)))
    disparity, around, true = scene(4.0, 14.0, 60.0, rig)
    found = fitted(disparity, around, views, rig)
    assert np.linalg.norm(found.seen.box.xy_m - true.xy_m) < 0.35
    assert turned_deg(found.seen.box, true) < 8


def test_a_box_on_half_a_car_tears_framed_and_seen_apart(views: DepthViews) -> None:
    disparity, around, true = scene(-1.0, 12.0, 15.0)
    half = around.copy()
    half[2] = (around[0] + around[2]) / 2
    whole, part = fitted(disparity, around, views), fitted(disparity, half, views)
    assert np.linalg.norm(part.seen.box.xy_m - true.xy_m) < 0.5
    assert part.overlap < 0.65 < whole.overlap
    # a car that fills half the box is half as large, and explains less
    assert part.seen.total - part.framed.total > 20
    assert whole.seen.total - whole.framed.total < 20


def test_looks_decide_which_end_is_the_nose() -> None:
    # a car with its cab in the middle has no nose in depth
    shape = car.space(cab_m=(-1.1, 1.1))
    views = render_depth_views(shape, 1.65, car.VIEWS_CONFIG)
    box = StandingBox(np.array([0.0, 14.0]), 0.4, car.SIZE_M)
    nowhere = StandingBox(np.array([0.0, 400.0]), 0.0, car.SIZE_M)
    clean = car.disparity_of(box, shape=shape)
    around = car.silhouette_of(clean, car.disparity_of(nowhere))
    disparity = car.disparity_of(box, noise_px=0.3, shape=shape)
    turn = 2 * np.pi * np.arange(12) / 12
    for nose_rad in (0.4, 0.4 + np.pi):
        looks = 2.0 * np.cos(turn - nose_rad)
        found = DisparityFit(disparity, car.RIG, views, CONFIG).fit(around[None], looks[None])[0]
        assert found is not None
        off = found.framed.box.yaw_rad - nose_rad
        assert np.degrees(abs(np.angle(np.exp(1j * off)))) < 10


def test_nothing_measured_finds_nothing(views: DepthViews) -> None:
    disparity = np.full((375, 1242), np.nan, np.float32)
    box = np.array([400.0, 160.0, 500.0, 220.0])
    assert DisparityFit(disparity, car.RIG, views, CONFIG).fit(box[None])[0] is None


def test_the_same_twice(views: DepthViews) -> None:
    disparity, around, _ = scene(3.0, 15.0, 200.0)
    one, two = fitted(disparity, around, views), fitted(disparity, around, views)
    np.testing.assert_array_equal(one.seen.pose.place, two.seen.pose.place)
    assert one.overlap == two.overlap


def test_a_car_cut_by_the_edge_of_the_picture_fits_what_is_seen(views: DepthViews) -> None:
    disparity, around, true = scene(-6.2, 7.0, 100.0)
    assert around[0] == 0
    found = fitted(disparity, around, views)
    assert np.linalg.norm(found.framed.box.xy_m - true.xy_m) < 0.6
    assert found.framed.silhouette_px[0] == 0


def test_boxes_beside_each_other_change_nothing(views: DepthViews) -> None:
    disparity, around, _ = scene(-2.0, 12.0, 50.0)
    half = around.copy()
    half[2] = (around[0] + around[2]) / 2
    nowhere = np.array([900.0, 10.0, 960.0, 40.0])
    fit = DisparityFit(disparity, car.RIG, views, CONFIG)
    together = fit.fit(np.stack([around, nowhere, half]))
    for box, found in zip((around, nowhere, half), together, strict=True):
        (alone,) = fit.fit(box[None])
        assert (alone is None) == (found is None)
        if alone is not None and found is not None:
            np.testing.assert_array_equal(found.framed.pose.place, alone.framed.pose.place)
            np.testing.assert_array_equal(found.seen.pose.place, alone.seen.pose.place)
            np.testing.assert_array_equal(found.heading_log_mass, alone.heading_log_mass)
            assert found.overlap == alone.overlap
    assert fit.fit(np.zeros((0, 4))) == ()
