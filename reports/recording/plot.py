"""Charts inside a recording. Rerun has no x-y plot, so a chart is drawn as lines and labels in a 2D view.

Plot coordinates: x runs from 0 to ``WIDTH``, y from ``HEIGHT`` (bottom) to 0 (top), since image coordinates
grow downwards. Line widths are in screen points, so that they keep their width when the view is zoomed.
Intervals are not drawn: a 2D view has no areas, and the HTML page shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from recon.arrays import FloatArray
from reports.charts import Chart, Line
from reports.palette import NIGHT, NIGHT_AXIS, NIGHT_GRID, NIGHT_INK, on_dark, rgb
from reports.run.tables import SHORT_MODE

WIDTH, HEIGHT = 650, 500
_DASH = 0.022 * HEIGHT
_MARK_LABEL = np.array([0.76 * WIDTH, 0.88 * HEIGHT])
"""Middle of the upper edge of the label of a point: below the right end of the curves, which is high."""
_LEGEND_X, _LEGEND_STEP = 1.2 * WIDTH, 0.105 * HEIGHT


@dataclass(frozen=True)
class Marks:
    """Points on the curves of a plot."""

    x: FloatArray
    """Values of the horizontal axis, shape (n,)."""
    y: FloatArray
    """Values of the vertical axis, shape (n,)."""
    colours: tuple[str, ...]
    labels: tuple[str, ...]
    """Label of each point; an empty one shows nothing."""


@dataclass(frozen=True, eq=False)
class Plot:
    """A chart at an entity path of the recording."""

    path: str
    title: str
    """Title of the view."""
    chart: Chart

    def place(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """View coordinates (n, 2) of data points."""
        return np.stack([self.chart.x.unit(x) * WIDTH, (1 - self.chart.y.unit(y)) * HEIGHT], axis=-1)

    def log(self, rec: rr.RecordingStream) -> None:
        """Draw all but the marks, once for all times."""
        self._log_frame(rec)
        for i, line in enumerate(self.chart.lines):
            self._log_line(rec, line, i)

    def log_marks(self, rec: rr.RecordingStream, marks: Marks) -> None:
        """Draw points at the time that is set."""
        spots = self.place(marks.x, marks.y)
        colours = [rgb(on_dark(c)) for c in marks.colours]
        rec.log(
            f"{self.path}/operating_point",
            rr.Points2D(
                spots, colors=colours, radii=rr.Radius.ui_points(5), draw_order=60, show_labels=False
            ),
            rr.AnyValues(x=marks.x, y=marks.y),
        )
        named = [i for i, text in enumerate(marks.labels) if text]
        rec.log(
            f"{self.path}/operating_point/label",
            rr.Points2D(
                np.tile(_MARK_LABEL, (len(named), 1)),
                labels=[marks.labels[i] for i in named],
                colors=[colours[i] for i in named],
                radii=rr.Radius.ui_points(0),
                show_labels=True,
                draw_order=61,
            ),
        )

    def view(self) -> rrb.Spatial2DView:
        """The blueprint's view of this plot."""
        return rrb.Spatial2DView(
            origin=self.path,
            name=self.title,
            background=rgb(NIGHT),
            visual_bounds=rrb.VisualBounds2D(
                x_range=[-0.13 * WIDTH, 1.42 * WIDTH], y_range=[-0.13 * HEIGHT, 1.19 * HEIGHT]
            ),
        )

    def _log_frame(self, rec: rr.RecordingStream) -> None:
        across, up = self.chart.x, self.chart.y
        xs = across.unit(np.array(across.ticks)) * WIDTH
        ys = (1 - up.unit(np.array(up.ticks))) * HEIGHT
        grid = [[(x, 0), (x, HEIGHT)] for x in xs] + [[(0, y), (WIDTH, y)] for y in ys]
        thin, axis = rr.Radius.ui_points(0.5), rr.Radius.ui_points(1.0)
        frame = [[(0, 0), (0, HEIGHT), (WIDTH, HEIGHT)]]
        rec.log(
            f"{self.path}/grid",
            rr.LineStrips2D(grid, colors=[rgb(NIGHT_GRID)], radii=thin, draw_order=-10),
            static=True,
        )
        rec.log(
            f"{self.path}/axes",
            rr.LineStrips2D(frame, colors=[rgb(NIGHT_AXIS)], radii=axis, draw_order=-5),
            static=True,
        )
        spots = (
            [(x, 1.02 * HEIGHT) for x in xs]
            + [(-0.055 * WIDTH, y - 0.025 * HEIGHT) for y in ys]
            + [(WIDTH / 2, 1.09 * HEIGHT), (WIDTH / 2, -0.09 * HEIGHT)]
        )
        text = [f"{v:g}" for v in (*across.ticks, *up.ticks)]
        text += [f"across: {across.still_label}", f"up: {up.still_label}"]
        _log_labels(rec, f"{self.path}/labels", spots, text)

    def _log_line(self, rec: rr.RecordingStream, line: Line, index: int) -> None:
        x, y = np.asarray(line.x, float), np.asarray(line.y, float)
        if line.step:
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        path = f"{self.path}/{rr.escape_entity_path_part(line.tags[-1])}"
        points = self.place(x, y)
        dashed = line.look.dash == "dashed"
        strips = dashes(points, _DASH) if dashed else [points]
        colour, width = rgb(line.look.dark), rr.Radius.ui_points(1.6)
        rec.log(path, rr.LineStrips2D(strips, colors=[colour], radii=width, draw_order=index), static=True)
        # a label keeps its size on screen, so no drawn key could stay beside it: the text bears the colour
        key = "- -" if dashed else "—"
        spot, mode = (_LEGEND_X, (index + 0.5) * _LEGEND_STEP), line.tags[-1]
        _log_labels(rec, f"{path}/key", [spot], [f"{key} {SHORT_MODE.get(mode, mode)} {line.figure}"], colour)


def dashes(points: FloatArray, length: float) -> list[FloatArray]:
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
    colour: tuple[int, int, int] = rgb(NIGHT_INK),
) -> None:
    none = rr.Radius.ui_points(0)
    rec.log(path, rr.Points2D(spots, labels=text, radii=none, colors=[colour], show_labels=True), static=True)
