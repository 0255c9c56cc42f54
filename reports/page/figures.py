"""The interactive charts of the HTML page: curves of a run or several, image weight, reliability, sweeps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from reports.charts import Axis, Chart, ChartGroup, Line, Look, Switch, mode_switches
from reports.palette import detector_name, mode_name
from reports.run.curves import (
    CANDIDATES,
    CARS,
    PRECISION,
    CurveSet,
    DrawnCurves,
    alt_text,
    count_text,
    curve_charts,
    reliability_charts,
    weight_chart,
    weight_line,
)
from reports.run.tables import interval_text, number_text
from rescore.metrics.curve_bands import CurveBands
from rescore.results.metrics_file import DetectorTuning, Metrics, ReliabilityRow, TunedWeight
from rescore.results.sweep_file import SweepFigures, SweepResult, SweptDial, SweptInterval

SWEEP_FACTOR = (0.1, 30.0)
"""Factors beyond are drawn at the edge."""
SWEEP_FPPI = (0.03, 20.0)
Bands = Mapping[tuple[str, str], CurveBands | None]
"""Bands of the curves by detector and mode."""


def weight_group(name: str, tuning: Mapping[str, DetectorTuning]) -> ChartGroup | None:
    """The objective over w of every detector and mode; None where no w was chosen."""
    charts: list[Chart] = []
    modes: list[str] = []
    n_images = 0
    for detector, tuned in tuning.items():
        # an older version knows no other mode
        own: Mapping[str, TunedWeight] = tuned.modes or {"paper": tuned}
        modes += own
        n_images = max([n_images, *(t.n_images or 0 for t in own.values())])
        lines = [weight_line(mode_name(mode), Look.of_mode(mode), (mode,), t) for mode, t in own.items()]
        objective = next(iter(own.values())).objective_name
        title = detector_name(detector)
        alt = f"{objective.replace('_', ' ')} over w, {title}"
        charts.append(weight_chart(title, alt, lines, objective))
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


def reliability_group(name: str, shown: Sequence[ReliabilityRow]) -> ChartGroup | None:
    """Share of hits over score, in groups with intervals; None where scores are no likelihoods."""
    if not shown:
        return None
    modes = list(dict.fromkeys(r.mode for r in shown))
    n = max(len(r.count) for r in shown)
    note = (
        f"Up to {n} groups of equally many candidates, by score; bars: intervals of 95 %. On the dotted line "
        "a score is a probability. Most candidates have low scores, so most groups lie at the left."
    )
    names = {m: mode_name(m) for m in modes}
    switches = mode_switches(modes, names, (modes[0], modes[-1]))
    charts = tuple(reliability_charts(shown).values())
    return ChartGroup(name, {"Reliability": charts}, {"Reliability": note}, switches)


def sweep_group(name: str, sweep: SweepResult) -> ChartGroup:
    """What is left of the gain while the input is spoilt, a chart a dial."""
    dials = sweep.dials
    factors = [
        _sweep_chart(dial, lambda f: f.reduction, "times fewer false positives", SWEEP_FACTOR, level=1.0)
        for dial in dials.values()
    ]
    alarms = [
        _sweep_chart(dial, lambda f: f.fppi, "false positives per image", SWEEP_FPPI)
        for dial in dials.values()
    ]
    notes = {
        "Times fewer": f"{detector_name(sweep.detector)}, {sweep.n_images} test images: how many times "
        "fewer false positives per image than the detector alone where 70 % of the cars are found, with "
        "intervals of 95 %. Above the line at 1 depth helps. Level 0 is the input as it is.",
        "False positives": "False positives per image where 70 % of the cars are found.",
    }
    modes = list(dict.fromkeys(line.tags[0] for chart in (*alarms, *factors) for line in chart.lines))
    names = {m: mode_name(m) for m in modes}
    kinds = {"Times fewer": tuple(factors), "False positives": tuple(alarms)}
    return ChartGroup(name, kinds, notes, mode_switches(modes, names, modes))


def _sweep_chart(
    dial: SweptDial,
    figure: Callable[[SweepFigures], SweptInterval | None],
    what: str,
    limits: tuple[float, float],
    level: float | None = None,
) -> Chart:
    points = dial.points
    at = np.array([p.level for p in points], float)
    lines = []
    for mode in points[0].figures:
        read = [f for p in points if (f := figure(p.figures[mode])) is not None]
        if len(read) < len(points):
            continue
        value, low, high = np.clip(np.array([(f.value, f.low, f.high) for f in read]).T, *limits)
        text = tuple(interval_text(f) for f in read)
        last = f"at the end {number_text(read[-1].value, 2)}"
        band = {"x": at, "low": low, "high": high} if level is not None else None
        look = Look.of_mode(mode)
        lines.append(
            Line(mode_name(mode), last, look, at, value, (mode,), text=text, markers=True, band=band)
        )
    alt = alt_text(f"{what} over {dial.what}", lines)
    x = Axis(dial.what, float(at.min()), float(at.max()))
    return Chart(dial.what, alt, x, Axis(what, *limits, log=True), tuple(lines), level=level)


def curve_group(name: str, curves: Sequence[CurveSet], metrics: Metrics, bands: Bands) -> ChartGroup:
    """The three curves of every detector, a line a mode; the detector alone and the last mode are on."""
    modes = list(dict.fromkeys(c.mode for c in curves))
    drawn = [DrawnCurves.of_mode(c, bands.get((c.detector, c.mode))) for c in curves]
    switches = mode_switches(modes, {m: mode_name(m) for m in modes}, (modes[0], modes[-1]))
    return _group(name, drawn, (metrics,), switches)


def runs_group(
    name: str,
    runs: Mapping[str, Sequence[CurveSet]],
    colours: Mapping[str, str],
    metrics: Sequence[Metrics],
) -> ChartGroup:
    """The curves of several runs in the same charts: a colour a run, dashes by mode.

    The detector alone and the last mode of each run are on.
    """
    modes = list(dict.fromkeys(c.mode for curves in runs.values() for c in curves))
    drawn = [
        DrawnCurves(
            c, f"{run}, {mode_name(c.mode)}", _look(colours[run], c, curves[-1]), (f"run {run}", c.mode)
        )
        for run, curves in runs.items()
        for c in curves
    ]
    ends = [mode for curves in runs.values() for mode in (curves[0].mode, curves[-1].mode)]
    switches = tuple(
        Switch(f"run {run}", run, Look.of_colour(colour), True) for run, colour in colours.items()
    )
    return _group(
        name, drawn, metrics, switches + mode_switches(modes, {m: mode_name(m) for m in modes}, ends)
    )


def _look(colour: str, curve: CurveSet, last: CurveSet) -> Look:
    """The look of a curve of a run: the last mode alone has a solid line, since all have one colour."""
    look = Look.of_colour(colour, curve.mode)
    return replace(look, dash="longdash") if look.dash == "solid" and curve.mode != last.mode else look


def _group(
    name: str, drawn: Sequence[DrawnCurves], metrics: Sequence[Metrics], switches: tuple[Switch, ...]
) -> ChartGroup:
    kinds = {kind: tuple(charts.values()) for kind, charts in curve_charts(drawn, metrics).items()}
    return ChartGroup(name, kinds, _notes(metrics), switches)


def _notes(metrics: Sequence[Metrics]) -> dict[str, str]:
    cars, images = count_text(m.n_cars for m in metrics), count_text(m.n_images for m in metrics)
    candidates = count_text(m.n_candidates for m in metrics)
    return {
        CARS: f"Counts all {cars}annotated cars, missed ones too, and all {images}images, also those without "
        "a car. A second candidate on the same car is a false positive. On the log axis the left edge is no "
        "false positive at all.",
        CANDIDATES: f"Counts the {candidates}candidates only. A car that no candidate found does not appear "
        "here; candidates on ignored objects are left out. Dotted: chance.",
        PRECISION: "Precision: share of the accepted candidates that are hits. Recall: share of all cars "
        "found.",
    }
