"""What the engines of clusters share: how many workers there are, and what to say where one is missing."""

import os
from collections.abc import Callable
from importlib.util import find_spec

from recon.errors import RescoreError
from rescore.speech import now_s

TASK_S = 1.0
"""Seconds of work in a task of a cluster: what it costs to send one, some milliseconds, is then little."""
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


def quiet_ray(local: bool) -> None:
    """Settings that Ray reads when it is imported: it asks no network and prints nothing where results go.

    With ``local``, what is started listens on the loopback address alone.
    """
    settings = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_DEDUP_LOGS_SKIP_REGEX": "."}
    if local:
        settings["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    for name, value in settings.items():
        os.environ.setdefault(name, value)


class Ahead:
    """How many tasks keep all workers busy: two for each, by a count that is renewed now and then."""

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._tasks, self._looked_s = 0, float("-inf")

    def tasks(self) -> int:
        """The number; workers that are being replaced leave at least two."""
        if now_s() - self._looked_s >= _LOOK_S:
            self._tasks, self._looked_s = 2 * max(self._count(), 1), now_s()
        return self._tasks
