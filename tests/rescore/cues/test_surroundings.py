"""A thing on a ground plane before a far wall, in closed form: what the cues must say of it."""

import numpy as np
import pytest

from recon.camera import GroundedStereo, GroundPlane, PinholeCamera, StereoCamera
from rescore.cues.surroundings import SURROUNDINGS, SurroundingsConfig, expected_size_m, surroundings

CAMERA = StereoCamera(PinholeCamera(600.0, 600.0, 319.5, 239.5, 640, 480), 0.4)
GROUND = GroundPlane(1.5)
SEEN_FROM = GroundedStereo(CAMERA, GROUND)
CONFIG = SurroundingsConfig()
SIDE_RAD = np.pi / 2
DEPTH_M = 12.0
LENGTH_M, HEIGHT_M = 4.4, 1.5
FOOT_ROW = 239.5 + 600 * 1.5 / DEPTH_M + 0.5


def car_box(depth_m: float = DEPTH_M, size_m: tuple[float, float] = (LENGTH_M, HEIGHT_M)) -> np.ndarray:
    """Box of a thing on the ground in the middle of the picture."""
    width, height = np.array(size_m) * 600 / depth_m
    foot = 240 + 600 * 1.5 / depth_m
    return np.array([[320 - width / 2, foot - height, 320 + width / 2, foot]])


def street(wall_m: float = 40.0) -> np.ndarray:
    """Depth of the ground up to a wall, shape (480, 640)."""
    rows = np.arange(480.0)
    with np.errstate(divide="ignore"):
        ground = np.where(rows > 239.5, 1.5 * 600 / (rows - 239.5), np.inf)
    return np.repeat(np.minimum(ground, wall_m)[:, None], 640, axis=1)


def with_board(depth: np.ndarray, box: np.ndarray, board_m: float) -> np.ndarray:
    """The street with an upright board that fills a box."""
    x0, y0, x1, y1 = np.round(box[0]).astype(int)
    out = depth.copy()
    out[y0:y1, x0:x1] = board_m
    return out


def cues_of(depth: np.ndarray, box: np.ndarray, ground: GroundPlane | None = GROUND) -> dict[str, float]:
    seen_from = CAMERA if ground is None else GroundedStereo(CAMERA, ground)
    found = surroundings(CAMERA.disparity_px(depth), box, np.full(len(box), SIDE_RAD), seen_from, CONFIG)
    assert found.shape == (len(box), len(SURROUNDINGS))
    return dict(zip(SURROUNDINGS, found[0].tolist(), strict=True))


def test_a_thing_of_the_right_size_that_stands_free() -> None:
    box = car_box()
    cues = cues_of(with_board(street(), box, DEPTH_M), box)
    assert cues["width"] == pytest.approx(0, abs=1e-6)
    assert cues["height"] == pytest.approx(0, abs=1e-6)
    assert cues["foot"] == pytest.approx(0, abs=0.03)
    for one in ("compact", "fill_left", "fill_right", "fill_top", "support", "lower", "measured"):
        assert cues[one] == 1, one
    for nothing in ("left", "right", "above", "near"):
        assert cues[nothing] == 0, nothing
    assert cues["behind_above"] == 1
    assert cues["ground_below"] == 1
    assert cues["relief"] == 0


def test_a_picture_on_a_wall_goes_on_beside_and_above() -> None:
    box = car_box()
    # the same box on a wall at the depth of the thing: the size is right, but the wall goes on
    cues = cues_of(street(DEPTH_M), box)
    assert cues["width"] == pytest.approx(0, abs=1e-6)
    for goes_on in ("left", "right", "above"):
        assert cues[goes_on] == 1, goes_on
    assert cues["behind_above"] == 0


@pytest.mark.parametrize("scale", [0.1, 2.5])
def test_size_is_that_of_the_thing_not_of_the_box(scale: float) -> None:
    # a toy near the camera and a building far away fill the same box as a car
    box = car_box()
    cues = cues_of(with_board(street(80.0), box, DEPTH_M * scale), box)
    assert cues["width"] == pytest.approx(np.log(scale), abs=1e-5)
    assert cues["height"] == pytest.approx(np.log(scale), abs=1e-5)
    assert cues["support"] == 0


