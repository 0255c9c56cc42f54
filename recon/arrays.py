"""Kinds of arrays that annotations name; the shape stands in the docstring of each value."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
BoolArray = NDArray[np.bool_]
UInt8Array = NDArray[np.uint8]
"""Pictures: (h, w, 3) RGB, or (h, w) grey."""


def constant(value: object, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
    """An array with one value everywhere, in the memory of that value alone; not to be written to."""
    return np.broadcast_to(np.array(value, dtype), shape)


def median(values: NDArray[Any]) -> float:
    """The median of one or more numbers (n,), none of them NaN; ``np.median`` takes three times as long."""
    n = len(values)
    ordered = np.partition(values, ((n - 1) // 2, n // 2))
    return float(ordered[(n - 1) // 2] + ordered[n // 2]) / 2


def percentiles(values: NDArray[Any], percent: Sequence[float]) -> list[float]:
    """Percentiles of one or more numbers (n,), none of them NaN, with straight lines between the numbers."""
    at = [q / 100 * (len(values) - 1) for q in percent]
    below = [int(a) for a in at]
    above = [min(i + 1, len(values) - 1) for i in below]
    ordered = np.partition(values, sorted({*below, *above}))
    return [
        float(ordered[i]) + (a - i) * (float(ordered[j]) - float(ordered[i]))
        for a, i, j in zip(at, below, above, strict=True)
    ]


def rows_by_value(column: IntArray) -> dict[int, IntArray]:
    """The rows of each value, in their order, from one look at all rows."""
    order = np.argsort(column, kind="stable")
    values, first = np.unique(column[order], return_index=True)
    return dict(zip(values.tolist(), np.split(order, first[1:]), strict=True)) if len(column) else {}


def rows_of(column: NDArray[Any], rows: NDArray[Any]) -> NDArray[Any]:
    """The rows of a mask or an index; of an array of ``constant`` again such a one."""
    if not is_constant(column):
        return np.asarray(column[rows])
    n = len(np.empty(len(column), np.bool_)[rows])
    return np.broadcast_to(column[0], (n, *column.shape[1:]))


def stacked(columns: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The rows of arrays below each other; of arrays of ``constant`` with one value again such a one."""
    filled = [c for c in columns if len(c)]
    if len(filled) == 1:
        return filled[0]
    if filled and all(is_constant(c) and _same(c[0], filled[0][0]) for c in filled):
        return np.broadcast_to(filled[0][0], (sum(map(len, filled)), *filled[0].shape[1:]))
    return np.concatenate(columns)


def is_constant(column: NDArray[Any]) -> bool:
    """Whether an array has its rows in the memory of one, as those of ``constant``."""
    return len(column) > 0 and all(stride == 0 for stride in column.strides)


def _same(a: Any, b: Any) -> bool:
    return bool(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f"))
