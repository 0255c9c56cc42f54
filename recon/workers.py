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
        n_jobs=jobs, backend="loky", initializer=_end_with_parent, initargs=(os.getpid(),), **options
    )


def _end_with_parent(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":  # there, the number of a parent that is no more stays
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    os._exit(1)
