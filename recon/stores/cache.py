"""The cache of what is read whole from stores: files on disk, with a bound."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from recon.errors import RescoreError

CACHE_VARIABLE = "RESCORE_CACHE_MB"
"""Environment variable with the bound of the cache in megabytes; 0 keeps nothing."""
CACHE_MB = 2000
"""Bound of the cache where nothing else is said."""


def cache_folder() -> Path:
    """The folder of the cache."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "rescore" / "objects"


def _bound() -> int:
    """Bytes that the cache may hold."""
    text = os.environ.get(CACHE_VARIABLE, str(CACHE_MB))
    if not text.isdecimal():
        raise RescoreError(f"{CACHE_VARIABLE}: expected megabytes as a whole number, got {text!r}; mend it")
    return int(text) * 10**6


def kept(name: str, read: Callable[[], bytes]) -> bytes:
    """The content of that name, read where the cache has none; the cache then holds it, within its bound."""
    folder, bound = cache_folder(), _bound()
    file = folder / hashlib.sha256(name.encode()).hexdigest()
    with suppress(OSError):
        data = file.read_bytes()
        os.utime(file)
        return data
    data = read()
    # an object that takes a good part of the cache would push out all the rest
    if len(data) * 10 <= bound:
        with suppress(OSError):
            _keep(folder, file, data, bound)
    return data


_written_bytes: dict[int, int] = {}
"""Bytes that a process has put into the cache since it last looked at its size."""


def _keep(folder: Path, file: Path, data: bytes, bound: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    before = _written_bytes.get(os.getpid())
    if before is None or before + len(data) > bound // 10:
        _shrink(folder, bound * 8 // 10 - len(data))
        before = 0
    _written_bytes[os.getpid()] = before + len(data)
    handle, beside = tempfile.mkstemp(dir=folder)
    with os.fdopen(handle, "wb") as out:
        out.write(data)
    os.replace(beside, file)


def _shrink(folder: Path, most: int) -> None:
    """Remove what was used longest ago until no more than ``most`` bytes are left."""
    files = []
    for entry in os.scandir(folder):
        with suppress(OSError):
            state = entry.stat()
            files.append((state.st_mtime_ns, state.st_size, entry.path))
    total = sum(size for _, size, _ in files)
    for _, size, path in sorted(files):
        if total <= most:
            return
        with suppress(OSError):
            os.unlink(path)
            total -= size
