"""The compiled loops say what the same arithmetic on whole arrays says."""

import numpy as np
import pytest

from recon.camera import GroundedStereo, GroundPlane
from recon.localization.box_samples import BoxSamples, box_samples
from recon.localization.depth_views import DepthViews
from recon.localization.disparity_fit import DisparityFitConfig
from recon.localization.poses import PoseLikelihood, Poses
from recon.localization.standing_box import StandingBox
from tests.recon.localization import stepped_car as car
from tests.recon.localization.array_poses import explained, silhouette_boxes

CONFIG = DisparityFitConfig(views=car.VIEWS_CONFIG)
LEANING = GroundedStereo(car.RIG.stereo, GroundPlane(1.65, 0.02, np.radians(3)))
BOXES = np.array([[500.0, 160.0, 760.0, 300.0], [60.0, 150.0, 300.0, 330.0]])


@pytest.fixture(scope="module")
def views() -> DepthViews:
    return car.views()


def samples(rig: GroundedStereo) -> tuple[BoxSamples, ...]:
    disparity = car.disparity_of(StandingBox(np.array([0.3, 11.0]), 0.7, car.SIZE_M), rig, noise_px=0.3)
    disparity[200:230, 560:600] = np.nan
    return box_samples(disparity, BOXES, rig, CONFIG.noise, CONFIG.grid)


def some_poses(views: DepthViews, count: int = 600) -> Poses:
    """Poses all over and far beside the boxes, some of them half behind the camera."""
    rng = np.random.default_rng(0)
    low, high = [1.0, -0.8, -7.0, -0.2], [40.0, 0.6, 7.0, 0.2]
    return Poses(rng.uniform(low, high, (count, 4)), rng.integers(0, len(views.size_m), count))


@pytest.mark.parametrize("rig", [car.RIG, LEANING], ids=["level", "leaning"])
@pytest.mark.parametrize(("step", "fine"), [(1, False), (3, False), (1, True)])
def test_sums_and_boxes(views: DepthViews, rig: GroundedStereo, step: int, fine: bool) -> None:
    poses, of = some_poses(views), samples(rig)
    owner = np.arange(len(poses)) % 2
    boxes, ratio = PoseLikelihood(views, of, CONFIG.noise, CONFIG.surface).scan(poses, owner, step, fine=fine)
    np.testing.assert_allclose(boxes, silhouette_boxes(poses, views, rig.left), atol=1e-6)
    for b in range(2):
        rows = owner == b
        logs, _ = explained(poses[rows], views, of[b], CONFIG.noise, CONFIG.surface, step, fine)
        expected = step**2 * logs.sum(axis=1)
        # a ray between two samples of a map may be rounded to either
        off = np.abs(ratio[rows] - expected)
        assert np.quantile(off, 0.95) < 0.01
        assert off.max() < 0.02 * np.abs(expected).max()
    assert np.abs(ratio).max() > 100


def test_each_sample(views: DepthViews) -> None:
    of = samples(car.RIG)
    pose = Poses(np.array([[11.0, 0.03, 0.75, 0.02]]), np.zeros(1, np.int64))
    found = PoseLikelihood(views, of, CONFIG.noise, CONFIG.surface).explained(pose, 0)
    logs, predicted = explained(pose, views, of[0], CONFIG.noise, CONFIG.surface, 1, True)
    on = np.isfinite(predicted)
    assert 50 < on.sum() < on.size
    np.testing.assert_array_equal(np.isfinite(found.disparity_px).ravel(), on[0])
    np.testing.assert_allclose(found.disparity_px.ravel(), predicted[0], rtol=1e-4, equal_nan=True)
    np.testing.assert_allclose(found.log_ratio.ravel(), logs[0], atol=2e-3)
    unknown = ~of[0].known
    assert unknown.any()
    assert np.isnan(found.residual[unknown]).all()
    assert (found.log_ratio[unknown] == 0).all()
