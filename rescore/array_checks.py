"""What checks of arrays that users give have in common."""

from typing import Any

import numpy as np


def kind_of(value: Any) -> str:
    """What came, for an error: shape and type of an array, the type of anything else."""
    if isinstance(value, np.ndarray):
        return f"shape {value.shape} of {value.dtype}"
    return type(value).__name__
