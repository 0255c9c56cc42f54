import json
import subprocess
import sys
from pathlib import Path

import pytest

from recon.errors import RescoreError
from rescore.files import atomic_path, digest_of, read_json, versions, write_json


def test_atomic_path_moves_a_whole_file_into_place(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "x.json"
    with atomic_path(target) as beside:
        assert beside.suffix == ".json"
        assert beside.parent == target.parent
        beside.write_text("new")
        assert not target.exists()
    assert [p.name for p in target.parent.iterdir()] == ["x.json"]
    assert target.read_text() == "new"


def test_atomic_path_leaves_nothing_on_failure(tmp_path: Path) -> None:
    target = tmp_path / "x.json"
    target.write_text("old")

    def fail() -> None:
        with atomic_path(target) as beside:
            beside.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]
    assert target.read_text() == "old"


def test_atomic_path_says_where_it_cannot_write(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(RescoreError, match=r"expected to write here, got .*choose another place"),
        atomic_path(tmp_path / "file" / "x.json"),
    ):
        pass


def test_a_killed_writer_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "x.txt"
    target.write_text("old")
    code = (
        "import os, sys; from pathlib import Path; from rescore.files import atomic_path\n"
        "with atomic_path(Path(sys.argv[1])) as beside:\n    beside.write_text('half'); os._exit(9)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(target)], check=False)
    assert done.returncode == 9
    assert target.read_text() == "old"


def test_json(tmp_path: Path) -> None:
    path = tmp_path / "v.json"
    write_json(path, {"b": 1, "a": "é"})
    assert read_json(path, "a value") == {"b": 1, "a": "é"}
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(path, float("nan"))
    assert json.loads(path.read_text())["b"] == 1
    path.write_text("{")
    with pytest.raises(RescoreError, match="expected a value as JSON, got"):
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
