"""The plain colours of an object's parts, for what its picture does not show."""

from collections.abc import Mapping

import numpy as np

from recon.arrays import FloatArray, IntArray, UInt8Array

Colour = tuple[int, int, int]
_FEW = 30
"""Fewer seen places of a part give no colour."""
_ALIKE = 4
"""Parts are of one stuff where the last words of their names begin with as many equal letters: left_windows
and rear_window, front_left_leg and rear_right_leg."""


def part_colours(
    colours: UInt8Array, label: IntArray | UInt8Array, names: Mapping[int, str]
) -> dict[int, Colour]:
    """The plain colour of each part by label, and of the whole by 0: medians, which lamps and plates leave.

    A part that is not seen has the colour of those of its stuff, else that of the whole.

    Args:
        colours: what is seen, shape (n, 3).
        label: the part that each belongs to, shape (n,); other numbers belong to none.
        names: name of each part by label.
    """
    whole = _median(colours) if len(colours) else np.full(3, 128.0)
    out = {0: _rounded(whole)}
    for own, name in names.items():
        kin = [k for k, other in names.items() if _stuff(other) == _stuff(name)]
        for group in ([own], kin):
            seen = colours[np.isin(label, group)]
            if len(seen) >= _FEW:
                out[own] = _rounded(_median(seen))
                break
        else:
            out[own] = out[0]
    return out


def _median(colours: UInt8Array) -> FloatArray:
    return np.asarray(np.median(colours, axis=0))


def _rounded(colour: FloatArray) -> Colour:
    r, g, b = (int(v) for v in np.rint(colour))
    return r, g, b


def _stuff(name: str) -> str:
    return name.rpartition("_")[2][:_ALIKE]
