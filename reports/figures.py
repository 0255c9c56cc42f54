"""The interactive curves of the HTML page, for ``reports.charts``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from reports.charts import Axis, Chart, ChartGroup, Line, Look, Switch, mode_switches
from reports.curves import CurveSet
from reports.palette import detector_name, mode_name
from reports.roc import left_edge
from reports.tables import number
from rescore.curve_bands import Band, CurveBands

CARS, CANDIDATES, PRECISION = "Cars found", "Candidate ROC", "Precision and recall"
RIGHT_EDGE_FPPI = 20.0
RIGHT_EDGE_LINEAR_FPPI = 5.0
Bands = Mapping[tuple[str, str], CurveBands | None]
"""By detector and mode."""


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
    """A number and a space where all runs have the same one, else nothing."""
    values = {m[key] for m in metrics}
    return f"{values.pop()} " if len(values) == 1 else ""
