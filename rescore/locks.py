"""Locks on folders, so that two processes do not write the results of one run over each other."""

import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from recon.errors import RescoreError
from recon.files import refuse_as_folder
from recon.stores import remote

LOCK = ".lock"
"""Name of the file in a folder that the process which writes there holds locked."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Inside, no other process gets past the same call for this folder, which is made if need be.

    A folder that was made here and in which nothing was left is removed again.

    The system gives the lock back when the process ends, in whatever way.

    Raises:
        RescoreError: another process has it; the message names that process. Or the folder cannot be made.
    """
    if remote(folder) is not None:
        # a store has no locks; what is written there is whole, and the last one wins
        yield
        return
    refuse_as_folder(folder)
    path, was_there = folder / LOCK, folder.exists()
    with _told_where_it_cannot_write(folder):
        file = _opened(path)
    try:
        with _told_where_it_cannot_write(folder):
            file.truncate(0)
            since = time.strftime("%Y-%m-%d %H:%M:%S")
            owner = {"process": os.getpid(), "computer": platform.node(), "since": since}
            file.write(json.dumps(owner).encode())
        yield
    finally:
        # while it is held: after that, it may be another's
        with suppress(OSError):
            path.unlink()
            if not was_there:
                folder.rmdir()
        file.close()


@contextmanager
def _told_where_it_cannot_write(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RescoreError(
            f"{folder}: expected to write here, got {error.strerror or str(error)!r}; choose another place, "
            "make room or mend the permissions"
        ) from error


def _opened(path: Path) -> IO[bytes]:
    """The lock file, held by this process; what is written to it is there at once."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            file = path.open("a+b", buffering=0)
        except FileNotFoundError:
            # who held it before has just removed the folder
            continue
        if not _hold(file):
            owner = _owner(file)
            file.close()
            raise RescoreError(
                f"{path.parent}: expected no other process to write here, got {owner}; wait until it "
                "is done, stop it or choose another folder"
            )
        # who held it before may have removed the name from the file that was opened
        with suppress(OSError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        file.close()


def _owner(file: IO[bytes]) -> str:
    file.seek(0)
    try:
        told = json.loads(file.read())
        return f"process {told['process']} of {told['computer']}, which began {told['since']}"
    except (ValueError, KeyError, TypeError, OSError):
        return "one that has just begun"


if sys.platform == "win32":
    import msvcrt

    def _hold(file: IO[bytes]) -> bool:
        # a byte far behind the text, which others must be able to read
        file.seek(2**20)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _hold(file: IO[bytes]) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            # a file system without locks: names of partial files are unique all the same
            return True
        return True
