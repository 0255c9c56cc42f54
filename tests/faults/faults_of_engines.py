"""Kills workers of each engine at random moments, the caller, and what gives the tasks out:
`python -m tests.faults.faults_of_engines`.

Prints a table of killed workers: nothing may be lost, nothing may come twice. Then one of runs in parts that
are stopped: the same command must go on, and end with the bytes of a run that nothing stopped. Engines that
are not installed are left out.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from rescore.engines.executor import Executor
from rescore.engines.map_frames import Failed, map_frames
from tests.conftest import ROOT
from tests.faults import small_parts
from tests.faults.clusters import dask_scheduler, free_port, kill_ray_head
from tests.faults.processes import alive, descendants, until

PACKAGES = {"joblib": "joblib", "dask": "distributed", "ray": "ray"}
FRAME_S = 0.05
BETWEEN_FRAMES = 10
"""Frames that are done between two kills, however slow the machine is; then comes a random wait."""
MOST_WAIT_S = 0.5
MOST_FRAMES = 100_000


@dataclass(frozen=True)
class Row:
    """What kills did to one engine."""

    engine: str
    kills: int
    frames: int
    lost: int
    twice: int
    set_aside: int
    begun_again: int

    def __str__(self) -> str:
        counts = (self.kills, self.frames, self.lost, self.twice, self.set_aside, self.begun_again)
        return f"| {self.engine} | " + " | ".join(map(str, counts)) + " |"


HEAD = """| engine | workers killed | frames | lost | twice | set aside | begun again |
|---|---:|---:|---:|---:|---:|---:|"""


def frame(number: int, folder: Path) -> int:
    """Work of some milliseconds that leaves a mark when it begins, and another at its end."""
    (folder / f"{number}_{os.getpid()}_{time.monotonic_ns()}").touch()
    until_s = time.process_time() + FRAME_S
    while time.process_time() < until_s:
        sum(range(1000))
    (folder / f"done_{number}").touch()
    return number


def kept_frame(number: int, folder: Path) -> int:
    """A frame whose file is its result; one that exists is not done again."""
    file = folder / f"frame_{number}"
    if not file.exists():
        frame(number, folder / "begun")
        beside = folder / f"beside_{number}_{os.getpid()}"
        beside.touch()
        beside.rename(file)
    return number


def random_kills(engine: str, kills: int, seed: int) -> Row:
    """Frames go on until so many workers were killed."""
    rng, over, killed = random.Random(seed), threading.Event(), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def kill() -> None:
            nonlocal killed
            done = 0
            while killed < kills:
                time.sleep(0.02)
                if len(list(folder.glob("done_*"))) < done + BETWEEN_FRAMES:
                    continue
                time.sleep(rng.uniform(0, MOST_WAIT_S))
                done = len(list(folder.glob("done_*")))
                workers = sorted({int(mark.name.split("_")[1]) for mark in folder.glob("[0-9]*")})
                living = [pid for pid in workers if alive(pid)]
                if living:
                    os.kill(rng.choice(living), signal.SIGKILL)
                    killed += 1
            over.set()

        def frames() -> Iterator[int]:
            for number in range(MOST_FRAMES):
                if over.is_set():
                    return
                yield number

        killer = threading.Thread(target=kill, daemon=True)
        killer.start()
        lost: list[Failed] = []

        def set_aside(failed: Failed) -> int:
            lost.append(failed)
            return -1

        executor = Executor.of(engine, 2, None)
        found = list(map_frames(frame, frames(), folder, executor, failed=set_aside))
        killer.join()
        begun = len(list(folder.glob("[0-9]*")))
    done = [n for n in found if n >= 0]
    n, once = len(found), len(set(done))
    return Row(engine, killed, n, n - once - len(lost), len(done) - once, len(lost), begun - n)


@dataclass(frozen=True)
class Resumed:
    """What became of a run whose command was killed and started again."""

    engine: str
    frames: int
    before: int
    """Frames that were done when it was killed."""
    processes: int
    """Those it had started."""
    gone_s: float
    """Time until they were gone."""
    after: int
    """Frames that are done in the end."""
    begun_twice: int

    def __str__(self) -> str:
        return (
            f"{self.engine}: caller killed after {self.before} of {self.frames} frames, its {self.processes} "
            f"processes gone in {self.gone_s:.1f} s; started again: {self.after} frames, {self.begun_twice} "
            "of them begun twice"
        )


def caller_killed(engine: str, frames: int, seed: int) -> Resumed:
    """A run whose command is killed at a random frame, then started again."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "begun").mkdir()
        command = [sys.executable, "-m", "tests.faults.faults_of_engines", "--run", engine, str(frames), name]
        first = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wanted = rng.randint(frames // 10, frames // 2)
        until(lambda: len(list(folder.glob("frame_*"))) >= wanted, 180)
        workers = descendants(first.pid)
        first.kill()
        first.wait()
        gone_s = until(lambda: not any(map(alive, workers)), 240)
        before = len(list(folder.glob("frame_*")))
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        after, begun = len(list(folder.glob("frame_*"))), len(list((folder / "begun").glob("[0-9]*")))
    return Resumed(engine, frames, before, len(workers), gone_s, after, begun - frames)


@dataclass(frozen=True)
class StoppedRun:
    """What became of a run in parts that was stopped, and of the same command after it."""

    what: str
    ended_s: float
    """Time until the command had ended, with one line of its own."""
    left: int
    """Processes that it had started and that were there still."""
    gone_s: float
    """Time until they were gone."""
    kept: int
    parts: int
    same: bool
    """Whether the same command then kept these parts and ended with the bytes of an undisturbed run."""

    def __str__(self) -> str:
        left = f"{self.left}, gone after {self.gone_s:.0f} s" if self.left else "0"
        same = "yes" if self.same else "NO"
        return f"| {self.what} | {self.ended_s:.0f} s | {left} | {self.kept} of {self.parts} | {same} |"


STOPPED_HEAD = """| what | the command ended after | processes left | parts kept | the same command goes on |
|---|---:|---:|---:|---|"""
FRAMES = 60
ENDS = {
    128 + signal.SIGINT: "rescore: detect stopped (SIGINT); parts of a table are kept",
    -signal.SIGKILL: "",
    1: "; start it and run the command again",
}
"""What the command says by its exit code."""


def stopped_runs(engine: str) -> Iterator[StoppedRun]:
    """What Ctrl-C, a kill of the command, and the death of what gives its tasks out do to a run in parts."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        street, _ = small_parts.write_street(folder / "street", FRAMES)
        whole = folder / "whole"
        _done(small_parts.detect(street, whole, "--jobs", 1))
        own = small_parts.detect(street, folder / "out", "--engine", engine, "--jobs", 2)
        yield _stopped(f"{engine}: Ctrl-C", own, folder / "out", whole, _ctrl_c)
        yield _stopped(f"{engine}: the command is killed", own, folder / "out", whole, _kill)
        if engine == "dask":
            port = free_port()
            address = ["--engine", "dask", "--address", f"tcp://127.0.0.1:{port}"]
            command = small_parts.detect(street, folder / "out", *address)
            with dask_scheduler(port, folder / "log") as scheduler:
                found = _stopped(
                    "dask: the scheduler dies", command, folder / "out", None, lambda *_: scheduler.kill()
                )
            with dask_scheduler(port, folder / "log"):
                yield replace(found, same=_goes_on(command, folder / "out", whole))
        elif engine == "ray":
            yield _stopped("ray: the head dies", own, folder / "out", whole, _kill_head)


def _stopped(
    what: str,
    command: list[str],
    out: Path,
    whole: Path | None,
    stop: Callable[["subprocess.Popen[str]", list[int]], None],
) -> StoppedRun:
    shutil.rmtree(out, ignore_errors=True)
    process = small_parts.start(command)
    until(lambda: len(small_parts.parts_in(out)) >= 2 or process.poll() is not None, 300)
    helpers = descendants(process.pid)
    start_s = time.monotonic()
    stop(process, helpers)
    told = process.communicate()[1]
    ended_s = time.monotonic() - start_s
    line = ENDS[process.returncode]
    assert told.count("rescore: ") == bool(line), told
    assert line in told, told
    left = [pid for pid in helpers if alive(pid)]
    gone_s = until(lambda: not any(map(alive, left)), 240)
    kept = len(small_parts.parts_in(out))
    same = whole is not None and _goes_on(command, out, whole)
    return StoppedRun(what, ended_s, len(left), gone_s, kept, FRAMES // small_parts.FRAMES_A_PART, same)


def _goes_on(command: list[str], out: Path, whole: Path) -> bool:
    there = {p.name: p.stat().st_mtime_ns for p in small_parts.parts_in(out)}
    _done(command)
    now = small_parts.parts_in(out)
    kept = there.items() <= {p.name: p.stat().st_mtime_ns for p in now}.items()
    made = {p.name: p.read_bytes() for p in now}
    return kept and made == {p.name: p.read_bytes() for p in small_parts.parts_in(whole)}


def _done(command: list[str]) -> None:
    process = small_parts.start(command)
    told = process.communicate()[1]
    assert process.returncode == 0, told


def _ctrl_c(process: "subprocess.Popen[str]", _helpers: list[int]) -> None:
    os.killpg(process.pid, signal.SIGINT)


def _kill(process: "subprocess.Popen[str]", _helpers: list[int]) -> None:
    process.kill()


def _kill_head(_process: "subprocess.Popen[str]", helpers: list[int]) -> None:
    kill_ray_head(helpers)


def main() -> None:
    """Print the tables, and between them a line for each engine whose caller was killed."""
    options = argparse.ArgumentParser(prog="python -m tests.faults.faults_of_engines", description=__doc__)
    options.add_argument("--kills", type=int, default=20, help="0 for the second table alone")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--engines", nargs="*", default=list(PACKAGES))
    options.add_argument("--run", nargs=3, metavar=("ENGINE", "FRAMES", "FOLDER"), help="what is killed")
    chosen = options.parse_args()
    if chosen.run:
        engine, frames, folder = chosen.run
        list(map_frames(kept_frame, range(int(frames)), Path(folder), Executor.of(engine, 2, None)))
        return
    present = [e for e in chosen.engines if find_spec(PACKAGES[e])]
    if chosen.kills:
        print(HEAD)
        for engine in present:
            print(random_kills(engine, chosen.kills, chosen.seed), flush=True)
        for engine in present:
            print(caller_killed(engine, 100, chosen.seed), flush=True)
    print(STOPPED_HEAD)
    for engine in present:
        for stopped in stopped_runs(engine):
            print(stopped, flush=True)


if __name__ == "__main__":
    main()
