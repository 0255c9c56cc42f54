"""A detector that is known by its entry in the registry alone takes part in everything."""

import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recon.arrays import FloatArray, UInt8Array
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.detectors.base import Detections, SuppressionConfig, best_candidates, ordered
from rescore.detectors.files import write_detector
from rescore.detectors.mining import CropStyle, MiningConfig, ScanRange, car_crops
from rescore.detectors.platt import PlattScaling
from rescore.detectors.registry import (
    DETECTORS,
    DetectorEntry,
    detector_entry,
    load_detector,
    train_detector,
)
from rescore.detectors.windows import WindowGeometry, gray
from rescore.experiment.config import RunConfig, run_preset, with_changes
from rescore.experiment.reproduce import Experiment
from rescore.experiment.stages import Done
from rescore.formats.coco import read_detections
from rescore.formats.coco_dataset import read_dataset
from rescore.results.run_folder import RunFolder


@dataclass(frozen=True)
class ToyConfig:
    """Settings of the toy."""

    smallest_px: int = 50
    """Width of the smallest of the five cars that it looks for."""


@dataclass(frozen=True, eq=False)
class ToyDetector:
    """The mean crop of a car, moved over the picture: score is the normalised correlation."""

    mean: FloatArray
    config: ToyConfig
    name: str = "toy"

    def detect(self, rgb: UInt8Array) -> Detections:
        return best_candidates(self.scan(rgb), SuppressionConfig(), rgb.shape[1], rgb.shape[0])

    def scan(self, rgb: UInt8Array) -> Detections:
        window, (height, width) = WindowGeometry(), self.mean.shape
        boxes, scores = [np.zeros((0, 4))], [np.zeros(0)]
        for car_px in self.config.smallest_px * 1.3 ** np.arange(7):
            zoom = window.object_width_px / car_px
            picture = cv2.resize(gray(rgb), None, fx=zoom, fy=zoom).astype(np.float32)
            if picture.shape[0] < height or picture.shape[1] < width:
                continue
            score = cv2.matchTemplate(picture, self.mean.astype(np.float32), cv2.TM_CCOEFF_NORMED)
            y, x = (v[::4, ::4].ravel() for v in np.indices(score.shape))
            boxes.append(window.boxes(np.stack([x, y], axis=1) / zoom, np.full(len(x), 1 / zoom)))
            scores.append(score[y, x].astype(float))
        return ordered(np.concatenate(boxes), np.concatenate(scores))

    def save(self, path: Path) -> None:
        write_detector(path, "toy template", self.name, asdict(self.config), {"mean": self.mean})


def train_toy(data: DataSet, config: ToyConfig, rng: np.random.Generator, jobs: int) -> ToyDetector:
    mining = MiningConfig(jitter_copies=0, min_visibility=0.3)
    style = CropStyle(WindowGeometry(), cv2.INTER_AREA, ScanRange(), mining)
    return ToyDetector(car_crops(data, style, rng, jobs).mean(axis=0), config)


def load_toy(name: str, config: Mapping[str, Any], arrays: Mapping[str, Any]) -> ToyDetector:
    return ToyDetector(arrays["mean"], ToyConfig(**config), name)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = DetectorEntry("a toy", "toy template", 9, ToyConfig, train_toy, load_toy)
    monkeypatch.setitem(DETECTORS, "toy", entry)


@pytest.mark.usefixtures("toy")
def test_a_toy_is_trained_saved_and_loaded(tiny_run: Path, tmp_path: Path) -> None:
    data = read_dataset(tiny_run / "data")
    trained = train_detector("toy", data, ToyConfig(), seed=0, jobs=1)
    trained.save(tmp_path / "toy.npz")
    loaded = load_detector(tmp_path / "toy.npz")
    assert isinstance(loaded, ToyDetector)
    rgb = np.random.default_rng(0).integers(0, 255, (200, 300, 3), dtype=np.uint8)
    np.testing.assert_array_equal(loaded.detect(rgb).score, trained.detect(rgb).score)


@pytest.mark.usefixtures("toy")
def test_a_toy_takes_part_in_the_experiment(
    tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # two frames are too few for the scaling of so weak a detector
    monkeypatch.setattr("rescore.detectors.detect.fit_platt", lambda *_: PlattScaling(-1.0, 0.0))
    shutil.copytree(tiny_run / "data", tmp_path / "run" / "data")
    (tmp_path / "changes.json").write_text('{"detectors": ["toy"], "toy": {"smallest_px": 60}}')
    config = with_changes(run_preset("tiny"), tmp_path / "changes.json")
    assert config.detector_settings["toy"] == ToyConfig(60)
    assert RunConfig.model_validate(config.as_json()) == config
    done: list[Done] = []
    run = Experiment(RunFolder(tmp_path / "run"), config, 0, 1, done.append)
    for _ in range(2):
        run.train("toy")
        run.detect("toy", "test")
    assert [d.reused for d in done] == [False] * 3 + [True] * 3
    data = run._data().split("test")
    table = read_detections(run.folder.detections("toy", "test"), data).table
    assert len(table)
    assert np.isfinite(table.likelihood).all()


def test_an_unknown_detector_is_one_line() -> None:
    with pytest.raises(
        RescoreError,
        match=r"detector: expected hog or boosted or modelled or .*, got 'toy'; choose one of these",
    ):
        detector_entry("toy")
