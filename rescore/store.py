"""Files that results live in: written beside and moved into place, so nobody ever reads half a file."""

import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from recon.errors import RescoreError


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
    except (PermissionError, NotADirectoryError, FileExistsError, IsADirectoryError) as error:
        raise RescoreError(
            f"{path}: expected to write here, got {error.strerror!r}; "
            "choose another place or mend the permissions"
        ) from error
    finally:
        beside.unlink(missing_ok=True)


def write_json(path: Path, value: Any) -> None:
    """Write JSON in one piece, keys in the given order, NaN refused (the standard has none)."""
    text = json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False)
    with atomic_path(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def read_json(path: Path, what: str) -> Any:
    """The value in a JSON file; ``what`` names it in the error.

    Raises:
        RescoreError: there is no such file, or it is not JSON.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected {what}, found no file; check the path")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise RescoreError(f"{path}: expected {what} as JSON, got {error}; write the file again") from error


def digest_of(path: Path) -> str:
    """Digest of a file, or of all files of a folder with their names; empty where there is nothing."""
    total = hashlib.sha256()
    if path.is_file():
        total.update(_file_digest(path))
    elif path.is_dir():
        for file in sorted(p for p in path.rglob("*") if p.is_file()):
            total.update(file.relative_to(path).as_posix().encode() + b"\0")
            total.update(_file_digest(file))
    else:
        return ""
    return total.hexdigest()


def _file_digest(path: Path) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def remove(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
