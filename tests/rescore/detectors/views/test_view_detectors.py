"""Both detectors of all views on drawn patterns of three views."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.boxes import iou_matrix
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.detectors.detect import calibrate_and_detect, calibrate_detector, detect_candidates
from rescore.detectors.fragments import FragmentConfig
from rescore.detectors.mining import MiningConfig, ScanRange
from rescore.detectors.platt import PlattScaling
from rescore.detectors.registry import DETECTORS, learned_detectors, load_detector, train_detector
from rescore.detectors.views.boosted import BoostedViewsConfig
from rescore.detectors.views.examples import ViewExamples, aspects, car_views
from rescore.detectors.views.hog import HogViewsConfig
from rescore.detectors.views.joint_boosting import JointBoostConfig
from rescore.experiment.config import RunConfig, run_preset
from rescore.formats.coco import read_detections, write_detections
from tests.rescore.toy_street import ASPECT, ASPECT_OF_END, picture_of, random_view, toy_views

SIZES = ScanRange(25, 65, 1.2)
MINING = MiningConfig(jitter_copies=3, random_per_frame=10, hard_per_frame=6, rounds=1, max_car_iou=0.4)
SMALL: dict[str, Any] = {
    "hog_views": HogViewsConfig(scan=SIZES, mining=MINING, floor=-1.0),
    "boosted_views": BoostedViewsConfig(
        scan=SIZES,
        mining=MINING,
        floor=-4.0,
        fragments=FragmentConfig(count=120, sizes_px=(9,)),
        boosting=JointBoostConfig(rounds=40, features_per_round=40),
    ),
}
NAMES = tuple(SMALL)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    return toy_views(tmp_path_factory.mktemp("views"), 28, 0)


@pytest.fixture(scope="module")
def trained(data: DataSet) -> Callable[[str], Any]:
    detectors = {name: train_detector(name, data, SMALL[name], 0, 1) for name in NAMES}
    return detectors.__getitem__


@pytest.mark.parametrize("name", NAMES)
def test_finds_the_pattern_its_shape_and_its_view(trained: Callable[[str], Any], name: str) -> None:
    rng = np.random.default_rng(7)
    placed = views = 0
    for _ in range(12):
        draw, azimuth_deg = random_view(rng)
        picture, box = picture_of(rng, [draw])
        found = trained(name).detect(picture)
        placed += iou_matrix(found.xyxy_px[:1], box)[0, 0] > 0.6
        views += found.azimuth_deg[0] == azimuth_deg
    assert placed >= 11
    assert views >= 11


@pytest.mark.parametrize("name", NAMES)
def test_a_mirrored_picture_has_the_mirrored_view(trained: Callable[[str], Any], name: str) -> None:
    rng = np.random.default_rng(3)
    draw, azimuth_deg = random_view(rng)
    while azimuth_deg == 0:
        draw, azimuth_deg = random_view(rng)
    picture, box = picture_of(rng, [draw])
    flipped = trained(name).detect(np.ascontiguousarray(picture[:, ::-1]))
    assert flipped.azimuth_deg[0] == 360 - azimuth_deg
    mirrored = box[:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [320, 0, 320, 0]
    assert iou_matrix(flipped.xyxy_px[:1], mirrored)[0, 0] > 0.6


@pytest.mark.parametrize("name", NAMES)
def test_what_is_loaded_finds_what_was_saved(
    trained: Callable[[str], Any], name: str, tmp_path: Path
) -> None:
    trained(name).save(tmp_path / "detector.npz")
    loaded = load_detector(tmp_path / "detector.npz")
    picture, _ = picture_of(np.random.default_rng(1), [random_view(np.random.default_rng(2))[0]])
    one, other = trained(name).detect(picture), loaded.detect(picture)
    assert one.score.tolist() == other.score.tolist()
    assert one.azimuth_deg is not None
    assert other.azimuth_deg is not None
    assert one.azimuth_deg.tolist() == other.azimuth_deg.tolist()
    assert loaded.name == name


@pytest.mark.parametrize("name", NAMES)
def test_one_seed_gives_one_file_whatever_the_jobs(data: DataSet, name: str, tmp_path: Path) -> None:
    few = replace(data, frames=data.frames[:8])
    config = replace(SMALL[name], examples=ViewExamples(min_cars=2), scan=ScanRange(40, 60, 1.25))
    for jobs in (1, 2):
        train_detector(name, few, config, 5, jobs).save(tmp_path / f"{jobs}.npz")
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "2.npz").read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_candidates_are_few_apart_and_inside(trained: Callable[[str], Any], name: str) -> None:
    rng = np.random.default_rng(8)
    picture, _ = picture_of(rng, [random_view(rng)[0] for _ in range(3)])
    found = trained(name).detect(picture)
    assert 0 < len(found) <= 15
    assert (np.diff(found.score) <= 0).all()
    overlap = iou_matrix(found.xyxy_px, found.xyxy_px) - np.eye(len(found))
    assert overlap.max() <= 0.4
    assert (found.xyxy_px >= 0).all()
    assert (found.xyxy_px <= [320, 240, 320, 240]).all()
    tiny = trained(name).detect(np.zeros((20, 3, 3), np.uint8))
    assert (tiny.xyxy_px <= [3, 20, 3, 20]).all()


def test_the_view_goes_into_the_file_of_detections(
    trained: Callable[[str], Any], data: DataSet, tmp_path: Path
) -> None:
    few = replace(data, frames=data.frames[:2])
    table = detect_candidates(trained("hog_views"), PlattScaling(-1.0, 0.0), few, 1, show=False)
    write_detections(tmp_path / "found.json", "hog_views", table, few)
    read = read_detections(tmp_path / "found.json", few).table
    assert np.isfinite(read.azimuth_deg).all()
    assert read.azimuth_deg.tolist() == table.azimuth_deg.tolist()
    assert set(read.azimuth_deg.tolist()) <= {0.0, 90.0, 270.0}


def test_candidates_that_come_with_the_scaling_are_those_of_the_split(
    trained: Callable[[str], Any], data: DataSet
) -> None:
    half = len(data.frames) // 2
    frames = [replace(f, split="calibration" if i < half else f.split) for i, f in enumerate(data.frames)]
    mixed = replace(data, frames=tuple(frames))
    scaling, table = calibrate_and_detect(trained("hog_views"), mixed, 1, show=False)
    assert scaling == calibrate_detector(trained("hog_views"), mixed, 1, show=False)
    again = detect_candidates(trained("hog_views"), scaling, mixed.split("calibration"), 1, show=False)
    for name in ("image_id", "xyxy_px", "score", "likelihood", "azimuth_deg"):
        np.testing.assert_array_equal(getattr(table, name), getattr(again, name))


def test_a_bin_has_the_shape_of_its_cars_and_a_rare_one_is_left_out(data: DataSet) -> None:
    cars = car_views(data, ViewExamples(), MINING)
    # of bins 0 to 6, which are learned, the patterns show the nose and the side; 270 degrees is 90 mirrored
    found = aspects(cars, ViewExamples())
    assert found == pytest.approx({0: ASPECT_OF_END, 3: ASPECT})
    with pytest.raises(RescoreError, match="expected at least 99 cars of some view bin"):
        aspects(cars, ViewExamples(min_cars=99))


def test_cars_without_azimuth_are_refused(data: DataSet) -> None:
    bare = replace(data, truth={i: replace(t, azimuth_deg=None) for i, t in data.truth.items()})
    with pytest.raises(RescoreError, match="expected whole cars with azimuth_deg"):
        train_detector("hog_views", bare, SMALL["hog_views"], 0, 1)


def test_they_run_where_they_are_named_alone() -> None:
    assert set(NAMES) <= set(DETECTORS)
    assert not set(NAMES) & set(learned_detectors())


def test_streets_run_them_beside_the_modelled_boxes() -> None:
    config = run_preset("streets")
    assert config.detectors == ("modelled", *NAMES)
    assert RunConfig.model_validate(config.as_json()) == config
    assert run_preset("paper").detectors == ("hog", "boosted")
