"""What each engine costs a frame: processor time of all its processes against that of the frame alone."""

import os
import statistics
import time
from importlib.util import find_spec

import numpy as np
import psutil

from reports.publishing.bench_file import Row
from rescore.engines.executor import Executor
from rescore.engines.map_frames import map_frames

FRAME_S = 0.1
FRAMES = 40
REPEATS = 3
WANTED = {"joblib": 1.1, "dask": 1.15, "ray": 1.15}
PACKAGES = {"dask": "distributed", "ray": "ray"}


def engines() -> list[Row]:
    """Frames of 100 ms by each engine with two workers."""
    rounds = rounds_of(FRAME_S)
    return [_row(name, wanted, rounds) for name, wanted in WANTED.items() if _installed(name)]


def _installed(engine: str) -> bool:
    return engine not in PACKAGES or find_spec(PACKAGES[engine]) is not None


def busy(_number: int, rounds: int) -> float:
    """Work of a fixed number of steps, and the processor time that it took."""
    start_s = time.process_time()
    value = np.arange(1000.0)
    for _ in range(rounds):
        value = np.sqrt(value + 1.0)
    return time.process_time() - start_s


def rounds_of(seconds: float) -> int:
    """Steps that take so long, in one process."""
    busy(0, 10_000)
    return max(1, round(10_000 * seconds / statistics.median(busy(0, 10_000) for _ in range(5))))


def _row(engine: str, wanted: float, rounds: int) -> Row:
    executor = Executor.of(engine, 2, None)
    list(map_frames(busy, range(FRAMES), rounds, executor))
    spent = [spent_s(rounds, executor) for _ in range(REPEATS)]
    ratio = statistics.median(all_s / frames_s for all_s, frames_s in spent)
    ours_ms, bare_ms = (1e3 * statistics.median(times) / FRAMES for times in zip(*spent, strict=True))
    what = f"a frame of 100 ms by {engine}, two workers: all processes / the function alone"
    return Row(what, ratio, "ratio", wanted, ours_ms=ours_ms, bare_ms=bare_ms)


def spent_s(rounds: int, executor: Executor) -> tuple[float, float]:
    """Processor seconds of this process and all that it started, and those of the function in the same run.

    One process that does the work spends the latter; apart, the two would differ by what else a machine does.
    """
    before = _processor_s()
    in_function = sum(map_frames(busy, range(FRAMES), rounds, executor))
    return _processor_s() - before, in_function


def _processor_s() -> float:
    """Processor time so far of this process and of those under it."""
    family = [psutil.Process(os.getpid()), *psutil.Process(os.getpid()).children(recursive=True)]
    times = (process.cpu_times() for process in family)
    return sum(t.user + t.system for t in times)
