"""``map_frames``: a function of many records by any engine, in their order, with memory that stays flat."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from recon.errors import RescoreError
from rescore.engines.engine import TRIES, Ended, Engine
from rescore.engines.clusters import require
from rescore.engines.executor import EngineName, Workers, executor_of
from rescore.engines.local import InProcess, Processes

R = TypeVar("R")
S = TypeVar("S")
T = TypeVar("T")

_HELD = 4
"""Times as many records as keep the workers busy may be done ahead of the one whose turn it is."""


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
    finished = False
    try:
        yield from _results(engine, records, ordered, failed)
        finished = True
    finally:
        engine.close(finished)


def _started(function: Callable[[R, S], T], shared: S, executor: Workers) -> Engine:
    chosen = executor_of(executor)
    if chosen.engine is EngineName.DASK:
        require("distributed", "dask")
        from rescore.engines.on_dask import OnDask  # noqa: PLC0415 - comes with an extra

        return OnDask(function, shared, chosen)
    if chosen.engine is EngineName.RAY:
        require("ray", "ray")
        from rescore.engines.on_ray import OnRay  # noqa: PLC0415 - comes with an extra

        return OnRay(function, shared, chosen)
    if chosen.jobs == 1:
        return InProcess(function, shared)
    return Processes(function, shared, chosen.jobs)


def _results(
    engine: Engine, records: Iterable[R], ordered: bool, failed: Callable[[Failed], T] | None
) -> Iterator[T]:
    coming, more = enumerate(records), True
    given: dict[int, R] = {}
    done: dict[int, tuple[R, Ended]] = {}
    turn = 0
    while True:
        while more and len(given) < engine.ahead() and len(given) + len(done) < _HELD * engine.ahead():
            for number, record in islice(coming, 1):
                given[number] = record
                engine.put(number, record)
                break
            else:
                more = False
        if not given:
            return
        ended = engine.take()
        done[ended.number] = given.pop(ended.number), ended
        while done and (not ordered or turn in done):
            yield _value(*done.pop(turn if ordered else ended.number), failed)
            turn += 1


def _value(record: R, ended: Ended, failed: Callable[[Failed], T] | None) -> T:
    if ended.error is None and not ended.killed:
        value: T = ended.value
        return value
    if ended.error is not None and failed is None:
        raise ended.error
    reason = _reason(ended.error) if ended.error else f"ended its worker {TRIES} times"
    if failed is None:
        raise RescoreError(
            f"{_name(record, ended.number)}: expected a result, got none: it {reason}; leave it out, or "
            "give each worker more memory"
        )
    return failed(Failed(record, reason, ended.killed))


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, RescoreError) else f"{type(error).__name__}: {text}"


def _name(record: Any, number: int) -> str:
    """What the user knows a record by: its image, where it has one."""
    for part in record if isinstance(record, tuple) else (record,):
        if (image_id := getattr(part, "image_id", None)) is not None:
            return f"image {image_id}"
    return f"record {number}"
