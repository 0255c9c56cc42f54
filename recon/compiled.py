"""Inner loops compiled to machine code by Numba, for what whole arrays do not do well.

Importing this takes half a second, so modules that hold loops are imported where they are called. A loop is
compiled at its first call, in some seconds, and kept: beside its source, or in the user's cache where that
may not be written, or not at all where neither may.
"""

from collections.abc import Callable
from typing import Any

import numba


def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code; it runs beside other threads and raises nothing on division by zero."""
    try:
        made = numba.njit(loop, cache=True, nogil=True, error_model="numpy")
    except RuntimeError:  # no place to keep it
        made = numba.njit(loop, nogil=True, error_model="numpy")
    return made  # type: ignore[no-any-return]
