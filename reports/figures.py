"""The interactive curves of the HTML page, as the data and layout that plotly.js draws."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reports.certainty_tables import in_interval, weight_text
from reports.curves import CurveSet
from reports.palette import detector_colour, detector_name, mode_name
from reports.roc import left_edge
from reports.tables import number

FloatArray = NDArray[np.float64]
Figure = dict[str, Any]
"""``id``, ``title``, ``alt``, ``note``, ``traces`` and ``layout``; JSON values only."""

_DASHES = ("solid", "dashdot", "dot", "longdashdot")


def json_values(value: Any) -> Any:
    """The value with null for every number that JSON cannot hold, such as the rates of a class that is empty.

    A browser refuses a page's data whole for a single NaN.
    """
    if isinstance(value, dict):
        return {k: json_values(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_values(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def candidate_roc_figure(curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> Figure:
    """The ROC over candidates."""
    traces = [
        _trace(
            c, curves, (c.candidate.x, c.candidate.y), c.candidate.threshold, f"area {number(c.row['auc'])}"
        )
        for c in curves
    ]
    for trace in traces:
        trace["hovertemplate"] = (
            "threshold %{text}<br>%{y:.1%} of the hits, %{x:.1%} of the false candidates accepted"
        )
    chance = {"x": [0, 1], "y": [0, 1], "mode": "lines", "name": "chance", "hoverinfo": "skip"}
    traces.append(chance | {"line": {"color": "#8A8A8A", "width": 1, "dash": "dot"}})
    return _figure(
        "candidate-roc",
        "Candidate ROC",
        traces,
        (
            _axis("false-positive rate: share of the false candidates accepted", [-0.01, 1.01]),
            _axis("true-positive rate (share of hits)", [0, 1.02]),
        ),
        note=f"Counts the {metrics['n_candidates']} candidates only. A car that no candidate found does not "
        "appear here; candidates on ignored objects are left out.",
        alt=_alt("Candidate ROC", curves, "auc", "area"),
    )


def car_roc_figure(curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> Figure:
    """All annotated cars found against false positives per image."""
    left = left_edge(metrics)
    traces = []
    for c in curves:
        legend = f"AP {number(c.row['average_precision'])}"
        trace = _trace(c, curves, (np.maximum(c.cars.x, left), c.cars.y), c.cars.threshold, legend)
        trace["line"]["shape"] = "hv"
        trace["customdata"] = c.cars.x.tolist()
        trace["hovertemplate"] = (
            "threshold %{text}<br>%{y:.1%} of all cars, %{customdata:.2f} false positives per image"
        )
        traces.append(trace)
    x = _axis(
        "false positives per image (log axis; left edge: none)", [float(np.log10(left)), float(np.log10(20))]
    )
    x |= {"type": "log", "dtick": 1}
    return _figure(
        "car-roc",
        "Cars found against false positives",
        traces,
        (x, _axis(f"share of all {metrics['n_cars']} annotated cars", [0, 1.02])),
        note=f"Counts all {metrics['n_cars']} annotated cars, missed ones too, and all "
        f"{metrics['n_images']} images, also those without a car. "
        "A second candidate on the same car is a false positive.",
        alt=_alt(
            "Cars found against false positives per image", curves, "average_precision", "average precision"
        ),
    )


def precision_recall_figure(curves: Sequence[CurveSet], metrics: Mapping[str, Any]) -> Figure:
    """Precision against recall."""
    traces = []
    for c in curves:
        p = c.precision
        trace = _trace(
            c, curves, (p.recall, p.precision), p.threshold, f"AP {number(c.row['average_precision'])}"
        )
        trace["hovertemplate"] = "threshold %{text}<br>precision %{y:.1%} at %{x:.1%} of all cars"
        traces.append(trace)
    return _figure(
        "precision-recall",
        "Precision and recall",
        traces,
        (
            _axis(f"recall: share of all {metrics['n_cars']} annotated cars", [0, 1.01]),
            _axis("precision (hits among accepted)", [0, 1.02]),
        ),
        note="Precision: share of the accepted candidates that are hits. Recall: share of all cars found.",
        alt=_alt("Precision against recall", curves, "average_precision", "average precision"),
    )


def weight_figure(tuning: Mapping[str, Mapping[str, Any]]) -> Figure:
    """The objective over w, with the chosen w marked."""
    traces: list[dict[str, Any]] = []
    for detector, t in tuning.items():
        colour = detector_colour(detector, tuple(tuning))
        name = f"{detector_name(detector, short=True)}: w = {weight_text(t)}"
        hover = "w = %{x:.2f}: %{y:.3f}"
        line = {"color": colour, "width": 2}
        if t.get("uncertainty"):
            inside = in_interval(t)
            band = {
                k: [v for v, use in zip(t[k], inside, strict=True) if use] for k in ("w_grid", "objective")
            }
            look = {"opacity": 0.25, "line": {"color": colour, "width": 12}, "showlegend": False}
            where = {"x": band["w_grid"], "y": band["objective"], "mode": "lines", "hoverinfo": "skip"}
            traces.append(where | look)
        traces.append(
            {
                "x": t["w_grid"],
                "y": t["objective"],
                "mode": "lines",
                "name": name,
                "line": line,
                "hovertemplate": hover,
            }
        )
        chosen = int(np.argmin(np.abs(np.array(t["w_grid"]) - t["w"])))
        marker = {"color": colour, "size": 11}
        traces.append(
            {
                "x": [t["w_grid"][chosen]],
                "y": [t["objective"][chosen]],
                "mode": "markers",
                "marker": marker,
                "showlegend": False,
                "hovertemplate": hover,
            }
        )
    objective = next(iter(tuning.values()))["objective_name"].replace("_", " ")
    chosen_text = ", ".join(f"{detector_name(d, short=True)} w = {t['w']:g}" for d, t in tuning.items())
    return _figure(
        "weight",
        "Choice of w on the validation set",
        traces,
        (
            _axis("w: 0 trusts the depth alone, 1 the detector alone", [-0.02, 1.02]),
            {"title": {"text": f"{objective} on the validation set"}},
        ),
        note="The marked w was chosen on the validation images alone; of many equally good ones, the middle. "
        "Broad line: interval of 95% of w, chosen again on images drawn with replacement.",
        alt=f"{objective} on the validation set over w; chosen: {chosen_text}",
    )


def reliability_figure(shown: Sequence[Mapping[str, Any]], detectors: Sequence[str]) -> Figure:
    """Share of hits over score, in groups of candidates, with intervals."""
    traces: list[dict[str, Any]] = []
    for r in shown:
        alone = r["mode"] == "detector"
        rate, high, low = (np.array(r[k], float) for k in ("hit_rate", "high", "low"))
        error = {"type": "data", "array": (high - rate).tolist(), "arrayminus": (rate - low).tolist()}
        line = {
            "color": detector_colour(r["detector"], detectors),
            "width": 2,
            "dash": "dash" if alone else "solid",
        }
        legend = f"{detector_name(r['detector'], short=True)}, {mode_name(r['mode'])}"
        traces.append(
            {
                "x": r["likelihood"],
                "y": r["hit_rate"],
                "text": [str(n) for n in r["count"]],
                "error_y": error | {"symmetric": False, "width": 2, "thickness": 1},
                "mode": "lines+markers",
                "name": f"{legend}: Brier {number(r['brier_score'])}",
                "line": line,
                "hovertemplate": "mean score %{x:.3f}: %{y:.1%} of %{text} candidates are hits",
            }
        )
    perfect = {"x": [0, 1], "y": [0, 1], "mode": "lines", "name": "as it should be", "hoverinfo": "skip"}
    traces.append(perfect | {"line": {"color": "#8A8A8A", "width": 1, "dash": "dot"}})
    return _figure(
        "reliability",
        "Are scores probabilities?",
        traces,
        (_axis("mean score of a group", [-0.02, 1.02]), _axis("share of hits in the group", [-0.02, 1.02])),
        note="Twenty groups of equally many candidates, by score; bars: intervals of 95%. Most candidates "
        "have low scores, so most groups lie at the left.",
        alt="Share of hits over score: "
        + "; ".join(
            f"{detector_name(r['detector'])}, {mode_name(r['mode'])}: Brier {number(r['brier_score'])}"
            for r in shown
        ),
    )


def _trace(
    c: CurveSet,
    curves: Sequence[CurveSet],
    xy: tuple[FloatArray, FloatArray],
    threshold: FloatArray,
    legend: str,
) -> dict[str, Any]:
    detectors = tuple(dict.fromkeys(o.detector for o in curves))
    others = [m for m in dict.fromkeys(o.mode for o in curves) if m != "detector"]
    alone = c.mode == "detector"
    dash = "dash" if alone else _DASHES[others.index(c.mode) % len(_DASHES)]
    return {
        "x": xy[0].tolist(),
        "y": xy[1].tolist(),
        "text": [f"{t:.4f}" if np.isfinite(t) else "above all scores" for t in threshold.tolist()],
        "mode": "lines",
        "name": f"{c.short_name}: {legend}",
        "line": {
            "color": detector_colour(c.detector, detectors),
            "width": 1.8 if alone else 2.8,
            "dash": dash,
        },
    }


def _axis(title: str, limits: list[float]) -> dict[str, Any]:
    return {"title": {"text": title}, "range": limits}


def _figure(
    name: str,
    title: str,
    traces: list[dict[str, Any]],
    axes: tuple[dict[str, Any], dict[str, Any]],
    *,
    note: str,
    alt: str,
) -> Figure:
    layout = {"xaxis": axes[0], "yaxis": axes[1]}
    return {"id": name, "title": title, "note": note, "alt": alt, "traces": traces, "layout": layout}


def _alt(title: str, curves: Sequence[CurveSet], key: str, what: str) -> str:
    return f"{title}. " + "; ".join(f"{c.name}: {what} {number(c.row[key])}" for c in curves)
