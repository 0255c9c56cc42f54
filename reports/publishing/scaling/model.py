"""A model of a cluster: one process gives tasks out, a scheduler passes them on, and workers share a store.

Workers die, and some are slow.
"""

import heapq
from collections import deque
from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray


@dataclass(frozen=True)
class Cluster:
    """What a run meets; rates are stated, not measured, where ``recorded`` says nothing of them."""

    workers: int
    task_s: float
    """Seconds of work that a task holds."""
    caller_task_s: float
    """Seconds of the process that gives tasks out, a task; it does one at a time."""
    caller_frame_s: float
    """Seconds of that process, a frame."""
    scheduler_task_s: float = 0.0
    """Seconds of the scheduler, a task; it does one at a time too."""
    latency_s: float = 0.002
    """One way between that process and a worker."""
    store_bytes_s: float = 3e9
    """What the store of the pictures gives all workers together."""
    spread: float = 0.1
    """Standard deviation of the logarithm of the speeds of workers."""
    slow_share: float = 0.005
    """Share of the tasks that take ``slow_times`` as long."""
    slow_times: float = 5.0
    deaths_per_hour: float = 0.1
    """Rate at which one worker dies."""
    renewal_s: float = 30.0
    """From a death to a worker that takes tasks again."""
    noticed_s: float = 5.0
    """From a death to its task being given out again."""
    ahead: int = 2
    """Tasks that are out for each worker."""
    held: int = 4
    """Times as many may be done ahead of the one whose turn it is."""


@dataclass(frozen=True)
class Replayed:
    """What a run took."""

    makespan_s: float
    efficiency: float
    """Time in frames over the time of all workers."""
    caller_busy: float
    """Share of the time in which the process that gives tasks out was at work."""
    scheduler_busy: float
    """Share of the time in which the scheduler was."""
    store_busy: float
    """Share of what the store gives that was asked for."""
    deaths: int


def replay(frame_s: FloatArray, read_bytes: float, frames: int, cluster: Cluster, seed: int) -> Replayed:
    """A run of so many frames, whose times are drawn from a trace, through a cluster.

    Args:
        frame_s: times of the frames of the trace, shape (n,), in seconds.
        read_bytes: bytes that a frame reads from the store.
        frames: number of frames.
        cluster: the model.
        seed: of every random choice.
    """
    rng = np.random.default_rng(seed)
    size = max(1, round(cluster.task_s / float(frame_s.mean())))
    n_tasks = -(-frames // size)
    work_s = rng.choice(frame_s, (n_tasks, size)).sum(axis=1)
    run = _Run(cluster, work_s, size, read_bytes, rng)
    makespan_s = run.to_the_end()
    total_s = float(work_s.sum())
    return Replayed(
        makespan_s,
        total_s / (cluster.workers * makespan_s),
        n_tasks * run.caller_s / makespan_s,
        n_tasks * cluster.scheduler_task_s / makespan_s,
        n_tasks * size * read_bytes / cluster.store_bytes_s / makespan_s,
        run.deaths,
    )


class _Run:
    """The state of a run: who has which task, and when the process that gives them out is free."""

    def __init__(
        self, cluster: Cluster, work_s: FloatArray, size: int, read_bytes: float, rng: np.random.Generator
    ) -> None:
        self.cluster = cluster
        self.caller_s = cluster.caller_task_s + size * cluster.caller_frame_s
        self.deaths = 0
        slow = np.where(rng.random(len(work_s)) < cluster.slow_share, cluster.slow_times, 1.0)
        self._takes_s = (work_s * slow).tolist()
        # their mean is one, so that the workers together are as fast as that many of speed one
        speed = np.exp(rng.normal(0, cluster.spread, cluster.workers))
        self._speed = (speed / speed.mean()).tolist()
        self._store_s = size * read_bytes / cluster.store_bytes_s
        self._rng = rng
        self._again: deque[tuple[float, int]] = deque()
        """Tasks of dead workers, from when on they are given out again."""
        self._next, self._turn = 0, 0
        self._done: set[int] = set()
        self._caller_free_s, self._scheduler_free_s, self._store_free_s = 0.0, 0.0, 0.0
        self._has: list[deque[tuple[float, int]]] = [deque() for _ in range(cluster.workers)]
        """Tasks of each worker that have not begun, from when on it has them."""
        self._events: list[tuple[float, int, int, bool]] = []
        """When a worker ends a task, the worker, the task, and whether it dies of something then."""
        self._running = [False] * cluster.workers
        self._dead = [False] * cluster.workers
        self._starved: deque[int] = deque()
        """Workers that could have one more task than there was to give."""

    def to_the_end(self) -> float:
        """Run all tasks; returns when the last result is there."""
        self._starved.extend(list(range(self.cluster.workers)) * self.cluster.ahead)
        while self._starved and self._give(self._starved[0], 0.0):
            self._starved.popleft()
        now_s = 0.0
        while self._events:
            at_s, worker, task, died = heapq.heappop(self._events)
            if died:
                self._lose(worker, task, at_s)
            elif task >= 0:
                now_s = at_s
                self._running[worker] = False
                self._finish(task)
                self._begin(worker, at_s)
                self._starved.append(worker)
            elif worker >= 0:
                self._dead[worker] = False
                self._starved.extend([worker] * self.cluster.ahead)
            while self._starved and self._give(self._starved[0], at_s):
                self._starved.popleft()
        return max(now_s, self._caller_free_s)

    def _finish(self, task: int) -> None:
        self._done.add(task)
        while self._turn in self._done:
            self._done.remove(self._turn)
            self._turn += 1

    def _lose(self, worker: int, task: int, now_s: float) -> None:
        """A worker is gone: its tasks are given out again when that is noticed, and it comes back later."""
        self.deaths += 1
        lost = [task, *(waiting for _, waiting in self._has[worker])]
        self._has[worker].clear()
        noticed_s = now_s + self.cluster.noticed_s
        self._again.extend((noticed_s, one) for one in lost)
        self._running[worker], self._dead[worker] = False, True
        heapq.heappush(self._events, (noticed_s, -1, -1, False))
        heapq.heappush(self._events, (now_s + self.cluster.renewal_s, worker, -1, False))

    def _give(self, worker: int, now_s: float) -> bool:
        """A task for a worker; whether there was one, or the worker is gone and needs none."""
        cluster = self.cluster
        if self._dead[worker]:
            return True
        if self._again and self._again[0][0] <= now_s:
            _, task = self._again.popleft()
        elif self._next < len(self._takes_s) and (
            self._next - self._turn < cluster.held * cluster.ahead * cluster.workers
        ):
            task, self._next = self._next, self._next + 1
        else:
            return False
        self._caller_free_s = max(self._caller_free_s, now_s) + self.caller_s
        passed_on_s = max(self._scheduler_free_s, self._caller_free_s) + cluster.scheduler_task_s
        self._scheduler_free_s = passed_on_s
        self._has[worker].append((passed_on_s + cluster.latency_s, task))
        self._begin(worker, now_s)
        return True

    def _begin(self, worker: int, now_s: float) -> None:
        if self._running[worker] or not self._has[worker]:
            return
        there_s, task = self._has[worker].popleft()
        start_s = max(now_s, there_s)
        self._store_free_s = max(self._store_free_s, start_s) + self._store_s
        takes_s = self._takes_s[task] / self._speed[worker] + max(0.0, self._store_free_s - start_s)
        death_s = self._rng.exponential(3600 / self.cluster.deaths_per_hour)
        died = death_s < takes_s
        self._running[worker] = True
        heapq.heappush(self._events, (start_s + min(takes_s, death_s), worker, task, died))
