"""Processes of this machine: one a job, each renewed where it ends, and kept warm for the next records."""

import os
import pickle
import queue
import tempfile
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from recon.workers import end_with_parent, thread_limits
from rescore.engines.engine import TRIES, Ended
from rescore.engines.shared import pickled, run, run_with

_IDLE_S = 300
"""Seconds after which a process that has nothing to do ends."""


class InProcess:
    """The engine of one job: this process, one record after another."""

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any) -> None:
        self._function, self._shared = function, shared
        self._given: deque[tuple[int, Any]] = deque()

    def ahead(self) -> int:
        """One: a record is run when its result is asked for."""
        return 1

    def put(self, number: int, record: Any) -> None:
        """Keep a record."""
        self._given.append((number, record))

    def take(self) -> Ended:
        """Run the record that was kept first."""
        number, record = self._given.popleft()
        return run(self._function, record, self._shared, number)

    def close(self, finished: bool) -> None:
        """Nothing is left to end."""


class _Process:
    """One process, and the records that it has, the one that runs first."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.has: deque[tuple[int, bytes]] = deque()
        self.life = 0
        self.renew()

    def renew(self) -> None:
        """Put a new process in the place of one that ended."""
        self.life += 1
        self.pool = ProcessPoolExecutor(
            max_workers=1,
            timeout=_IDLE_S,
            initializer=end_with_parent,
            initargs=(os.getpid(),),
            env=thread_limits(self.threads),
        )

    def end(self) -> None:
        """End the process at once."""
        self.pool.shutdown(kill_workers=True)


_idle: list[_Process] = []
"""Processes that wait for the next records: a new one takes seconds to import what it needs."""


def _processes(jobs: int) -> list[_Process]:
    """Processes that have nothing to do, so many; those that wait for other work are ended."""
    threads = max((os.cpu_count() or 1) // jobs, 1)
    fit = [p for p in _idle if p.threads == threads][:jobs]
    for process in _idle:
        if process not in fit:
            process.end()
    _idle.clear()
    return fit + [_Process(threads) for _ in range(jobs - len(fit))]


class Processes:
    """The engine of several jobs.

    A process has one record that runs and one that waits. Where it ends, the first of them is held to be the
    cause and is given again with the other one, until it was the cause ``TRIES`` times.
    """

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, jobs: int) -> None:
        handle, name = tempfile.mkstemp(prefix="rescore_shared_")
        with os.fdopen(handle, "wb") as file:
            file.write(pickled((function, shared)))
        self._shared = Path(name)
        self._processes = _processes(jobs)
        self._ended: queue.SimpleQueue[tuple[_Process, int, int, Future[bytes]]] = queue.SimpleQueue()
        self._deaths: dict[int, int] = {}

    def ahead(self) -> int:
        """Two records for each process."""
        return 2 * len(self._processes)

    def put(self, number: int, record: Any) -> None:
        """Give a record to the process that has least."""
        self._give(min(self._processes, key=lambda p: len(p.has)), number, pickled(record))

    def _give(self, process: _Process, number: int, record: bytes) -> None:
        process.has.append((number, record))
        try:
            future = process.pool.submit(_run, self._shared, record, number)
        except BrokenProcessPool:
            if len(process.has) > 1:  # the others tell of its end, and this record is given again with them
                return
            process.renew()
            future = process.pool.submit(_run, self._shared, record, number)
        life = process.life
        future.add_done_callback(lambda done: self._ended.put((process, life, number, done)))

    def take(self) -> Ended:
        """What became of a record; a process that ended meanwhile is renewed."""
        while True:
            process, life, number, future = self._ended.get()
            if life != process.life:  # told once for each record that an ended process had
                continue
            error = future.exception()
            if error is None:
                ended: Ended = pickle.loads(future.result())
            elif isinstance(error, BrokenProcessPool):
                set_aside = self._renewed(process)
                if set_aside is None:
                    continue
                return set_aside
            else:
                raise error
            process.has = deque(given for given in process.has if given[0] != number)
            return ended

    def _renewed(self, process: _Process) -> Ended | None:
        """Renew a process and give it back its records; without the first if that is set aside."""
        process.renew()
        given, process.has = process.has, deque()
        first = given[0][0]
        self._deaths[first] = self._deaths.get(first, 0) + 1
        set_aside = self._deaths[first] == TRIES
        for number, record in given:
            if number != first or not set_aside:
                self._give(process, number, record)
        return Ended(first, killed=True) if set_aside else None

    def close(self, finished: bool) -> None:
        """Keep the processes for the next records; end those that are still at work."""
        for process in self._processes:
            if process.has:
                process.end()
            else:
                _idle.append(process)
        self._shared.unlink(missing_ok=True)



def _run(path: Path, record: bytes, number: int) -> bytes:
    return run_with(path.name, path.read_bytes, record, number)
