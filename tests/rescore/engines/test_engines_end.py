"""Runs in parts on clusters that are stopped, or whose scheduler or head dies: what is done stays.

`python -m tests.faults.faults_of_engines` goes on with a second cluster, which takes minutes.
"""

import os
import signal
import subprocess
import threading
from importlib.util import find_spec
from pathlib import Path

import pytest

from rescore.large import run as run_module
from rescore.speech import counted
from tests.faults.clusters import dask_scheduler, free_port, kill_ray_head
from tests.faults.processes import alive, descendants, until
from tests.faults.small_parts import FRAMES_A_PART, detect, parts_in, start, write_street
from tests.rescore.conftest import Run

FRAMES = 60
PARTS = FRAMES // FRAMES_A_PART
needs_dask = pytest.mark.skipif(find_spec("distributed") is None, reason="no dask; pip install rescore[dask]")
needs_ray = pytest.mark.skipif(find_spec("ray") is None, reason="no ray; pip install rescore[ray]")


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_street(tmp_path_factory.mktemp("faults") / "street", FRAMES)[0]


@pytest.fixture(scope="module")
def whole() -> dict[str, bytes]:
    """What one process makes of the street, once it is made."""
    return {}


def parts_of(out: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in parts_in(out)}


def goes_on(run: Run, street: Path, out: Path, whole: dict[str, bytes], *who: object) -> None:
    """The command keeps what is there, and ends with the bytes of a run that nothing stopped."""
    if not whole:
        assert run(*detect(street, out.parent / "whole", "--jobs", 1))[0] == 0
        whole |= parts_of(out.parent / "whole")
        assert len(whole) == PARTS
    there = {p.name: p.stat().st_mtime_ns for p in parts_in(out)}
    assert 0 < len(there) < PARTS
    code, _, err = run(*detect(street, out, *who))
    assert code == 0, err
    assert f"kept from before: {counted(len(there), 'part')}\n" in err
    assert there.items() <= {p.name: p.stat().st_mtime_ns for p in parts_in(out)}.items()
    assert parts_of(out) == whole


def begun(process: "subprocess.Popen[str]", out: Path, parts: int) -> list[int]:
    """Processes that a command started, once it has written so many parts."""
    until(lambda: len(parts_in(out)) >= parts or process.poll() is not None, 120)
    assert process.poll() is None, process.communicate()[1]
    return descendants(process.pid)


@pytest.fixture(autouse=True)
def _small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "FRAMES_A_PART", FRAMES_A_PART)


def interrupted(process: "subprocess.Popen[str]", out: Path) -> None:
    """Ctrl-C, which all of the group get from a terminal, ends a command with one line and all it started."""
    helpers = begun(process, out, 1)
    assert len(helpers) >= 2
    os.killpg(process.pid, signal.SIGINT)
    error = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    line = "rescore: detect stopped (SIGINT); parts of a table are kept; run the command again to go on"
    assert error.split("\n") == [line, ""]
    until(lambda: not any(map(alive, helpers)), 20)


@needs_dask
def test_ctrl_c_and_the_death_of_dasks_scheduler(
    street: Path, tmp_path: Path, run: Run, whole: dict[str, bytes]
) -> None:
    out, port = tmp_path / "found", free_port()
    stopped = tmp_path / "stopped"
    interrupted(start(detect(street, stopped, "--engine", "dask", "--jobs", 2)), stopped)
    goes_on(run, street, stopped, whole, "--jobs", 1)
    address = ("--engine", "dask", "--address", f"tcp://127.0.0.1:{port}")
    with dask_scheduler(port, tmp_path / "log") as scheduler:
        killer = threading.Thread(
            target=lambda: [until(lambda: len(parts_in(out)) > 0, 120), scheduler.kill()]
        )
        killer.start()
        code, _, err = run(*detect(street, out, *address))
        killer.join()
    assert code == 1
    told = "expected the scheduler to answer, got nothing; start it and run the command again"
    assert err.split("\n") == [f"rescore: --engine dask: {told}", ""]
    goes_on(run, street, out, whole, "--jobs", 1)


@needs_ray
def test_ctrl_c_and_the_death_of_rays_head(
    street: Path, tmp_path: Path, run: Run, whole: dict[str, bytes]
) -> None:
    out, stopped = tmp_path / "found", tmp_path / "stopped"
    interrupted(start(detect(street, stopped, "--engine", "ray", "--jobs", 2)), stopped)
    goes_on(run, street, stopped, whole, "--jobs", 1)
    process = start(detect(street, out, "--engine", "ray", "--jobs", 2))
    kill_ray_head(begun(process, out, 1))
    error = process.communicate(timeout=60)[1]
    assert process.returncode == 1
    # lines of Ray's own may stand before and behind
    (line,) = [each for each in error.splitlines() if each.startswith("rescore: ")]
    assert line.startswith("rescore: --engine ray: expected the head to answer, got")
    assert "Traceback" not in error
    goes_on(run, street, out, whole, "--jobs", 1)
