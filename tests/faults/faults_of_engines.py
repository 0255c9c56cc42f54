"""Kills workers of each engine at random moments, and the caller: `python -m tests.faults.faults_of_engines`.

Prints a table: nothing may be lost, nothing may come twice. Engines that are not installed are left out.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from rescore.engines.executor import Executor
from rescore.engines.map_frames import Failed, map_frames
from tests.conftest import ROOT
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


def main() -> None:
    """Print the table, then a line for each engine whose caller was killed."""
    options = argparse.ArgumentParser(prog="python -m tests.faults.faults_of_engines", description=__doc__)
    options.add_argument("--kills", type=int, default=20)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--engines", nargs="*", default=list(PACKAGES))
    options.add_argument("--run", nargs=3, metavar=("ENGINE", "FRAMES", "FOLDER"), help="what is killed")
    chosen = options.parse_args()
    if chosen.run:
        engine, frames, folder = chosen.run
        list(map_frames(kept_frame, range(int(frames)), Path(folder), Executor.of(engine, 2, None)))
        return
    present = [e for e in chosen.engines if find_spec(PACKAGES[e])]
    print(HEAD)
    for engine in present:
        print(random_kills(engine, chosen.kills, chosen.seed), flush=True)
    for engine in present:
        print(caller_killed(engine, 100, chosen.seed), flush=True)


if __name__ == "__main__":
    main()
