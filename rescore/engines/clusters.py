"""What the engines of clusters share: how many workers there are, and what to say where one is missing."""

import os
import re
import socket
import time
from collections.abc import Callable
from importlib.util import find_spec

from recon.errors import RescoreError
from rescore.speech import now_s

CONNECT_S = 10.0
"""Seconds that a scheduler or head has to take a connection: it may have been started just before."""
_PAUSE_S = 0.2
_ADDRESS = re.compile(r"([a-z]+://)?(?P<host>\[[^]]+\]|[^:/\[\]]+):(?P<port>[0-9]{1,5})/?")
TASK_S = 1.0
"""Seconds of work in a task of a cluster: what it costs to send one, some milliseconds, is then little."""
TASK_S_OF_A_WORKER = 0.02
"""Seconds more for each worker, where there are many: one process sends the tasks of all."""
_LOOK_S = 5.0
"""Seconds between two looks at how many workers there are."""


def require(module: str, extra: str) -> None:
    """Nothing, where the engine's package is installed.

    Raises:
        RescoreError: it is not.
    """
    if find_spec(module) is None:
        raise RescoreError(
            f'--engine {extra}: expected its package, found none; do pip install "rescore[{extra}]"'
        )


def wait_for_answer(address: str, form: str, start: str) -> None:
    """Nothing, once an address of a cluster takes connections.

    ``form`` is that of addresses, and ``start`` the command that starts what is to answer there.

    Raises:
        RescoreError: it is no address, or nothing answers there within seconds.
    """
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > 65535:
        raise RescoreError(
            f"--address: expected {form}, got {address!r}; name host and port, or leave it out"
        )
    end_s = now_s() + CONNECT_S
    while True:
        try:
            return _connect(found["host"].strip("[]"), int(found["port"]), end_s - now_s())
        except OSError as error:
            if now_s() + _PAUSE_S >= end_s:
                raise RescoreError(
                    f"--address {address}: expected {form} that answers, got {error.strerror or error} for "
                    f"{CONNECT_S:g} s; start it by `{start}`, or leave the option out"
                ) from error
            time.sleep(_PAUSE_S)


def _connect(host: str, port: int, patience_s: float) -> None:
    socket.create_connection((host, port), timeout=patience_s).close()


def quiet_ray(local: bool) -> None:
    """Settings that Ray reads when it is imported: it asks no network and prints nothing where results go.

    With ``local``, what is started listens on the loopback address alone.
    """
    settings = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_DEDUP_LOGS_SKIP_REGEX": "."}
    if local:
        settings["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    for name, value in settings.items():
        os.environ.setdefault(name, value)


class Crew:
    """The workers that there are now, by a count that is renewed now and then."""

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._workers, self._looked_s = 1, float("-inf")

    @property
    def workers(self) -> int:
        """Number of workers; at least one, since those that died are replaced."""
        if now_s() - self._looked_s >= _LOOK_S:
            self._workers, self._looked_s = max(self._count(), 1), now_s()
        return self._workers

    @property
    def task_s(self) -> float:
        """Seconds of work that a task should hold."""
        return seconds_of_a_task(self.workers)

    def ahead(self) -> int:
        """Number of tasks that keep all busy: two for each."""
        return 2 * self.workers


def seconds_of_a_task(workers: int) -> float:
    """Seconds of work that a task should hold, so that workers do not wait for the one that sends them."""
    return max(TASK_S, TASK_S_OF_A_WORKER * workers)
