"""`rescore apply MY_DATA found.json --out rescored.json`, and what it says without a rescorer for it."""

import json
from pathlib import Path

import numpy as np
import pytest

import rescore.defaults
from rescore.library.bundles import write_bundle
from tests.rescore import shipped
from tests.rescore.spoiling import Run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of what comes with the package, empty at first."""
    folder = tmp_path / "defaults"
    folder.mkdir()
    monkeypatch.setattr(rescore.defaults, "FOLDER", folder)
    return folder


def test_data_and_detections_are_enough(tmp_path: Path, folder: Path, run: Run) -> None:
    bundle = shipped.bundle()
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", bundle)
    data, found = shipped.write_street(tmp_path / "street")
    out = tmp_path / "rescored.json"
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1)
    assert code == 0, err
    assert (
        "used: class model, evidence (mode instance) and w 0.40 that come with the package for class 'car', "
        "made by `publish it`" in err
    )
    rows = json.loads(out.read_text())
    assert [r["registration"] for r in rows] == ["instance"] * 3
    assert [r["status"] for r in rows] == ["ok"] * 3
    # rows keep the detector's order: the half car, the whole one, bare road
    assert np.argsort([-r["score"] for r in rows]).tolist() == [1, 0, 2]
    np.testing.assert_allclose(rows[1]["bbox3d"][:3], [-2.0, 0.9, 12.0], atol=0.1)
    config = json.loads((tmp_path / "rescored.json.config.json").read_text())["config"]
    assert config["w"] == bundle.w
    assert config["rescore"]["fit"]["views"]["coefficients"] == [[0.0]]
    assert set(config["evidence_model"]["modes"]) == {"instance"}


def test_settings_of_a_file_change_those_of_the_package(tmp_path: Path, folder: Path, run: Run) -> None:
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", shipped.bundle())
    data, found = shipped.write_street(tmp_path / "street")
    changes = tmp_path / "changes.json"
    changes.write_text('{"rescore": {"nearest_m": 3.0}}')
    out = tmp_path / "rescored.json"
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1, "--config", changes)
    assert code == 0, err
    settings = json.loads((tmp_path / "rescored.json.config.json").read_text())["config"]["rescore"]
    assert settings["nearest_m"] == 3.0
    assert settings["fit"]["views"]["coefficients"] == [[0.0]]
    changes.write_text('{"class_name": "chair"}')
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1, "--config", changes)
    assert (code, err.count("\n")) == (1, 1)
    assert "class 'chair': expected a rescorer that comes with the package, found car; give --model" in err


def test_second_boxes_are_told(tmp_path: Path, folder: Path, run: Run) -> None:
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", shipped.bundle())
    data, found = shipped.write_street(tmp_path / "street")
    rows = json.loads(found.read_text())
    x, y, width, height = rows[0]["bbox"]
    loose = {**rows[0], "bbox": [x + 10, y + 4, width - 20, height - 4], "score": 0.3}
    found.write_text(json.dumps([*rows, loose]))
    out = tmp_path / "rescored.json"
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1, "--suppress")
    assert code == 0, err
    # the half car and the loose box
    assert "4 candidates, 2 with depth evidence, 2 second boxes of a car" in err
    last = json.loads(out.read_text())[-1]
    assert last["status"] == "second_box"
    assert last["reason_detail"].startswith("the same car as candidate 2 at ")
    assert 0 < last["score"] < 1e-14
    # without a camera nothing stands in 3D
    data, found = shipped.write_street(tmp_path / "unknown", calibrated=False)
    code, _, err = run("apply", data, found, "--out", out, "--jobs", 1, "--suppress")
    assert code == 0, err
    assert "note: --suppress: no candidate has a 3D box" in err
    assert [r["status"] for r in json.loads(out.read_text())] == ["no_calibration"] * 3


def test_without_a_rescorer_one_line_says_what_to_give(tmp_path: Path, folder: Path, run: Run) -> None:
    data, found = shipped.write_street(tmp_path / "street")
    code, _, err = run("apply", data, found, "--out", tmp_path / "rescored.json")
    assert (code, err.count("\n")) == (1, 1)
    assert "class 'car': expected a rescorer that comes with the package, found none; give --model" in err
    assert "`rescore learn --class car --out car.json` makes (to rescore also --w or --tuned" in err


def test_what_is_named_keeps_its_meaning(tmp_path: Path, folder: Path, run: Run) -> None:
    write_bundle(folder / f"car{rescore.defaults.SUFFIX}", shipped.bundle())
    data, found = shipped.write_street(tmp_path / "street")
    model, out = tmp_path / "car.json", tmp_path / "rescored.json"
    shipped.class_model().save(model)
    code, _, err = run("apply", data, found, "--out", out, "--model", model, "--w", 0.7, "--jobs", 1)
    assert code == 0, err
    assert f"used: class model {model}, evidence of mode paper, w 0.70" in err
    assert {(r["registration"], r["w"]) for r in json.loads(out.read_text())} == {("paper", 0.7)}
    code, _, err = run("apply", data, found, "--out", out, "--w", 0.7)
    assert (code, err.count("\n")) == (1, 1)
    assert "--model, --predicted: expected one of the two, got neither" in err
    code, _, err = run("apply", data, found, "--out", out, "--model", model)
    assert (code, err.count("\n")) == (1, 1)
    assert "expected either --tuned or --w" in err
