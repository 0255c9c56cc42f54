"""Clusters on the loopback address that are started by their own commands, to be killed."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.faults.processes import alive, descendants, name_of, send, until

_ROOT = Path(__file__).parents[2]


def free_port() -> int:
    """A port that nothing listens to."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@contextmanager
def started(command: list[str], log: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """Inside, a command of the environment runs; with all that it started it ends then."""
    program = str(Path(sys.executable).parent / command[0])
    # what workers are given to do may be of the tests, which are not installed
    environment = os.environ | {"PYTHONPATH": str(_ROOT)}
    with log.open("ab") as file:
        process = subprocess.Popen([program, *command[1:]], stdout=file, stderr=file, env=environment)
    try:
        yield process
    finally:
        end([process.pid])
        process.wait()


def end(processes: list[int]) -> None:
    """Kill processes and what they started."""
    every = [pid for first in processes for pid in (first, *descendants(first))]
    send([pid for pid in every if alive(pid)], signal.SIGKILL)


def kill_ray_head(processes: list[int]) -> None:
    """Kill Ray's head with the workers of its machine, which would else finish the run if it is short."""
    names = ("gcs_server", "raylet", "ray::")
    send([pid for pid in processes if name_of(pid).startswith(names)], signal.SIGKILL)


@contextmanager
def dask_scheduler(port: int, log: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """Inside, a scheduler of Dask has two workers."""
    where = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    workers = ["--nworkers", "2", "--nthreads", "1", "--no-dashboard"]
    with started(["dask", "scheduler", *where], log) as scheduler:
        until(lambda: answers(port), 60)
        with started(["dask", "worker", f"tcp://127.0.0.1:{port}", *workers], log):
            yield scheduler


def answers(port: int) -> bool:
    """Whether something listens to a port."""
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1).close()
    except OSError:
        return False
    return True
