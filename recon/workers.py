"""Helper processes that share the work on many items, and end with the process that started them."""

import os
import signal
import sys
import threading
import time
from typing import Any

from joblib import Parallel

_POLL_S = 0.5


def workers(jobs: int, **options: Any) -> Parallel:
    """joblib's helpers, ``jobs`` at a time, as a function of delayed tasks; ``options`` as of ``Parallel``.

    They end within a second where this process is killed, and leave Ctrl-C to it.
    """
    return Parallel(
        n_jobs=jobs, backend="loky", initializer=end_with_parent, initargs=(os.getpid(),), **options
    )


def thread_limits(threads: int) -> dict[str, str]:
    """Variables of the environment by which a new process uses so many threads for its linear algebra."""
    libraries = ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB_MAXIMUM", "NUMBA", "NUMEXPR")
    names = (f"{library}_NUM_THREADS" for library in libraries)
    return {name: os.environ.get(name, str(threads)) for name in names}


def end_with_parent(parent: int) -> None:
    """Make this process end within a second where the one that started it is killed, and ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":  # there, the number of a parent that is no more stays
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    os._exit(1)
