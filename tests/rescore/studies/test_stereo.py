import os
from pathlib import Path

import numpy as np
import pytest

from recon.stereo.sgbm import KITTI_SGBM, SgbmConfig
from reports.publishing.stereo_pairs import lay_out_aloe
from rescore.data.pictures import read_rgb
from rescore.formats.open import read_dataset
from rescore.formats.stereo_truth import TruePair, find_true_scenes
from rescore.studies.stereo import (
    METHODS,
    Method,
    accuracies,
    accuracy,
    added,
    bare_call,
    consistency,
    consistency_of,
    matcher_of,
    n_unlike,
)
from tests.true_pairs import HEIGHT, SHIFT, WIDTH, kitti_2015, noise, scene, untrue

OPENCV_DOC = Path(os.environ.get("OPENCV_DOC", "/usr/share/doc/opencv-doc/examples/data"))


def rough_pair(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A pair with holes, occlusions and colour: two layers of noise."""
    rng = np.random.default_rng(seed)
    far, near = (rng.integers(0, 255, (70, 200, 3), dtype=np.uint8) for _ in range(2))
    left, right = far[:, 6:166].copy(), far[:, 10:170].copy()
    left[20:50, 70:110], right[20:50, 55:95] = near[20:50, :40], near[20:50, :40]
    left[:, 120:140] = right[:, 110:130] = 90
    return left, right


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "config", [SgbmConfig(num_disparities=32), SgbmConfig(num_disparities=16, block_size=3, speckle_window=0)]
)
def test_ours_equals_the_same_call_bit_for_bit(seed: int, config: SgbmConfig):
    left, right = rough_pair(seed)
    ours, same = (METHODS[m](left, right, config) for m in (Method.OURS, Method.SAME_CALL))
    assert ours.dtype == same.dtype == np.float32
    np.testing.assert_array_equal(ours, same)
    assert n_unlike(ours, same) == 0
    assert 0.05 < np.isnan(ours).mean() < 0.9  # there are holes to agree on
    bare = bare_call(left, right, config)
    assert np.isnan(bare[:, : config.num_disparities]).all()
    assert n_unlike(ours, bare) > 0


def test_ours_equals_the_same_call_on_a_kitti_pair(kitti: Path):
    frame = read_dataset(kitti).frames[0]
    assert frame.right_path is not None
    left, right = (read_rgb(p, frame.width_px, frame.height_px) for p in (frame.left_path, frame.right_path))
    ours, same = (METHODS[m](left, right, KITTI_SGBM) for m in (Method.OURS, Method.SAME_CALL))
    np.testing.assert_array_equal(ours, same)
    assert 0.6 < np.isfinite(ours).mean() < 0.95


@pytest.mark.skipif(
    not (OPENCV_DOC / "aloeL.jpg").is_file(),
    reason="needs example pictures (a download of 96 MB): apt-get install opencv-doc",
)
def test_ours_equals_the_same_call_on_aloe(tmp_path: Path):
    (pair,) = find_true_scenes(lay_out_aloe(OPENCV_DOC.parents[4].parent, tmp_path)) or ()
    found = accuracy(pair, matcher_of(pair, kitti=False, nearest_m=2.0))
    assert found.num_disparities == (224,)
    assert found.n_unlike == 0
    error = found.errors[Method.OURS, "seen twice", "bad_2"]
    assert error == found.errors[Method.SAME_CALL, "seen twice", "bad_2"]
    assert error.density > 0.9
    assert error.wrong_share_measured < 0.04


def test_kitti_is_counted_as_its_benchmark_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Counts in closed form, with the true shift as the measurement and a hole of 5 columns in it."""

    def measure(left: np.ndarray, _right: np.ndarray, _config: SgbmConfig) -> np.ndarray:
        disparity = np.full(left.shape[:2], float(SHIFT), np.float32)
        disparity[:, 105:110] = np.nan
        disparity[:, 50] = SHIFT + 3.5
        return disparity

    for method in Method:
        monkeypatch.setitem(METHODS, method, measure)
    scenes = find_true_scenes(kitti_2015(tmp_path))
    assert scenes is not None
    total = added("made", accuracies(scenes, 2.0, 1))
    assert total.num_disparities == (32, 32)  # 48 px m / 2 m = 24
    assert total.n_pixels == 2 * HEIGHT * WIDTH

    # two frames; 32 rows of foreground, 16 of background with truth; column 50 is off by 3.5, over 5 % of 12
    for ground, rows, wrong_measured, wrong_filled in (
        (", foreground", 64, 1, 1),  # the hole is filled with what is right
        (", background", 32, 1 + 5, 1 + 10),  # truth is 10 px off in columns 100 to 109
    ):
        error = total.errors[Method.OURS, f"all{ground}", "D1"]
        assert error.n_truth == rows * WIDTH
        assert error.n_measured == rows * (WIDTH - 5)
        assert error.n_wrong_measured == rows * wrong_measured
        assert error.n_wrong_filled == rows * wrong_filled
        twice = total.errors[Method.OURS, f"seen twice{ground}", "D1"]
        assert twice.n_truth == rows * (WIDTH - SHIFT)
        assert twice.n_wrong_filled == rows * wrong_filled
    everything = total.errors[Method.OURS, "all", "D1"]
    assert everything.wrong_share_filled == pytest.approx((64 * 1 + 32 * 11) / (96 * WIDTH))


def test_a_wall_of_noise_is_measured_right(tmp_path: Path):
    scenes = find_true_scenes(scene(tmp_path))
    assert scenes is not None
    (found,) = accuracies(scenes, 2.0, 1)
    assert found.num_disparities == (16,)  # 0 to 15 hold 12
    assert found.n_unlike == 0
    error = found.errors[Method.OURS, "seen twice", "bad_1"]
    assert error.n_truth == (HEIGHT - 4) * (WIDTH - SHIFT)
    assert error.density > 0.95
    assert error.wrong_share_measured < 0.01
    bare = found.errors[Method.BARE_CALL, "seen twice", "bad_1"]
    assert bare.n_measured <= (HEIGHT - 4) * (WIDTH - 16)


def test_kitti_without_calibrations_gets_the_preset(tmp_path: Path):
    truth = np.full((375, 1242), 20.0, np.float32)
    picture = np.zeros((375, 1242, 3), np.uint8)
    pair = TruePair("frame", picture, picture, truth, truth > 0, None, None)
    assert matcher_of(pair, kitti=True, nearest_m=2.0) is KITTI_SGBM
    scenes = find_true_scenes(kitti_2015(tmp_path, 1))
    assert scenes is not None
    assert [matcher_of(s.load(), True, 1.0).num_disparities for s in scenes.scenes] == [64]  # 48 px at 1 m


def test_two_maps_are_unlike_where_one_measures_or_they_differ():
    a = np.array([[1, 2, np.nan, np.nan, 5]], np.float32)
    b = np.array([[1, 2.5, np.nan, 4, np.nan]], np.float32)
    assert n_unlike(a, b) == 3
    assert n_unlike(a, b, 0.5) == 2


def test_pairs_without_truth_agree_with_their_features(tmp_path: Path):
    data = read_dataset(untrue(tmp_path / "mine"))
    found = list(consistency_of(data, 2.0, 1))  # 48 px m / 2 m = 24 px
    assert [c.name for c in found] == ["mine 000000", "mine 000001"]
    for one in found:
        assert one.num_disparities == 32
        assert one.n_unlike == 0
        assert one.density_bare + 0.05 < one.density < 1
        assert one.features.n_measured > 20
        assert one.features.end_point_error_px < 0.5
        assert one.features.n_wrong_measured == 0


def test_a_search_that_is_too_short_shows(tmp_path: Path):
    left, right = noise(3)
    # 8 columns more: all of the wall at 20 px, but for the last columns
    colour = [np.repeat(p[..., None], 3, axis=2) for p in (left, np.roll(right, -8, axis=1))]
    short = consistency("wall", *colour, SgbmConfig(num_disparities=16))
    far = consistency("wall", *colour, SgbmConfig(num_disparities=32))
    assert far.features.density > 0.9 > short.features.density
