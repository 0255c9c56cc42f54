"""Curves inside a recording. Rerun has no x-y plot, so a plot is drawn as lines and labels in a 2D view.

Plot coordinates: x runs from 0 to ``WIDTH``, y from ``HEIGHT`` (bottom) to 0 (top), since image coordinates
grow downwards, and a band is an image. Line widths are in screen points, so that they keep their width when
the view is zoomed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from recon.arrays import FloatArray
from reports.palette import on_dark, rgb
from rescore.metrics.curve_bands import Band

WIDTH, HEIGHT = 650, 500
BACKGROUND = (22, 24, 29)
_GRID = (52, 56, 64)
_AXIS = (150, 156, 165)
_LABEL = (225, 228, 232)
_DASH = 0.022 * HEIGHT
_MARK_LABEL = np.array([0.17 * WIDTH, 0.02 * HEIGHT])
"""Offset from a point to the middle of the upper edge of its label."""
_BAND_OPACITY = 0.16
_LEGEND_X, _LEGEND_STEP = 1.4 * WIDTH, 0.115 * HEIGHT


@dataclass(frozen=True)
class Axis:
    """One axis of a plot."""

    title: str
    low: float
    high: float
    ticks: tuple[float, ...]
    log: bool = False

    def unit(self, value: FloatArray) -> FloatArray:
        """Values mapped to [0, 1] along the axis; values beyond its ends are held at the ends."""
        low, high = (np.log10(self.low), np.log10(self.high)) if self.log else (self.low, self.high)
        at = np.log10(np.maximum(value, self.low)) if self.log else value
        return np.clip((at - low) / (high - low), 0, 1)


@dataclass(frozen=True, eq=False)
class Line:
    """One curve of a plot."""

    name: str
    legend: str
    x: FloatArray
    """Values of the horizontal axis, shape (n,)."""
    y: FloatArray
    """Values of the vertical axis, shape (n,)."""
    colour: str
    dashed: bool = False
    steps: bool = False
    band: Band | None = None
    """Where the curve may lie."""
    thick: tuple[FloatArray, FloatArray] | None = None
    """A piece of the curve that is drawn broad, as x and y."""


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


@dataclass(frozen=True)
class Plot:
    """A plot at an entity path of the recording."""

    path: str
    title: str
    x: Axis
    y: Axis
    lines: tuple[Line, ...]
    hidden_bands: tuple[str, ...] = ()
    """Names of the curves whose bands are hidden at first, for too many bands hide each other."""

    def place(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """View coordinates (n, 2) of data points."""
        return np.stack([self.x.unit(x) * WIDTH, (1 - self.y.unit(y)) * HEIGHT], axis=-1)

    def log(self, rec: rr.RecordingStream) -> None:
        """Draw all but the marks, once for all times."""
        self._log_frame(rec)
        classes = [rr.AnnotationInfo(id=0, color=(0, 0, 0, 0))]
        classes += [
            rr.AnnotationInfo(id=i + 1, color=rgb(on_dark(line.colour))) for i, line in enumerate(self.lines)
        ]
        rec.log(self.path, rr.AnnotationContext(classes), static=True)
        for i, line in enumerate(self.lines):
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
                spots[named].reshape(-1, 2) + _MARK_LABEL,
                labels=[marks.labels[i] for i in named],
                colors=[colours[i] for i in named],
                radii=rr.Radius.ui_points(0),
                show_labels=True,
                draw_order=61,
            ),
        )

    def view(self) -> rrb.Spatial2DView:
        """The blueprint's view of this plot."""
        hidden = {
            f"{self._path_of(name)}/band": rrb.EntityBehavior(visible=False) for name in self.hidden_bands
        }
        return rrb.Spatial2DView(
            origin=self.path,
            name=self.title,
            background=BACKGROUND,
            visual_bounds=rrb.VisualBounds2D(
                x_range=[-0.13 * WIDTH, 1.78 * WIDTH], y_range=[-0.13 * HEIGHT, 1.19 * HEIGHT]
            ),
            overrides=hidden,
        )

    def _path_of(self, line: str) -> str:
        return f"{self.path}/{rr.escape_entity_path_part(line)}"

    def _log_frame(self, rec: rr.RecordingStream) -> None:
        xs = self.x.unit(np.array(self.x.ticks)) * WIDTH
        ys = (1 - self.y.unit(np.array(self.y.ticks))) * HEIGHT
        grid = [[(x, 0), (x, HEIGHT)] for x in xs] + [[(0, y), (WIDTH, y)] for y in ys]
        thin, axis = rr.Radius.ui_points(0.5), rr.Radius.ui_points(1.0)
        frame = [[(0, 0), (0, HEIGHT), (WIDTH, HEIGHT)]]
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
            [(x, 1.02 * HEIGHT) for x in xs]
            + [(-0.055 * WIDTH, y - 0.025 * HEIGHT) for y in ys]
            + [(WIDTH / 2, 1.09 * HEIGHT), (WIDTH / 2, -0.09 * HEIGHT)]
        )
        text = [f"{v:g}" for v in (*self.x.ticks, *self.y.ticks)] + [
            f"across: {self.x.title}",
            f"up: {self.y.title}",
        ]
        _log_labels(rec, f"{self.path}/labels", spots, text)

    def _log_line(self, rec: rr.RecordingStream, line: Line, index: int) -> None:
        x, y = (np.repeat(line.x, 2)[1:], np.repeat(line.y, 2)[:-1]) if line.steps else (line.x, line.y)
        path = self._path_of(line.name)
        points = self.place(x, y)
        strips = dashes(points, _DASH) if line.dashed else [points]
        colour, width = rgb(on_dark(line.colour)), rr.Radius.ui_points(1.6)
        rec.log(path, rr.LineStrips2D(strips, colors=[colour], radii=width, draw_order=index), static=True)
        if line.thick is not None:
            dim = tuple(int(0.45 * c + 0.55 * b) for c, b in zip(colour, BACKGROUND, strict=True))
            broad = rr.LineStrips2D(
                [self.place(*line.thick)], colors=[dim], radii=rr.Radius.ui_points(5), draw_order=-2
            )
            rec.log(f"{path}/interval", broad, static=True)
        if line.band is not None and len(line.band.x):
            self._log_band(rec, f"{path}/band", line.band, index)
        # a label keeps its size on screen, so no drawn key could stay beside it: the text bears the colour
        key = "- -" if line.dashed else "—"
        spot = (_LEGEND_X, (index + 0.5) * _LEGEND_STEP)
        _log_labels(rec, f"{path}/key", [spot], [f"{key} {line.legend}"], colour)

    def _log_band(self, rec: rr.RecordingStream, path: str, band: Band, index: int) -> None:
        """A mask: in a 2D view only masks are drawn translucent."""
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        edge = np.concatenate([self.place(band.x, band.low), self.place(band.x, band.high)[::-1]])
        cv2.fillPoly(mask, [np.rint(edge).astype(np.int32)], index + 1)
        rec.log(
            path,
            rr.SegmentationImage(mask, opacity=_BAND_OPACITY, draw_order=-4 + 0.1 * index),
            rr.AnyValues(x=band.x, low=band.low, high=band.high),
            static=True,
        )


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
    colour: tuple[int, int, int] = _LABEL,
) -> None:
    none = rr.Radius.ui_points(0)
    rec.log(path, rr.Points2D(spots, labels=text, radii=none, colors=[colour], show_labels=True), static=True)
