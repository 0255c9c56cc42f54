"""Processes of this machine: one a job, each renewed where it ends, and kept warm for the next records."""

import os
import pickle
import queue
import tempfile
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, ClassVar

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from recon.workers import end_with_parent, thread_limits
from rescore.engines.engine import Ended
from rescore.engines.shared import pickled, run, run_with

_IDLE_S = 300
"""Seconds after which a process that has nothing to do ends."""


class InProcess:
    """The engine of one job: this process, one task after another."""

    task_s: ClassVar[float] = 0.0

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any) -> None:
        self._function, self._shared = function, shared
        self._given: deque[tuple[int, Sequence[Any]]] = deque()

    def ahead(self) -> int:
        """One: a task is run when its result is asked for."""
        return 1

    def put(self, task: int, records: Sequence[Any], deaths: int) -> None:
        """Keep a task."""
        self._given.append((task, records))

    def take(self) -> Ended:
        """Run the task that was kept first."""
        return run(*self._given.popleft(), self._function, self._shared)

    def close(self) -> None:
        """Nothing is left to end."""


class _Process:
    """One process, and the tasks that it has, the one that runs first."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.has: deque[tuple[int, bytes]] = deque()
        """Numbers of tasks with their pickled records."""
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
"""Processes that wait for the next tasks: a new one takes seconds to import what it needs."""


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

    A process has one task that runs and one that waits. Where it ends, the first of them is held to be the
    cause and is given again with the other one, until it was the cause as often as it may.
    """

    task_s: ClassVar[float] = 0.0

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, jobs: int) -> None:
        handle, name = tempfile.mkstemp(prefix="rescore_shared_")
        with os.fdopen(handle, "wb") as file:
            file.write(pickled((function, shared)))
        self._shared = Path(name)
        self._processes = _processes(jobs)
        self._ended: queue.SimpleQueue[tuple[_Process, int, Future[bytes]]] = queue.SimpleQueue()
        self._deaths_left: dict[int, int] = {}

    def ahead(self) -> int:
        """Two tasks for each process."""
        return 2 * len(self._processes)

    def put(self, task: int, records: Sequence[Any], deaths: int) -> None:
        """Give a task to the process that has least."""
        self._deaths_left[task] = deaths
        self._give(min(self._processes, key=lambda p: len(p.has)), task, pickled(records))

    def _give(self, process: _Process, task: int, records: bytes) -> None:
        process.has.append((task, records))
        try:
            future = process.pool.submit(_run, self._shared, task, records)
        except BrokenProcessPool:
            if len(process.has) > 1:  # the others tell of its end, and this task is given again with them
                return
            process.renew()
            future = process.pool.submit(_run, self._shared, task, records)
        life = process.life
        future.add_done_callback(lambda done: self._ended.put((process, life, done)))

    def take(self) -> Ended:
        """What became of a task; a process that ended meanwhile is renewed."""
        while True:
            process, life, future = self._ended.get()
            if life != process.life:  # told once for each task that an ended process had
                continue
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                given_up = self._renewed(process)
                if given_up is not None:
                    return given_up
            elif error is not None:
                raise error
            else:
                ended: Ended = pickle.loads(future.result())
                process.has.popleft()
                del self._deaths_left[ended.task]
                return ended

    def _renewed(self, process: _Process) -> Ended | None:
        """Renew a process and give it back its tasks; without the first if that is given up."""
        process.renew()
        given, process.has = process.has, deque()
        first = given[0][0]
        self._deaths_left[first] -= 1
        given_up = not self._deaths_left[first]
        for task, records in given:
            if task != first or not given_up:
                self._give(process, task, records)
        return Ended(first, None) if given_up else None

    def close(self) -> None:
        """Keep the processes for the next tasks; end those that are still at work."""
        for process in self._processes:
            if process.has:
                process.end()
            else:
                _idle.append(process)
        self._shared.unlink(missing_ok=True)


def _run(path: Path, task: int, records: bytes) -> bytes:
    return run_with(path.name, path.read_bytes, task, records)
