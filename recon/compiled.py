"""Inner loops compiled to machine code by Numba, for what whole arrays do not do well.

Importing this takes half a second, so modules that hold loops are imported where they are called. A loop is
compiled at its first call, in some seconds, and kept: beside its source, or in the user's cache where that
may not be written, or not at all where neither may.
"""

from collections.abc import Callable
from typing import Any

import numba


def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code; it runs beside other threads, and a division by zero is infinite."""
    try:
        return _made(loop, cache=True)
    except RuntimeError:  # no place to keep it
        return _made(loop)


def within(part: Callable[..., Any]) -> Callable[..., Any]:
    """A part of compiled loops, put into each in place of its calls, which makes small ones twice as fast."""
    return _made(part, inline="always")


def _made(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    # a product and a sum may be rounded once; NaN, which marks what is not measured, stays what it is
    free = {"contract", "arcp", "nsz"}
    return numba.njit(function, nogil=True, error_model="numpy", fastmath=free, **options)  # type: ignore[no-any-return]
