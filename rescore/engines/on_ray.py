"""Workers of a Ray cluster, one that runs or one of this machine."""

import os
import pickle
import signal
import socket
import sys
import threading
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError

from recon.errors import RescoreError
from rescore.engines.clusters import Crew, Greeting, wait_for_answer
from rescore.engines.engine import TRIES, Ended
from rescore.engines.executor import Executor
from rescore.engines.shared import pickled, run_with

_PATIENCE_S = 20
"""Seconds that the head has to take a connection."""
_START = "ray start --head"
_SETTINGS = 4
_GREETING = Greeting(
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, _SETTINGS, 0, 0, 0, 0, 0]),
    lambda words: words[3] == _SETTINGS,
)
"""A head speaks gRPC, so HTTP/2 (RFC 9113, section 3.4): each side begins with a frame of settings, whose
kind is its fourth byte."""
_LOOK_S = 2.0
"""Seconds without a result after which it is asked whether the head still lives."""


class OnRay:
    """The engine of Ray, which runs the task of a dead worker again by itself.

    It stays connected until this process ends, since a cluster takes seconds to start.
    """

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, executor: Executor) -> None:
        if not ray.is_initialized():
            with _same_handlers():
                _connect(executor)
        self._name = uuid.uuid4().hex
        self._shared = ray.put(pickled((function, shared)))
        self._run = ray.remote(_run)
        self._crew = Crew(_processors)
        self._given: dict[Any, int] = {}

    @property
    def task_s(self) -> float:
        """A second, more where there are many workers."""
        return self._crew.task_s

    def ahead(self) -> int:
        """Two tasks for each processor of the cluster."""
        return self._crew.ahead()

    def put(self, task: int, records: Sequence[Any], deaths: int) -> None:
        """Give a task to the cluster."""
        # in a list, so that it is read once a worker and not once a task
        run = self._run.options(max_retries=deaths - 1, num_cpus=1)
        self._given[run.remote(self._name, [self._shared], task, pickled(records))] = task

    def take(self) -> Ended:
        """What became of a task."""
        with _signals_pass():
            ended: list[Any] = []
            while not ended:
                ended, _ = ray.wait(list(self._given), num_returns=1, timeout=_LOOK_S)
                if not ended:
                    _refuse_dead_head()
            return self._result(ended[0])

    def _result(self, ended: Any) -> Ended:
        try:
            result: Ended = pickle.loads(ray.get(ended))
        except RayError:
            # where the head is gone, no task is to blame
            _refuse_dead_head()
            result = Ended(self._given[ended], None)
        del self._given[ended]
        return result

    def close(self) -> None:
        """Cancel what is left, and interrupt what runs."""
        # by force, Ray ends this process where a task is done just then
        for done in self._given if _head_error() is None else ():
            ray.cancel(done, force=False)


def _run(name: str, shared: list[Any], task: int, records: bytes) -> bytes:
    return run_with(name, lambda: ray.get(shared[0]), task, records)


@contextmanager
def _same_handlers() -> Iterator[None]:
    """Inside, Ray may set handlers of signals: its own aborts where the command is to end with one line."""
    main = threading.current_thread() is threading.main_thread()
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)} if main else {}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _signals_pass() -> Iterator[None]:
    """Inside, what a handler of signals raises comes out as it is; Ray makes an error of its own of it."""
    try:
        yield
    except SystemError as error:
        raise error.__cause__ or error from None


def _processors() -> int:
    """Processors of the cluster."""
    # of a head that is gone Ray asks for a minute, and then ends this process without a word
    _refuse_dead_head()
    return int(ray.cluster_resources().get("CPU", 0))


def _head_error() -> OSError | None:
    """What comes of a connection to the head; None where it answers."""
    host, _, port = ray.get_runtime_context().gcs_address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE_S).close()
    except OSError as error:
        return error
    return None


def _refuse_dead_head() -> None:
    """Raises RescoreError where the head does not answer."""
    error = _head_error()
    if error is not None:
        raise RescoreError(
            f"--engine ray: expected the head to answer, got {error}; start it and run the command again"
        ) from error


def address_of(named: str) -> str:
    """The address of a head; "auto" stands for that of Ray's environment, or of `ray start` on this machine.

    Ray itself would also take the head of any program that runs here, and wait for minutes where that is not
    for others.
    """
    if named != "auto":
        return named
    temporary = os.environ.get("TMPDIR", "/tmp") if sys.platform.startswith("linux") else "/tmp"
    file = Path(os.environ.get("RAY_TMPDIR", temporary)) / "ray" / "ray_current_cluster"
    found = os.environ.get("RAY_ADDRESS") or (file.read_text().strip() if file.is_file() else "")
    if not found:
        raise RescoreError(
            f"--address auto: expected a Ray cluster of this machine, got none; start a head by `{_START}`, "
            "name HOST:PORT, or leave the option out"
        )
    return found


def wait_for_head(address: str) -> None:
    """Nothing, once a head answers; RescoreError where none does within seconds."""
    encrypted = os.environ.get("RAY_USE_TLS", "0").lower() in {"1", "true"}
    wait_for_answer(address, "HOST:PORT of a Ray head", _START, None if encrypted else _GREETING)


def _connect(executor: Executor) -> None:
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "CRITICAL"}
    try:
        if executor.address is not None:
            wait_for_head(address_of(executor.address))
            # by its own word "auto", Ray also takes the token that this machine's head asks for
            ray.init(executor.address, **quiet)
            return
        # a record that needs more memory than there is must not be tried for ever
        patience = {"task_oom_retries": TRIES - 1}
        ray.init("local", num_cpus=executor.jobs, include_dashboard=False, _system_config=patience, **quiet)
    except (ConnectionError, OSError, RuntimeError, ValueError) as error:
        where, why = executor.address or "local", " ".join(str(error).split())
        raise RescoreError(
            f"--address {where}: expected a Ray cluster, got {why}; start it, set RAY_AUTH_MODE=token where "
            "its head asks for one, or leave the option out"
        ) from error
