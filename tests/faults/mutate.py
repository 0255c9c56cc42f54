"""Seeded damage to the bytes of a file: cut, flipped, zeroed, spliced, extreme numbers, wrong types."""

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np

Random = np.random.Generator
EXTREME = ("1e308", "-1e308", "1e999", "NaN", "-Infinity", "0", "-1", "9" * 5000, "4294967296", str(2**70))
EXTREME += ("1e-320", "65536", "0.5", "1.0000001")
WRONG: tuple[Any, ...] = (None, True, "", "x\0y", "../../../etc/x", "\ud800", [], {}, [[]], -1, 0, 1.5, 2**70)
WRONG += (1e308, "é" * 300, [1, 2, 3], {"a": {}}, float("nan"), float("inf"), "\x1b[31m", 10**400)
_NUMBER = re.compile(rb"(?<![A-Za-z_\d.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def damaged(data: bytes, rng: Random) -> tuple[str, bytes]:
    """The kind of damage, and the bytes after it."""
    kinds = [k for k in KINDS if k not in _TEXT or _is_text(data)]
    name = str(rng.choice(kinds))
    return name, KINDS[name](data, rng)


def _is_text(data: bytes) -> bool:
    return b"\0" not in data[:4000] and data[:2] not in (b"\x1f\x8b", b"\x89P")


def _cut(data: bytes, rng: Random) -> bytes:
    return data[: int(rng.integers(0, len(data) + 1))]


def _flip(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for place in rng.integers(0, max(len(data), 1), int(rng.integers(1, 9))) if data else ():
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _zero(data: bytes, rng: Random) -> bytes:
    at, n = int(rng.integers(0, len(data) + 1)), int(rng.integers(1, 200))
    return data[:at] + bytes(min(n, len(data) - at)) + data[at + n :]


def _splice(data: bytes, rng: Random) -> bytes:
    a, b, c = (int(v) for v in rng.integers(0, len(data) + 1, 3))
    return data[:a] + data[min(b, c) : max(b, c)] + data[a:]


def _swap(data: bytes, rng: Random) -> bytes:
    """Foreign bytes in place of a stretch, or of all."""
    foreign = (
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"[" * 100_000,
        b"\0" * 64,
        b"\x80abc",
        b"<a>" * 3000,
        b"\n\n",
        b"{}",
    )
    piece = foreign[int(rng.integers(len(foreign)))]
    if rng.random() < 0.3:
        return piece
    at, n = int(rng.integers(0, len(data) + 1)), int(rng.integers(0, 60))
    return data[:at] + piece + data[at + n :]


def _number(data: bytes, rng: Random) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return _flip(data, rng)
    m = found[int(rng.integers(len(found)))]
    return data[: m.start()] + EXTREME[int(rng.integers(len(EXTREME)))].encode() + data[m.end() :]


def _line(data: bytes, rng: Random) -> bytes:
    """A line left out, doubled or moved to the end."""
    lines = data.split(b"\n")
    line = lines.pop(int(rng.integers(len(lines))))
    return b"\n".join(lines + [line] * int(rng.integers(3)))


def _type(data: bytes, rng: Random) -> bytes:
    """A value of another type at a random place of JSON; a key left out, or one too many."""
    try:
        value = json.loads(data)
    except ValueError:
        return _number(data, rng)
    holder: list[Any] = [value]
    at: Any = holder
    key: Any = 0
    while isinstance(at[key], dict | list) and at[key] and rng.random() < 0.85:
        at = at[key]
        keys = list(at) if isinstance(at, dict) else range(len(at))
        key = keys[int(rng.integers(len(keys)))]
    if isinstance(at, dict) and rng.random() < 0.25:
        if rng.random() < 0.5:
            del at[key]
        else:
            at[f"{key}x"] = at.pop(key)
    else:
        at[key] = WRONG[int(rng.integers(len(WRONG)))]
    return json.dumps(holder[0]).encode("utf-8", "surrogatepass")


def _empty(_data: bytes, _rng: Random) -> bytes:
    return b""


_TEXT = {"number", "line", "type"}
KINDS: dict[str, Callable[[bytes, Random], bytes]] = {
    "cut": _cut,
    "flip": _flip,
    "zero": _zero,
    "splice": _splice,
    "foreign": _swap,
    "number": _number,
    "line": _line,
    "type": _type,
    "empty": _empty,
}
