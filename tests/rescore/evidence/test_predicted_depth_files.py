"""Predictions of depth in folders: what is read, and the way from `rescore apply` to the recording."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from reports.run.frame_view import frame_views
from rescore.evidence.predicted_depth import PredictedAs, PredictedUnit
from rescore.evidence.predicted_depth_files import PredictionFolder, Predictions, read_prediction_folder
from rescore.formats.open import read_dataset
from rescore.results.run_folder import load_run
from tests.rescore import own_data as own
from tests.rescore.spoiling import Run

BOX = [20, 10, 50, 40]
"""Left, top, width, height."""


def inverse_depth(seed: int) -> np.ndarray:
    """Disparity (h, w) in pixels of a round thing before a slanted wall."""
    y, x = np.mgrid[: own.HEIGHT, : own.WIDTH].astype(float)
    bump = np.hypot((x - 45 - seed) / 20, (y - 30) / 15)
    return np.where(bump < 1, 8 + 2 * np.sqrt(np.maximum(1 - bump**2, 0)), 4 + 0.01 * x)


def data_folder(root: Path) -> Path:
    value = own.annotations()
    for image in value["images"]:
        del image["right_file_name"]
        name = f"{image['id']}.npy"
        image["measured"] = {"file_name": f"measured/{name}", "quantity": "disparity", "factor": 1}
        (root / "measured").mkdir(parents=True, exist_ok=True)
        np.save(root / "measured" / name, inverse_depth(image["id"]))
    value["annotations"] = [{"id": 1, "image_id": 1, "category_id": 1, "bbox": BOX}]
    return own.own_folder(root, value)


def npy(path: Path, values: np.ndarray) -> None:
    np.save(path.with_suffix(".npy"), values)


def pfm(path: Path, values: np.ndarray) -> None:
    own.write_pfm(path.with_suffix(".pfm"), values)


def png(path: Path, values: np.ndarray) -> None:
    own.write_png(path.with_suffix(".png"), np.rint(values).astype(np.uint16))


def folder_of(root: Path, write: Callable[[Path, np.ndarray], None], scale: float, offset: float) -> Path:
    root.mkdir()
    for i in (1, 2):
        write(root / str(i), scale * inverse_depth(i) + offset)
    return root


def described(net: Path, predicted_as: str) -> Path:
    """The file of `--predicted` beside a folder; its path of the folder is relative to it."""
    text = json.dumps({"folder": net.name, "as": predicted_as})
    return own.write_text(net.with_name(f"{net.name}_{predicted_as}.json"), text)


def detections(path: Path) -> Path:
    rows = [
        {"image_id": 1, "category_id": 1, "bbox": BOX, "score": 0.6},
        {"image_id": 2, "category_id": 1, "bbox": [95, 60, 40, 30], "score": 0.3},
    ]
    return own.write_text(path, json.dumps(rows))


@pytest.mark.parametrize(
    ("write", "scale", "offset"), [(npy, 0.1, -3.0), (pfm, 0.02, 0.0), (png, 4000.0, 300.0)]
)
def test_from_a_folder_to_a_recording(
    tmp_path: Path, run: Run, write: Callable[[Path, np.ndarray], None], scale: float, offset: float
) -> None:
    data = data_folder(tmp_path / "data")
    net = folder_of(tmp_path / "net", write, scale, offset)
    found, out, mine = detections(tmp_path / "found.json"), tmp_path / "rescored.json", tmp_path / "run"
    options = ("--predicted", described(net, "inverse"), "--w", 0.5, "--jobs", 1)
    code, _, err = run("apply", data, found, *options, "--out", out, "--evidence", mine / "evidence")
    assert code == 0, err
    assert "2 candidates, 1 with depth evidence (1 box_outside_image)" in err
    first, second = json.loads(out.read_text())
    # percentiles clip a little of an exact prediction
    assert first["depth_difference"] < 0.06
    assert first["scale"] > 0
    assert first["score"] == pytest.approx(np.sqrt(0.6 * (1 - first["depth_difference"])))
    assert (second["status"], second["score"]) == ("box_outside_image", 0.3)

    code, _, err = run("evaluate", data, out, "--out", mine)
    assert code == 0, err
    used = json.loads((mine / "config.json").read_text())["config"]["predicted"][str(out)]
    assert (used["folder"], used["predicted_as"], used["n_frames"]) == (str(net), "inverse", 2)
    (c,) = next(frame_views(load_run(mine), "paper")).candidates["found"]
    assert c.instance is None
    assert c.predicted is not None
    assert c.registered is not None
    measured_m = own.FX * own.BASELINE_M / inverse_depth(1)[c.predicted.window]
    gap = np.abs(c.registered / measured_m - 1)
    assert np.median(gap) < 0.02
    code, _, err = run("log", mine)
    assert code == 0, err
    assert (mine / "recording.rrd").stat().st_size > 10_000


def predictions(
    root: Path, folder: Path, masks: Path | None = None, ids: tuple[int, ...] = (1, 2)
) -> Predictions:
    data = read_dataset(root)
    kind = PredictionFolder(folder, PredictedAs.DEPTH, PredictedUnit.METRIC, 1000.0, masks)
    return Predictions.of(kind, data, ids)


def test_millimetres_and_masks(tmp_path: Path) -> None:
    data = own.own_folder(tmp_path / "data")
    numbers = np.zeros((own.HEIGHT, own.WIDTH), np.uint16)
    numbers[5:, 7:] = 300
    for i in (1, 2):
        own.write_png(tmp_path / f"net/{i}.png", np.full((own.HEIGHT, own.WIDTH), 2500 * i, np.uint16))
        own.write_png(tmp_path / f"masks/{i}.png", numbers)
    found = predictions(data, tmp_path / "net", tmp_path / "masks").files[2].read(own.WIDTH, own.HEIGHT)
    np.testing.assert_array_equal(found.depth_values(), np.float32(5))
    assert found.mask is not None
    np.testing.assert_array_equal(found.mask, numbers)


def test_only_frames_with_candidates_need_a_prediction(tmp_path: Path) -> None:
    data = own.own_folder(tmp_path / "data")
    (tmp_path / "net").mkdir()
    npy(tmp_path / "net" / "2", inverse_depth(2))
    assert set(predictions(data, tmp_path / "net", ids=(2,)).files) == {2}
    with pytest.raises(RescoreError, match="found none for 1 of 2, such as '1'"):
        predictions(data, tmp_path / "net")


def test_the_digest_tells_predictions_apart(tmp_path: Path) -> None:
    data = own.own_folder(tmp_path / "data")
    net = folder_of(tmp_path / "net", npy, 1, 0)
    before = predictions(data, net).as_json()["sha256"]
    assert predictions(data, net).as_json()["sha256"] == before
    assert predictions(data, net, ids=(1,)).as_json()["sha256"] != before
    # as a machine of the other byte order would save it
    np.save(net / "2.npy", inverse_depth(2).astype(">f8"))
    assert predictions(data, net).as_json()["sha256"] == before
    npy(net / "2", inverse_depth(2) + 1)
    assert predictions(data, net).as_json()["sha256"] != before


def test_what_is_fitted_is_used_with_the_same_predictions(tmp_path: Path, run: Run) -> None:
    data = data_folder(tmp_path / "data")
    value = json.loads((data / "annotations.json").read_text())
    for image in value["images"]:
        image["split"] = "validation" if image["id"] == 1 else "test"
    own.write_text(data / "annotations.json", json.dumps(value))
    net = folder_of(tmp_path / "net", npy, 2, 1)
    row = {"image_id": 1, "category_id": 1, "bbox": BOX, "score": 0.6}
    false = row | {"bbox": [60, 5, 30, 20], "score": 0.7}
    found = own.write_text(tmp_path / "found.json", json.dumps([row, false]))
    inverse = ("--predicted", described(net, "inverse"), "--jobs", 1)
    code, _, err = run("tune", data, found, *inverse, "--out", tmp_path / "w.json")
    assert code == 0, err
    assert (
        json.loads((tmp_path / "w.json").read_text())["depth_of"] == "another system (relative inverse depth)"
    )
    used = json.loads((tmp_path / "w.json.config.json").read_text())["config"]["predicted"]
    assert (used["predicted_as"], used["n_frames"]) == ("inverse", 1)

    rest = ("--split", "validation", "--tuned", tmp_path / "w.json", "--out", tmp_path / "out.json")
    assert run("apply", data, found, *inverse, *rest)[0] == 0
    (tmp_path / "out.json").unlink()
    for options in (
        ("--predicted", described(net, "depth")),
        ("--model", tmp_path / "car.json"),
    ):
        code, _, err = run("apply", data, found, *options, *rest)
        assert (code, len(err.splitlines())) == (1, 1)
        assert "w.json: expected what was fitted with depth of" in err
        assert not (tmp_path / "out.json").exists()


def test_a_description_is_read_from_its_own_folder(tmp_path: Path) -> None:
    short = own.write_text(tmp_path / "deep" / "net.json", '{"folder": "../net", "as": "inverse"}')
    beside = tmp_path / "deep"
    assert read_prediction_folder(short) == PredictionFolder(beside / "../net", PredictedAs.INVERSE)
    value = {"folder": "/maps", "as": "depth", "unit": "metric", "factor": 1000, "masks": "masks"}
    whole = own.write_text(tmp_path / "deep" / "metric.json", json.dumps(value))
    assert read_prediction_folder(whole) == PredictionFolder(
        Path("/maps"), PredictedAs.DEPTH, PredictedUnit.METRIC, 1000.0, beside / "masks"
    )
