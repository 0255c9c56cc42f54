"""Workers of a Ray cluster, one that runs or one of this machine."""

import pickle
import uuid
from collections.abc import Callable, Sequence
from typing import Any

import ray
from ray.exceptions import RayError

from recon.errors import RescoreError
from rescore.engines.clusters import Crew
from rescore.engines.engine import TRIES, Ended
from rescore.engines.executor import Executor
from rescore.engines.shared import pickled, run_with


class OnRay:
    """The engine of Ray, which runs the task of a dead worker again by itself.

    It stays connected until this process ends, since a cluster takes seconds to start.
    """

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, executor: Executor) -> None:
        if not ray.is_initialized():
            _connect(executor)
        self._name = uuid.uuid4().hex
        self._shared = ray.put(pickled((function, shared)))
        self._run = ray.remote(_run)
        self._crew = Crew(lambda: int(ray.cluster_resources().get("CPU", 0)))
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
        (done,), _ = ray.wait(list(self._given), num_returns=1)
        task = self._given.pop(done)
        try:
            ended: Ended = pickle.loads(ray.get(done))
        except RayError:
            return Ended(task, None)
        return ended

    def close(self) -> None:
        """Cancel what is left, and end what runs."""
        for done in self._given:
            ray.cancel(done, force=True)


def _run(name: str, shared: list[Any], task: int, records: bytes) -> bytes:
    return run_with(name, lambda: ray.get(shared[0]), task, records)


def _connect(executor: Executor) -> None:
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "CRITICAL"}
    try:
        if executor.address is not None:
            ray.init(executor.address, **quiet)
            return
        # a record that needs more memory than there is must not be tried for ever
        patience = {"task_oom_retries": TRIES - 1}
        ray.init("local", num_cpus=executor.jobs, include_dashboard=False, _system_config=patience, **quiet)
    except (ConnectionError, OSError, RuntimeError, ValueError) as error:
        where, why = executor.address or "local", " ".join(str(error).split())
        raise RescoreError(
            f"--address {where}: expected a Ray cluster, got {why}; start it, or leave the option out"
        ) from error
