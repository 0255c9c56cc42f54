"""The curves as pictures: both ROC figures after the report's figure 13, precision-recall, and w."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.palette import detector_colour, detector_name, mode_colour, mode_dash, mode_name
from reports.run.curves import CurveSet, curve_sets
from reports.run.tables import in_interval, number, weight_text
from rescore.files import atomic_path
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
    "grid.color": "#E3E3E3",
    "axes.edgecolor": "#555555",
    "legend.edgecolor": "white",
    "legend.framealpha": 0.9,
    "legend.fontsize": 10.5,
    "savefig.facecolor": "white",
    "svg.hashsalt": "rescore",
}
_MARKER = "o"


def write_curves(run: Run, folder: Path) -> tuple[Path, ...]:
    """Draw every curve of a run as PNG into ``folder``; the paths, in the order of reading.

    Nothing is drawn where no car is annotated: there is nothing to find.
    """
    if not run.metrics["n_cars"]:
        return ()
    curves = curve_sets(run)
    by_detector = [[c for c in curves if c.detector == d] for d in run.detectors]
    drawings = {
        "candidate_roc.png": draw_candidate_roc,
        "car_roc.png": draw_car_roc,
        "precision_recall.png": draw_precision_recall,
    }
    paths = []
    for name, draw in drawings.items():
        paths.append(folder / name)
        _save(paths[-1], [partial(draw, curves=c, metrics=run.metrics) for c in by_detector])
    tuning = run.tuning()
    if tuning:
        paths.append(folder / "weight.png")
        _save(paths[-1], [partial(draw_weight, tuning=tuning)])
    shown = run.reliability()
    if shown:
        paths.append(folder / "reliability.png")
        groups = [[r for r in shown if r["detector"] == d] for d in run.detectors]
        _save(paths[-1], [partial(draw_reliability, shown=group) for group in groups if group])
    return tuple(paths)


def draw_candidate_roc(ax: Axes, curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> None:
    """The ROC over candidates of one detector: hits kept against false candidates kept."""
    for curve in curves:
        label = f"{mode_name(curve.mode)}: area {number(curve.row['auc'])}"
        ax.plot(curve.candidate.x, curve.candidate.y, label=label, **style(curve))
    ax.plot([0, 1], [0, 1], color="#999999", lw=1, ls=":", label="chance")
    ax.set(xlim=(-0.01, 1.01), ylim=(0, 1.02), title=_title(curves))
    ax.set_xlabel("false-positive rate: share of the false candidates that are accepted")
    ax.set_ylabel("true-positive rate: share of the hits that are accepted")
    ax.legend(
        loc="lower right", title=f"{metrics['n_candidates']} candidates of {metrics['n_images']} images"
    )


def draw_car_roc(ax: Axes, curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> None:
    """The rate of all annotated cars that one detector finds against false positives an image, log axis."""
    left = left_edge(metrics)
    for curve in curves:
        ceiling = curve.row["recall_ceiling"]
        x = np.maximum(curve.cars.x, left)
        ax.plot(
            x,
            curve.cars.y,
            drawstyle="steps-post",
            label=f"{mode_name(curve.mode)}: AP {number(curve.row['average_precision'])}",
            **style(curve),
        )
        if curve.mode == "detector":
            ax.axhline(ceiling, color=style(curve)["color"], lw=0.8, ls=":")
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set(xlim=(left, 20), ylim=(0, 1.02), title=_title(curves))
    ax.set_xlabel("false positives per image (log; the left edge is none)")
    ax.set_ylabel(f"true-positive rate: share of all {metrics['n_cars']} annotated cars")
    # the curves rise from the left below to the right above
    ax.legend(loc="upper left", title="dotted: all candidates accepted")


def draw_precision_recall(ax: Axes, curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> None:
    """Precision of one detector against the rate of all annotated cars found."""
    for curve in curves:
        label = f"{mode_name(curve.mode)}: AP {number(curve.row['average_precision'])}"
        ax.plot(curve.precision.recall, curve.precision.precision, label=label, **style(curve))
    ax.set(xlim=(0, 1.01), ylim=(0, 1.02), title=_title(curves))
    ax.set_xlabel(f"recall: share of all {metrics['n_cars']} annotated cars found")
    ax.set_ylabel("precision: share of accepted candidates that are hits")
    ax.legend(loc="best")


def draw_weight(ax: Axes, tuning: Mapping[str, Mapping[str, Any]]) -> None:
    """The objective on the validation set over w, with the chosen w marked."""
    for detector, tuned in tuning.items():
        colour = detector_colour(detector, tuple(tuning))
        w, value = np.array(tuned["w_grid"]), np.array(tuned["objective"], float)
        ax.plot(
            w,
            value,
            color=colour,
            lw=2,
            label=f"{detector_name(detector, short=True)}: w = {weight_text(tuned)}",
        )
        if tuned.get("uncertainty"):
            inside = in_interval(tuned)
            ax.plot(w[inside], value[inside], color=colour, alpha=0.25, lw=10, solid_capstyle="butt")
        ax.plot([tuned["w"]], [np.interp(tuned["w"], w, value)], _MARKER, color=colour, ms=9)
    ax.set(xlim=(-0.02, 1.02), title="Choice of w on the validation set")
    ax.set_xlabel("w: 0 trusts the depth alone, 1 the detector alone")
    ax.set_ylabel(f"objective: {next(iter(tuning.values()))['objective_name'].replace('_', ' ')}")
    ax.legend(loc="best", title="broad line: interval of 95 % of w" if _has_bands(tuning) else None)


def _has_bands(tuning: Mapping[str, Mapping[str, Any]]) -> bool:
    return any(t.get("uncertainty") for t in tuning.values())


def draw_reliability(ax: Axes, shown: Sequence[Mapping[str, Any]]) -> None:
    """Share of hits over score in groups of candidates of one detector, with intervals of 95 %."""
    for r in shown:
        rate, low, high = (np.array(r[k], float) for k in ("hit_rate", "low", "high"))
        ax.errorbar(
            r["likelihood"],
            rate,
            np.stack([rate - low, high - rate]),
            color=mode_colour(r["mode"]),
            ls=mode_dash(r["mode"]),
            marker=_MARKER,
            ms=4,
            elinewidth=1,
            capsize=2,
            label=f"{mode_name(r['mode'])}: Brier {number(r['brier_score'])}",
        )
    ax.plot([0, 1], [0, 1], color="#999999", lw=1, ls=":", label="as it should be")
    ax.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), title=detector_name(shown[0]["detector"]))
    ax.set_xlabel("mean score of a group of candidates")
    ax.set_ylabel("share of hits in the group")
    ax.legend(loc="best")


def style(curve: CurveSet) -> dict[str, Any]:
    """Line style of a curve by its mode; all detectors share it."""
    alone = curve.mode == "detector"
    return {"color": mode_colour(curve.mode), "lw": 1.6 if alone else 2.2, "ls": mode_dash(curve.mode)}


def _title(curves: Sequence[CurveSet]) -> str:
    return detector_name(curves[0].detector)


def left_edge(metrics: Mapping[str, Any]) -> float:
    """Left end of the log axis of false positives per image: half of one false positive in all images."""
    return 0.5 / max(int(metrics["n_images"]), 1)


def _save(path: Path, panels: Sequence[Callable[[Axes], None]]) -> None:
    """One picture of panels side by side."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4 * len(panels), 5.2), dpi=130, layout="constrained")
        for axes, draw in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            draw(axes)
        with atomic_path(path) as beside:
            figure.savefig(beside, metadata={"Software": None})
