"""Objects of a store as paths, and what asks the store."""

import io
import os
import re
import time
from collections.abc import Callable, Iterator
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from pathlib import Path, PurePosixPath
from typing import IO, Any, NamedTuple, TypeVar, cast

from recon.errors import RescoreError
from recon.stores.cache import kept

SCHEMES = ("s3", "gs")
"""Stores that are reached through fsspec; ``file://`` is a path of this machine."""
EXTRAS = {"s3": "s3", "gs": "gcs"}
"""Extra of the package that a store needs."""
TRIES = 5
"""How often a store is asked before its error is told."""
FIRST_PAUSE_S = 0.1
"""Pause before the second try; each further one is twice as long."""
BLOCK_BYTES = 2**16
"""Least that is read of an object at once."""

T = TypeVar("T")
_SECRET = re.compile(r"key|secret|token|password|credential", re.IGNORECASE)
_URL = re.compile(r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*):/+(?P<rest>.*)", re.DOTALL)
_NO_BUCKET = re.compile(rf"(--[a-z-]+=)?(?P<scheme>{'|'.join(SCHEMES)}):/(//.*|/?)", re.DOTALL)


class StoreError(RescoreError):
    """A store that refuses, or fails at every try: no fault of what was to be read."""


class State(NamedTuple):
    """What a store says of an object."""

    st_size: int
    """Bytes."""
    tag: str
    """Changes with the content."""


class RemotePath(PurePosixPath):
    """An object of a store, or what begins with its name and a slash: a folder.

    It has those methods of ``pathlib.Path`` that this project reads by.
    """

    __slots__ = ()

    def __str__(self) -> str:
        return super().__str__().replace(":/", "://", 1)

    def __reduce__(self) -> tuple[type["RemotePath"], tuple[str]]:
        return RemotePath, (super().__str__(),)

    @property
    def scheme(self) -> str:
        """The kind of store, as "s3"."""
        return self.parts[0][:-1]

    @property
    def key(self) -> str:
        """Bucket and key, as fsspec takes them."""
        return "/".join(self.parts[1:])

    def stat(self) -> State:
        """Size and tag of the object.

        Raises:
            FileNotFoundError: there is no such object.
        """
        return _state(str(self))

    def is_file(self) -> bool:
        """Whether there is an object of this name."""
        try:
            self.stat()
        except FileNotFoundError:
            return False
        return True

    def is_dir(self) -> bool:
        """Whether some object lies below."""
        try:
            return bool(_info(self)["type"] == "directory")
        except FileNotFoundError:
            return False

    def exists(self) -> bool:
        """Whether there is an object of this name, or one below."""
        return self.is_file() or self.is_dir()

    def is_symlink(self) -> bool:
        """False: stores have no links."""
        return False

    def resolve(self) -> "RemotePath":
        """The path itself."""
        return self

    def mkdir(self, parents: bool = False, exist_ok: bool = False) -> None:
        """Nothing: a store has no folders to make."""

    def iterdir(self) -> Iterator["RemotePath"]:
        """What lies directly below, without what lies deeper."""
        # of a folder that is not there, some clients list what lies above it
        if not self.is_dir():
            return iter(())
        names = _asked(self, "list", lambda fs: list(fs.ls(self.key, detail=False)))
        own = sorted(name.rstrip("/") for name in names)
        return (RemotePath(f"{self.scheme}:/{name}") for name in own if name != self.key)

    def glob(self, pattern: str) -> Iterator["RemotePath"]:
        """What lies directly below and has a name of a pattern."""
        return (path for path in self.iterdir() if fnmatchcase(path.name, pattern))

    def read_bytes(self) -> bytes:
        """The whole object, from the cache where it is kept there."""
        state = self.stat()
        return kept(f"{self}\0{state.tag}\0{state.st_size}", lambda: self.read_range(0, state.st_size))

    def read_text(self, encoding: str = "utf-8") -> str:
        """The whole object as text."""
        return self.read_bytes().decode(encoding)

    def read_range(self, start: int, end: int) -> bytes:
        """The bytes from ``start`` up to ``end``, that one left out."""
        return _asked(self, "read", lambda fs: bytes(fs.cat_file(self.key, start=start, end=end)))

    def open(self, mode: str = "rb") -> IO[bytes]:
        """The object to read from anywhere in it; of it only the blocks that are asked for are read."""
        if mode != "rb":
            raise ValueError(f"{self}: objects are opened to read bytes, not {mode!r}")
        return io.BufferedReader(_RangeFile(self, self.stat().st_size), BLOCK_BYTES)

    def write_bytes(self, data: bytes) -> None:
        """Write the object by one put: others see all of it or what was there before."""
        try:
            # clients would send what is larger than their chunks in pieces
            _asked(self, "write", lambda fs: fs.pipe_file(self.key, data, chunksize=len(data) + 1))
        except FileNotFoundError:
            raise StoreError(f"{self}: expected to write here, found no such bucket; make it") from None
        _state.cache_clear()


class _RangeFile(io.RawIOBase):
    """An object as a file that is read by ranges."""

    def __init__(self, path: RemotePath, size: int) -> None:
        self._path, self._size, self._at = path, size, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        end = min(self._at + len(buffer), self._size)
        if end <= self._at:
            return 0
        data = self._path.read_range(self._at, end)
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)


