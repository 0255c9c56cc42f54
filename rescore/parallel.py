"""One thread for one frame: frames run in parallel, and sums come out the same for any number of them."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

import cv2
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

T = TypeVar("T")


def track(items: Iterable[T], description: str, total: int, show: bool = True) -> Iterator[T]:
    """The items one after another, with a bar that counts them."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    # in a log file a bar is noise
    hidden = not (show and console.is_terminal)
    with Progress(*columns, console=console, transient=True, disable=hidden) as progress:
        bar = progress.add_task(description, total=total)
        for item in items:
            yield item
            progress.advance(bar)


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
