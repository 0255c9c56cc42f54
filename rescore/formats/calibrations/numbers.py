"""The numbers of a calibration file: of a value as files nest it, and of a name."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError

Values = dict[str, FloatArray]
"""Numbers and lists of shape (n,) and matrices (rows, n) by their names."""


def numbers_of(path: Path, name: str, value: object) -> FloatArray:
    """The numbers of one, a list, rows, or a matrix with rows, cols and data.

    Raises:
        RescoreError: there is something else, or another count of numbers than rows and cols say.
    """
    matrix = value if isinstance(value, dict) else {}
    listed = matrix.get("data") if matrix else value
    try:
        numbers = np.atleast_1d(np.array(_parsed(listed), float))
        rows, columns = int(matrix.get("rows", 0)), int(matrix.get("cols", 0))
        # OpenCV writes "3d" where each place has three numbers
        channels = int(re.split(r"\D", str(matrix.get("dt", "")))[0] or 1)
    except (ValueError, TypeError, OverflowError) as error:
        raise RescoreError(f"{path}: {name}: expected numbers, got {short(value)}; mend it") from error
    if not numbers.size or not np.isfinite(numbers).all():
        raise RescoreError(f"{path}: {name}: expected finite numbers, got {short(listed)}; mend it")
    if not matrix or (rows, columns) == (0, 0):
        return numbers
    if numbers.size != rows * columns * channels:
        raise RescoreError(
            f"{path}: {name}: expected {rows} x {columns} numbers, got {numbers.size}; mend rows and cols"
        )
    return numbers.reshape(rows, columns * channels)


def _parsed(value: object) -> Any:
    """The number of a text, or the numbers of a text or a list, nested as they stand.

    Raises:
        ValueError: there is something else.
    """
    if isinstance(value, list):
        return [_parsed(v) for v in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, str):
        raise ValueError("no text")
    # YAML writes .nan and .inf
    plain = re.sub(r"\.(nan|inf)", r"\1", value, flags=re.IGNORECASE)
    numbers = [float(v) for v in re.split(r"[\s,]+", plain.strip()) if v]
    return numbers[0] if len(numbers) == 1 else numbers


def short(value: object) -> str:
    """The beginning of a value, for an error."""
    return repr(str(value).strip()[:40])


def matrix_of(path: Path, values: Mapping[str, FloatArray], name: str, rows: int, columns: int) -> FloatArray:
    """The matrix of a name, shape (rows, columns); a list of as many numbers is taken row by row.

    Raises:
        RescoreError: there is no such name, or its value has another shape.
    """
    value = values.get(name)
    # a matrix of one row or column is a list
    listed = value is not None and (value.ndim == 1 or 1 in value.shape)
    if value is not None and value.size == rows * columns and (listed or value.shape == (rows, columns)):
        return value.reshape(rows, columns)
    got = "no such entry" if value is None else f"{' x '.join(map(str, value.shape))} numbers"
    raise RescoreError(f"{path}: {name}: expected {rows} x {columns} numbers, got {got}; mend it")


def number_of(path: Path, values: Mapping[str, FloatArray], name: str) -> float:
    """The single number of a name.

    Raises:
        RescoreError: there is no such name, or its value is not one number.
    """
    return float(matrix_of(path, values, name, 1, 1)[0, 0])


def pinhole(fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    """The matrix K, shape (3, 3)."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=float)
