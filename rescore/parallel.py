"""Work on many frames: several at a time, one thread for each, in their order, with progress shown."""

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import TypeVar

import cv2
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from rescore import speech

T = TypeVar("T")


def track(
    items: Iterable[T], description: str, total: int, show: bool = True, *, done: int = 0
) -> Iterator[T]:
    """The items one after another, counted by a bar in a terminal and by a line a minute elsewhere.

    Both tell the rate and the time left. ``done`` items of the total were there before.
    """
    if not show or speech.is_quiet():
        return iter(items)
    console = Console(stderr=True)
    # a terminal that cannot move its cursor draws no bar
    if console.is_terminal and not console.is_dumb_terminal:
        return _with_bar(items, description, total, done, console)
    return _with_lines(items, description, total, done)


def _with_bar(items: Iterable[T], description: str, total: int, done: int, console: Console) -> Iterator[T]:
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        *(_RateColumn(), TimeRemainingColumn()),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task(description, total=total, completed=done)
        for item in items:
            yield item
            progress.advance(bar)


class _RateColumn(ProgressColumn):
    """Items a second."""

    def render(self, task: Task) -> Text:
        return Text("" if task.speed is None else _rate(task.speed), style="progress.data.speed")


def _rate(each_s: float) -> str:
    return f"{each_s:.2g} a second" if each_s < 100 else f"{each_s:.0f} a second"


def _with_lines(items: Iterable[T], description: str, total: int, done: int) -> Iterator[T]:
    start_s = told_s = speech.now_s()
    for count, item in enumerate(items, start=done + 1):
        yield item
        if count < total and speech.now_s() - told_s >= speech.EVERY_S:
            told_s = speech.now_s()
            each_s = (count - done) / (told_s - start_s)
            left_min = (total - count) / each_s / 60
            speech.say(f"{description}: {count} of {total}, {_rate(each_s)}, {left_min:.0f} min left")


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


def one_blas_thread() -> AbstractContextManager[object]:
    """Inside, the linear algebra uses one thread, and OpenCV as many as it is set to."""
    limited: AbstractContextManager[object] = _libraries().limit(limits=1, user_api="blas")
    return limited


@cache
def _libraries() -> ThreadpoolController:
    # finding the loaded libraries takes milliseconds, so once
    return ThreadpoolController()
