"""One thread for one frame: frames run in parallel, and sums come out the same for any number of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import cv2
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]


@contextmanager
def one_thread() -> Iterator[None]:
    """Inside, OpenCV and the linear algebra use one thread; what was set before comes back after.

    Results then do not depend on how many frames run at a time: floating-point sums split among threads
    differ in their last digits.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with _libraries().limit(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)


@cache
def _libraries() -> ThreadpoolController:
    # finding the loaded libraries takes milliseconds, so once
    return ThreadpoolController()
