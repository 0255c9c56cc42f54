"""Commands that are killed, that meet each other, and that run out of disk."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.data.pictures import is_whole_png_file
from rescore.locks import LOCK, locked
from tests.conftest import ROOT
from tests.faults.inputs import detections
from tests.faults.processes import alive, descendants
from tests.reports.fake_run import make_run
from tests.rescore import own_data as own


def start(*arguments: object) -> "subprocess.Popen[str]":
    """The command as a process of its own; its helpers are its children."""
    command = [sys.executable, "-m", "rescore.cli", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def wait_for(what: str, condition: "Iterator[bool]", limit_s: float = 90.0) -> None:
    until = time.monotonic() + limit_s
    while not next(condition):
        assert time.monotonic() < until, f"{what}: not in {limit_s} s"
        time.sleep(0.02)


def frames_in(folder: Path, n: int) -> "Iterator[bool]":
    while True:
        yield len(list((folder / "records").glob("[!.]*.json"))) >= n


def held_by(folder: Path, process: int) -> "Iterator[bool]":
    """Whether the lock of a folder names a process, as it does once that process has it."""
    while True:
        text = (folder / LOCK).read_text() if (folder / LOCK).is_file() else ""
        yield f'"process": {process},' in text


def gone(processes: list[int]) -> "Iterator[bool]":
    while True:
        yield not any(alive(p) for p in processes)


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    splits = {name: {"n_images": 3, "n_cars": 3} for name in ("train", "calibration", "validation", "test")}
    return own.write_text(tmp_path / "small.json", json.dumps({"synth": {"n_pictures": 1, "splits": splits}}))


def test_a_stopped_build_says_so_goes_on_and_is_locked_meanwhile(tmp_path: Path, settings: Path) -> None:
    """SIGTERM, SIGKILL and Ctrl-C, each at another frame of one build, which then ends."""
    out = tmp_path / "data"
    build = ("synth", out, "--preset", "tiny", "--config", settings, "--jobs", 2)
    for how, code in ((signal.SIGTERM, 143), (signal.SIGKILL, -9), (signal.SIGINT, 130)):
        there = len(list((out / "records").glob("[!.]*.json")))
        process = start(*build)
        # more than the build before left: its helpers are at work, and frames are left for them
        wait_for("frames", frames_in(out, there + 1))
        wait_for("lock", held_by(out, process.pid))
        with pytest.raises(RescoreError, match=f"{out}: expected no other .*, got process {process.pid} of"):
            locked(out).__enter__()
        helpers = descendants(process.pid)
        assert helpers
        process.send_signal(how)
        error = process.communicate(timeout=60)[1]
        assert process.returncode == code
        if how is not signal.SIGKILL:
            (line,) = [each for each in error.splitlines() if each.startswith("rescore: ")]
            kept = "finished frames are kept; run the command again to go on"
            assert line == f"rescore: synth stopped ({how.name}); {kept}"
            assert "Traceback" not in error
        wait_for("helpers end", gone(helpers), limit_s=10)
        # what a build notes as done is whole
        for record in (out / "records").glob("[!.]*.json"):
            assert all(is_whole_png_file(out / kind / f"{record.stem}.png") for kind in ("left", "truth"))
    kept = {p: p.stat().st_mtime_ns for p in (out / "records").glob("[!.]*.json")}
    (out / "left" / "test_0000.png").write_bytes(b"cut")
    last = start(*build)
    last.communicate(timeout=120)
    assert last.returncode == 0
    assert len(list((out / "records").glob("[!.]*.json"))) == 12
    again = {p.stem for p, t in kept.items() if p.stat().st_mtime_ns != t}
    assert again <= {"test_0000"}
    assert is_whole_png_file(out / "left" / "test_0000.png")
    assert [p.name for p in out.rglob(".*")] == []


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_recording_leaves_nothing(tmp_path: Path, how: signal.Signals) -> None:
    run = make_run(tmp_path / "run", n_frames=40)
    process = start("log", run, "--out", tmp_path / "out" / "a.rrd")
    wait_for("the recording begins", begun(tmp_path / "out"))
    process.send_signal(how)
    error = process.communicate(timeout=60)[1]
    assert process.returncode == 128 + how
    assert error.splitlines()[-1] == (
        f"rescore: log stopped ({how.name}); no half-written file is left; run the command again"
    )
    assert list((tmp_path / "out").iterdir()) == []


def begun(folder: Path) -> "Iterator[bool]":
    while True:
        yield folder.is_dir() and any(folder.iterdir())


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 2 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if (
        os.geteuid()
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(disk)], check=False, capture_output=True
        ).returncode
    ):
        pytest.skip("no disk of our own may be mounted here")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


@pytest.mark.parametrize("left_kb", [0, 8, 100])
@pytest.mark.parametrize("command", ["import", "log", "convert", "report"])
def test_a_full_disk_is_one_line_and_leaves_nothing(
    tmp_path: Path, small_disk: Path, command: str, left_kb: int
) -> None:
    fill(small_disk / "filler", left_kb)
    data, out = tmp_path / "data", small_disk / "out"
    own.own_folder(data)
    for i in (1, 2):  # pictures that are larger than what is left
        noise = np.random.default_rng(i).integers(0, 255, (own.HEIGHT, own.WIDTH, 3), np.uint8)
        (data / "left" / f"{i}.png").write_bytes(
            own.write_png(tmp_path / "x.png", noise).read_bytes() + bytes(90_000)
        )
    if command in ("log", "report"):
        make_run(tmp_path / "run", n_frames=2)
    arguments = {
        "import": ("import", data, "--copy", "--out", out),
        "convert": ("convert", data, "--out", out),
        "log": ("log", tmp_path / "run", "--out", out / "a.rrd"),
        "report": ("report", tmp_path / "run", "--out", out / "a.html"),
    }[command]
    process = start(*arguments)
    _, error = process.communicate(timeout=100)
    if process.returncode == 0:
        # text of a few bytes may fit
        assert (command, left_kb > 0) == ("convert", True)
        return
    assert process.returncode == 1, error
    (line,) = [each for each in error.splitlines() if each.startswith("rescore: ")]
    assert str(out) in line.split(": expected", 1)[0]
    assert "expected to write here, got" in line
    assert "Traceback" not in error
    written = [p for p in out.rglob("*") if p.is_file() and p.name != LOCK] if out.exists() else []
    assert not [p for p in written if p.stat().st_size == 0 or ".partial" in p.name]
    for copy in (p for p in written if p.suffix == ".png"):
        assert copy.read_bytes() == (data / copy.relative_to(out)).read_bytes()


def fill(path: Path, left_kb: int) -> None:
    """Fill the disk but for so many kilobytes."""
    free = shutil.disk_usage(path.parent).free - left_kb * 1024
    path.write_bytes(bytes(free))


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (("localize", "--cars", 1, "--placements", 1), "--out"),
        (("learn-primitives",), "--out"),
        (("study-models",), "--out"),
    ],
)
def test_targets_are_refused_before_the_work(
    tmp_path: Path, command: tuple[object, ...], option: str
) -> None:
    (tmp_path / "file").write_text("mine")
    target = tmp_path if command[0] == "learn-primitives" else tmp_path / "file"
    process = start(*command, option, target)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 1
    (line,) = [each for each in error.splitlines() if each.startswith("rescore: ")]
    assert "expected" in line
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("target", ["/dev/null", "pipe", "", "."])
def test_a_file_is_not_put_in_place_of_a_device_or_folder(tmp_path: Path, target: str) -> None:
    own.own_folder(tmp_path / "data")
    os.mkfifo(tmp_path / "pipe")
    name = str(tmp_path / target) if target == "pipe" else target
    before = os.lstat(name or ".")
    process = start("report", make_run(tmp_path / "run", n_frames=1), "--out", name)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 1
    assert error.startswith("rescore: ")
    assert len(error.splitlines()) == 1
    assert os.path.samestat(before, os.lstat(name or "."))


@pytest.mark.parametrize("command", ["reproduce", "synth", "import", "evaluate"])
def test_two_at_once_are_refused(tmp_path: Path, command: str) -> None:
    data, out = own.own_folder(tmp_path / "data"), tmp_path / "out"
    found = detections(data)
    arguments = {
        "reproduce": ("--preset", "tiny", "--out", out),
        "synth": (out, "--preset", "tiny"),
        "import": (data, "--out", out),
        "evaluate": (data, found, "--out", out, "--split", "all", "--no-report"),
    }[command]
    with locked(out):
        process = start(command, *arguments)
        error = process.communicate(timeout=100)[1]
    assert process.returncode == 1
    assert f"{out}: expected no other process to write here, got process {os.getpid()} of" in error
    assert not out.exists()
