"""What the engines of clusters share: how many workers there are, and what to say where one is missing."""

import os
import re
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Greeting:
    """The first words of a connection to a cluster, by which it is known from any other server.

    The engines themselves wait for minutes for one that takes the connection and says nothing.
    """

    sent: bytes
    """What is said to it; nothing where it speaks first."""
    is_known: Callable[[bytes], bool]
    """Whether the first ``GREETED`` bytes are of such a cluster."""


GREETED = 9
"""Bytes by which a cluster is known."""


def wait_for_answer(address: str, form: str, start: str, greeting: Greeting | None) -> None:
    """Nothing, once an address of a cluster takes connections and greets as such a cluster does.

    Args:
        address: where.
        form: what addresses look like.
        start: the command that starts what is to answer there.
        greeting: how it greets; None where the connection is encrypted: then that it takes one will do.

    Raises:
        RescoreError: it is no address, or nothing answers there within seconds, or something else does.
    """
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > 65535:
        raise RescoreError(
            f"--address: expected {form}, got {address!r}; name host and port, or leave it out"
        )
    end_s = now_s() + CONNECT_S
    told = f"--address {address}: expected {form} that answers, got"
    while True:
        try:
            words = _greeted(found["host"].strip("[]"), int(found["port"]), end_s, greeting)
        except OSError as error:
            if now_s() + _PAUSE_S >= end_s:
                raise RescoreError(
                    f"{told} {error.strerror or error} for {CONNECT_S:g} s; start it by `{start}`, or leave "
                    "the option out"
                ) from error
            time.sleep(_PAUSE_S)
            continue
        if greeting is not None and not greeting.is_known(words):
            raise RescoreError(f"{told} a server of another kind; name the port of `{start}`")
        return


def _greeted(host: str, port: int, end_s: float, greeting: Greeting | None) -> bytes:
    """The first bytes that a server says until then; none where it is not asked to greet.

    Raises:
        OSError: it takes no connection, says nothing or hangs up.
    """
    with socket.create_connection((host, port), timeout=max(end_s - now_s(), _PAUSE_S)) as connection:
        if greeting is None:
            return b""
        connection.sendall(greeting.sent)
        words = b""
        while len(words) < GREETED:
            connection.settimeout(max(end_s - now_s(), _PAUSE_S))
            more = connection.recv(GREETED - len(words))
            if not more:
                raise OSError("a closed connection")
            words += more
        return words


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
