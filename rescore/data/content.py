"""Digests of what files hold, for all that is compared between machines.

One seed gives the same bytes of nearly every file on one machine, and tests hold it to that. Another machine
has another zlib, zip or Parquet writer, sometimes by a patch version of Python alone: there a file holds the
same in other bytes. So whatever leaves a machine (a digest in a config, frames that two runs share, a test
that reads a file of the repository) looks at the content, by ``content_digest``.

A cached stage looks at the bytes, by ``rescore.files.digest_of``. Its record never leaves the run folder, and
other bytes of the same content only cost a run; they can never make a stale result pass for a fresh one. It
runs on every file of a run at every start, and to decode a picture takes three to four times as long as to
hash its file.

docs/decisions.md says of each kind of file on which side it stands.
"""

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.errors import RescoreError
from recon.reading import array_of, arrays_of, reading
from rescore.data.pictures import decode_picture


def content_digest(path: Path) -> str:
    """SHA-256 of what a file holds, as hexadecimal digits.

    It covers the names and arrays of an npz, the array of an npy and the pixels of a PNG, however they are
    packed, and the bytes of any other file: JSON and PFM have no packing, and a JPEG gives other pixels with
    another decoder. The suffix says which it is.

    Raises:
        RescoreError: there is no such file, or it is not whole.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a file, found none; check the path")
    arrays = _READERS.get(path.suffix.lower())
    if arrays is None:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    total = hashlib.sha256()
    for name, array in sorted(arrays(path).items()):
        # a machine of the other byte order hashes the same numbers
        little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        total.update(f"{name}\0{little.dtype.str}\0{array.shape}\0".encode())
        total.update(little.tobytes())
    return total.hexdigest()


def _of_numpy(path: Path) -> dict[str, NDArray[Any]]:
    with reading(path, "whole arrays of numbers", "write the file again"):
        return {"": array_of(path)} if path.suffix.lower() == ".npy" else arrays_of(path)


def _of_png(path: Path) -> dict[str, NDArray[Any]]:
    pixels = decode_picture(path, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise RescoreError(f"{path}: expected a whole PNG, could not decode it; write it again")
    return {"": pixels}


_READERS: Mapping[str, Callable[[Path], dict[str, NDArray[Any]]]] = MappingProxyType(
    {".npz": _of_numpy, ".npy": _of_numpy, ".png": _of_png}
)
