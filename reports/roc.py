"""The curves as pictures: both ROC figures after the report's figure 13, precision-recall, and w."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.curves import CurveSet, curve_sets
from reports.palette import detector_colour, detector_name
from reports.run_folder import Run
from reports.tables import number
from rescore.store import atomic_path

STYLE: Any = {
    "font.size": 12,
    "axes.titlesize": 13,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 12,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "axes.edgecolor": "#555555",
    "legend.frameon": False,
    "legend.fontsize": 10.5,
    "savefig.facecolor": "white",
    "svg.hashsalt": "rescore",
}
_MARKER = "o"


def write_curves(run: Run, folder: Path) -> tuple[Path, ...]:
    """Draw every curve of a run as PNG into ``folder``; the paths, in the order of reading."""
    curves = curve_sets(run)
    drawings: dict[str, Callable[[Axes], None]] = {
        "candidate_roc.png": lambda ax: draw_candidate_roc(ax, curves, run.metrics),
        "car_roc.png": lambda ax: draw_car_roc(ax, curves, run.metrics),
        "precision_recall.png": lambda ax: draw_precision_recall(ax, curves, run.metrics),
    }
    tuning = run.tuning()
    if tuning:
        drawings["weight.png"] = lambda ax: draw_weight(ax, tuning)
    paths = []
    for name, draw in drawings.items():
        paths.append(folder / name)
        _save(paths[-1], draw)
    return tuple(paths)


def draw_candidate_roc(ax: Axes, curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> None:
    """The ROC over candidates: hits kept against false candidates kept."""
    for curve, style in zip(curves, styles(curves), strict=True):
        label = f"{curve.short_name}: area {number(curve.row['auc'])}"
        ax.plot(curve.candidate.x, curve.candidate.y, label=label, **style)
    ax.plot([0, 1], [0, 1], color="#999999", lw=1, ls=":", label="chance")
    ax.set(xlim=(-0.01, 1.01), ylim=(0, 1.02), title="Candidate ROC")
    ax.set_xlabel("false-positive rate: share of the false candidates that are accepted")
    ax.set_ylabel("true-positive rate: share of the hits that are accepted")
    ax.legend(
        loc="lower right", title=f"{metrics['n_candidates']} candidates of {metrics['n_images']} images"
    )


def draw_car_roc(ax: Axes, curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> None:
    """The rate of all annotated cars found against false positives an image, on a log axis."""
    left = left_edge(metrics)
    for curve, style in zip(curves, styles(curves), strict=True):
        ceiling = curve.row["recall_ceiling"]
        x = np.maximum(curve.cars.x, left)
        ax.plot(
            x,
            curve.cars.y,
            drawstyle="steps-post",
            label=f"{curve.short_name}: AP {number(curve.row['average_precision'])}",
            **style,
        )
        if curve.mode == "detector":
            ax.axhline(ceiling, color=style["color"], lw=0.8, ls=":")
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlim=(left, 20), ylim=(0, 1.02), title="Cars found against false positives")
    ax.set_xlabel("false positives per image (log axis; the left edge stands for none)")
    ax.set_ylabel(f"true-positive rate: share of all {metrics['n_cars']} annotated cars")
    ax.legend(loc="lower right", title="dotted: all candidates accepted")


def draw_precision_recall(ax: Axes, curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> None:
    """Precision against the rate of all annotated cars found."""
    for curve, style in zip(curves, styles(curves), strict=True):
        label = f"{curve.short_name}: AP {number(curve.row['average_precision'])}"
        ax.plot(curve.precision.recall, curve.precision.precision, label=label, **style)
    ax.set(xlim=(0, 1.01), ylim=(0, 1.02), title="Precision and recall")
    ax.set_xlabel(f"recall: share of all {metrics['n_cars']} annotated cars found")
    ax.set_ylabel("precision: share of accepted candidates that are hits")
    ax.legend(loc="best")


def draw_weight(ax: Axes, tuning: Mapping[str, Mapping[str, Any]]) -> None:
    """The objective on the validation set over w, with the chosen w marked."""
    for detector, tuned in tuning.items():
        colour = detector_colour(detector, tuple(tuning))
        w, value = np.array(tuned["w_grid"]), np.array(tuned["objective"], float)
        ax.plot(
            w, value, color=colour, lw=2, label=f"{detector_name(detector, short=True)}: w = {tuned['w']:g}"
        )
        ax.plot([tuned["w"]], [np.interp(tuned["w"], w, value)], _MARKER, color=colour, ms=9)
    ax.set(xlim=(-0.02, 1.02), title="Choice of w on the validation set")
    ax.set_xlabel("w: 0 trusts the depth alone, 1 the detector alone")
    ax.set_ylabel(f"objective: {next(iter(tuning.values()))['objective_name']}")
    ax.legend(loc="best")


def styles(curves: Sequence[CurveSet]) -> list[dict[str, Any]]:
    """One line style a curve: colour by detector, dashed without rescoring, other modes by dash pattern."""
    detectors = tuple(dict.fromkeys(c.detector for c in curves))
    modes = tuple(m for m in dict.fromkeys(c.mode for c in curves) if m != "detector")
    patterns = ("-", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)))
    return [
        {
            "color": detector_colour(c.detector, detectors),
            "lw": 1.6 if c.mode == "detector" else 2.4,
            "ls": "--" if c.mode == "detector" else patterns[modes.index(c.mode) % len(patterns)],
        }
        for c in curves
    ]


def left_edge(metrics: Mapping[str, Any]) -> float:
    """Left end of the log axis of false positives per image: half of one false positive in all images."""
    return 0.5 / max(int(metrics["n_images"]), 1)


def _save(path: Path, draw: Callable[[Axes], None]) -> None:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), dpi=150, layout="constrained")
        draw(figure.add_subplot())
        with atomic_path(path) as beside:
            figure.savefig(beside, metadata={"Software": None})
