"""Pictures on disk: their names, sizes and pixels."""

import io
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.reading import reading, refuse_large_picture

PNG_HEAD = b"\x89PNG\r\n\x1a\n"
PNG_END = b"\x00\x00\x00\x00IEND\xae\x42\x60\x82"


def decode_picture(path: Path, flags: int) -> NDArray[np.generic] | None:
    """The pixels of a picture file as OpenCV gives them; None where it is no whole picture.

    Raises:
        RescoreError: its head claims more than ``recon.reading.MAX_PIXELS``.
    """
    # imdecode on bytes, since imread neither takes every path nor says why it failed
    data = path.read_bytes()
    # OpenCV gives the rows before the damage of a damaged file, and prints lines of its own
    damaged = (data.startswith(PNG_HEAD) and not _is_whole_png(data)) or (
        data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data
    )
    if not data or damaged:
        return None
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
        raise RescoreError(f"{path}: expected a picture, found no file; check file_name in annotations.json")
    # a small file may claim any size: compared before it is unpacked
    width, height = picture_size(path)
    if (width, height) != (width_px, height_px):
        raise RescoreError(
            f"{path}: expected {width_px} x {height_px} pixels, got {width} x {height}; "
            "mend width and height in annotations.json or the picture"
        )
    bgr = decode_picture(path, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RescoreError(
            f"{path}: expected a picture that OpenCV reads, could not decode it; write it again as PNG"
        )
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8)


PICTURES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".bmp", ".tif", ".tiff", ".webp")


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture, from its head alone.

    Raises:
        RescoreError: no such file, or no picture.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a picture, found no file; check the folder")
    with reading(path, "a picture", "write it again as PNG"):
        return refuse_large_picture(path, path.read_bytes())


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder in the order of their names; hidden files are none.

    Raises:
        RescoreError: there is none, or two bear one name.
    """
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in PICTURES and not p.name.startswith("."))
    if not found:
        raise RescoreError(
            f"{folder}: expected pictures ({', '.join(PICTURES)}), found none; check the folder"
        )
    twice = [name for name, n in Counter(p.stem for p in found).items() if n > 1]
    if twice:
        raise RescoreError(
            f"{folder}: expected one picture of each name, got two of {twice[0]!r}; remove one"
        )
    return found
