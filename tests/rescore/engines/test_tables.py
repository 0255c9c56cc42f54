"""`rescore apply` by every engine: the same bytes of the result and of every evidence file."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.rescore.conftest import Run
from tests.rescore.engines.test_map_frames import DASK, JOBLIB, RAY, Executor

pytestmark = pytest.mark.xdist_group("engines")
STREET = ROOT / "examples" / "real_street"


def few_detections() -> list[dict[str, Any]]:
    """The best one of each frame: what is compared is the way there and back, not the method."""
    best: dict[int, dict[str, Any]] = {}
    for one in json.loads((STREET / "detections.json").read_text()):
        best[one["image_id"]] = max(one, best.get(one["image_id"], one), key=lambda d: float(d["score"]))
    return list(best.values())


def applied(run: Run, out: Path, *options: object) -> dict[str, bytes]:
    """What the command writes, by name."""
    out.mkdir()
    found = out / "detections.json"
    found.write_text(json.dumps(few_detections()))
    evidence = ("--evidence", out / "evidence")
    code, _, err = run("apply", STREET, found, "--out", out / "rescored.json", *evidence, *options)
    assert code == 0, err
    files = (p for p in out.rglob("*") if p.is_file())
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in files}


@pytest.fixture(scope="module")
def by_one_process() -> dict[str, bytes]:
    return {}


@pytest.mark.parametrize("executor", [JOBLIB, DASK, RAY])
def test_tables_are_the_same_bytes(
    executor: Executor, run: Run, tmp_path: Path, by_one_process: dict[str, bytes]
) -> None:
    if not by_one_process:
        by_one_process |= applied(run, tmp_path / "one", "--jobs", 1)
    assert len(by_one_process) >= 3
    found = applied(run, tmp_path / "other", "--engine", executor.engine, "--jobs", executor.jobs)
    assert found == by_one_process
