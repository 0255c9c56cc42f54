"""What a chart of the HTML page is: axes and lines as values that templates/charts.js draws."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from reports.palette import mode_colour, mode_dash, on_dark

_DASH_PATTERN = {"-": "", "--": "7 4", "-.": "9 4 2 4", (0, (1, 1)): "2 3"}
"""Matplotlib's line styles as SVG's."""
_DIGITS = 5


@dataclass(frozen=True)
class Axis:
    """One axis. Values beyond its ends are drawn at the ends."""

    label: str
    low: float
    high: float
    percent: bool = False
    log: bool = False
    linear_high: float | None = None
    """Right end where a reader switches a log axis to a linear one, which begins at 0; None: no switch."""
    digits: int = 2
    """Digits after the point of a value that is read off; of one in per cent, one less than for a share."""


@dataclass(frozen=True)
class Look:
    """Colour on a light and on a dark page, dashes and width of a line."""

    light: str
    dark: str
    dash: str = ""
    width: float = 2.2

    @staticmethod
    def of_mode(mode: str) -> "Look":
        """The common look of a way of scoring."""
        colour, dash = mode_colour(mode), _DASH_PATTERN[mode_dash(mode)]
        dark = "#B4BBC4" if mode == "detector" else on_dark(colour)
        return Look(colour, dark, dash, 1.8 if mode == "detector" else 2.4)

    @staticmethod
    def of_colour(colour: str, mode: str = "metric") -> "Look":
        """A colour with the dashes of a way of scoring."""
        return Look(colour, on_dark(colour), _DASH_PATTERN[mode_dash(mode)], Look.of_mode(mode).width)


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart. Arrays of one length each; NaN and infinity become null."""

    name: str
    """Name in the legend and where values are read off."""
    figure: str
    """Text of the legend on the line, such as its area."""
    look: Look
    x: ArrayLike
    y: ArrayLike
    tags: tuple[str, ...]
    """Names of the switches of the line, which is shown while all of them are on."""
    threshold: ArrayLike | None = None
    """Score of the worst candidate that is accepted at each point."""
    text: tuple[str, ...] = ()
    """Texts that are read off at each point, in place of y."""
    read: str = "nearest"
    """Point that is read off at an x: "last" with at most that x, "first" with at least it, or "nearest"."""
    step: bool = False
    markers: bool = False
    band: Mapping[str, ArrayLike] | None = None
    """``x``, ``low`` and ``high`` of an interval around the line."""
    bars: Mapping[str, ArrayLike] | None = None
    """``low`` and ``high`` of an interval at each point."""
    broad: tuple[float, float] | None = None
    """Values of x between which the line is underlaid with a broad one."""
    mark: tuple[float, float] | None = None
    """Point of the line that is marked, as (x, y)."""


@dataclass(frozen=True, eq=False)
class Chart:
    """A chart with its texts."""

    title: str
    alt: str
    """Description of the chart, for those who do not see it."""
    x: Axis
    y: Axis
    lines: tuple[Line, ...]
    diagonal: bool = False
    """Whether a dotted line from corner to corner is drawn."""
    level: float | None = None
    """y of a line across the whole width."""


@dataclass(frozen=True, eq=False)
class Switch:
    """Something that a reader can show or hide."""

    tag: str
    name: str
    look: Look
    on: bool


@dataclass(frozen=True, eq=False)
class ChartGroup:
    """Charts that share their switches."""

    name: str
    """Name of the group, unique within a page; names of its elements begin with it."""
    kinds: Mapping[str, tuple[Chart, ...]]
    """Charts by what they show; of several kinds one is shown at a time."""
    notes: Mapping[str, str]
    """A sentence or two on each kind."""
    switches: tuple[Switch, ...] = field(default=())

    @property
    def has_bands(self) -> bool:
        """Whether there is an interval to show or hide."""
        return any(
            line.band is not None for charts in self.kinds.values() for c in charts for line in c.lines
        )

    @property
    def has_log_switch(self) -> bool:
        """Whether an axis can be drawn in two ways."""
        return any(c.x.linear_high is not None for charts in self.kinds.values() for c in charts)

    def as_json(self) -> dict[str, Any]:
        """The charts by the id of their element, as JSON values."""
        return {
            f"{self.name}-{i}-{j}": _json(chart)
            for i, charts in enumerate(self.kinds.values())
            for j, chart in enumerate(charts)
        }


def mode_switches(modes: Sequence[str], names: Mapping[str, str], on: Sequence[str]) -> tuple[Switch, ...]:
    """A switch for each way of scoring."""
    return tuple(Switch(m, names[m], Look.of_mode(m), m in on) for m in modes)


def _json(value: Any) -> Any:
    """Dataclasses, arrays and numbers as JSON values, rounded; null for what JSON cannot hold.

    A browser refuses a page's data whole for a single NaN.
    """
    if hasattr(value, "__dataclass_fields__"):
        return {name: _json(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, np.ndarray):
        return [_json(v) for v in value.tolist()]
    if isinstance(value, Mapping):
        return {k: _json(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_json(v) for v in value]
    if isinstance(value, float):
        return round(value, _DIGITS) if math.isfinite(value) else None
    return value
