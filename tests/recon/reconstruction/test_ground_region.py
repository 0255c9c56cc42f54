"""The ground region: what lies below points in closed form, the classifier's file, and a drawn street."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.camera import GroundPlane, PinholeCamera
from recon.errors import RescoreError
from recon.reconstruction.ground_region import (
    FEATURES,
    PACKAGED,
    GroundPixels,
    ground_below,
    ground_features,
    ground_probability,
    packaged_ground_pixels,
    touching_points,
)


def street(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A sky, a wall with windows, a grey road, a red box on it; and which pixels show road."""
    rng = np.random.default_rng(seed)
    rgb = np.zeros((240, 320, 3))
    rgb[:60] = (150, 180, 220)
    rgb[60:130] = (170, 120, 90)
    for x in range(10, 320, 40):
        rgb[75:105, x : x + 18] = (60, 70, 90)
    rgb[130:] = (95, 95, 98)
    rgb[110:170, 120:200] = (170, 30, 30)
    road = np.zeros((240, 320), bool)
    road[130:] = True
    road[130:170, 120:200] = False
    noisy = rgb + rng.normal(0, 6, rgb.shape)
    return np.clip(cv2.GaussianBlur(noisy, (0, 0), 0.7), 0, 255).astype(np.uint8), road


def test_horizon_row() -> None:
    camera = PinholeCamera(700.0, 700.0, 320.0, 240.0, 641, 481)
    ground = GroundPlane(1.5, np.deg2rad(10))
    row = ground.horizon_row_px(camera)
    # looking down puts the horizon up: 240 - 700 tan 10 = 116.57
    assert row == pytest.approx(116.57, abs=0.01)
    # the ground is seen below that row and not above
    seen = ground.intersect(camera.rays(np.array([[10.0, row + 0.1], [600.0, row - 0.1]])))
    assert np.isfinite(seen[0]).all()
    assert np.isnan(seen[1]).all()


def test_strip_below_points() -> None:
    region = np.zeros((20, 10), np.float32)
    region[12:, :5] = 1.0
    points = np.array([[2.0, 11.5], [2.0, 9.5], [7.0, 11.5], [2.4, 18.5], [2.0, 19.5], [30.0, 11.5]])
    # rows 12 to 15; rows 10 to 13, two of them ground; none; row 19 alone; none left; beside the picture
    np.testing.assert_array_equal(ground_below(points, region, 4.0), [1.0, 0.5, 0.0, 1.0, np.nan, np.nan])
    # a point on a pixel's centre has that pixel behind it, not below
    np.testing.assert_array_equal(ground_below(np.array([[0.0, 11.0]]), region, 1.0), [1.0])


def test_touching_points_of_a_box() -> None:
    region = np.zeros((40, 40), np.float32)
    region[21:, :16] = 1.0
    box = np.array([[10.0, 5.0], [29.0, 5.0], [29.0, 20.0], [10.0, 20.0]])
    points = touching_points(box, region)
    # the lower edge over columns 10 to 15, where ground lies below it
    np.testing.assert_array_equal(np.round(points[:, 0]), np.arange(10, 16))
    np.testing.assert_array_equal(points[:, 1], 20.0)
    for shifted in (box[::-1], np.roll(box, 1, axis=0)):
        np.testing.assert_array_equal(np.round(touching_points(shifted, region)), np.round(points))
    assert touching_points(box, np.zeros_like(region)).shape == (0, 2)


def test_touching_points_are_those_of_the_wheels() -> None:
    region = np.zeros((60, 60), np.float32)
    region[41:] = 1.0
    # a body down to row 30 on two feet down to row 40: below the body's middle lies something else
    outline = [(5, 10), (55, 10), (55, 40), (45, 40), (45, 30), (15, 30), (15, 40), (5, 40)]
    columns = np.round(touching_points(np.array(outline, float), region)[:, 0])
    np.testing.assert_array_equal(columns, [*range(5, 16), *range(45, 56)])


def test_features_are_finite_and_know_the_horizon() -> None:
    rgb, _ = street()
    features = ground_features(rgb)
    assert features.shape == (120, 160, FEATURES)
    assert np.isfinite(features).all()
    # without a camera the horizon is in the middle, between rows 119 and 120
    np.testing.assert_array_equal(features, ground_features(rgb, 119.5))
    assert not np.array_equal(features, ground_features(rgb, 80.0))
    assert np.isfinite(ground_features(np.zeros((50, 30, 3), np.uint8))).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drawn_street(seed: int) -> None:
    rgb, road = street(seed)
    found = ground_probability(rgb)
    assert found.shape == road.shape
    assert found.dtype == np.float32
    assert found.min() >= 0
    assert found.max() <= 1
    # all below the horizon gets 0.917: it takes the foot of the wall and the lower part of the box for road
    assert ((found >= 0.5) == road).mean() > 0.93
    assert (found[115:165, 125:195] >= 0.5).mean() < 0.2
    np.testing.assert_array_equal(found, ground_probability(rgb))


def test_mirrored_pictures_give_mirrored_regions() -> None:
    rgb, _ = street()
    both = ground_probability(rgb), ground_probability(np.ascontiguousarray(rgb[:, ::-1]))[:, ::-1]
    np.testing.assert_allclose(*both, atol=0.02)


def test_probability_is_the_network_written_out() -> None:
    network = packaged_ground_pixels()
    x = np.random.default_rng(0).normal(0, 3, (50, FEATURES)).astype(np.float32)
    found = network.probability(x)
    for row, p in zip(x.astype(float), found, strict=True):
        layer = np.clip(row, network.low, network.high)
        for weight, bias in zip(network.weights, network.biases, strict=True):
            odds = weight.T.astype(float) @ layer + bias
            layer = np.where(odds > 0, odds, 0)
        assert p == pytest.approx(1 / (1 + np.exp(-np.clip(odds[0], -30, 30))), abs=1e-4)


def test_file_and_its_faults(tmp_path: Path) -> None:
    network, path = packaged_ground_pixels(), tmp_path / "ground.npz"
    network.save(path)
    assert path.read_bytes() == PACKAGED.read_bytes()
    assert len(path.read_bytes()) < 200_000
    back = GroundPixels.load(path)
    np.testing.assert_array_equal(back.weights[1], network.weights[1])
    with pytest.raises(RescoreError, match="found no file; run `rescore learn-ground`"):
        GroundPixels.load(tmp_path / "none.npz")
    path.write_bytes(b"PK nonsense")
    with pytest.raises(RescoreError, match="could not read it"):
        GroundPixels.load(path)
    np.savez(path, format=np.array("ground-pixels 0"))
    with pytest.raises(RescoreError, match="format ground-pixels 0"):
        GroundPixels.load(path)
    np.savez(path, format=np.array({"a": 1}, dtype=object))
    with pytest.raises(RescoreError, match="allow_pickle=False"):
        GroundPixels.load(path)
    with pytest.raises(ValueError, match="ground pixels: weights"):
        replace(network, low=network.low[1:])
