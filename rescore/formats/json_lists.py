"""Long lists of objects in JSON, read in pieces, so that memory does not grow with the file."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TypeVar

from pydantic import TypeAdapter, ValidationError

from recon.errors import RescoreError
from recon.reading import utf8_of
from rescore.formats.checked_json import first_difference

T = TypeVar("T")
PIECE_BYTES = 4 * 2**20
MAX_OBJECT_BYTES = 16 * 2**20
"""Bytes within which an object of the list must end; what has none there is no such list."""
_BETWEEN = re.compile(rb"\}\s*,\s*(?=\{)")
_TAIL_BYTES = 2**18
"""The end of a piece, which is looked through first."""
_TRIES = 64
"""Places at the end of a piece that are tried as the end of an object; objects in objects have such too."""


def read_pieces(path: Path, shape: TypeAdapter[list[T]], what: str) -> Iterator[list[T]]:
    """The items of a JSON file that holds a list of objects, some at a time, in their order.

    Raises:
        RescoreError: no such file, not JSON, another shape, or no end of an object within
            ``MAX_OBJECT_BYTES``; the first difference is named with its place.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected {what}, found no file; check the path")
    with path.open("rb") as file:
        rest, before, n = _first(file), b"", 0
        while True:
            more = file.read(max(PIECE_BYTES, len(rest)))
            rest += more
            found = _whole(before, rest, shape) if more else (_checked(before + rest, shape), len(rest))
            if found is None and len(rest) > MAX_OBJECT_BYTES:
                raise RescoreError(
                    f"{path}: expected {what}, got {len(rest) >> 20} MB without the end of one; mend the file"
                )
            if found is None:
                continue
            items, used = found
            if isinstance(items, ValidationError):
                why = first_difference(items, n)
                raise RescoreError(f"{path}: expected {what}, got {why}; mend the file") from items
            yield items
            if not more:
                return
            before, rest, n = b"[", rest[used:].lstrip().removeprefix(b","), n + len(items)


def _first(file: IO[bytes]) -> bytes:
    """The beginning of a file; all of it in UTF-8 where it is in another encoding."""
    head = file.read(4)
    return head if json.detect_encoding(head) == "utf-8" else utf8_of(head + file.read())


def _whole(
    before: bytes, rest: bytes, shape: TypeAdapter[list[T]]
) -> tuple[list[T] | ValidationError, int] | None:
    """The items that end in a piece, or their fault, and the bytes that they take; None where none ends.

    What lies before a comma between objects, closed as a list, is JSON only where that list is the outer one.
    """
    tail = max(0, len(rest) - _TAIL_BYTES)
    ends = [m.start() + 1 for m in _BETWEEN.finditer(rest, tail)]
    ends = ends or [m.start() + 1 for m in _BETWEEN.finditer(rest)]
    for end in ends[: -_TRIES - 1 : -1]:
        found = _checked(before + rest[:end] + b"]", shape)
        if not (isinstance(found, ValidationError) and found.errors()[0]["type"] == "json_invalid"):
            return found, end
    return None


def _checked(text: bytes, shape: TypeAdapter[list[T]]) -> list[T] | ValidationError:
    try:
        return shape.validate_json(text)
    except ValidationError as error:
        return error
