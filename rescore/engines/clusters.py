"""What the engines of clusters share: how many workers there are now, and what to say where one is missing."""

from collections.abc import Callable
from importlib.util import find_spec

from recon.errors import RescoreError
from rescore.speech import now_s

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


class Ahead:
    """How many records keep all workers busy: two for each, by a count that is renewed now and then."""

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._records, self._looked_s = 0, float("-inf")

    def records(self) -> int:
        """The number; workers that are being replaced leave at least two."""
        if now_s() - self._looked_s >= _LOOK_S:
            self._records, self._looked_s = 2 * max(self._count(), 1), now_s()
        return self._records
