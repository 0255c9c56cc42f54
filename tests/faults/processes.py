"""Processes that a process started, and whether they run, as Linux tells."""

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path


def descendants(process: int) -> list[int]:
    """Processes that a process started, and what they started."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if parent == process:
            found += [int(stat.parent.name), *descendants(int(stat.parent.name))]
    return found


def alive(process: int) -> bool:
    """Whether a process runs; one that only waits to be asked for its exit code does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def name_of(process: int) -> str:
    """The program that a process runs; "" where it is gone."""
    try:
        return Path(f"/proc/{process}/comm").read_text().strip()
    except OSError:
        return ""


def send(processes: list[int], how: signal.Signals) -> None:
    """A signal for all of them that are not gone."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, how)


def until(condition: Callable[[], bool], limit_s: float) -> float:
    """Wait for a condition; returns the seconds it took."""
    start_s = time.monotonic()
    while not condition():
        assert time.monotonic() < start_s + limit_s, f"not in {limit_s} s"
        time.sleep(0.05)
    return time.monotonic() - start_s
