"""The interactive curves of the HTML page, for ``reports.charts``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from reports.charts import Axis, Chart, ChartGroup, Line, Look, Switch, mode_switches
from reports.palette import detector_name, mode_name
from reports.run.curve_pictures import left_edge
from reports.run.curves import CurveSet
from reports.run.tables import as_float, interval_text, number, number_text, weight_text
from rescore.metrics.curve_bands import Band, CurveBands

SWEEP_FACTOR = (0.1, 30.0)
"""Factors beyond are drawn at the edge."""


SWEEP_FPPI = (0.03, 20.0)


def weight_group(name: str, tuning: Mapping[str, Mapping[str, Any]]) -> ChartGroup | None:
    """The objective over w of every detector and mode; None where no w was chosen."""
    charts: list[Chart] = []
    modes: list[str] = []
    n_images = 0
    for detector, tuned in tuning.items():
        # an older version knows no other mode
        own = tuned.get("modes") or {"paper": tuned}
        modes += own
        n_images = max([n_images, *(t.get("n_images") or 0 for t in own.values())])
        lines = tuple(_weight_line(mode, t) for mode, t in own.items())
        objective = next(iter(own.values()))["objective_name"].replace("_", " ")
        values = np.array([v for line in lines for v in np.asarray(line.y, float) if np.isfinite(v)])
        room = 0.06 * float(np.ptp(values)) + 1e-3
        y = Axis(
            f"{objective} on the validation set",
            float(values.min()) - room,
            float(values.max()) + room,
            digits=3,
        )
        alt = f"{objective} over w, {detector_name(detector)}. " + "; ".join(
            f"{line.name}: {line.figure}" for line in lines
        )
        x = Axis("w: 0 trusts the depth alone, 1 the detector alone", 0.0, 1.0)
        charts.append(Chart(detector_name(detector), alt, x, y, lines))
    if not charts:
        return None
    counted = f"{n_images} validation images" if n_images else "the validation images"
    note = (
        f"The marked w was chosen on {counted} alone; of many equally good ones, the middle. Broad line: "
        "interval of 95 % of w, chosen again on images drawn with replacement."
    )
    names = {m: mode_name(m) for m in dict.fromkeys(modes)}
    return ChartGroup(
        name,
        {"Choice of w": tuple(charts)},
        {"Choice of w": note},
        mode_switches(list(names), names, list(names)),
    )


def _weight_line(mode: str, tuned: Mapping[str, Any]) -> Line:
    w, value = np.array(tuned["w_grid"], float), np.array(tuned["objective"], float)
    u = tuned.get("uncertainty")
    chosen = int(np.argmin(np.abs(w - tuned["w"])))
    return Line(
        mode_name(mode),
        f"w = {weight_text(tuned)}",
        Look.of_mode(mode),
        w,
        value,
        (mode,),
        broad=(u["low"], u["high"]) if u else None,
        mark=(float(w[chosen]), float(value[chosen])),
    )


def reliability_group(name: str, shown: Sequence[Mapping[str, Any]]) -> ChartGroup | None:
    """Share of hits over score, in groups with intervals; None where scores are no likelihoods."""
    if not shown:
        return None
    charts = []
    for detector in dict.fromkeys(r["detector"] for r in shown):
        lines = tuple(_reliability_line(r) for r in shown if r["detector"] == detector)
        alt = f"Share of hits over score, {detector_name(detector)}. " + "; ".join(
            f"{line.name}: {line.figure}" for line in lines
        )
        axes = (
            Axis("mean score of a group", 0.0, 1.0, digits=3),
            Axis("hits in the group", 0.0, 1.0, percent=True),
        )
        charts.append(Chart(detector_name(detector), alt, *axes, lines, diagonal=True))
    modes = list(dict.fromkeys(str(r["mode"]) for r in shown))
    n = max(len(r["count"]) for r in shown)
    note = (
        f"Up to {n} groups of equally many candidates, by score; bars: intervals of 95 %. On the dotted line "
        "a score is a probability. Most candidates have low scores, so most groups lie at the left."
    )
    names = {m: mode_name(m) for m in modes}
    switches = mode_switches(modes, names, (modes[0], modes[-1]))
    return ChartGroup(name, {"Reliability": tuple(charts)}, {"Reliability": note}, switches)


def _reliability_line(r: Mapping[str, Any]) -> Line:
    rate = np.array(r["hit_rate"], float)
    return Line(
        mode_name(r["mode"]),
        f"Brier {number(r['brier_score'])}",
        Look.of_mode(r["mode"]),
        np.array(r["likelihood"], float),
        rate,
        (r["mode"],),
        text=tuple(f"{v:.1%} of {n} are hits" for v, n in zip(rate, r["count"], strict=True)),
        markers=True,
        bars={"low": np.array(r["low"], float), "high": np.array(r["high"], float)},
    )


def sweep_group(name: str, sweep: Mapping[str, Any]) -> ChartGroup:
    """What is left of the gain while the input is spoilt (content of sweep.json), a chart a dial."""
    dials = sweep["dials"]
    factors = [
        _sweep_chart(dial, "reduction", "times fewer false positives", SWEEP_FACTOR, level=1.0)
        for dial in dials.values()
    ]
    alarms = [_sweep_chart(dial, "fppi", "false positives per image", SWEEP_FPPI) for dial in dials.values()]
    notes = {
        "Times fewer": f"{detector_name(sweep['detector'])}, {sweep['n_images']} test images: how many times "
        "fewer false positives per image than the detector alone where 70 % of the cars are found, with "
        "intervals of 95 %. Above the line at 1 depth helps. Level 0 is the input as it is.",
        "False positives": "False positives per image where 70 % of the cars are found.",
    }
    modes = list(dict.fromkeys(line.tags[0] for chart in (*alarms, *factors) for line in chart.lines))
    names = {m: mode_name(m) for m in modes}
    kinds = {"Times fewer": tuple(factors), "False positives": tuple(alarms)}
    return ChartGroup(name, kinds, notes, mode_switches(modes, names, modes))


def _sweep_chart(
    dial: Mapping[str, Any], figure: str, what: str, limits: tuple[float, float], level: float | None = None
) -> Chart:
    points = dial["points"]
    at = np.array([p["level"] for p in points], float)
    lines = []
    for mode in points[0]["figures"]:
        read = [p["figures"][mode][figure] for p in points]
        if any(f is None for f in read):
            continue
        value, low, high = (
            np.clip(np.array([as_float(f[end]) for f in read]), *limits) for end in ("value", "low", "high")
        )
        text = tuple(interval_text(f) for f in read)
        last = f"at the end {number_text(read[-1]['value'], 2)}"
        band = {"x": at, "low": low, "high": high} if level is not None else None
        look = Look.of_mode(mode)
        lines.append(
            Line(mode_name(mode), last, look, at, value, (mode,), text=text, markers=True, band=band)
        )
    alt = f"{what} over {dial['what']}. " + "; ".join(f"{line.name}: {line.figure}" for line in lines)
    x = Axis(dial["what"], float(at.min()), float(at.max()))
    return Chart(dial["what"], alt, x, Axis(what, *limits, log=True), tuple(lines), level=level)


CARS, CANDIDATES, PRECISION = "Cars found", "Candidate ROC", "Precision and recall"
RIGHT_EDGE_FPPI = 20.0
RIGHT_EDGE_LINEAR_FPPI = 5.0
Bands = Mapping[tuple[str, str], CurveBands | None]
"""Bands of the curves by detector and mode."""


def curve_group(
    name: str, curves: Sequence[CurveSet], metrics: Mapping[str, Any], bands: Bands
) -> ChartGroup:
    """The three curves of every detector, a line a mode; the detector alone and the last mode are on."""
    modes = list(dict.fromkeys(c.mode for c in curves))
    lines = [_Lines(c, mode_name(c.mode), Look.of_mode(c.mode), (c.mode,), bands) for c in curves]
    switches = mode_switches(modes, {m: mode_name(m) for m in modes}, (modes[0], modes[-1]))
    return _group(name, lines, (metrics,), switches)


def runs_group(
    name: str,
    runs: Mapping[str, Sequence[CurveSet]],
    colours: Mapping[str, str],
    metrics: Sequence[Mapping[str, Any]],
) -> ChartGroup:
    """The curves of several runs in the same charts: a colour a run, dashes by mode.

    The detector alone and the last mode of each run are on.
    """
    modes = list(dict.fromkeys(c.mode for curves in runs.values() for c in curves))
    lines = [
        _Lines(
            c, f"{run}, {mode_name(c.mode)}", Look.of_colour(colours[run], c.mode), (f"run {run}", c.mode), {}
        )
        for run, curves in runs.items()
        for c in curves
    ]
    ends = [mode for curves in runs.values() for mode in (curves[0].mode, curves[-1].mode)]
    switches = tuple(
        Switch(f"run {run}", run, Look.of_colour(colour), True) for run, colour in colours.items()
    )
    return _group(
        name, lines, metrics, switches + mode_switches(modes, {m: mode_name(m) for m in modes}, ends)
    )


class _Lines:
    """One detector in one mode as a line of each kind of chart."""

    def __init__(self, curves: CurveSet, name: str, look: Look, tags: tuple[str, ...], bands: Bands):
        self.curves, self.detector = curves, curves.detector
        self._common: dict[str, Any] = {"name": name, "look": look, "tags": tags}
        self._bands = bands.get((curves.detector, curves.mode))

    def cars(self, left: float) -> Line:
        """Share of all cars over false positives an image."""
        c, b = self.curves.cars, self._bands
        band = None if b is None else _band(Band(np.maximum(b.cars.x, left), b.cars.low, b.cars.high))
        figure = f"AP {number(self.curves.row['average_precision'])}"
        return self._line(c.x, c.y, c.threshold, figure, band, read="last", step=True)

    def candidates(self) -> Line:
        """The ROC over candidates."""
        c, b = self.curves.candidate, self._bands
        figure = f"area {number(self.curves.row['auc'])}"
        return self._line(
            c.x, c.y, c.threshold, figure, None if b is None else _band(b.candidate), read="last"
        )

    def precision(self) -> Line:
        """Precision over recall."""
        c, b = self.curves.precision, self._bands
        figure = f"AP {number(self.curves.row['average_precision'])}"
        band = None if b is None else _band(b.precision)
        return self._line(c.recall, c.precision, c.threshold, figure, band, read="first")

    def _line(self, x: Any, y: Any, threshold: Any, figure: str, band: Any, **how: Any) -> Line:
        return Line(figure=figure, x=x, y=y, threshold=threshold, band=band, **how, **self._common)


def _band(band: Band) -> dict[str, Any]:
    return {"x": band.x, "low": band.low, "high": band.high}


def _group(
    name: str, lines: Sequence[_Lines], metrics: Sequence[Mapping[str, Any]], switches: tuple[Switch, ...]
) -> ChartGroup:
    left = min(left_edge(m) for m in metrics)
    shares: dict[str, Any] = {"low": 0.0, "high": 1.0, "percent": True}
    cars = f"share of all {_count(metrics, 'n_cars')}cars"
    alarms = Axis(
        "false positives per image", left, RIGHT_EDGE_FPPI, log=True, linear_high=RIGHT_EDGE_LINEAR_FPPI
    )
    by_detector: dict[str, list[_Lines]] = {}
    for line in lines:
        by_detector.setdefault(line.detector, []).append(line)
    kinds: dict[str, list[Chart]] = {CARS: [], CANDIDATES: [], PRECISION: []}
    axes = {
        CARS: (alarms, Axis(f"{cars} found", **shares)),
        CANDIDATES: (
            Axis("share of the false candidates accepted", **shares),
            Axis("share of the hits accepted", **shares),
        ),
        PRECISION: (Axis(f"recall: {cars}", **shares), Axis("precision: hits among the accepted", **shares)),
    }
    for detector, own in by_detector.items():
        drawn = {
            CARS: [o.cars(left) for o in own],
            CANDIDATES: [o.candidates() for o in own],
            PRECISION: [o.precision() for o in own],
        }
        for kind, shown in drawn.items():
            title = detector_name(detector)
            alt = f"{kind}, {title}. " + "; ".join(f"{line.name}: {line.figure}" for line in shown)
            kinds[kind].append(Chart(title, alt, *axes[kind], tuple(shown), diagonal=kind == CANDIDATES))
    return ChartGroup(name, {k: tuple(c) for k, c in kinds.items()}, _notes(metrics), switches)


def _notes(metrics: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    cars, images, candidates = (_count(metrics, key) for key in ("n_cars", "n_images", "n_candidates"))
    return {
        CARS: f"Counts all {cars}annotated cars, missed ones too, and all {images}images, also those without "
        "a car. A second candidate on the same car is a false positive. On the log axis the left edge is no "
        "false positive at all.",
        CANDIDATES: f"Counts the {candidates}candidates only. A car that no candidate found does not appear "
        "here; candidates on ignored objects are left out. Dotted: chance.",
        PRECISION: "Precision: share of the accepted candidates that are hits. Recall: share of all cars "
        "found.",
    }


def _count(metrics: Sequence[Mapping[str, Any]], key: str) -> str:
    """Number of a metric that all runs share, as text with a space after it; empty where runs differ."""
    values = {m[key] for m in metrics}
    return f"{values.pop()} " if len(values) == 1 else ""
