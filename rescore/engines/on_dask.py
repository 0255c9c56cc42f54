"""Workers of a Dask cluster, one that runs or one of this machine."""

import atexit
import logging
import pickle
import queue
import signal
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, WorkerPlugin

from recon.errors import RescoreError
from rescore.engines.clusters import CONNECT_S, Crew, Greeting, wait_for_answer
from rescore.engines.engine import TRIES, Ended
from rescore.engines.executor import Executor
from rescore.engines.shared import pickled, run_with

_PATIENCE_S = 60
"""Seconds that a cluster has to have a worker."""
_MOST_BYTES = 2**20
_GREETING = Greeting(b"", lambda words: int.from_bytes(words[:8], "little") < _MOST_BYTES)
"""A scheduler speaks first: the length of its message in 8 bytes, and some hundred bytes of what it can."""


@dataclass
class _Given:
    """A task that is out."""

    records: bytes
    deaths: int
    """Deaths of workers after which it is given up."""
    alone: bool
    """Whether it is one record, which is tried by itself before it is given up."""
    died: int = 0
    """Deaths of workers that it may have caused so far."""


class OnDask:
    """The engine of Dask.

    The scheduler gives tasks of dead workers to others. Where it gives one up, it gives up what waited behind
    it on the same worker too. So a task of one record is tried again while nothing else runs: then a death is
    its own.
    """

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, executor: Executor) -> None:
        self._cluster = _Cluster.of(executor)
        self._client = self._cluster.client
        self._name = f"rescore-{uuid.uuid4().hex}"
        self._client.register_plugin(_Shared(self._name, pickled((function, shared))))
        self._crew = Crew(lambda: sum(self._client.nthreads().values()))
        self._ended: queue.SimpleQueue[tuple[int, Future]] = queue.SimpleQueue()
        self._given: dict[int, _Given] = {}
        self._suspects: deque[int] = deque()

    @property
    def task_s(self) -> float:
        """A second, more where there are many workers."""
        return self._crew.task_s

    def ahead(self) -> int:
        """Two tasks for each worker; none while suspects are to be tried alone."""
        return 0 if self._suspects else self._crew.ahead()

    def put(self, task: int, records: Sequence[Any], deaths: int) -> None:
        """Give a task to the scheduler."""
        self._given[task] = _Given(pickled(records), deaths, alone=len(records) == 1)
        self._submit(task)

    def _submit(self, task: int) -> None:
        given = self._given[task]
        key = f"{self._name}-task-{task}-{given.died}"
        arguments = (self._name, task, given.records)
        future = self._client.submit(_run, *arguments, key=key, retries=TRIES - 1)
        future.add_done_callback(lambda done: self._ended.put((task, done)))

    def take(self) -> Ended:
        """What became of a task."""
        while True:
            if self._suspects and len(self._suspects) == len(self._given):
                self._submit(self._suspects[0])
            task, future = self._ended.get()
            with _scheduler_lives():
                try:
                    ended: Ended = pickle.loads(future.result())
                except KilledWorker as killed:
                    if not self._is_given_up(task, killed.allowed_failures + 1):
                        continue
                    ended = Ended(task, None)
            del self._given[task]
            if task in self._suspects:
                self._suspects.remove(task)
            return ended

    def _is_given_up(self, task: int, deaths: int) -> bool:
        """Count deaths of workers under a task; whether it is to be given up."""
        given = self._given[task]
        given.died += deaths
        if not given.alone:
            return True
        was_alone = task in self._suspects
        if not was_alone:
            self._suspects.append(task)
        return was_alone and given.died >= given.deaths

    def close(self) -> None:
        """Cancel what is left; a cluster of this machine is ended then, since Dask lets what runs go on."""
        if self._given:
            self._cluster.end()
        else:
            with suppress(OSError):  # of a scheduler that is gone
                self._client.unregister_worker_plugin(self._name)


class _Shared(WorkerPlugin):  # type: ignore[misc] # which has no types
    """What all records share, on its way to each worker, also to those that come later.

    Scattered data would be gone with the last worker that has it.
    """

    def __init__(self, name: str, shared: bytes) -> None:
        self.name = name
        self._shared = shared

    def setup(self, worker: Any) -> None:
        """Keep it in a worker."""
        _shared_here[self.name] = self._shared

    def teardown(self, worker: Any) -> None:
        """Let it go."""
        _shared_here.pop(self.name, None)


class _LeavesCtrlC(WorkerPlugin):  # type: ignore[misc] # which has no types
    """Workers of a terminal get its Ctrl-C too; the command is to end them, without a word of theirs."""

    def setup(self, worker: Any) -> None:
        """Ignore it."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)


_shared_here: dict[str, bytes] = {}
"""In a worker: what it was given, by name."""


def _run(name: str, task: int, records: bytes) -> bytes:
    return run_with(name, lambda: _shared_here[name], task, records)


class _Cluster:
    """A connection to a cluster, and the cluster itself if it was started here; kept for the next records."""

    _open: ClassVar[dict[Executor, "_Cluster"]] = {}

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._own = None if executor.address is not None else _local(executor.jobs)
        self.client = _connected(executor.address or self._own)
        if self._own is not None:
            self.client.register_plugin(_LeavesCtrlC())
        atexit.register(self.end)

    @staticmethod
    def of(executor: Executor) -> "_Cluster":
        """The cluster of an executor."""
        if executor not in _Cluster._open:
            _Cluster._open[executor] = _Cluster(executor)
        return _Cluster._open[executor]

    def end(self) -> None:
        """Leave the cluster, which cancels what waits; one of this machine ends."""
        atexit.unregister(self.end)
        _Cluster._open.pop(self._executor, None)
        self.client.close()
        if self._own is not None:
            self._own.close()


def _local(jobs: int) -> LocalCluster:
    """A cluster of this machine, on the loopback address alone."""
    dask.config.set(
        {
            # what is sampled for a dashboard, which is not shown, would cost a tenth of a processor
            "distributed.worker.profile.enabled": False,
            "distributed.admin.system-monitor.interval": "10s",
            "distributed.admin.tick.interval": "1s",
            # a worker that is being replaced just then would be given up for good
            "distributed.deploy.lost-worker-timeout": "365 days",
        }
    )
    try:
        return LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
            silence_logs="CRITICAL",
            # each death is counted here, and what only waited on the worker is no suspect for long
            scheduler_kwargs={"allowed_failures": 0},
        )
    except RuntimeError as error:
        raise RescoreError(
            f"--engine dask: expected {jobs} workers to start, got {error}; a script of one's own needs "
            '`if __name__ == "__main__":`'
        ) from error


def wait_for_scheduler(address: str) -> None:
    """Nothing, once a scheduler answers; RescoreError where none does within seconds."""
    greeting = None if address.startswith("tls://") else _GREETING
    wait_for_answer(address, "tcp://HOST:PORT of a Dask scheduler", "dask scheduler --port PORT", greeting)


def _connected(where: Any) -> Client:
    # of a scheduler that is gone, one line is told here
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
    if isinstance(where, str):
        wait_for_scheduler(where)
    try:
        client = Client(where, timeout=CONNECT_S, set_as_default=False)
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise RescoreError(
            f"--address {where}: expected a Dask scheduler with workers, got {error}; start it, or leave the "
            "option out"
        ) from error
    return client


@contextmanager
def _scheduler_lives() -> Iterator[None]:
    try:
        yield
    except (CancelledError, OSError) as error:
        raise RescoreError(
            "--engine dask: expected the scheduler to answer, got nothing; start it and run the command again"
        ) from error
