"""Files written beside and moved into place, so that nobody ever reads half a file."""

import json
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from recon.errors import RescoreError


def utf8_of(data: bytes) -> bytes:
    """The bytes of a text in UTF-8 without a byte order mark, from any Unicode encoding that its first bytes
    tell, as JSON's standard has it; other bytes as they are."""
    encoding = json.detect_encoding(data)
    if encoding == "utf-8":
        return data
    try:
        return data.decode(encoding).encode()
    except UnicodeError:
        return data


def read_text(path: Path, what: str) -> str:
    """The text of a file in UTF-8 or UTF-16, lines ended by a line feed alone; ``what`` names it in errors.

    Raises:
        RescoreError: it is in another encoding, or no text.
    """
    try:
        text = utf8_of(path.read_bytes()).decode()
    except UnicodeDecodeError as error:
        raise RescoreError(
            f"{path}: expected {what} as text in UTF-8 or UTF-16, got other bytes; save it as UTF-8"
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; on success it becomes ``path``, on failure nothing is left.

    The temporary name keeps the suffix, since many writers choose the format by it. Its name is unique, so
    two processes that write the same file do not meet; the last one wins, with a whole file.

    Raises:
        RescoreError: the folder cannot be written.
    """
    beside = path.with_name(f".{uuid.uuid4().hex[:12]}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        if not beside.exists():
            raise ValueError(f"{path}: nothing was written to the path that atomic_path gave")
        with beside.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(beside, path)
    except OSError as error:
        # a file that the caller was reading can fail too: that error is the caller's
        if error.filename not in {None, str(beside), str(path), *map(str, path.parents)}:
            raise
        raise RescoreError(
            f"{path}: expected to write here, got {error.strerror!r}; "
            "choose another place or mend the permissions"
        ) from error
    finally:
        with suppress(OSError):
            beside.unlink()
