"""Every dial does what it says, and more of it at a larger level."""

import numpy as np
import pytest

from recon.camera import DEFAULT_GROUND, StereoCamera, default_camera
from recon.errors import RescoreError
from rescore.studies.degradations import DIALS, dials_named

SHAPE = (120, 160)


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def pair() -> tuple[np.ndarray, np.ndarray]:
    texture = rng().integers(60, 180, (*SHAPE, 3)).astype(np.uint8)
    return texture, texture.copy()


def disparity() -> np.ndarray:
    ramp = np.repeat(np.linspace(4, 40, SHAPE[0], dtype=np.float32)[:, None], SHAPE[1], axis=1)
    ramp[:10] = np.nan
    return ramp


@pytest.mark.parametrize("name", DIALS)
def test_a_dial_has_one_function_and_no_level_zero(name: str) -> None:
    dial = DIALS[name]
    assert sum(f is not None for f in (dial.pictures, dial.disparity, dial.calibration)) == 1
    assert 0 not in dial.levels
    assert len(set(dial.levels)) == len(dial.levels)


@pytest.mark.parametrize("name", [n for n, d in DIALS.items() if d.pictures])
def test_pictures_are_farther_from_the_truth_at_a_larger_level(name: str) -> None:
    dial = DIALS[name]
    assert dial.pictures
    upward = [level for level in dial.levels if level > 0]
    errors = []
    for level in (min(upward), max(upward)):
        changed = dial.pictures(pair(), level, rng())
        errors.append(
            sum(float(np.abs(a.astype(float) - b).mean()) for a, b in zip(changed, pair(), strict=True))
        )
    assert errors[0] > 0
    # a texture without scale is as wrong after a small shift as after a large one
    assert errors[1] > 0.9 * errors[0]


@pytest.mark.parametrize("name", ["exposure", "vertical", "roll"])
def test_what_concerns_the_right_eye_leaves_the_left(name: str) -> None:
    dial = DIALS[name]
    assert dial.pictures
    np.testing.assert_array_equal(dial.pictures(pair(), 2, rng())[0], pair()[0])


def test_a_vertical_shift_lowers_the_right_picture() -> None:
    dial = DIALS["vertical"]
    assert dial.pictures
    right = dial.pictures(pair(), 4.0, rng())[1]
    np.testing.assert_array_equal(right[4:], pair()[1][:-4])


@pytest.mark.parametrize("share", [0.25, 0.75, 1.0])
def test_holes_have_their_share_and_are_nested(share: float) -> None:
    dial = DIALS["holes"]
    assert dial.disparity
    full = np.full(SHAPE, 9, np.float32)
    holes = np.isnan(dial.disparity(full, share, rng()))
    assert abs(holes.mean() - share) < 0.02
    smaller = np.isnan(dial.disparity(full, share / 2, rng()))
    assert not (smaller & ~holes).any()


@pytest.mark.parametrize("name", ["destroyed", "invented", "exchanged"])
def test_a_destroyed_map_tells_nothing(name: str) -> None:
    dial = DIALS[name]
    assert dial.disparity
    gone = dial.disparity(disparity(), 1.0, rng())
    known = np.isfinite(gone) & np.isfinite(disparity())
    assert known.mean() > 0.5
    assert abs(np.corrcoef(gone[known], disparity()[known])[0, 1]) < 0.5
    half = dial.disparity(disparity(), 0.25, rng())
    same = (half == disparity()) | (np.isnan(half) & np.isnan(disparity()))
    assert 0.5 < same.mean() < 0.95


def test_what_would_be_negative_is_a_hole() -> None:
    dial = DIALS["bias"]
    assert dial.disparity
    moved = dial.disparity(disparity(), -10.0, rng())
    assert np.nanmin(moved) > 0
    np.testing.assert_allclose(moved[-1], disparity()[-1] - 10)


def test_calibration_dials_change_one_thing() -> None:
    camera = StereoCamera(default_camera(160, 120), 0.3)

    def changed(name: str, level: float):
        dial = DIALS[name]
        assert dial.calibration
        return dial.calibration((camera, DEFAULT_GROUND), level)

    assert np.degrees(changed("pitch", 2.0)[1].pitch_rad - DEFAULT_GROUND.pitch_rad) == pytest.approx(2)
    assert changed("height", 20.0)[1].height_m == pytest.approx(1.2 * DEFAULT_GROUND.height_m)
    assert changed("focal", -10.0)[0].left.fx_px == pytest.approx(0.9 * camera.left.fx_px)
    assert changed("baseline", 40.0)[0].baseline_m == pytest.approx(0.42)
    assert changed("baseline", 40.0)[0].left == camera.left
    for name in ("pitch", "height", "focal", "baseline"):
        dial = DIALS[name]
        assert dial.calibration
        assert dial.calibration((None, None), 10.0) == (None, None)


def test_names_and_levels_are_read() -> None:
    assert [d.name for d in dials_named(None, None)] == list(DIALS)
    assert dials_named("noise", "1,2.5")[0].levels == (1.0, 2.5)
    for names, levels in (("fog", None), ("", None), ("noise,blur", "1"), ("noise", "0"), ("noise", "much")):
        with pytest.raises(RescoreError, match="expected"):
            dials_named(names, levels)