def test_a_picture_above_the_ground_has_no_foot() -> None:
    box = car_box() - np.array([0, 60.0, 0, 60.0])
    cues = cues_of(with_board(street(), box, DEPTH_M), box)
    # 60 pixels at 12 m
    assert cues["foot"] == pytest.approx(60 / 600 * DEPTH_M, abs=0.03)


def test_what_stands_before_a_car_is_not_taken_for_it() -> None:
    box = car_box()
    depth = with_board(street(), box, DEPTH_M)
    x0, y0, x1, _ = np.round(box[0]).astype(int)
    # half of the car is behind a hedge 4 m from the camera
    depth[y0 + 20 :, x0 : (x0 + x1) // 2 + 30] = 4.0
    cues = cues_of(depth, box)
    assert cues["width"] == pytest.approx(0, abs=1e-6)
    assert 0.3 < cues["near"] < 0.6
    assert cues["support"] < 0.6


def test_holes_and_the_border_of_the_picture_leave_cues_out() -> None:
    box = car_box()
    depth = with_board(street(), box, DEPTH_M)
    cues = cues_of(np.full_like(depth, np.nan), box)
    assert cues["measured"] == 0
    assert all(np.isnan(v) for name, v in cues.items() if name not in ("measured",))
    # left of the picture there is nothing to see
    shifted = box - np.array([box[0, 0] - 2, 0, box[0, 0] - 2, 0])
    cues = cues_of(with_board(street(), shifted, DEPTH_M), shifted)
    assert np.isnan(cues["left"])
    assert cues["right"] == 0


def test_without_a_ground_plane_only_the_ground_is_missing() -> None:
    box = car_box()
    cues = cues_of(with_board(street(), box, DEPTH_M), box, ground=None)
    missing = {name for name, value in cues.items() if np.isnan(value)}
    assert missing == {"foot", "ground_below"}


def test_each_box_is_judged_alone() -> None:
    near, far = car_box(8.0), car_box(20.0)
    depth = with_board(street(), near, 8.0)
    together = surroundings(
        CAMERA.disparity_px(depth), np.concatenate([near, far]), np.full(2, SIDE_RAD), SEEN_FROM, CONFIG
    )
    alone = [
        surroundings(CAMERA.disparity_px(depth), b, np.full(1, SIDE_RAD), SEEN_FROM, CONFIG)
        for b in (near, far)
    ]
    np.testing.assert_array_equal(together, np.concatenate(alone))
    none = surroundings(CAMERA.disparity_px(depth), np.zeros((0, 4)), np.zeros(0), SEEN_FROM, CONFIG)
    assert none.shape == (0, len(SURROUNDINGS))


def test_the_expected_size_turns_with_the_view() -> None:
    wide, high = expected_size_m(np.array([np.pi / 2, 0.0, np.pi / 4, np.nan]), (4.4, 1.75, 1.5))
    np.testing.assert_allclose(wide, [4.4, 1.75, (4.4 + 1.75) / np.sqrt(2), np.nan])
    np.testing.assert_array_equal(high, 1.5)


def test_each_box_is_measured_against_its_own_side() -> None:
    # a car's front fills the box at 12 m; taken for its side it would be far too narrow
    box = car_box(size_m=(1.75, HEIGHT_M))
    disparity = CAMERA.disparity_px(with_board(street(), box, DEPTH_M))
    turned = np.array([0.0, SIDE_RAD, np.nan])
    found = surroundings(disparity, np.repeat(box, 3, axis=0), turned, SEEN_FROM, CONFIG)
    front, side, unknown = (dict(zip(SURROUNDINGS, row.tolist(), strict=True)) for row in found)
    assert front["width"] == pytest.approx(0, abs=1e-6)
    assert side["width"] == pytest.approx(np.log(1.75 / 4.4), abs=1e-6)
    assert (front["support"], side["support"]) == (1, 0)
    # without a side the height alone says which depth the class may have
    assert np.isnan(unknown["width"])
    assert unknown["support"] == 1
    assert unknown["height"] == pytest.approx(0, abs=1e-6)
