"""What is told to the user on standard error: notes, progress, and what is being done. Silent with --quiet.

Standard output holds results, and errors are printed by the command itself; neither is silenced.
"""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

EVERY_S = 60.0
"""Seconds between two lines of progress where standard error is no terminal."""
SILENT_S = 75.0
"""Seconds of silence after which ``heartbeat`` speaks; more than ``EVERY_S``, since counts say more."""


@dataclass
class _State:
    quiet: bool = False
    last_said_s: float = 0.0
    doing: list[tuple[str, float]] = field(default_factory=list)
    """What is being done, and since when; the last entry is inside those before."""


_state = _State()


def now_s() -> float:
    """Seconds of a clock that only goes forward."""
    return time.monotonic()


def silence(quiet: bool) -> None:
    """Turn notes and progress off or on for this process."""
    _state.quiet = quiet


def is_quiet() -> bool:
    """Whether notes and progress are silent."""
    return _state.quiet


def shown(text: str) -> str:
    """The text as a terminal may have it: what files hold, such as names, could else steer it."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def counted(n: int, thing: str) -> str:
    """A number with a thing, whose plural ends in s or, after x, in es: "1 frame", "2 boxes"."""
    plural = "" if n == 1 else "es" if thing.endswith("x") else "s"
    return f"{n} {thing}{plural}"


def say(text: str) -> None:
    """Tell the user something on standard error, unless that is silenced."""
    if not _state.quiet:
        # in one piece, since two threads speak
        print(f"{shown(text)}\n", end="", file=sys.stderr, flush=True)
        _state.last_said_s = now_s()


@contextmanager
def doing(what: str) -> Iterator[None]:
    """Inside, ``heartbeat`` says that this is being done."""
    _state.doing.append((what, now_s()))
    try:
        yield
    finally:
        _state.doing.pop()


@contextmanager
def heartbeat(poll_s: float = 1.0) -> Iterator[None]:
    """Inside, a line a minute says what ``doing`` holds, where nothing else was said and no one looks on.

    Only where standard error is no terminal: in a terminal, bars of progress show it.
    """
    if _state.quiet or sys.stderr.isatty():
        yield
        return
    over = threading.Event()
    _state.last_said_s = now_s()

    def watch() -> None:
        while not over.wait(poll_s):
            say_what_is_done()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def what_is_done() -> tuple[str, ...]:
    """What is being done, the command first and then what of it."""
    return tuple(what for what, _ in _state.doing)


def say_what_is_done() -> None:
    """Say what is being done and for how long, if nothing was said for ``SILENT_S``."""
    # a copy: the work may end meanwhile
    for what, since_s in _state.doing[-1:]:
        if now_s() - _state.last_said_s < SILENT_S:
            return
        say(f"{what}: {(now_s() - since_s) / 60:.0f} min so far")
