"""Workers of a Ray cluster, one that runs or one of this machine."""

import os
import pickle
import uuid
from collections.abc import Callable
from typing import Any

import ray
from ray.exceptions import RayError

from recon.errors import RescoreError
from rescore.engines.clusters import Ahead
from rescore.engines.engine import TRIES, Ended
from rescore.engines.executor import Executor
from rescore.engines.shared import pickled, run_with


class OnRay:
    """The engine of Ray, which runs the record of a dead worker again, and gives it up after ``TRIES``."""

    def __init__(self, function: Callable[[Any, Any], Any], shared: Any, executor: Executor) -> None:
        self._own = not ray.is_initialized()
        if self._own:
            _connect(executor)
        self._name = uuid.uuid4().hex
        self._shared = ray.put(pickled((function, shared)))
        self._run = ray.remote(max_retries=TRIES - 1, num_cpus=1)(_run)
        self._ahead = Ahead(lambda: int(ray.cluster_resources().get("CPU", 0)))
        self._given: dict[Any, int] = {}

    def ahead(self) -> int:
        """Two records for each processor of the cluster."""
        return self._ahead.records()

    def put(self, number: int, record: Any) -> None:
        """Give a record to the cluster."""
        # in a list, so that it is read once a worker and not once a record
        self._given[self._run.remote(self._name, [self._shared], pickled(record), number)] = number

    def take(self) -> Ended:
        """What became of a record."""
        (done,), _ = ray.wait(list(self._given), num_returns=1)
        number = self._given.pop(done)
        try:
            ended: Ended = pickle.loads(ray.get(done))
        except RayError:
            return Ended(number, killed=True)
        return ended

    def close(self, finished: bool) -> None:
        """Cancel what runs, and leave the cluster; one of this machine ends."""
        for task in self._given:
            ray.cancel(task, force=True)
        if self._own:
            ray.shutdown()


def _run(name: str, shared: list[Any], record: bytes, number: int) -> bytes:
    return run_with(name, lambda: ray.get(shared[0]), record, number)


def _connect(executor: Executor) -> None:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # it asks the network
    try:
        if executor.address is not None:
            ray.init(address=executor.address, log_to_driver=False, logging_level="ERROR")
            return
        ray.init(
            num_cpus=executor.jobs,
            include_dashboard=False,
            log_to_driver=False,
            logging_level="ERROR",
            _node_ip_address="127.0.0.1",
            # a record that needs more memory than there is must not be tried for ever
            _system_config={"task_oom_retries": TRIES - 1},
        )
    except (ConnectionError, OSError, RuntimeError, ValueError) as error:
        raise RescoreError(
            f"--address {executor.address}: expected a Ray cluster, got {' '.join(str(error).split())}; start "
            "it, or leave the option out"
        ) from error
