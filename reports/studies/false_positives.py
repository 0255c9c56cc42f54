"""False positives an image by the share of cars found, for several ways of scoring, with their intervals."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from rescore.results.sweep_file import SweptInterval

Way = tuple[Mapping[str, SweptInterval], str, str]
"""False positives an image by recall, as "0.7", of a way of scoring; its colour and its marker."""


def draw_false_positives(ax: Axes, ways: Mapping[str, Way]) -> None:
    """Draw the ways of scoring, by their names in the legend, side by side at each recall.

    All of them have the same recalls. One that is never reached is a cross at the top.
    """
    known = [i for fppi, *_ in ways.values() for i in fppi.values() if np.isfinite(i.value)]
    largest = max((i.value for i in known), default=1.0)
    # an end far above all figures would press them together
    top = min(1.06 * max((i.high for i in known), default=1.0), 2.5 * largest)
    recalls = list(next(iter(ways.values()))[0])
    offsets = 0.16 * (np.arange(len(ways)) - (len(ways) - 1) / 2)
    for offset, (name, (fppi, colour, marker)) in zip(offsets, ways.items(), strict=True):
        intervals = [fppi[recall] for recall in recalls]
        reached = [k for k, i in enumerate(intervals) if np.isfinite(i.value)]
        x = np.array(reached) + offset
        value, low, high = (_column(intervals, reached, end) for end in ("value", "low", "high"))
        # an open end leaves the picture
        ax.vlines(x, low, np.minimum(high, 10 * top), color=colour, lw=2, alpha=0.6)
        ax.plot(x, value, marker, color=colour, label=name)
        never = [k + offset for k in range(len(recalls)) if k not in reached]
        ax.plot(never, np.full(len(never), 0.97 * top), "x", color=colour, clip_on=False)
    ax.set_xticks(range(len(recalls)), [f"{float(recall):.0%}" for recall in recalls])
    ax.set(xlabel="share of all cars found (× at the top: not reached)", ylim=(0, top))
    ax.spines[["top", "right"]].set_visible(False)


def _column(intervals: Sequence[SweptInterval], rows: Sequence[int], end: str) -> np.ndarray:
    return np.array([getattr(intervals[k], end) for k in rows])
