"""What an engine is to ``map_frames``: it takes numbered records and gives what became of each."""

from dataclasses import dataclass
from typing import Any, Protocol

TRIES = 3
"""Times that a record may end the worker that has it before it is set aside."""


@dataclass(frozen=True)
class Ended:
    """What became of one record: a value, an error of the function, or an end of its workers."""

    number: int
    value: Any = None
    error: Exception | None = None
    killed: bool = False
    """Whether the record was set aside because it ended its workers."""


class Engine(Protocol):
    """Workers that have the function and what it shares, and are given records."""

    def ahead(self) -> int:
        """Number of records that keep all workers busy, with those that run."""

    def put(self, number: int, record: Any) -> None:
        """Give a record to the workers."""

    def take(self) -> Ended:
        """What became of a record that ended; waits for one."""

    def close(self, finished: bool) -> None:
        """Let the workers go; where records are left, cancel them and end what runs."""

