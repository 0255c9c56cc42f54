"""Training of ground pixels on drawn frames with pictures of instance numbers."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from recon.camera import GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.reconstruction.ground_region import GroundPixels
from rescore.cli import app
from rescore.data.frames import DataSet, FrameRecord
from rescore.experiment.ground_training import GroundTrainingConfig, score_ground, train_ground

CAMERA = StereoCamera(PinholeCamera(150.0, 150.0, 79.5, 59.5, 160, 120), 0.3)
QUICK = GroundTrainingConfig(copies=4, cells_per_copy=500, hidden=(8,), epochs=10)


def frame(folder: Path, number: int) -> FrameRecord:
    """A wall of rows over a smooth road, and a striped box on the road."""
    rng = np.random.default_rng(number)
    instances = np.ones((120, 160), np.uint16)
    instances[60:] = 2
    x = int(rng.integers(10, 90))
    instances[40:90, x : x + 60] = 3
    colours = rng.uniform(40, 200, (4, 3))
    rgb = colours[instances]
    rgb[(instances == 3) & (np.arange(160) // 4 % 2 == 0)] *= 0.3
    rgb[(instances == 1) & (np.arange(120)[:, None] // 5 % 2 == 0)] *= 0.5
    rgb = np.clip(rgb + rng.normal(0, 3, rgb.shape), 0, 255).astype(np.uint8)
    left, numbers = folder / f"{number}.png", folder / f"{number}_instance.png"
    cv2.imwrite(str(left), rgb)
    cv2.imwrite(str(numbers), instances)
    kinds = {1: "facade", 2: "road", 3: "bus"}
    size = (160, 120)
    return FrameRecord(number, left, None, None, "train", *size, CAMERA, GroundPlane(1.5), numbers, kinds)


def data_set(frames: list[FrameRecord]) -> DataSet:
    return DataSet(Path("data"), 1, "car", tuple(frames), {})


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[FrameRecord]:
    folder = tmp_path_factory.mktemp("ground")
    return [frame(folder, i) for i in range(9)]


def test_what_it_learns_carries_over_to_other_frames(frames: list[FrameRecord]) -> None:
    classifier = train_ground(data_set(frames[:6]), QUICK, np.random.default_rng(0))
    others = data_set(frames[6:])
    for known in (True, False):
        learned, trivial = score_ground(others, classifier, known), score_ground(others, None, known)
        assert learned.n_frames == 3
        assert learned.accuracy > 0.95
        assert learned.accuracy > trivial.accuracy + 0.05


def test_below_the_horizon_in_closed_form(frames: list[FrameRecord]) -> None:
    score = score_ground(data_set(frames[:1]), None, True)
    # half the picture is below the horizon, row 59.5; the box hides 30 x 60 of its 60 x 160 pixels
    assert score.recall == 1.0
    assert score.precision == pytest.approx(1 - 30 * 60 / (60 * 160))
    assert score.accuracy == pytest.approx(1 - 30 * 60 / (120 * 160))


def test_the_same_seed_gives_the_same_bytes(frames: list[FrameRecord], tmp_path: Path) -> None:
    quick = replace(QUICK, epochs=2)
    paths = [tmp_path / f"{i}.npz" for i in range(3)]
    for path, seed in zip(paths, (0, 0, 1), strict=True):
        train_ground(data_set(frames[:2]), quick, np.random.default_rng(seed)).save(path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].read_bytes() != paths[2].read_bytes()


def test_frames_that_cannot_teach(frames: list[FrameRecord]) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(RescoreError, match="expected frames to learn from, got none"):
        train_ground(data_set([]), QUICK, rng)
    with pytest.raises(RescoreError, match="expected a picture of instance numbers, got none"):
        train_ground(data_set([replace(frames[0], instance_path=None)]), QUICK, rng)
    with pytest.raises(RescoreError, match="expected a camera with height_m, got none"):
        train_ground(data_set([replace(frames[0], ground=None)]), QUICK, rng)


def test_the_command(frames: list[FrameRecord], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = {"fx": 150, "fy": 150, "cx": 79.5, "cy": 59.5, "baseline_m": 0.3, "height_m": 1.5}
    images = [
        {
            **{"id": f.image_id, "file_name": str(f.left_path), "instance_file_name": str(f.instance_path)},
            "instances": [{"id": number, "kind": kind} for number, kind in f.instance_kinds.items()],
            **{"width": 160, "height": 120, "split": "train" if i < 4 else "test", "camera": camera},
        }
        for i, f in enumerate(frames)
    ]
    categories = [{"id": 1, "name": "car"}]
    file = {"images": images, "annotations": [], "categories": categories}
    (tmp_path / "annotations.json").write_text(json.dumps(file))
    monkeypatch.setattr("rescore.experiment.ground_training.GroundTrainingConfig", lambda: QUICK)
    out = tmp_path / "ground.npz"
    arguments = ["learn-ground", str(tmp_path), "--out", str(out), "--seed", "3", "--check", str(tmp_path)]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0
    assert done.stdout.count("of 9 frames") == 4
    expected = train_ground(data_set(frames[:4]), QUICK, np.random.default_rng(3))
    for mine, theirs in zip(GroundPixels.load(out).weights, expected.weights, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-4, atol=1e-5)
    assert json.loads((tmp_path / "ground.npz.config.json").read_text())["seed"] == 3
