"""What all records share, on its way to the workers and there: pickled once, unpickled once a worker."""

import pickle
import time
from collections.abc import Callable, Iterable
from io import BytesIO
from typing import Any

from joblib.externals.loky.backend.reduction import dump

from rescore.engines.engine import Ended, Outcome


def pickled(value: Any) -> bytes:
    """A value as bytes; functions of a script too, which have no module to be imported from.

    Engines have pickles of their own, which give arrays that cannot be written to.
    """
    file = BytesIO()
    dump(value, file)
    return file.getvalue()


def run(task: int, records: Iterable[Any], function: Any, shared: Any) -> Ended:
    """What became of a task, done here."""
    start_s = time.perf_counter()
    outcomes = tuple(_outcome(record, function, shared) for record in records)
    return Ended(task, outcomes, time.perf_counter() - start_s)


def _outcome(record: Any, function: Any, shared: Any) -> Outcome:
    try:
        return Outcome(function(record, shared))
    except Exception as error:
        return Outcome(error=error)


_held: tuple[str, Any] = ("", None)
"""Name of what this worker has read last of what is shared, and the thing itself."""


def run_with(name: str, read: Callable[[], bytes], task: int, records: bytes) -> bytes:
    """In a worker: what became of a pickled task, pickled; ``read`` gives the function and what is shared."""
    global _held  # noqa: PLW0603 - a worker keeps it from one task to the next
    if _held[0] != name:
        _held = ("", None)
        _held = (name, pickle.loads(read()))
    ended = run(task, pickle.loads(records), *_held[1])
    try:
        return pickled(ended)
    except Exception as error:
        stuck = RuntimeError(f"a result, or an error, cannot be sent: {error}")
        return pickled(Ended(task, tuple(Outcome(error=stuck) for _ in ended.outcomes or ()), ended.seconds))
