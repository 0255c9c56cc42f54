import numpy as np
import pytest

from recon.depth_map import DepthMap
from rescore.evidence.align_depth import measured_pixels
from rescore.evidence.guarded import GuardedAlignment, GuardedConfig, guarded_alignment

BOX = np.array([0.0, 0.0, 60.0, 40.0])
CONFIG = GuardedConfig()


def bulge() -> np.ndarray:
    """Predicted depth of something that is nearer in the middle: 9 to 11 m."""
    u = np.linspace(-1, 1, 60)
    return np.tile(9 + 2 * u**2, (40, 1))


def fitted(
    predicted: np.ndarray, measured_depth: np.ndarray, config: GuardedConfig = CONFIG
) -> GuardedAlignment:
    found = in_box(predicted, 200 / measured_depth, BOX, config)
    assert found is not None
    return found


def in_box(
    predicted: np.ndarray, disparity: np.ndarray, box: np.ndarray, config: GuardedConfig = CONFIG
) -> GuardedAlignment | None:
    """The alignment over the measured pixels of a box."""
    depth, disparity = DepthMap(0, 0, predicted.astype(np.float32)), disparity.astype(np.float32)
    use = measured_pixels(depth, disparity, box)
    return guarded_alignment(depth.depth.take(use), disparity.take(use), config)


def test_the_predicted_relief_fits_at_any_unit_of_depth() -> None:
    for unit in (1.0, 3.0):
        fit = fitted(bulge(), unit * bulge())
        # the grid of scales holds 0.3 ... 3 in 15 steps; the middle one is 0.95
        assert abs(fit.scale) < 0.1
        assert fit.residual < 0.005
        assert fit.gain > 0.7
        # inverse depth from 1/11 to 1/9 around a disparity of 20 / unit px: a fraction of that varies
        assert 0.8 < fit.predicted_px * unit < 1.4


def test_a_flat_wall_has_nothing_to_win() -> None:
    fit = fitted(bulge(), np.full((40, 60), 10.0))
    # the smallest scale allowed, and still worse than the flat surface
    assert fit.scale == pytest.approx(np.log(CONFIG.scale_limits[0]))
    assert fit.residual > 0.01
    assert fit.gain < 0
    assert fit.roughness == 0


def test_a_hollow_does_not_fit_with_a_negative_scale() -> None:
    fit = fitted(bulge(), 20 - bulge())
    assert fit.gain < 0


def test_background_in_the_box_changes_little() -> None:
    rng = np.random.default_rng(0)
    measured = bulge()
    measured[rng.random(measured.shape) < 0.2] = 40.0
    fit = fitted(bulge(), measured)
    assert abs(fit.scale) < 0.2
    assert fit.gain > 0.1


def test_too_few_measurements_give_nothing() -> None:
    disparity = np.full((40, 60), np.nan, np.float32)
    disparity[0, : CONFIG.min_valid_px - 1] = 20
    assert in_box(bulge(), disparity, BOX) is None
    disparity[0, : CONFIG.min_valid_px] = 20
    assert in_box(bulge(), disparity, BOX) is not None


def test_only_the_box_counts() -> None:
    measured = bulge()
    measured[:, 30:] = 77.0
    half = np.array([0.0, 0.0, 30.0, 40.0])
    inside, whole = (in_box(bulge(), 200 / depth, half) for depth in (measured, bulge()))
    assert inside == whole
