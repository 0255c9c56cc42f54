"""What a box that frames no car is taken for, by the numbers that compare the framed and the seen instance.

These are words for people alone: nothing is decided by them.
"""

from collections.abc import Mapping

import numpy as np

TOO_LARGE = "something larger than a car, such as a van or a truck"
NO_CAR = "ground that recedes, or no car at all"
MORE = "more than one car"
PART = "a part of a car"

_GOES_ON_ABOVE = 0.3
"""Share above the car that fits the box best, at its depth, from which the thing is taller than a car."""
_INSIDE, _BEYOND = 0.25, 0.3
"""Extents of the box by which the seen instance ends within it, or beyond it, where it is another one."""
_LOWER = 0.18
"""Extents by which it is lower than the box, where something goes on above; one that is shifted is not."""
_LITTLE = 0.2
"""Expected overlap below which no instance near the box is that of the box."""
_HIDDEN, _WELL_EXPLAINED = 0.6, 0.65
"""Share of the framed silhouette that nearer things hide, and of the attainable that the seen instance
explains, from which the box is on the edge of a car that stands nearer."""
_GOES_ON_BESIDE = 0.2
_OUTSIDE = 0.35
"""Share of the seen instance's own measurements outside the box, from which the box shows a part of it."""


def look_alike(cues: Mapping[str, float]) -> str:
    """Words for what a candidate is taken for, if it is no whole car; empty where the numbers do not say.

    Args:
        cues: values of ``rescore.cues.framing.FRAMING`` by name; NaN where one is missing.
    """
    sides = [-cues["end_left"], -cues["end_right"]]
    inside = np.nanmax([*sides, -np.inf])
    beyond = np.nanmax([*(-s for s in sides), cues["end_top"], cues["end_bottom"], -np.inf])
    if cues["goes_on_above"] > _GOES_ON_ABOVE and cues["end_top"] + cues["end_bottom"] < -_LOWER:
        return TOO_LARGE
    if cues["explained"] < 0 and cues["overlap"] < _LITTLE:
        on_edge = cues["hidden"] >= _HIDDEN and cues["seen_explained"] >= _WELL_EXPLAINED
        return PART if on_edge else NO_CAR
    if inside > _INSIDE and cues["goes_on_beside"] > _GOES_ON_BESIDE:
        return MORE
    if beyond > _BEYOND and cues["beyond_box"] > _OUTSIDE:
        return PART
    return MORE if inside > _INSIDE else ""
