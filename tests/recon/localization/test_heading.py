"""The heading of an object, the end that is its front, from how the surface looks."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from recon.arrays import Float32Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.errors import RescoreError
from recon.localization.heading import (
    CUES,
    LOOKS,
    FitLooks,
    Heading,
    HeadingConfig,
    Posed,
    learn_heading,
    neutral_hull,
    read_surface,
    weigh_cues,
)
from recon.localization.standing_box import StandingBox, cam_from_ground
from recon.outlines import fill_polygon
from rescore.files import write_json

CAMERA = PinholeCamera(600.0, 600.0, 399.5, 299.5, 800, 600)
GROUND = GroundPlane(14.5, float(np.deg2rad(35)))
SEEN_FROM = GroundedCamera(CAMERA, GROUND)
REACH = (0.56, 0.68, 1.08)
SIZE_M = np.array([4.4, 1.8, 1.5])
CONFIG = HeadingConfig()


def box_hull() -> Float32Array:
    """Signed distance to the sides of a box in metres, roughly, on a grid (56, 20, 24)."""
    x = np.abs(np.linspace(-REACH[0], REACH[0], 56)) - 0.5
    y, z = np.linspace(0, REACH[1], 20) - 0.5, np.linspace(0, REACH[2], 24) - 1.0
    x, y, z = x * SIZE_M[0], y * SIZE_M[1], z * SIZE_M[2]
    return np.maximum(np.maximum(x[:, None, None], y[:, None]), z).astype(np.float32)


def photo(box: StandingBox) -> np.ndarray:
    """Linear light of a grey box whose rear third is red, on a dark ground."""
    pose = cam_from_ground(GROUND)
    light = np.full((CAMERA.height_px, CAMERA.width_px, 3), 0.05, np.float32)
    unit = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.5

    def paint(low: float, high: float, colour: tuple[float, float, float]) -> None:
        c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
        corners = np.concatenate([unit, unit + np.array([0, 0, 1])]) * box.size_m
        corners[:, 0] = np.where(corners[:, 0] < 0, low, high) * box.size_m[0]
        xy = corners[:, :2] @ np.array([[c, s], [-s, c]]) + box.xy_m
        uv = CAMERA.project(np.insert(xy, 2, corners[:, 2], axis=1) @ pose[:3, :3].T + pose[:3, 3])
        for face in ([0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]):
            light[fill_polygon(uv[face], CAMERA.height_px, CAMERA.width_px)] = colour

    # the farther third first
    parts = [(-0.5, -0.17, (0.5, 0.05, 0.05)), (-0.17, 0.5, (0.4, 0.4, 0.4))]
    for low, high, colour in parts if np.sin(box.yaw_rad) < 0 else parts[::-1]:
        paint(low, high, colour)
    return light


def looks(yaw_deg: float, taken_deg: float, cost: float = 25.0, agreement: float = 0.3) -> FitLooks:
    """A fit of one direction to a box of another."""
    box = StandingBox(np.array([0.4, 20.0]), float(np.deg2rad(yaw_deg)), SIZE_M)
    taken = StandingBox(box.xy_m, float(np.deg2rad(taken_deg)), SIZE_M)
    read = read_surface(photo(box), Posed(box_hull(), REACH, taken), SEEN_FROM, CONFIG)
    return FitLooks(read, cost, agreement)


def pair(yaw_deg: float, **turned: float) -> tuple[FitLooks, FitLooks]:
    """A right fit and the one turned round."""
    return looks(yaw_deg, yaw_deg), looks(yaw_deg, yaw_deg + 180, **turned)


@cache
def learned() -> Heading:
    readings = [looks(y, y).reading for y in (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0)]
    return learn_heading(readings, CONFIG)


@pytest.mark.parametrize("yaw_deg", [25.0, 70.0, 110.0, -20.0, -75.0, 200.0])
def test_the_nose_is_found_at_the_end_that_looks_like_one(yaw_deg: float) -> None:
    right, wrong = pair(yaw_deg)
    odds = learned().odds(right, wrong)
    # the red third is a lamp, and it is not the colour of the rest
    assert odds.cues["lamps"] > 0.5
    assert odds.cues["windows"] > 0
    assert odds.log_odds == pytest.approx(sum(odds.cues.values()))
    assert odds.probability > 0.6
    # the same question asked the other way round
    assert learned().odds(wrong, right).log_odds == pytest.approx(-odds.log_odds)
    assert odds.reversed.probability == pytest.approx(1 - odds.probability)


def test_what_looks_alike_at_both_ends_tells_nothing() -> None:
    box = StandingBox(np.array([0.4, 20.0]), 0.7, SIZE_M)
    plain = np.full((CAMERA.height_px, CAMERA.width_px, 3), 0.4, np.float32)
    same = FitLooks(read_surface(plain, Posed(box_hull(), REACH, box), SEEN_FROM, CONFIG), 25.0, 0.3)
    assert learned().odds(same, same).log_odds == pytest.approx(0, abs=1e-6)


def test_a_colour_of_its_own_is_told_whether_it_is_light_or_dark() -> None:
    """Glass is darker than a white car and lighter than a black one."""
    box = StandingBox(np.array([0.4, 20.0]), 0.4, SIZE_M)
    both = []
    for paint, glass in ((0.5, 0.05), (0.05, 0.5)):
        light = np.full((CAMERA.height_px, CAMERA.width_px, 3), paint, np.float32)
        light[:, : CAMERA.width_px // 2] = glass
        both.append(read_surface(light, Posed(box_hull(), REACH, box), SEEN_FROM, CONFIG))
    (_, lightness, other), (_, reverse, as_far) = both
    told = np.abs(lightness) > 0.1
    assert told.any()
    assert (np.sign(lightness[told]) == -np.sign(reverse[told])).all()
    assert (other[told] > 0.1).all()
    assert (as_far[told] > 0.1).all()


def test_cues_are_weighed_by_fits_and_one_that_misleads_is_dropped() -> None:
    pairs = [pair(y, cost=50.0, agreement=0.5) for y in (20.0, 100.0, 160.0, 290.0)]
    heading = weigh_cues(learned(), pairs)
    outline, borders = heading.fits
    assert outline > 0.1
    # the borders of the wrong fits agree better in all of these
    assert borders == 0
    odds = heading.odds(*pairs[0])
    assert tuple(odds.cues) == CUES
    assert odds.cues["outline"] == pytest.approx(outline * np.tanh(np.log(2) / CONFIG.outline))
    # a shape that is none of the class costs much both ways: the ratio counts
    right, wrong = (FitLooks(f.reading, 40 * f.cost, f.agreement) for f in pairs[0])
    assert heading.odds(right, wrong).cues["outline"] == pytest.approx(odds.cues["outline"])


def test_a_cue_of_small_numbers_weighs_as_much_as_one_of_large_numbers() -> None:
    """A correlation that is right every time, by hundredths or by tenths."""
    said = []
    for step in (0.02, 0.2):
        pairs = [pair(y, cost=25.0 + y / 10, agreement=0.3 - step) for y in (20.0, 100.0, 160.0, 290.0)]
        said.append(weigh_cues(learned(), pairs).odds(*pairs[0]).cues["borders"])
    assert said[0] > 0.1
    assert said[0] == pytest.approx(said[1], rel=1e-3)


def test_the_neutral_shape_is_alike_at_both_ends() -> None:
    hull = box_hull().copy()
    hull[40:, :, 12:] += 0.5  # a low nose
    neutral = neutral_hull(hull)
    assert np.array_equal(neutral, neutral[::-1])
    # read off it, a plain picture says nothing whichever way it is taken
    plain = np.full((CAMERA.height_px, CAMERA.width_px, 3), 0.4, np.float32)
    box = StandingBox(np.array([0.4, 20.0]), 0.7, SIZE_M)
    same = FitLooks(read_surface(plain, Posed(neutral, REACH, box), SEEN_FROM, CONFIG), 25.0, 0.3)
    assert learned().odds(same, same).log_odds == pytest.approx(0, abs=1e-6)


def test_no_cue_of_the_looks_is_surer_than_its_doubt() -> None:
    sure = Heading(1000 * learned().cells, CONFIG)
    odds = sure.odds(*pair(70.0))
    most = np.log((1 - CONFIG.doubt) / CONFIG.doubt)
    assert odds.cues["lamps"] == pytest.approx(most)
    assert max(abs(odds.cues[cue]) for cue in LOOKS) <= most + 1e-9


def test_a_heading_comes_back_from_its_file(tmp_path: Path) -> None:
    heading = weigh_cues(learned(), [pair(20.0, cost=50.0)])
    write_json(tmp_path / "heading.json", heading.as_json)
    back = Heading.load(tmp_path / "heading.json")
    assert np.array_equal(back.cells, heading.cells)
    assert (back.config, back.looks, back.fits) == (heading.config, heading.looks, heading.fits)
    (tmp_path / "heading.json").write_text('{"config": {}, "cells": [1], "looks": 1, "fits": [0, 0]}')
    with pytest.raises(RescoreError, match=r"heading\.json: expected what front and rear look like"):
        Heading.load(tmp_path / "heading.json")
