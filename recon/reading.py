"""Files that others wrote: one line for whatever a reader raises, sizes checked before memory is taken."""

import io
import json
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from recon.errors import RescoreError

MAX_PIXELS = 100_000_000
"""Pixels of a picture that is decoded; one that claims more is refused from its head alone."""
MAX_ARRAY_BYTES = 2**30
"""Bytes of the arrays of a file, unpacked; one that claims more is refused from its heads alone."""


@contextmanager
def reading(path: object, what: str, advice: str) -> Iterator[None]:
    """Inside, whatever a reader raises over what a file holds becomes one line that names the file.

    Args:
        path: what is read, for the message.
        what: what it should be.
        advice: what to do where it is not.

    Raises:
        RescoreError: the file cannot be read as what it should be.
    """
    try:
        yield
    except RescoreError:
        raise
    except OSError as error:
        why = error.strerror or _told(error)
        raise RescoreError(f"{path}: expected {what}, could not read it ({why}); {advice}") from error
    except Exception as error:
        # parsers of damaged files raise what they come across: KeyError, OverflowError, RecursionError,
        # MemoryError, zlib.error, and errors of their own; to the user all mean the same
        raise RescoreError(
            f"{path}: expected {what}, could not read it ({_told(error)}); {advice}"
        ) from error


def _told(error: Exception) -> str:
    name = type(error).__name__
    text = " ".join(str(error).split())
    return f"{name}: {text if len(text) <= 200 else text[:197] + '...'}" if text else name


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


def json_of(path: Path, what: str, advice: str) -> Any:
    """The value of a JSON file in UTF-8, UTF-16 or UTF-32; NaN and infinity are no numbers of JSON.

    Raises:
        RescoreError: no such file, or not JSON.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected {what}, found no file; check the path")
    with reading(path, f"{what} as JSON", advice):
        return json.loads(path.read_bytes(), parse_constant=_no_number)


def _no_number(name: str) -> float:
    raise ValueError(f"{name}, which is no number of JSON")


def array_of(path: Path) -> NDArray[Any]:
    """The array of an NPY file; nothing in it is unpickled.

    Raises:
        ValueError: it is none, is cut off, or claims more than the file holds.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        _refuse_size(file, path.stat().st_size)
        return np.asarray(np.load(file, allow_pickle=False))


def arrays_of(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an NPZ file by name; nothing in it is unpickled.

    Raises:
        ValueError: an array is none, is cut off, or all claim more than ``MAX_ARRAY_BYTES``.
        zipfile.BadZipFile: it is none.
        OSError: it cannot be read.
    """
    with path.open("rb") as whole, zipfile.ZipFile(whole) as packed:
        members = packed.infolist()
        unpacked = sum(m.file_size for m in members)
        if unpacked > MAX_ARRAY_BYTES:
            raise ValueError(f"{unpacked} bytes of arrays, at most {MAX_ARRAY_BYTES} are read")
        found = {}
        for member in members:
            with packed.open(member) as file:
                _refuse_size(file, member.file_size)
            data = io.BytesIO(packed.read(member))
            found[member.filename.removesuffix(".npy")] = np.asarray(np.load(data, allow_pickle=False))
        return found


def _refuse_size(file: IO[bytes], size: int) -> None:
    """Raises ValueError where the head of an array claims more bytes than there are."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"NPY of version {version}, versions 1 and 2 are read")
    shape, _, kind = read[version](file)
    # in whole numbers without limit: a product of int64 may wrap around
    claimed = kind.itemsize
    for length in shape:
        claimed *= int(length)
    left = size - file.tell()
    if not 0 <= claimed <= left:
        raise ValueError(f"an array of shape {shape} and type {kind}, but {left} bytes")
    file.seek(0)


def refuse_large_picture(path: Path, data: bytes | IO[bytes]) -> tuple[int, int]:
    """Width and height that the head of a picture claims; ``data`` is the file ``path``, open or read.

    Raises:
        RescoreError: more than ``MAX_PIXELS``.
        OSError, ValueError, SyntaxError: no picture that Pillow knows.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data) if isinstance(data, bytes) else data) as picture:
                width, height = picture.size
    except UnidentifiedImageError as error:
        raise ValueError("its head is that of no picture") from error
    except Image.DecompressionBombError as error:
        raise _too_large(path, str(error)) from error
    if width * height > MAX_PIXELS:
        raise _too_large(path, f"{width} x {height}")
    return width, height


def _too_large(path: Path, size: str) -> RescoreError:
    return RescoreError(
        f"{path}: expected a picture of at most {MAX_PIXELS // 10**6} million pixels, got {size}; "
        "scale it down"
    )
