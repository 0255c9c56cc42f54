"""Workers of a Dask cluster, one that runs or one of this machine."""

import pickle
import queue
import uuid
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from typing import Any

import dask
from distributed import Client, Future, KilledWorker, LocalCluster

from recon.errors import RescoreError
from rescore.engines.clusters import Ahead
from rescore.engines.engine import TRIES, Ended
from rescore.engines.executor import Executor
from rescore.engines.shared import pickled, run_with

_PATIENCE_S = 60
"""Seconds that a cluster has to answer, and to have a worker."""


class OnDask:
    """The engine of Dask.

    The scheduler gives records of dead workers to others. Where it gives one up, what waited behind it on the
    same worker is given up with it: so each of them is tried again while nothing else runs, and then a death
    is its own.
    """

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, executor: Executor) -> None:
        self._cluster = None if executor.address is not None else _local(executor.jobs)
        self._client = _connected(executor.address or self._cluster)
        self._name = f"rescore-{uuid.uuid4().hex}"
        # a task, not scattered data: Dask makes it again where all workers that held it are gone
        self._shared = self._client.submit(bytes, pickled((function, shared)), key=f"{self._name}-shared")
        self._ahead = Ahead(lambda: sum(self._client.nthreads().values()))
        self._ended: queue.SimpleQueue[tuple[int, Future]] = queue.SimpleQueue()
        self._given: dict[int, bytes] = {}
        self._deaths: dict[int, int] = {}
        self._suspects: deque[int] = deque()

    def ahead(self) -> int:
        """Two records for each worker; none while suspects are to be tried alone."""
        return 0 if self._suspects else self._ahead.records()

    def put(self, number: int, record: Any) -> None:
        """Give a record to the scheduler."""
        self._given[number] = pickled(record)
        self._submit(number)

    def _submit(self, number: int) -> None:
        deaths = self._deaths.get(number, 0)
        future = self._client.submit(
            _run,
            self._name,
            self._shared,
            self._given[number],
            number,
            # later ones first would keep the one whose turn it is waiting
            priority=-number,
            key=f"{self._name}-record-{number}-{deaths}",
            retries=TRIES - 1,
        )
        future.add_done_callback(lambda done: self._ended.put((number, done)))

    def take(self) -> Ended:
        """What became of a record."""
        while True:
            if self._suspects and len(self._suspects) == len(self._given):
                self._submit(self._suspects[0])
            number, future = self._ended.get()
            with _scheduler_lives():
                try:
                    ended: Ended = pickle.loads(future.result())
                except KilledWorker as killed:
                    if not self._is_set_aside(number, killed.allowed_failures + 1):
                        continue
                    ended = Ended(number, killed=True)
            del self._given[number]
            if number in self._suspects:
                self._suspects.remove(number)
            return ended

    def _is_set_aside(self, number: int, deaths: int) -> bool:
        """Count deaths of workers under a record; whether they were enough, the last ones its own."""
        alone = number in self._suspects
        self._deaths[number] = self._deaths.get(number, 0) + deaths
        if not alone:
            self._suspects.append(number)
        return alone and self._deaths[number] >= TRIES

    def close(self, finished: bool) -> None:
        """Cancel what runs, and leave the cluster; one of this machine ends."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def _run(name: str, shared: bytes, record: bytes, number: int) -> bytes:
    return run_with(name, lambda: shared, record, number)


def _local(jobs: int) -> LocalCluster:
    """A cluster of this machine, on the loopback address alone."""
    # the scheduler's own patience is for deaths that have nothing to do with the task
    return LocalCluster(
        n_workers=jobs,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        memory_limit=0,
        silence_logs="CRITICAL",
        scheduler_kwargs={"allowed_failures": 0},
    )


def _connected(where: Any) -> Client:
    try:
        client = Client(where, timeout=_PATIENCE_S, set_as_default=False)
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
            "dask: expected the scheduler to answer, got nothing; start it again and run the command again"
        ) from error
