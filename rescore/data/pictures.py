"""Pictures on disk: their names, sizes and pixels."""

import zlib
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from recon.arrays import UInt8Array
from recon.errors import RescoreError

PNG_HEAD = b"\x89PNG\r\n\x1a\n"


def decode_picture(path: Path, flags: int) -> NDArray[np.generic] | None:
    """The pixels of a picture file as OpenCV gives them; None where it is no whole picture."""
    # imdecode on bytes, since imread neither takes every path nor says why it failed
    data = path.read_bytes()
    # of a damaged file OpenCV gives the rows before the damage, and prints lines of its own
    damaged = (data.startswith(PNG_HEAD) and not _is_whole_png(data)) or (
        data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data
    )
    if not data or damaged:
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def _is_whole_png(data: bytes) -> bool:
    """Whether the chunks of a PNG follow each other up to the last one, each with the checksum it names."""
    place = len(PNG_HEAD)
    while place + 12 <= len(data):
        length = int.from_bytes(data[place : place + 4])
        body, end = data[place + 4 : place + 8 + length], place + 12 + length
        if end > len(data) or zlib.crc32(body) != int.from_bytes(data[end - 4 : end]):
            return False
        if body[:4] == b"IEND":
            return True
        place = end
    return False


def read_rgb(path: Path, width_px: int, height_px: int) -> UInt8Array:
    """The picture as (h, w, 3) uint8 RGB; an error where it is missing, unreadable or of another size."""
    if not path.is_file():
        raise RescoreError(f"{path}: expected a picture, found no file; check file_name in annotations.json")
    bgr = decode_picture(path, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RescoreError(
            f"{path}: expected a picture that OpenCV reads, could not decode it; write it again as PNG"
        )
    if bgr.shape[:2] != (height_px, width_px):
        raise RescoreError(
            f"{path}: expected {width_px} x {height_px} pixels, got {bgr.shape[1]} x {bgr.shape[0]}; "
            "mend width and height in annotations.json or the picture"
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
    try:
        with Image.open(path) as picture:
            return picture.size
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise RescoreError(
            f"{path}: expected a picture, could not read its head; write it again as PNG"
        ) from error


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
