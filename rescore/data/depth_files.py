"""Files of measured depth or disparity: 16-bit PNG, PFM, NPY, EXR, each with its quantity and factor."""

import os
import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from recon.arrays import Float32Array
from recon.errors import RescoreError
from recon.reading import MAX_PIXELS, array_of, reading
from recon.stereo.sgbm import read_png16

SUFFIXES = (".png", ".pfm", ".npy", ".exr")
"""The forms that ``read_map`` reads."""
TUM_DEPTH_FACTOR = 5000.0
"""Value of the TUM RGB-D depth PNGs for one metre."""


class Quantity(StrEnum):
    """What a file measures."""

    DISPARITY = "disparity"
    """The file holds left disparity in pixels."""
    DEPTH = "depth"
    """The file holds z of the left camera in metres."""


@dataclass(frozen=True)
class MeasuredFile:
    """A file of measured depth or disparity of the left picture."""

    path: Path
    quantity: Quantity
    factor: float = 1.0
    """Value of the file for one pixel of disparity or one metre of depth."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.factor) and self.factor > 0):
            raise RescoreError(
                f"{self.path}: expected a positive factor from file value to {self.quantity}, "
                f"got {self.factor}; KITTI has 256, TUM depth 5000, millimetres 1000"
            )


def read_measured(file: MeasuredFile, width_px: int, height_px: int) -> Float32Array:
    """Disparity in pixels or depth in metres, shape (h, w); NaN where a file has 0, less, NaN or infinity.

    Raises:
        RescoreError: no such file, damaged, or another type or size.
    """
    value = read_map(file.path, file.quantity.value, file.factor, width_px, height_px)
    return np.where(np.isfinite(value) & (value > 0), value, np.float32(np.nan))


def has_whole_numbers(path: Path) -> bool:
    """Whether a file has no fractions, so that its unit must be told: a PNG, or an NPY of integers."""
    suffix = path.suffix.lower()
    if suffix != ".npy":
        return suffix == ".png"
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            read = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            kind = read(file)[2]
    except (ValueError, EOFError, OSError):
        # whoever reads the values says what is wrong
        return False
    return bool(np.issubdtype(kind, np.integer))


def read_map(path: Path, what: str, factor: float, width_px: int, height_px: int) -> Float32Array:
    """Value / factor as the file has it, shape (h, w), whatever it is; ``what`` names it in the errors.

    Raises:
        RescoreError: no such file, damaged, or another type or size.
    """
    suffix = path.suffix.lower()
    if suffix == ".png":
        return read_png16(path, width_px, height_px, what, factor)
    readers = {".pfm": _read_pfm, ".npy": _read_npy, ".exr": _read_exr}
    if suffix not in readers:
        raise RescoreError(
            f"{path}: expected a {what} file as {', '.join(SUFFIXES)}, got {suffix or 'no suffix'}; "
            "convert it"
        )
    if not path.is_file():
        raise RescoreError(f"{path}: expected a {what} file, found no file; check its name")
    value = readers[suffix](path)
    if value.shape != (height_px, width_px):
        raise RescoreError(
            f"{path}: expected a {what} file of {width_px} x {height_px} values (one channel), got an array "
            f"of shape {value.shape}; it must be that of the left picture"
        )
    return value / np.float32(factor)


_PFM_HEAD = re.compile(rb"(\S+)\s+(\d{1,9})\s+(\d{1,9})\s+(\S{1,40})\s", re.ASCII)
"""Kind, width, height and scale of a PFM, between any blanks or ends of lines, and one before the values."""


def _read_pfm(path: Path) -> Float32Array:
    """Grey portable float map, rows from the bottom up; a negative scale means little endian."""
    data = path.read_bytes()
    head = _PFM_HEAD.match(data[:200])
    try:
        if head is None:
            raise ValueError(f"no head in {data[:20]!r}")
        kind, (width, height), scale = head[1], map(int, head.group(2, 3)), float(head[4])
        if kind != b"Pf" or min(width, height) <= 0:
            raise ValueError(f"kind {kind[:8]!r}, size {width} x {height}")
        # a head of lines that end with two characters
        start = head.end() + (data[head.end() - 1 : head.end() + 1] == b"\r\n")
        if len(data) - start != 4 * width * height:
            raise ValueError(f"{(len(data) - start) / 4:g} of {width * height} values")
        values = np.frombuffer(data, "<f4" if scale < 0 else ">f4", offset=start)
    except ValueError as error:
        raise RescoreError(
            f"{path}: expected a whole grey PFM (header Pf), got another or a cut-off file ({error}); "
            "write it again"
        ) from error
    return np.flipud(values.reshape(height, width)).astype(np.float32)


def _read_npy(path: Path) -> Float32Array:
    with reading(path, "a whole NPY array of numbers", "write it again"):
        value = array_of(path)
    if not (np.issubdtype(value.dtype, np.floating) or np.issubdtype(value.dtype, np.integer)):
        raise RescoreError(f"{path}: expected an array of numbers, got type {value.dtype}; convert it")
    return np.asarray(value, np.float32)


def _refuse_large_exr(path: Path, data: bytes) -> None:
    # the head names the corners of the picture, in whole numbers, the last ones inside it
    place = data.find(b"dataWindow\0box2i\0")
    corners = data[place + 21 : place + 37]
    if place < 0 or len(corners) < 16:
        return
    x0, y0, x1, y1 = (int(v) for v in np.frombuffer(corners, "<i4"))
    if (x1 - x0 + 1) * (y1 - y0 + 1) > MAX_PIXELS:
        raise RescoreError(
            f"{path}: expected at most {MAX_PIXELS // 10**6} million pixels, got {x1 - x0 + 1} x "
            f"{y1 - y0 + 1}; scale it down"
        )


def _read_exr(path: Path) -> Float32Array:
    # asked before OpenCV is, which would print lines of its own
    if os.environ.get("OPENCV_IO_ENABLE_OPENEXR", "0") not in ("1", "true", "TRUE", "ON", "on"):
        raise RescoreError(
            f"{path}: expected OpenCV with EXR switched on, got it off; set OPENCV_IO_ENABLE_OPENEXR=1 or "
            "write PFM"
        )
    data = path.read_bytes()
    _refuse_large_exr(path, data)
    try:
        value = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        value = None
    if value is None:
        raise RescoreError(
            f"{path}: expected an EXR picture that OpenCV reads, could not decode it; write PFM"
        )
    return np.asarray(value, np.float32)
