"""What a chart is: axes, lines and titles as values.

Three painters draw it: ``reports.run.curve_pictures`` as PNG, ``page/templates/charts.js`` in the HTML page,
``reports.recording.plot`` in the recording.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from recon.arrays import FloatArray
from reports.palette import Dash, mode_colour, mode_dash, on_dark
from rescore.results.candidate_file import ALONE

_DIGITS = 5
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_MOST_TICKS = 6


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
    short: str = ""
    """The label of a low chart; empty where it is no other."""
    edge: str = ""
    """What the left end of a log axis stands for, where it is another value than its number."""

    @property
    def still_label(self) -> str:
        """The label in a picture where no reader can switch the axis to a linear one."""
        edge = f"; left edge: {self.edge}" if self.edge else ""
        return f"{self.label} (log{edge})" if self.log else self.label

    @property
    def ticks(self) -> tuple[float, ...]:
        """Round values from end to end: the decades of a log axis, else at most six even steps."""
        if self.log:
            first, last = math.ceil(math.log10(self.low)), math.floor(math.log10(self.high))
            return tuple(10.0**k for k in range(first, last + 1))
        rough = (self.high - self.low) / (_MOST_TICKS - 1)
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(s * power for s in _STEPS if s * power >= 0.999 * rough)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return tuple(round(k * step, 12) for k in range(first, last + 1))

    def unit(self, value: FloatArray) -> FloatArray:
        """Values mapped to [0, 1] along the axis; values beyond its ends are held at the ends."""
        low, high = (math.log10(self.low), math.log10(self.high)) if self.log else (self.low, self.high)
        at = np.log10(np.maximum(value, self.low)) if self.log else value
        return np.clip((at - low) / (high - low), 0, 1)


@dataclass(frozen=True)
class Look:
    """Colour on a light and on a dark page, dashes and width of a line."""

    light: str
    dark: str
    dash: Dash = "solid"
    width: float = 2.2
    """In points of a picture, or pixels of a page."""

    @staticmethod
    def of_mode(mode: str) -> "Look":
        """The common look of a way of scoring."""
        return Look.of_colour(mode_colour(mode), mode)

    @staticmethod
    def of_colour(colour: str, mode: str = "metric") -> "Look":
        """A colour with the dashes of a way of scoring."""
        return Look(colour, on_dark(colour), mode_dash(mode), 1.8 if mode == ALONE else 2.4)


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
    ceiling: float | None = None
    """Largest y that the line could reach; a PNG picture shows it dotted."""
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
    diagonal: str = ""
    """What a dotted line from corner to corner stands for; empty: none is drawn."""
    key: str = ""
    """Title of the legend in a picture that stands alone."""
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
