"""What an engine is to ``map_frames``: it takes numbered tasks of records and gives what became of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

TRIES = 3
"""Times that a record may end the worker that has it before it is set aside."""


@dataclass(frozen=True)
class Outcome:
    """What a record came to: a value, or an error of the function."""

    value: Any = None
    error: Exception | None = None


@dataclass(frozen=True)
class Ended:
    """What became of one task."""

    task: int
    outcomes: tuple[Outcome, ...] | None
    """What each record came to; None where the task ended as many workers as it may."""
    seconds: float = 0.0
    """Time in the function."""


class Engine(Protocol):
    """Workers that have the function and what it shares, and are given tasks."""

    @property
    def task_s(self) -> float:
        """Seconds of work that a task should hold; 0 where tasks of one record are as good."""

    def ahead(self) -> int:
        """Number of tasks that keep all workers busy, with those that run."""

    def put(self, task: int, records: Sequence[Any], deaths: int) -> None:
        """Give a task to the workers; it may end ``deaths`` of them before it is given up."""

    def take(self) -> Ended:
        """What became of a task that ended; waits for one."""

    def close(self) -> None:
        """Let the workers go; where tasks are left, cancel them and end what runs."""
