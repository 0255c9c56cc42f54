"""Inner loops compiled to machine code by Numba, for what whole arrays do not do well.

Importing this takes half a second, so modules that hold loops are imported where they are called. A loop is
compiled at its first call, in some seconds, and kept: beside its source, or in the user's cache where that
may not be written, or not at all where neither may.
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from recon.arrays import FloatArray


def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code; it runs beside other threads, and a division by zero is infinite."""
    return _kept(loop, fastmath=_FREE)


def exact(loop: Callable[..., Any]) -> Callable[..., Any]:
    """The function as machine code that rounds after every operation, as whole arrays do."""
    return _kept(loop)


def within(part: Callable[..., Any]) -> Callable[..., Any]:
    """A part of compiled loops, put into each in place of its calls, which makes small ones twice as fast."""
    return _made(part, inline="always", fastmath=_FREE)


def on_unit(function: Callable[[FloatArray], FloatArray], count: int) -> tuple[np.float32, ...]:
    """Coefficients, highest first, of the polynomial that is a function at the Chebyshev points of [0, 1]."""
    points = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
    fitted = Chebyshev.fit(points, function(points), count - 1, domain=(0, 1))
    return tuple(fitted.convert(kind=Polynomial).coef[::-1].astype(np.float32))


_FREE = {"contract", "arcp", "nsz"}
"""A product and a sum may be rounded once; NaN, which marks what is not measured, stays what it is."""


def _kept(loop: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    try:
        return _made(loop, cache=True, **options)
    except RuntimeError:  # no place to keep it
        return _made(loop, **options)


def _made(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    return numba.njit(function, nogil=True, error_model="numpy", **options)  # type: ignore[no-any-return]
