"""Curves inside a recording. Rerun has no x-y plot, so a plot is drawn as lines and labels in a 2D view.

Plot coordinates: x runs from 0 to ``ASPECT``, y from 0 (bottom) to -1 (top), since image coordinates grow
downwards. Line widths are in screen points, so that they keep their width when the view is zoomed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from reports.palette import on_dark, rgb

ASPECT = 1.3
_BACKGROUND = (22, 24, 29)
_GRID = (52, 56, 64)
_AXIS = (150, 156, 165)
_LABEL = (225, 228, 232)
_DASH = 0.022


@dataclass(frozen=True)
class Axis:
    """One axis of a plot."""

    title: str
    low: float
    high: float
    ticks: tuple[float, ...]
    log: bool = False

    def unit(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values mapped to [0, 1] along the axis; values beyond its ends are held at the ends."""
        low, high = (np.log10(self.low), np.log10(self.high)) if self.log else (self.low, self.high)
        at = np.log10(np.maximum(value, self.low)) if self.log else value
        return np.clip((at - low) / (high - low), 0, 1)


@dataclass(frozen=True)
class Line:
    """One curve of a plot."""

    name: str
    legend: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    colour: str
    dashed: bool = False
    steps: bool = False


@dataclass(frozen=True)
class Plot:
    """A plot at an entity path of the recording."""

    path: str
    title: str
    x: Axis
    y: Axis
    lines: tuple[Line, ...]
    legend_at: tuple[float, float]
    """Middle and bottom line of the legend, as shares of the width and height."""

    def place(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """View coordinates (n, 2) of data points."""
        return np.stack([self.x.unit(x) * ASPECT, -self.y.unit(y)], axis=-1)

    def log(self, rec: rr.RecordingStream) -> None:
        """Draw the whole plot, once for all times."""
        self._log_frame(rec)
        for i, line in enumerate(self.lines):
            self._log_line(rec, line, i)

    def view(self) -> rrb.Spatial2DView:
        """The blueprint's view of this plot."""
        return rrb.Spatial2DView(
            origin=self.path,
            name=self.title,
            background=_BACKGROUND,
            visual_bounds=rrb.VisualBounds2D(x_range=[-0.16, ASPECT + 0.08], y_range=[-1.17, 0.25]),
        )

    def _log_frame(self, rec: rr.RecordingStream) -> None:
        xs, ys = self.x.unit(np.array(self.x.ticks)) * ASPECT, -self.y.unit(np.array(self.y.ticks))
        grid = [[(x, 0), (x, -1)] for x in xs] + [[(0, y), (ASPECT, y)] for y in ys]
        thin, axis = rr.Radius.ui_points(0.5), rr.Radius.ui_points(1.0)
        frame = [[(0, -1), (0, 0), (ASPECT, 0)]]
        rec.log(
            f"{self.path}/grid",
            rr.LineStrips2D(grid, colors=[_GRID], radii=thin, draw_order=-10),
            static=True,
        )
        rec.log(
            f"{self.path}/axes",
            rr.LineStrips2D(frame, colors=[_AXIS], radii=axis, draw_order=-5),
            static=True,
        )
        spots = (
            [(x, 0.045) for x in xs]
            + [(-0.07, y - 0.035) for y in ys]
            + [(ASPECT / 2, 0.14), (ASPECT / 2, -1.1)]
        )
        text = [f"{v:g}" for v in (*self.x.ticks, *self.y.ticks)] + [
            f"across: {self.x.title}",
            f"up: {self.y.title}",
        ]
        _log_labels(rec, f"{self.path}/labels", spots, text)

    def _log_line(self, rec: rr.RecordingStream, line: Line, index: int) -> None:
        x, y = (np.repeat(line.x, 2)[1:], np.repeat(line.y, 2)[:-1]) if line.steps else (line.x, line.y)
        path = f"{self.path}/{rr.escape_entity_path_part(line.name)}"
        points = self.place(x, y)
        strips = dashes(points, _DASH) if line.dashed else [points]
        colour, width = rgb(on_dark(line.colour)), rr.Radius.ui_points(1.6)
        rec.log(path, rr.LineStrips2D(strips, colors=[colour], radii=width, draw_order=index), static=True)
        # a label keeps its size on screen, so no drawn key could stay beside it: the text bears the colour
        key = "– –" if line.dashed else "——"
        level = -self.legend_at[1] - 0.085 * (len(self.lines) - 1 - index)
        spot = (self.legend_at[0] * ASPECT, level - 0.04)
        _log_labels(rec, f"{path}/key", [spot], [f"{key} {line.legend}"], colour)


def dashes(points: NDArray[np.float64], length: float) -> list[NDArray[np.float64]]:
    """A poly-line (n, 2) cut into dashes: pieces of ``length`` with gaps as long."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    if len(points) < 2 or at[-1] == 0:
        return [points]
    # interpolation over arc length wants it strictly growing
    keep = np.concatenate([[True], steps > 0])
    at, points = at[keep], points[keep]
    pieces = []
    for start in np.arange(0.0, at[-1], 2 * length):
        end = min(start + length, at[-1])
        inner = at[(at > start) & (at < end)]
        s = np.concatenate([[start], inner, [end]])
        pieces.append(np.stack([np.interp(s, at, points[:, 0]), np.interp(s, at, points[:, 1])], axis=1))
    return pieces


def _log_labels(
    rec: rr.RecordingStream,
    path: str,
    spots: Sequence[tuple[float, float]],
    text: Sequence[str],
    colour: tuple[int, int, int] = _LABEL,
) -> None:
    none = rr.Radius.ui_points(0)
    rec.log(path, rr.Points2D(spots, labels=text, radii=none, colors=[colour], show_labels=True), static=True)
