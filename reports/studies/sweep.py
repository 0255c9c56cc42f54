"""Curves and page of a sweep: what is left of the gain while the input is spoilt step by step."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.palette import detector_name, mode_colour, mode_name
from reports.run.curve_pictures import STYLE
from reports.run.tables import Table, as_float, interval_text, number_text
from rescore.files import atomic_path

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


def write_sweep_page(value: Mapping[str, Any], out: Path) -> Path:
    """Draw the curves of a sweep (content of sweep.json) into a folder, with README.md; returns the page."""
    dials = value["dials"]
    _draw(out / "reduction.png", dials, _reduction)
    _draw(out / "fppi.png", dials, _false_positives)
    _draw(out / "area.png", dials, _area)
    with atomic_path(out / "README.md") as beside:
        beside.write_text(sweep_text(value))
    return out / "README.md"


def sweep_text(value: Mapping[str, Any]) -> str:
    """The page of a sweep in Markdown."""
    parts = [
        "# Where depth evidence breaks",
        f"{detector_name(value['detector'])}, {value['n_images']} test images. The input of the depth "
        "evidence is spoilt step by step; detector, models and weights stay those of the run, and the "
        "picture that detector and reconstruction see stays as it is. Level 0 is the input as it is.",
        *(f"![{text}]({name})\n\n{text}." for name, text in FIGURES.items()),
        "## Significant losses",
        losses_text(value["dials"]),
        *(
            f"## {name}: {dial['what']}\n\n{dial_table(dial['points']).markdown()}".rstrip()
            for name, dial in value["dials"].items()
        ),
        "Factor: false positives an image of the detector alone over those with depth, both where 70 % of "
        "all cars are found, with its interval of 95 % (paired, images drawn with replacement). *Loss*: the "
        "whole interval lies below 1.",
        "## By how much of a car is seen",
        visibility_table(value["visibility"]).markdown().rstrip(),
        "Only the cars of the group count in each row; the others are neither hits nor false positives.",
    ]
    return "\n\n".join(parts) + "\n"


def losses_text(dials: Mapping[str, Any]) -> str:
    """Where depth makes significantly more false positives, as a list; or that it nowhere does."""
    rows = [
        f"- {dial['what']}, level {_level(point['level'])}: {mode}, factor {interval_text(f['reduction'])}"
        for dial in dials.values()
        for point in dial["points"]
        for mode, f in point["figures"].items()
        if f["significant_loss"]
    ]
    return "\n".join(rows) if rows else "None: at no level of any dial is the gain significantly negative."


def dial_table(points: Sequence[Mapping[str, Any]]) -> Table:
    """A row a level: false positives, area and factor of each mode."""
    modes = list(points[0]["figures"])
    head = ["level"]
    for mode in modes:
        head += [f"FP/image {mode}"] + ([] if mode == "detector" else [f"factor {mode}"])
    head += [f"area {mode}" for mode in modes]
    rows = []
    for point in points:
        row = [_level(point["level"])]
        for mode in modes:
            f = point["figures"][mode]
            row.append(number_text(f["fppi"]["value"], 2))
            if f["reduction"]:
                row.append(interval_text(f["reduction"]) + (" *loss*" if f["significant_loss"] else ""))
        row += [number_text(point["figures"][mode]["auc"]["value"], 3) for mode in modes]
        rows.append(tuple(row))
    return Table("", tuple(head), tuple(rows), text_columns=0)


def visibility_table(groups: Sequence[Mapping[str, Any]]) -> Table:
    """A row a group of cars by their visible share."""
    modes = list(groups[0]["figures"]) if groups else []
    head = ["visible share", "cars", *(f"FP/image {m}" for m in modes)]
    head += [f"factor {m}" for m in modes if m != "detector"]
    rows = []
    for group in groups:
        figures = group["figures"]
        low, high = group["visible"]
        row = [f"{low:.0%} to {high:.0%}", str(group["n_cars"])]
        row += [number_text(figures[m]["fppi"]["value"], 2) for m in modes]
        row += [interval_text(figures[m]["reduction"]) for m in modes if m != "detector"]
        rows.append(tuple(row))
    return Table("", tuple(head), tuple(rows))


def _draw(path: Path, dials: Mapping[str, Any], panel: Callable[[Axes, Mapping[str, Any]], None]) -> None:
    rows = -(-len(dials) // _COLUMNS)
    columns = min(_COLUMNS, len(dials))
    with mpl.rc_context(STYLE | {"font.size": 9, "axes.titlesize": 9.5, "axes.labelsize": 8.5}):
        figure = Figure(figsize=(3.6 * columns, 2.9 * rows + 0.5), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, (name, dial) in zip(axes, dials.items(), strict=False):
            panel(ax, dial)
            ax.set_title(name)
            ax.set_xlabel(dial["what"])
        for ax in axes[len(dials) :]:
            ax.set_axis_off()
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=10)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as beside:
            figure.savefig(beside, dpi=110)


def _curve(dial: Mapping[str, Any], mode: str, figure: str, part: str) -> list[float]:
    return [as_float(p["figures"][mode][figure][part]) for p in dial["points"]]


def _modes(dial: Mapping[str, Any]) -> list[str]:
    return list(dial["points"][0]["figures"])


def _reduction(ax: Axes, dial: Mapping[str, Any]) -> None:
    at = [p["level"] for p in dial["points"]]
    for mode in [m for m in _modes(dial) if m != "detector"]:
        value, low, high = (
            np.clip(_curve(dial, mode, "reduction", part), *_FACTORS) for part in ("value", "low", "high")
        )
        colour = mode_colour(mode)
        ax.fill_between(at, low, high, color=colour, alpha=0.13, linewidth=0)
        ax.plot(at, value, color=colour, marker="o", markersize=3, label=mode_name(mode))
    ax.axhline(1, color="#555555", linewidth=1)
    ax.set_yscale("log")
    ax.set_ylim(*_FACTORS)
    ax.set_yticks([0.1, 0.3, 1, 3, 10, 30], ["0.1", "0.3", "1", "3", "10", "30"])
    ax.minorticks_off()
    ax.set_ylabel("times fewer")


def _false_positives(ax: Axes, dial: Mapping[str, Any]) -> None:
    for mode in _modes(dial):
        value = np.clip(_curve(dial, mode, "fppi", "value"), *_FALSE)
        at = [p["level"] for p in dial["points"]]
        ax.plot(at, value, color=mode_colour(mode), marker="o", markersize=3, label=mode_name(mode))
    ax.set_yscale("log")
    ax.set_yticks([0.1, 0.3, 1, 3, 10], ["0.1", "0.3", "1", "3", "10"])
    ax.minorticks_off()
    ax.set_ylabel("false positives an image")


def _area(ax: Axes, dial: Mapping[str, Any]) -> None:
    for mode in _modes(dial):
        at = [p["level"] for p in dial["points"]]
        value = _curve(dial, mode, "auc", "value")
        ax.plot(at, value, color=mode_colour(mode), marker="o", markersize=3, label=mode_name(mode))
    ax.set_ylabel("area")


def _level(level: float) -> str:
    return f"{level:g}"
