"""Memory of this process that is free, but that the system does not have back."""

import ctypes
from contextlib import suppress


def give_back() -> None:
    """Give the system what Arrow and the C library hold for later.

    Where some arrays of many small ones are kept, those that went leave gaps: a gigabyte with the candidates
    of a million frames.
    """
    import pyarrow as pa  # noqa: PLC0415 (not all that runs here reads tables)

    pa.default_memory_pool().release_unused()
    # other C libraries have no such function, or none to be found so
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)
