"""Kinds of arrays that annotations name; the shape stands in the docstring of each value."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
BoolArray = NDArray[np.bool_]
UInt8Array = NDArray[np.uint8]
"""Pictures: (h, w, 3) RGB, or (h, w) grey."""
