"""What all records share, on its way to the workers and there: pickled once, unpickled once a worker."""

import pickle
from collections.abc import Callable
from io import BytesIO
from typing import Any

from joblib.externals.loky.backend.reduction import dump

from rescore.engines.engine import Ended


def pickled(value: Any) -> bytes:
    """A value as bytes; functions of a script too, which have no module to be imported from.

    Engines have pickles of their own, which give arrays that cannot be written to.
    """
    file = BytesIO()
    dump(value, file)
    return file.getvalue()


def run(function: Any, record: Any, shared: Any, number: int) -> Ended:
    """The function of a record, its error as a value."""
    try:
        return Ended(number, function(record, shared))
    except Exception as error:
        return Ended(number, error=error)


_held: tuple[str, Any] = ("", None)
"""Name of what this worker has read last of what is shared, and the thing itself."""


def run_with(name: str, read: Callable[[], bytes], record: bytes, number: int) -> bytes:
    """In a worker: what became of a pickled record, pickled; ``read`` gives the function and what is shared."""
    global _held  # noqa: PLW0603 - a worker keeps it from one record to the next
    if _held[0] != name:
        _held = ("", None)
        _held = (name, pickle.loads(read()))
    function, shared = _held[1]
    ended = run(function, pickle.loads(record), shared, number)
    try:
        return pickled(ended)
    except Exception as error:
        return pickled(Ended(number, error=RuntimeError(f"the result, or its error, does not travel: {error}")))
