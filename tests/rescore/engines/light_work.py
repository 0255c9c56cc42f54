"""Light functions for engines to run: module-level ones, which workers of any engine import."""

import os
import signal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def doubled(number: int, offset: int) -> int:
    return 2 * number + offset


def drawn(number: int, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Numbers that the record decides, times what is shared, which may be written to as everywhere."""
    weights[0] = 1.0
    return np.random.default_rng(number).normal(size=len(weights)) * weights


def kills_once(number: int, folder: Path) -> int:
    """Three records end their worker on the first try, and leave a mark that they did."""
    if number in {3, 17, 31} and not (folder / str(number)).exists():
        (folder / str(number)).touch()
        kill()
    return number


def kills_always(number: int, folder: Path) -> int:
    """One record ends every worker, and marks each of its tries."""
    if number == 5:
        tries = len(list(folder.iterdir()))
        (folder / f"try_{tries}").touch()
        kill()
    return number


def raises(number: int, what: str) -> int:
    if number == 4:
        raise ValueError(f"{what}\nof record {number}")
    return number


def pid_of(_number: int, _shared: None) -> int:
    return os.getpid()


def marks(number: int, folder: Path) -> int:
    """Leaves a file for each record that was begun."""
    (folder / f"{number}_{os.getpid()}").touch()
    return number


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
