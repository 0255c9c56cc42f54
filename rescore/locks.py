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

LOCK = ".lock"
"""Name of the file in a folder that the process which writes there holds locked."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Inside, no other process gets past the same call for this folder, which is made if need be.

    The system gives the lock back when the process ends, in whatever way.

    Raises:
        RescoreError: another process has it; the message names that process. Or the folder cannot be made.
    """
    refuse_as_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    file = _opened(path)
    try:
        file.seek(0)
        file.truncate()
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        json.dump({"process": os.getpid(), "computer": platform.node(), "since": since}, file)
        file.flush()
        yield
    finally:
        # while it is held: after that, it may be another's
        with suppress(OSError):
            path.unlink()
        file.close()


def _opened(path: Path) -> IO[str]:
    """The lock file, held by this process."""
    while True:
        file = path.open("a+", encoding="utf-8")
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


def _owner(file: IO[str]) -> str:
    file.seek(0)
    try:
        told = json.loads(file.read())
        return f"process {told['process']} of {told['computer']}, which began {told['since']}"
    except (ValueError, KeyError, TypeError, OSError):
        return "one that has just begun"


if sys.platform == "win32":
    import msvcrt

    def _hold(file: IO[str]) -> bool:
        # a byte far behind the text, which others must be able to read
        file.seek(2**20)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _hold(file: IO[str]) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            # a file system without locks: names of partial files are unique all the same
            return True
        return True