def located(place: str | Path) -> Path:
    """The path of a URL or of a local name.

    A path that was made of a URL, which loses one of its two slashes, is taken for the URL.

    Raises:
        RescoreError: an unknown kind of URL, one without a bucket, or one with credentials in it.
    """
    if remote(place) is not None:
        return cast(Path, place)
    found = _URL.fullmatch(str(place))
    if found is None or len(found["scheme"]) == 1:
        return Path(place)
    scheme, rest = found["scheme"], found["rest"]
    if scheme == "file":
        return Path("/" + rest)
    if scheme not in SCHEMES:
        # a folder may have a colon at the end of its name
        if "://" not in str(place) and Path(f"{scheme}:").exists():
            return Path(place)
        raise RescoreError(f"{scheme}://: expected s3://, gs:// or file://, got another; copy the files here")
    bucket = rest.partition("/")[0]
    if not bucket or "@" in bucket or ":" in bucket:
        raise _no_bucket(scheme, "credentials" if "@" in bucket else "no plain name of a bucket")
    return cast(Path, RemotePath(f"{scheme}:/{rest}"))


def refuse_no_bucket(word: str) -> None:
    """Raises RescoreError where a word of a command is the URL of a store without a bucket.

    A path that is made of it would take the first part of its key for the bucket.
    """
    found = _NO_BUCKET.fullmatch(word)
    if found is not None:
        raise _no_bucket(found["scheme"], "no bucket")


def _no_bucket(scheme: str, got: str) -> RescoreError:
    return RescoreError(
        f"{scheme}://: expected {scheme}://BUCKET/KEY, got {got}; name the bucket; credentials belong in the "
        "environment"
    )


def beside(folder: Path, name: str) -> Path:
    """The path of a name that a file in a folder gives: relative to the folder, or a URL."""
    return located(name) if "://" in name else folder / name


def name_from(folder: Path, path: Path) -> str:
    """The name for ``beside`` of a file as seen from a folder; a URL where the two are not in one place."""
    if remote(folder) is None and remote(path) is None:
        return os.path.relpath(path.resolve(), folder.resolve())
    if remote(folder) is not None and path.is_relative_to(folder):
        return path.relative_to(folder).as_posix()
    return str(path) if remote(path) is not None else path.resolve().as_uri()


def remote(path: object) -> RemotePath | None:
    """The path where it is one of a store; None for one of this machine."""
    return path if isinstance(path, RemotePath) else None


def _info(path: RemotePath) -> dict[str, Any]:
    return _asked(path, "look at", lambda fs: dict(fs.info(path.key)))


@lru_cache(maxsize=10_000)
def _state(url: str) -> State:
    # what is not there raises and so is asked for again
    found = _info(RemotePath(url))
    if found["type"] != "file":
        raise FileNotFoundError(url)
    tag = found.get("ETag") or found.get("etag") or found.get("LastModified") or found.get("mtime") or ""
    return State(int(found["size"]), str(tag))


def _asked(path: RemotePath, doing: str, ask: Callable[[Any], T]) -> T:
    """What a store answers; errors that may pass are waited for, a few times.

    Raises:
        FileNotFoundError: there is no such object.
        StoreError: the store refuses, or still fails at the last try.
    """
    for n in range(TRIES):
        try:
            return ask(_filesystem(path.scheme))
        except (FileNotFoundError, RescoreError):
            raise
        except Exception as error:
            # client libraries raise what their transport does: OSError, TimeoutError, errors of their own
            lasting = isinstance(error, PermissionError) or "Credential" in type(error).__name__
            if lasting or n == TRIES - 1:
                tried = "" if lasting else f" at each of {TRIES} tries"
                raise StoreError(
                    f"{path}: expected to {doing} it, got {_told(error)}{tried}; check the address, the "
                    "store and the credentials of the environment"
                ) from None
            pause(FIRST_PAUSE_S * 2**n)
    raise AssertionError("the last try returns or raises")


def pause(seconds: float) -> None:
    """Wait before a store is asked again."""
    time.sleep(seconds)


def _told(error: Exception) -> str:
    """The error in one line, without what the environment holds as a secret."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    for name, value in os.environ.items():
        if _SECRET.search(name) and len(value) > 3:
            text = text.replace(value, "...")
    return text if len(text) <= 200 else text[:197] + "..."


@cache
def _filesystem(scheme: str) -> Any:
    missing = StoreError(
        f"{scheme}://: expected the package's extra {EXTRAS[scheme]!r}, which is not installed; "
        f'pip install "rescore[{EXTRAS[scheme]}]"'
    )
    try:
        import fsspec  # noqa: PLC0415 (whoever works on this machine alone needs none)

        if scheme == "gs":
            from recon.stores.google import google_store  # noqa: PLC0415

            return google_store()
        # tries are counted here, so that their number and time have a bound
        quick = {"retries": {"total_max_attempts": 1}, "connect_timeout": 10, "read_timeout": 60}
        s3 = fsspec.filesystem("s3", use_listings_cache=False, config_kwargs=quick)
        s3.retries = 1
    except ImportError:
        raise missing from None
    return s3
