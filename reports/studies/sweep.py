"""Curves and page of a sweep: what is left of the gain while the input is spoilt step by step."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from recon.files import atomic_path
from reports.pages import write_page
from reports.palette import DARK_GREY, detector_name, mode_colour, mode_name
from reports.run.curve_pictures import STYLE
from reports.run.tables import Table, interval_text, number_text
from rescore.results.candidate_file import ALONE
from rescore.results.sweep_file import SweepPoint, SweepResult, SweptDial, VisibilityGroup

_COLUMNS = 4
_FACTORS = (0.1, 30.0)
"""Factors beyond are drawn at the edge."""
_FALSE = (0.03, 20.0)
FIGURES = {
    "reduction.png": "How many times fewer false positives an image than the detector alone, with intervals "
    "of 95 %; above 1 depth helps, left or right of 0 the input is spoilt",
    "fppi.png": "False positives an image where 70 % of all cars are found",
    "area.png": "Area under the candidate ROC",
}
"""The pictures with what a person reads in their place."""


def write_sweep_page(sweep: SweepResult, out: Path) -> Path:
    """Draw the curves of a sweep into a folder, with README.md; returns the page."""
    dials = sweep.dials
    _draw(out / "reduction.png", dials, _reduction)
    _draw(out / "fppi.png", dials, _false_positives)
    _draw(out / "area.png", dials, _area)
    return write_page(out, sweep_text(sweep))


def sweep_text(sweep: SweepResult) -> str:
    """The page of a sweep in Markdown."""
    parts = [
        "# Where depth evidence breaks",
        f"{detector_name(sweep.detector)}, {sweep.n_images} test images. The input of the depth "
        "evidence is spoilt step by step; detector, models and weights stay those of the run, and the "
        "picture that detector and reconstruction see stays as it is. Level 0 is the input as it is.",
        *(f"![{text}]({name})\n\n{text}." for name, text in FIGURES.items()),
        "## Significant losses",
        losses_text(sweep.dials),
        *(
            f"## {name}: {dial.what}\n\n{dial_table(dial.points).markdown()}".rstrip()
            for name, dial in sweep.dials.items()
        ),
        "Factor: false positives an image of the detector alone over those with depth, both where 70 % of "
        "all cars are found, with its interval of 95 % (paired, images drawn with replacement). *Loss*: the "
        "whole interval lies below 1.",
        "## By how much of a car is seen",
        visibility_table(sweep.visibility).markdown().rstrip(),
        "Only the cars of the group count in each row; the others are neither hits nor false positives.",
    ]
    return "\n\n".join(parts) + "\n"


def losses_text(dials: Mapping[str, SweptDial]) -> str:
    """Where depth makes significantly more false positives, as a list; or that it nowhere does."""
    rows = [
        f"- {dial.what}, level {_level(point.level)}: {mode}, factor {interval_text(f.reduction)}"
        for dial in dials.values()
        for point in dial.points
        for mode, f in point.figures.items()
        if f.significant_loss and f.reduction is not None
    ]
    return "\n".join(rows) if rows else "None: at no level of any dial is the gain significantly negative."


def dial_table(points: Sequence[SweepPoint]) -> Table:
    """A row a level: false positives, area and factor of each mode."""
    modes = list(points[0].figures)
    head = ["level"]
    for mode in modes:
        head += [f"FP/image {mode}"] + ([] if mode == ALONE else [f"factor {mode}"])
    head += [f"area {mode}" for mode in modes]
    rows = []
    for point in points:
        row = [_level(point.level)]
        for mode in modes:
            f = point.figures[mode]
            row.append(number_text(f.fppi.value, 2))
            if f.reduction:
                row.append(interval_text(f.reduction) + (" *loss*" if f.significant_loss else ""))
        row += [number_text(point.figures[mode].auc.value, 3) for mode in modes]
        rows.append(tuple(row))
    return Table("", tuple(head), tuple(rows), text_columns=0)


def visibility_table(groups: Sequence[VisibilityGroup]) -> Table:
    """A row a group of cars by their visible share."""
    modes = list(groups[0].figures) if groups else []
    head = ["visible share", "cars", *(f"FP/image {m}" for m in modes)]
    head += [f"factor {m}" for m in modes if m != ALONE]
    rows = []
    for group in groups:
        figures = group.figures
        low, high = group.visible
        row = [f"{low:.0%} to {high:.0%}", str(group.n_cars)]
        row += [number_text(figures[m].fppi.value, 2) for m in modes]
        row += [interval_text(f) for m in modes if (f := figures[m].reduction) is not None]
        rows.append(tuple(row))
    return Table("", tuple(head), tuple(rows))


def _draw(path: Path, dials: Mapping[str, SweptDial], panel: Callable[[Axes, SweptDial], None]) -> None:
    rows = -(-len(dials) // _COLUMNS)
    columns = min(_COLUMNS, len(dials))
    with mpl.rc_context(STYLE | {"font.size": 9, "axes.titlesize": 9.5, "axes.labelsize": 8.5}):
        figure = Figure(figsize=(3.6 * columns, 2.9 * rows + 0.5), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, (name, dial) in zip(axes, dials.items(), strict=False):
            panel(ax, dial)
            ax.set_title(name)
            ax.set_xlabel(dial.what)
        for ax in axes[len(dials) :]:
            ax.set_axis_off()
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as beside:
            figure.savefig(beside, dpi=110)


def _modes(dial: SweptDial) -> list[str]:
    return list(dial.points[0].figures)


def _reduction(ax: Axes, dial: SweptDial) -> None:
    at = [p.level for p in dial.points]
    for mode in [m for m in _modes(dial) if m != ALONE]:
        factors = [f for p in dial.points if (f := p.figures[mode].reduction) is not None]
        value, low, high = np.clip(np.array([(f.value, f.low, f.high) for f in factors]).T, *_FACTORS)
        colour = mode_colour(mode)
        ax.fill_between(at, low, high, color=colour, alpha=0.13, linewidth=0)
        ax.plot(at, value, color=colour, marker="o", markersize=3, label=mode_name(mode))
    ax.axhline(1, color=DARK_GREY, linewidth=1)
    ax.set_yscale("log")
    ax.set_ylim(*_FACTORS)
    ax.set_yticks([0.1, 0.3, 1, 3, 10, 30], ["0.1", "0.3", "1", "3", "10", "30"])
    ax.minorticks_off()
    ax.set_ylabel("times fewer")


def _false_positives(ax: Axes, dial: SweptDial) -> None:
    for mode in _modes(dial):
        value = np.clip([p.figures[mode].fppi.value for p in dial.points], *_FALSE)
        at = [p.level for p in dial.points]
        ax.plot(at, value, color=mode_colour(mode), marker="o", markersize=3, label=mode_name(mode))
    ax.set_yscale("log")
    ax.set_yticks([0.1, 0.3, 1, 3, 10], ["0.1", "0.3", "1", "3", "10"])
    ax.minorticks_off()
    ax.set_ylabel("false positives an image")


def _area(ax: Axes, dial: SweptDial) -> None:
    for mode in _modes(dial):
        at = [p.level for p in dial.points]
        value = [p.figures[mode].auc.value for p in dial.points]
        ax.plot(at, value, color=mode_colour(mode), marker="o", markersize=3, label=mode_name(mode))
    ax.set_ylabel("area")


def _level(level: float) -> str:
    return f"{level:g}"
