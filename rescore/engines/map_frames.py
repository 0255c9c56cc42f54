"""``map_frames``: a function of many records by any engine, in their order, with memory that stays flat."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from recon.errors import RescoreError
from rescore.engines.clusters import quiet_ray, require
from rescore.engines.engine import TRIES, Ended, Engine, Outcome
from rescore.engines.executor import EngineName, Workers, executor_of
from rescore.engines.local import InProcess, Processes

R = TypeVar("R")
S = TypeVar("S")
T = TypeVar("T")

_HELD = 4
"""Times as many records as keep the workers busy may be done ahead of the one whose turn it is."""
_MOST_IN_A_TASK = 256
"""Records; what a dead worker had is done again."""


@dataclass(frozen=True, eq=False)
class Failed:
    """A record that has no result, and why in one line."""

    record: Any
    reason: str
    killed: bool
    """Whether it ended the workers that had it; else the function raised an error."""


def map_frames(
    function: Callable[[R, S], T],
    records: Iterable[R],
    shared: S,
    executor: Workers,
    *,
    ordered: bool = True,
    failed: Callable[[Failed], T] | None = None,
) -> Iterator[T]:
    """The function of each record and of what all share, as results are done.

    Records are taken, and results are held, only so far ahead as keeps the workers busy: memory does not grow
    with the number of records. A worker that dies is replaced and its record is tried again; one that ends
    three workers is set aside. Leaving the iterator, as Ctrl-C does, cancels what runs.

    Args:
        function: of a record and ``shared``; the same arguments must give the same result.
        records: what differs: small, since it travels with each task.
        shared: what does not: it goes to each worker once.
        executor: who runs it; a number is so many processes of this machine.
        ordered: results come in the order of the records; else as they are done.
        failed: makes a result of a record that has none; None raises its error.

    Raises:
        RescoreError: a record ended its workers, and there is no ``failed``.
    """
    engine = _started(function, shared, executor)
    try:
        for record, outcome in _Flow(engine, records).results(ordered):
            yield _value(record, outcome, failed)
    finally:
        engine.close()


def _started(function: Callable[[R, S], T], shared: S, executor: Workers) -> Engine:
    chosen = executor_of(executor)
    if chosen.engine is EngineName.DASK:
        require("distributed", "dask")
        from rescore.engines.on_dask import OnDask  # noqa: PLC0415 - comes with an extra

        return OnDask(function, shared, chosen)
    if chosen.engine is EngineName.RAY:
        require("ray", "ray")
        quiet_ray(local=chosen.address is None)
        from rescore.engines.on_ray import OnRay  # noqa: PLC0415 - comes with an extra

        return OnRay(function, shared, chosen)
    if chosen.jobs == 1:
        return InProcess(function, shared)
    return Processes(function, shared, chosen.jobs)


class _Flow:
    """Records on their way through an engine, in tasks."""

    def __init__(self, engine: Engine, records: Iterable[Any]) -> None:
        self._engine = engine
        self._records = iter(records)
        self._tasks: dict[int, tuple[int, tuple[Any, ...]]] = {}
        """Tasks that are out: the number of the first record, and the records."""
        self._done: dict[int, tuple[Any, Outcome | None]] = {}
        """Records by number that wait for their turn, and what they came to."""
        self._begun, self._taken = 0, 0
        """Numbers of tasks begun and of records taken."""
        self._record_s: float | None = None
        """Mean time of a record, the latest ones most; None before the first has ended."""

    def results(self, ordered: bool) -> Iterator[tuple[Any, Outcome | None]]:
        """Each record with what it came to; None where it ended its workers."""
        turn = 0
        while self._feed():
            self._note(self._engine.take())
            while self._done and (not ordered or turn in self._done):
                yield self._done.pop(turn if ordered else next(iter(self._done)))
                turn += 1

    def _feed(self) -> bool:
        """Give out tasks; whether any is out."""
        size = self._task_size()
        while len(self._tasks) < (ahead := self._engine.ahead()) and len(self._done) < _HELD * ahead * size:
            records = tuple(islice(self._records, size))
            if not records:
                break
            self._put(self._taken, records, TRIES if size == 1 else 1)
            self._taken += len(records)
        return bool(self._tasks)

    def _task_size(self) -> int:
        if self._record_s is None:
            return 1
        return min(max(round(self._engine.task_s / max(self._record_s, 1e-6)), 1), _MOST_IN_A_TASK)

    def _put(self, first: int, records: tuple[Any, ...], deaths: int) -> None:
        self._tasks[self._begun] = first, records
        self._engine.put(self._begun, records, deaths)
        self._begun += 1

    def _note(self, ended: Ended) -> None:
        first, records = self._tasks.pop(ended.task)
        if ended.outcomes is not None:
            for k, (record, outcome) in enumerate(zip(records, ended.outcomes, strict=True)):
                self._done[first + k] = record, outcome
            of_record = ended.seconds / len(records)
            self._record_s = of_record if self._record_s is None else 0.9 * self._record_s + 0.1 * of_record
        elif len(records) == 1:
            self._done[first] = records[0], None
        else:  # one of them did it: each by itself, with one death on its account
            for k, record in enumerate(records):
                self._put(first + k, (record,), TRIES - 1)


def _value(record: R, outcome: Outcome | None, failed: Callable[[Failed], T] | None) -> T:
    if outcome is None:
        return _failed_or_raise(Failed(record, f"ended its worker {TRIES} times", True), failed)
    if outcome.error is None:
        value: T = outcome.value
        return value
    if failed is None:
        raise outcome.error
    return failed(Failed(record, _reason(outcome.error), False))


def _failed_or_raise(lost: Failed, failed: Callable[[Failed], T] | None) -> T:
    if failed is None:
        raise RescoreError(
            f"{_name(lost.record)}: expected a result, got none: it {lost.reason}; leave it out, or give "
            "each worker more memory"
        )
    return failed(lost)


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, RescoreError) else f"{type(error).__name__}: {text}"


def _name(record: Any) -> str:
    """What the user knows a record by: its image, where it has one."""
    for part in record if isinstance(record, tuple) else (record,):
        if (image_id := getattr(part, "image_id", None)) is not None:
            return f"image {image_id}"
    return f"record {record!r:.60}"
