"""Pictures on disk: their names, sizes and pixels."""

import io
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image
from PIL.PngImagePlugin import PngImageFile

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.reading import reading, refuse_large_picture

PNG_HEAD = b"\x89PNG\r\n\x1a\n"
_TIFF_HEADS = (b"II*\x00", b"MM\x00*")
PNG_END = b"\x00\x00\x00\x00IEND\xae\x42\x60\x82"


def decode_picture(path: Path, flags: int) -> NDArray[np.generic] | None:
    """The pixels of a picture file as they are stored; None where it is no whole picture.

    An EXIF orientation is not followed: boxes, depth and calibration are of the stored pixels.

    Raises:
        RescoreError: its head claims more than ``recon.reading.MAX_PIXELS``, or it is a TIFF with an
            orientation, which OpenCV follows whatever it is told.
    """
    return _decoded(path, path.read_bytes(), flags)


def _decoded(path: Path, data: bytes, flags: int) -> NDArray[np.generic] | None:
    """``decode_picture`` of the bytes of a file."""
    # imdecode on bytes, since imread neither takes every path nor says why it failed
    # OpenCV gives the rows before the damage of a damaged file, and prints lines of its own
    damaged = (data.startswith(PNG_HEAD) and not _is_whole_png(data)) or (
        data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data
    )
    if not data or damaged:
        return None
    if data.startswith(_TIFF_HEADS) and (told := turned_by_exif(path)):
        raise RescoreError(f"{path}: expected pixels, got a TIFF{told}; write it without an orientation")
    try:
        refuse_large_picture(path, data)
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except (OSError, SyntaxError, ValueError, cv2.error):
        return None


def _is_whole_png(data: bytes) -> bool:
    """Whether the chunks of a PNG follow each other up to the last one, each with the checksum it names."""
    # Pillow does not read the checksum of the last chunk, and OpenCV refuses pictures without it
    if PNG_END not in data:
        return False
    try:
        PngImageFile(io.BytesIO(data)).verify()
    except (OSError, SyntaxError, ValueError):
        return False
    return True


def is_whole_png_file(path: Path) -> bool:
    """Whether there is a file, and it is a whole PNG."""
    try:
        return _is_whole_png(path.read_bytes())
    except OSError:
        return False


def read_rgb(path: Path, width_px: int, height_px: int) -> UInt8Array:
    """The picture as (h, w, 3) uint8 RGB; an error where it is missing, unreadable or of another size."""
    if not path.is_file():
        raise RescoreError(
            f"{path}: expected a picture, found no file; check the path that the data set names"
        )
    # read once, since a store takes a while to answer; a small file may claim any size: compared before it is
    # unpacked
    with reading(path, "a picture", "write it again as PNG"):
        width, height = refuse_large_picture(path, data := path.read_bytes())
    if (width, height) != (width_px, height_px):
        raise RescoreError(
            f"{path}: expected {width_px} x {height_px} pixels, got {width} x {height}"
            f"{turned_by_exif(path)}; mend the picture, or the width and height that the data set states"
        )
    bgr = _decoded(path, data, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RescoreError(
            f"{path}: expected a picture that OpenCV reads, could not decode it; write it again as PNG"
        )
    _refuse_few_bits(path, data, int(bgr.max()))
    return np.asarray(cv2.cvtColor(np.asarray(bgr, np.uint8), cv2.COLOR_BGR2RGB), np.uint8)


_FEW_BITS = 12
"""Cameras of 10 or 12 bits; of 16 bits, of which 8 are kept, their values would leave 4 or less."""


def _refuse_few_bits(path: Path, data: bytes, most: int) -> None:
    """Raises RescoreError where values of few bits stand in 16; ``most`` is the largest of the 8 kept."""
    if not most < 1 << (_FEW_BITS - 8):
        return
    stored = _decoded(path, data, cv2.IMREAD_UNCHANGED)
    if stored is not None and stored.dtype == np.uint16 and (top := int(stored.max())) > 0:
        raise RescoreError(
            f"{path}: expected values that fill the 16 bits they have, got none above {top}; multiply those "
            f"of {_FEW_BITS} bits by {1 << (16 - _FEW_BITS)}, or write 8 bits"
        )


PICTURES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture, from its head alone.

    Raises:
        RescoreError: no such file, or no picture.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a picture, found no file; check the folder")
    with reading(path, "a picture", "write it again as PNG"), path.open("rb") as file:
        return refuse_large_picture(path, file)


def turned_by_exif(path: Path) -> str:
    """Words on a picture whose EXIF orientation asks viewers to turn it; empty where none does."""
    try:
        with path.open("rb") as file, Image.open(file) as picture:
            # of other forms Pillow would decode the pixels to look for it
            known = picture.format in {"JPEG", "MPO", "TIFF", "WEBP"} or "exif" in picture.info
            value = picture.getexif().get(ExifTags.Base.Orientation, 1) if known else 1
    except (
        OSError,
        SyntaxError,
        ValueError,
        KeyError,
        TypeError,
        struct.error,
        Image.DecompressionBombError,
    ):
        # whoever decodes the picture says what is wrong with it
        return ""
    return f" as stored, which EXIF orientation {value} asks viewers to turn" if value in range(2, 9) else ""


def files_in(folder: Path, suffixes: Sequence[str], what: str) -> list[Path]:
    """The files of a folder that end so, in the order of their names; hidden files are left out.

    Raises:
        RescoreError: there is none, two bear one name, or one cannot be opened or written down; ``what``
        names them.
    """
    _refuse_odd(folder, suffixes)
    found = sorted(p for p in folder.iterdir() if _ends(p, suffixes) and not p.name.startswith("."))
    if not found:
        raise RescoreError(f"{folder}: expected {what} ({', '.join(suffixes)}), found none; check the folder")
    return list(by_stem(found).values())


def _refuse_odd(folder: Path, suffixes: Sequence[str]) -> None:
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() in suffixes):
        if path.is_symlink() and not path.exists():
            raise RescoreError(f"{path}: expected a file, got a link to none; fetch what it stands for")
        try:
            path.name.encode()
        except UnicodeEncodeError as error:
            raise RescoreError(f"{folder}: expected names in UTF-8, got {path.name!a}; rename it") from error


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder in the order of their names; hidden files are none.

    Raises:
        RescoreError: there is none, or two bear one name.
    """
    return files_in(folder, PICTURES, "pictures")


def by_stem(paths: Sequence[Path]) -> dict[str, Path]:
    """The files of a folder by their names without the end, in their order.

    Raises:
        RescoreError: two bear one name.
    """
    found: dict[str, Path] = {}
    for path in paths:
        _refuse_two(found.setdefault(path.stem, path), path)
    return found


def file_named(folder: Path, stem: str, suffixes: Sequence[str]) -> Path | None:
    """The file of a folder with a name and one of several ends, None where there is none.

    Raises:
        RescoreError: there are two.
    """
    found = sorted(p for p in folder.iterdir() if p.stem == stem and _ends(p, suffixes))
    for path in found[1:]:
        _refuse_two(found[0], path)
    return found[0] if found else None


def _ends(path: Path, suffixes: Sequence[str]) -> bool:
    return path.suffix.lower() in suffixes and path.is_file()


def _refuse_two(first: Path, second: Path) -> None:
    if first != second:
        raise RescoreError(
            f"{first.parent}: expected one file of the name {first.stem!r}, got {first.name} and "
            f"{second.name}; remove one"
        )
