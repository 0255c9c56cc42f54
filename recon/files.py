"""Files written beside and moved into place, so that nobody ever reads half a file; and checks of targets."""

import errno
import hashlib
import os
import platform
import re
import shutil
import sys
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from recon.errors import RescoreError
from recon.stores import RemotePath, remote

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}
"""Errors that only writing has, whatever file the error names."""
_PARTIAL = re.compile(r"\.(?P<host>[0-9a-f]{6})-(?P<process>[0-9]+)-[0-9a-f]{12}\.partial(\..*)?")


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; on success it becomes ``path``, on failure nothing is left.

    The temporary name keeps the suffix, since many writers choose the format by it. It names this process and
    is unique, so two processes that write the same file do not meet; the last one wins, with a whole file.
    What killed processes left in the folder is removed.

    Raises:
        RescoreError: the folder cannot be written, the disk is full, or the target is no regular file.
    """
    if (stored := remote(path)) is not None:
        with _put_once(stored) as beside:
            yield beside
        return
    refuse_as_file(path)
    beside = path.with_name(f".{_host()}-{os.getpid()}-{uuid.uuid4().hex[:12]}.partial{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _clear_once(path.parent, os.getpid())
        yield beside
        if not beside.exists():
            raise ValueError(f"{path}: nothing was written to the path that atomic_path gave")
        with beside.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(beside, path)
    except OSError as error:
        # a file that the caller was reading can fail too: that error is the caller's
        ours = error.filename in {None, str(beside), str(path), *map(str, path.parents)}
        if not ours and error.errno not in _FULL:
            raise
        raise RescoreError(
            f"{path}: expected to write here, got {error.strerror or str(error)!r}; "
            "choose another place, make room or mend the permissions"
        ) from error
    finally:
        with suppress(OSError):
            beside.unlink()


@contextmanager
def _put_once(path: RemotePath) -> Iterator[Path]:
    """A path of this machine to write to; on success the store gets its content by one put."""
    with tempfile.TemporaryDirectory() as folder:
        beside = Path(folder) / path.name
        yield beside
        if not beside.exists():
            raise ValueError(f"{path}: nothing was written to the path that atomic_path gave")
        path.write_bytes(beside.read_bytes())


def copy_file(source: Path, target: Path) -> None:
    """Copy a file; a whole one bears the name of the target, or none.

    Raises:
        RescoreError: the target cannot be written.
    """
    with atomic_path(target) as beside:
        if (stored := remote(source)) is not None:
            beside.write_bytes(stored.read_bytes())
        else:
            shutil.copyfile(source, beside)


def clear_partials(folder: Path) -> None:
    """Remove what processes of this machine that are no more were writing in a folder with an atomic path."""
    for name in os.listdir(folder) if folder.is_dir() else ():
        found = _PARTIAL.fullmatch(name)
        if found and found["host"] == _host() and not _is_alive(int(found["process"])):
            with suppress(OSError):
                (folder / name).unlink()


def refuse_as_file(path: Path) -> None:
    """Raises RescoreError where a file cannot be written at a path: a folder or a device is there, say."""
    if remote(path) is not None:
        return
    try:
        _refuse_name(path)
        if path.is_dir():
            raise RescoreError(
                f"{str(path)!r}: expected the name of a file to write, got a folder; add a name or choose "
                "another place"
            )
        if path.exists() and not path.is_file():
            raise RescoreError(
                f"{path}: expected a regular file or none here, got a device, pipe or socket; name a file"
            )
        _refuse_folder(path.parent)
    except (OSError, ValueError) as error:
        raise _no_target(path, error) from error


def refuse_as_folder(path: Path) -> None:
    """Raises RescoreError where a folder cannot be made or written to at a path."""
    if remote(path) is not None:
        return
    try:
        _refuse_name(path)
        _refuse_folder(path)
    except (OSError, ValueError) as error:
        raise _no_target(path, error) from error


def refuse_as_input(out: Path, inputs: Iterable[Path]) -> None:
    """Raises RescoreError where a result would be written over what it is made from."""
    for path in inputs:
        if _is_same(out, path):
            raise RescoreError(
                f"{out}: expected another place than what is read, got that of {path}; choose another --out"
            )


def _is_same(one: Path, other: Path) -> bool:
    if remote(one) is not None or remote(other) is not None:
        return str(one) == str(other)
    # what is not there cannot be lost
    return one.exists() and other.exists() and one.samefile(other)


def _refuse_name(path: Path) -> None:
    """Raises where the system has no such name: one that is too long, say, or holds a null byte."""
    with suppress(FileNotFoundError, NotADirectoryError):
        path.stat()


def _refuse_folder(path: Path) -> None:
    there = next(p for p in (path, *path.parents) if p.exists() or p == p.parent)
    if there.exists() and not there.is_dir():
        raise RescoreError(
            f"{path}: expected a folder to write to, got the file {str(there)!r}; choose another place"
        )
    if there.exists() and not os.access(there, os.W_OK | os.X_OK):
        raise RescoreError(
            f"{path}: expected to write here, got {str(there)!r} which is read-only; choose another place or "
            "mend the permissions"
        )


def _no_target(path: Path, error: OSError | ValueError) -> RescoreError:
    why = error.strerror if isinstance(error, OSError) else str(error)
    return RescoreError(
        f"{str(path)[:200]!r}: expected a name that can be written, got {why!r}; choose another"
    )


@cache
def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:6]


@cache
def _clear_once(folder: Path, _process: int) -> None:
    # a process that writes thousands of files lists their folder once
    clear_partials(folder)


def _is_alive(process: int) -> bool:
    if sys.platform == "win32":  # there, asking a process with a signal ends it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
