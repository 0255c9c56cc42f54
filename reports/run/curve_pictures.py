"""The curves as pictures: both ROC figures after the report's figure 13, precision-recall, and w."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from recon.files import atomic_path
from reports.charts import Axis, Chart, Line, Look
from reports.palette import DARK_GREY, GREY, GRID_GREY, detector_colour, detector_name
from reports.run.curves import (
    CANDIDATES,
    CARS,
    PRECISION,
    DrawnCurves,
    curve_charts,
    curve_sets,
    reliability_charts,
    weight_chart,
    weight_line,
)
from rescore.results.metrics_file import TunedWeight
from rescore.results.run_folder import Run

STYLE: Any = {
    "font.size": 12,
    "axes.titlesize": 13,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 12,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID_GREY,
    "axes.edgecolor": DARK_GREY,
    "legend.edgecolor": "white",
    "legend.framealpha": 0.9,
    "legend.fontsize": 10.5,
    "savefig.facecolor": "white",
    "svg.hashsalt": "rescore",
}
_MARKER = "o"
_DASH: Any = {"solid": "-", "longdash": (0, (7, 2)), "dashed": "--", "dashdot": "-.", "dotted": (0, (1, 1))}
_ROOM = 0.015
_PICTURES = {CANDIDATES: "candidate_roc.png", CARS: "car_roc.png", PRECISION: "precision_recall.png"}
"""Files by kind of curve."""
# curves of cars rise from the left below to the right above, those of candidates to the left above
# what rises to the right leaves this corner empty
_LEGEND_AT = {"candidate_roc.png": "lower right", "car_roc.png": "lower right"}


def write_curves(run: Run, folder: Path) -> tuple[Path, ...]:
    """Draw every curve of a run as PNG into ``folder``; the paths, in the order of reading.

    Nothing is drawn where no car is annotated: there is nothing to find.
    """
    if not run.metrics.n_cars:
        return ()
    charts = curve_charts([DrawnCurves.of_mode(c) for c in curve_sets(run)], (run.metrics,))
    pictures = {name: list(charts[kind].values()) for kind, name in _PICTURES.items()}
    tuning = run.tuning()
    if tuning:
        pictures["weight.png"] = [weights_of_detectors(tuning)]
    reliability = reliability_charts(run.reliability())
    if reliability:
        pictures["reliability.png"] = list(reliability.values())
    for name, panels in pictures.items():
        _save(folder / name, panels, _LEGEND_AT.get(name, "best"))
    return tuple(folder / name for name in pictures)


def weights_of_detectors(tuning: Mapping[str, TunedWeight]) -> Chart:
    """The objective over w, a line a detector in its colour."""
    lines = [
        weight_line(
            detector_name(d, short=True), Look.of_colour(detector_colour(d, tuple(tuning))), (d,), tuned
        )
        for d, tuned in tuning.items()
    ]
    title = "Choice of w on the validation set"
    return weight_chart(title, title, lines, next(iter(tuning.values())).objective_name)


def draw_chart(ax: Axes, chart: Chart, legend_at: Any = "best") -> None:
    """Draw a chart with its legend at a place that matplotlib knows."""
    for line in chart.lines:
        _draw_line(ax, chart, line)
    for line in chart.lines:
        if line.ceiling is not None:
            ax.axhline(line.ceiling, color=line.look.light, lw=0.8, ls=":")
    if chart.diagonal:
        ax.plot([0, 1], [0, 1], color=GREY, lw=1, ls=":", label=chart.diagonal)
    if chart.x.log:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlim=_limits(chart.x), ylim=_limits(chart.y), title=chart.title)
    ax.set_xlabel(chart.x.still_label)
    ax.set_ylabel(chart.y.still_label)
    ax.legend(loc=legend_at, title=chart.key or None)


def _draw_line(ax: Axes, chart: Chart, line: Line) -> None:
    x, y = np.maximum(line.x, chart.x.low), np.asarray(line.y, float)
    look: dict[str, Any] = {"color": line.look.light, "lw": line.look.width, "ls": _DASH[line.look.dash]}
    look["label"] = f"{line.name}: {line.figure}"
    if line.bars is not None:
        ends = [y - line.bars["low"], line.bars["high"] - y]
        ax.errorbar(x, y, ends, marker=_MARKER, ms=4, elinewidth=1, capsize=2, **look)
    else:
        ax.plot(x, y, drawstyle="steps-post" if line.step else "default", **look)
    if line.broad is not None:
        inside = (x >= line.broad[0]) & (x <= line.broad[1])
        ax.plot(x[inside], y[inside], color=line.look.light, alpha=0.25, lw=10, solid_capstyle="butt")
    if line.mark is not None:
        ax.plot(*([v] for v in line.mark), _MARKER, color=line.look.light, ms=9)


def _limits(axis: Axis) -> tuple[float, float]:
    """Ends of an axis with room for what lies at them; a log axis ends where it is cut."""
    room = 0.0 if axis.log else _ROOM * (axis.high - axis.low)
    return axis.low - room, axis.high + room


def _save(path: Path, panels: Sequence[Chart], legend_at: Any) -> None:
    """Save one picture of charts side by side."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4 * len(panels), 5.2), dpi=130, layout="constrained")
        for axes, chart in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            draw_chart(axes, chart, legend_at)
        with atomic_path(path) as beside:
            figure.savefig(beside, metadata={"Software": None})
