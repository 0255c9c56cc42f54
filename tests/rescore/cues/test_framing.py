"""The cues of framing: a whole car, a part of one, two of them, a wall, and one at the picture's edge."""

import numpy as np
import pytest

from recon.arrays import FloatArray
from recon.localization.depth_views import DepthViews
from recon.localization.disparity_fit import DisparityFit, DisparityFitConfig
from recon.localization.standing_box import StandingBox
from rescore.cues.framing import FRAMING, FramingConfig, framing, resolved
from tests.recon.localization import stepped_car as car

CONFIG = DisparityFitConfig(views=car.VIEWS_CONFIG)
NOWHERE = StandingBox(np.array([0.0, 400.0]), 0.0, car.SIZE_M)
PICTURE = (1242, 375)


@pytest.fixture(scope="module")
def views() -> DepthViews:
    return car.views()


def car_at(x_m: float, y_m: float, yaw_deg: float) -> StandingBox:
    return StandingBox(np.array([x_m, y_m]), np.radians(yaw_deg), car.SIZE_M)


def around(box: StandingBox) -> FloatArray:
    return car.silhouette_of(car.disparity_of(box), car.disparity_of(NOWHERE))


def cues(disparity: np.ndarray, box: FloatArray, views: DepthViews) -> dict[str, float]:
    fit = DisparityFit(disparity, car.RIG, views, CONFIG).fit(box[None])[0]
    assert fit is not None
    return dict(zip(FRAMING, framing([fit], box[None], PICTURE, FramingConfig())[0].tolist(), strict=True))


def test_a_whole_car(views: DepthViews) -> None:
    box = car_at(-2.0, 12.0, 50.0)
    found = cues(car.disparity_of(box, noise_px=0.3), around(box), views)
    assert found["overlap"] > 0.75
    assert found["framed_overlap"] > 0.85
    for end in ("end_left", "end_top", "end_right", "end_bottom"):
        assert found[end] == pytest.approx(0, abs=0.06)
    assert found["gap"] == pytest.approx(0, abs=0.02)
    # all but the noise of what an exact car attains
    assert 0.85 < found["explained"] < 1
    assert found["seen_explained"] == pytest.approx(found["explained"], abs=0.05)
    # a corner of a car is no plane
    assert found["over_plane"] > np.log1p(30)
    assert found["seen_through"] < 0.05
    assert found["hidden"] < 0.05
    assert found["beyond_box"] < 0.05
    assert found["goes_on_beside"] == pytest.approx(0, abs=0.2) or np.isnan(found["goes_on_beside"])


def test_the_left_half_of_a_car_ends_within_it(views: DepthViews) -> None:
    box = car_at(-1.0, 12.0, 15.0)
    half = around(box)
    half[2] = half[[0, 2]].mean()
    found = cues(car.disparity_of(box, noise_px=0.3), half, views)
    # the other half of the car is as wide as the box
    assert found["end_right"] == pytest.approx(1.0, abs=0.2)
    assert found["end_left"] == pytest.approx(0, abs=0.15)
    assert found["overlap"] < 0.6
    assert found["beyond_box"] > 0.3


def test_two_cars_in_one_box(views: DepthViews) -> None:
    one, two = car_at(-2.6, 12.0, 90.0), car_at(0.4, 16.0, 90.0)
    a, b = around(one), around(two)
    both = np.concatenate([np.minimum(a, b)[:2], np.maximum(a, b)[2:]])
    disparity = np.fmax(car.disparity_of(one, noise_px=0.3), car.disparity_of(two))
    found = cues(disparity, both, views)
    assert found["overlap"] < 0.7
    assert min(found["end_left"], found["end_right"]) < -0.2


def test_a_wall_is_a_plane_that_goes_on(views: DepthViews) -> None:
    box = around(car_at(0.0, 12.0, 0.0))
    found = cues(car.disparity_of(NOWHERE, wall_m=11.0, noise_px=0.3), box, views)
    assert found["over_plane"] < 0
    assert found["goes_on_beside"] > 0.8
    assert found["goes_on_above"] > 0.8


def test_ends_at_the_edge_of_the_picture_are_silent(views: DepthViews) -> None:
    box = car_at(-6.2, 7.0, 100.0)
    edges = around(box)
    found = cues(car.disparity_of(box, noise_px=0.3), edges, views)
    assert edges[0] == 0
    assert np.isnan(found["end_left"])
    assert np.isfinite(found["end_right"])


def test_what_hides_a_car_is_told(views: DepthViews) -> None:
    box = car_at(-2.0, 14.0, 90.0)
    edges = around(box)
    disparity = car.disparity_of(box, noise_px=0.3)
    post = slice(int(edges[0] + 10), int(edges[0] + 40))
    disparity[:, post] = 60.0
    found = cues(disparity, edges, views)
    assert 0.1 < found["hidden"] < 0.5
    assert found["overlap"] > 0.6


def test_a_far_car_is_not_resolved(views: DepthViews) -> None:
    def told(distance: float) -> float:
        box = car_at(0.0, distance, 90.0)
        fit = DisparityFit(car.disparity_of(box), car.RIG, views, CONFIG).fit(around(box)[None])[0]
        assert fit is not None
        return resolved(fit, FramingConfig())

    near, far = told(10.0), told(40.0)
    assert near > 0.9
    # the disparity that its length spans falls with the square of the distance
    assert far / (1 - far) == pytest.approx(near / (1 - near) / 4**4, rel=0.5)
