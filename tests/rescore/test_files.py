import json
from pathlib import Path

import pytest

from recon.errors import RescoreError
from rescore.files import digest_of, read_json, versions, write_json


def test_json(tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    write_json(path, {"b": 1, "a": "é"})
    assert read_json(path, "a value") == {"b": 1, "a": "é"}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(path, float("nan"))
    assert json.loads(path.read_text())["b"] == 1
    path.write_text("{")
    with pytest.raises(RescoreError, match="expected a value as JSON, could not read it"):
        read_json(path, "a value")
    with pytest.raises(RescoreError, match="expected a value, found no file"):
        read_json(tmp_path / "none", "a value")


def test_digest_sees_content_and_names(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x").write_text("1")
    first = digest_of(tmp_path / "a")
    (tmp_path / "a" / "x").write_text("22")
    second = digest_of(tmp_path / "a")
    (tmp_path / "a" / "x").rename(tmp_path / "a" / "y")
    assert len({first, second, digest_of(tmp_path / "a")}) == 3
    assert digest_of(tmp_path / "none") == ""


def test_versions_name_what_results_depend_on() -> None:
    assert {"python", "numpy", "opencv-python-headless", "scikit-learn", "rerun-sdk"} <= set(versions())
