"""Ways to spoil a data set of tests/rescore/own_data.py, for the tables of malformed input."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.rescore import own_data as own

Json = dict[str, Any]
Spoil = Callable[[Path], object]
Done = tuple[int, str, str]
"""Exit code, standard output and standard error."""
Run = Callable[..., Done]
NAN, INF = float("nan"), float("inf")


def annotations(change: Callable[[Json], object]) -> Spoil:
    def spoil(root: Path) -> None:
        value = own.annotations()
        change(value)
        (root / "annotations.json").write_text(json.dumps(value))

    return spoil


def first(kind: str, **changes: object) -> Spoil:
    return annotations(lambda d: d[kind][0].update(changes))


def camera(**changes: object) -> Spoil:
    return annotations(lambda d: d["images"][0]["camera"].update(changes))


def raw(content: bytes) -> Spoil:
    return lambda root: (root / "annotations.json").write_bytes(content)


def without(kind: str, key: str) -> Spoil:
    return annotations(lambda d: d[kind][0].pop(key))


def twice(kind: str) -> Spoil:
    return annotations(lambda d: d[kind].append(d[kind][0]))


def text(name: str, content: str) -> Spoil:
    return lambda root: own.write_text(root / name, content)


def png(name: str, value: np.ndarray[Any, Any]) -> Spoil:
    return lambda root: own.write_png(root / name, value)


def measured(name: str, write: Spoil, quantity: str = "disparity") -> Spoil:
    """The first frame has a measured file of a form."""

    def spoil(root: Path) -> None:
        entry = {"file_name": name, "quantity": quantity, "factor": 256 if name.endswith(".png") else 1}
        first("images", measured=entry)(root)
        write(root)

    return spoil


def disparity(value: np.ndarray[Any, Any]) -> Spoil:
    def spoil(root: Path) -> None:
        first("images", disparity_file_name="d.png")(root)
        own.write_png(root / "d.png", value)

    return spoil


def cut(spoil: Spoil, name: str, size: int) -> Spoil:
    def both(root: Path) -> None:
        spoil(root)
        (root / name).write_bytes((root / name).read_bytes()[:size])

    return both


def swapped(root: Path) -> None:
    for i in (1, 2):
        own.write_pair(root / "right" / f"{i}.png", root / "left" / f"{i}.png", i)
