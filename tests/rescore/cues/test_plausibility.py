"""Measurements that contradict each other or the ground are found out."""

import numpy as np
import pytest

from recon.camera import GroundedStereo, GroundPlane, StereoCamera, default_camera
from rescore.cues.plausibility import CHECKS, PlausibilityConfig, plausibility
from rescore.evidence.cues import CUES, cue_column
from rescore.evidence.fit_model import EvidenceConfig, fit_evidence
from rescore.evidence.registration import Registration

CAMERA = StereoCamera(default_camera(640, 480), 0.35)
GROUND = GroundPlane(1.5, np.radians(2))
BOXES = np.array([[100.0, 200, 300, 300], [350, 250, 600, 340]])
CONFIG = PlausibilityConfig()


def street() -> np.ndarray:
    """Disparity of bare ground before a wall at 30 m."""
    left = CAMERA.left
    v, u = np.mgrid[:480, :640].astype(float)
    depth = GROUND.intersect(left.rays(np.stack([u, v], axis=-1)))[..., 2]
    depth = np.where(np.isfinite(depth), np.minimum(depth, 30.0), 30.0)
    return CAMERA.disparity_px(depth)


def checks(disparity: np.ndarray, ground: GroundPlane | None = GROUND) -> np.ndarray:
    seen_from = None if ground is None else GroundedStereo(CAMERA, ground)
    return plausibility(disparity, BOXES, seen_from, CONFIG)


def test_a_street_is_believed() -> None:
    np.testing.assert_allclose(checks(street()), 1.0)


def test_noise_agrees_with_nothing() -> None:
    noise = np.random.default_rng(0).uniform(1, 64, (480, 640)).astype(np.float32)
    assert (checks(noise) < 0.3).all()


def test_noise_of_a_working_matcher_is_allowed() -> None:
    wobble = np.random.default_rng(0).uniform(-0.4, 0.4, (480, 640)).astype(np.float32)
    assert (checks(street() + wobble) > 0.95).all()


@pytest.mark.parametrize(("degrees", "least", "most"), [(1, 0.7, 1.0), (4, 0.0, 0.2)])
def test_a_ground_plane_may_be_a_little_wrong_and_no_more(degrees: float, least: float, most: float) -> None:
    wrong = GroundPlane(GROUND.height_m, GROUND.pitch_rad + np.radians(degrees))
    agreement, on_ground = checks(street(), wrong).T
    np.testing.assert_allclose(agreement, 1.0)
    assert (least <= on_ground).all()
    assert (on_ground <= most).all()


def test_what_cannot_be_checked_is_nan() -> None:
    empty = np.full((480, 640), np.nan, np.float32)
    assert np.isnan(checks(empty)).all()
    assert np.isnan(checks(street(), None)[:, 1]).all()
    assert np.isfinite(checks(street(), None)[:, 0]).all()


def test_a_box_beyond_the_picture_is_cut() -> None:
    outside = np.array([[-50.0, 200, 60, 900], [700, 10, 800, 50]])
    agreement = plausibility(street(), outside, GroundedStereo(CAMERA, GROUND), CONFIG)[:, 0]
    assert agreement[0] == pytest.approx(1.0)
    assert np.isnan(agreement[1])


def fitted_cues(n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    is_car = rng.random(n) < 0.3
    cues = rng.normal(0, 1, (n, len(CUES)))
    cues[:, cue_column("width")] += 2 * is_car
    for name in ("measured", *CHECKS):
        cues[:, cue_column(name)] = rng.uniform(0.6, 1.0, n)
    return cues, is_car


@pytest.mark.parametrize("check", ["measured", *CHECKS])
def test_a_candidate_that_fails_a_check_has_no_evidence(check: str) -> None:
    cues, is_car = fitted_cues()
    model = fit_evidence(cues, is_car, Registration.METRIC, EvidenceConfig())
    d = model.difference(cues)
    # the floor lets all but one in a hundred pass, for each of three checks
    assert 0.95 < np.isfinite(d).mean() < 1.0
    spoilt = cues.copy()
    spoilt[:, cue_column(check)] = 0.3
    assert np.isnan(model.difference(spoilt)).all()
    unknown = cues[np.isfinite(d)]
    unknown[:, cue_column(check)] = np.nan
    assert np.isfinite(model.difference(unknown)).all()


def test_checks_are_no_evidence() -> None:
    cues, is_car = fitted_cues()
    for name in CHECKS:
        cues[:, cue_column(name)] = np.where(is_car, 1.0, 0.9)
    for mode in (Registration.GUARDED, Registration.METRIC):
        model = fit_evidence(cues, is_car, mode, EvidenceConfig())
        assert not set(CHECKS) & set(model.knots)
        assert (model.contributions(cues)[:, [cue_column(n) for n in CHECKS]] == 0).all()


def test_left_out_cues_say_nothing() -> None:
    cues, is_car = fitted_cues()
    whole = fit_evidence(cues, is_car, Registration.METRIC, EvidenceConfig())
    without = fit_evidence(cues, is_car, Registration.METRIC, EvidenceConfig(), ("width",))
    assert set(whole.knots) - set(without.knots) == {"width"}

    def gap(model) -> float:
        d = model.difference(cues)
        return float(np.nanmean(d[~is_car]) - np.nanmean(d[is_car]))

    # width alone tells cars here
    assert gap(whole) > 0.3 > gap(without)
