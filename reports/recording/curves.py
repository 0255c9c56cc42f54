"""The plots of a recording: the curves of each detector in all its modes, and the choice of w."""

from collections.abc import Callable, Mapping

import numpy as np

from recon.arrays import FloatArray, IntArray
from reports.palette import detector_name, mode_colour
from reports.recording.names import part
from reports.recording.plot import Axis, Line, Plot
from reports.recording.story import Story
from reports.recording.threshold import CurvePlots
from reports.run.curve_pictures import left_edge
from reports.run.curves import CurveSet, curve_sets
from reports.run.tables import in_interval, number
from rescore.metrics.curve_bands import Band, CurveBands, curve_bands
from rescore.results.candidate_file import ALONE
from rescore.results.metrics_file import Ends, Row, TunedWeight

MODE_SHORT = {ALONE: "alone"}
RIGHT_EDGE_FPPI = 20.0
_SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def curve_plots(story: Story) -> dict[str, CurvePlots]:
    """The plots of the curves, by detector."""
    metrics, left = story.run.metrics, left_edge(story.run.metrics)
    sets = curve_sets(story.run)
    bands = {
        (c.detector, c.mode): curve_bands(
            story.tables[c.detector, c.mode], _cars_of_image(story, c.detector), metrics.seed
        )
        for c in sets
    }
    cars = f"share of all {metrics.n_cars} cars found"
    decades = tuple(10.0**k for k in range(-3, 2) if left <= 10.0**k <= RIGHT_EDGE_FPPI)
    share, found = Axis("share of the hits accepted", 0, 1, _SHARES), Axis(cars, 0, 1, _SHARES)
    false = Axis("share of the false candidates accepted", 0, 1, _SHARES)
    rate = Axis("false positives an image (log; left edge: none)", left, RIGHT_EDGE_FPPI, decades, log=True)
    precise = Axis("share of the accepted that are hits", 0, 1, _SHARES)

    def plot(
        kind: str,
        title: str,
        axes: tuple[Axis, Axis],
        detector: str,
        points: Callable[[CurveSet], tuple[FloatArray, FloatArray]],
        band: Callable[[CurveBands], Band],
        figure: Callable[[Row], str],
        steps: bool = False,
    ) -> Plot:
        lines = tuple(
            Line(
                c.mode,
                f"{MODE_SHORT.get(c.mode, c.mode)}: {figure(c.row)}",
                *points(c),
                mode_colour(c.mode),
                c.mode == ALONE,
                steps,
                None if (own := bands[c.detector, c.mode]) is None else band(own),
            )
            for c in sets
            if c.detector == detector
        )
        name = f"{detector_name(detector, short=True)}: {title}"
        hidden = tuple(line.name for line in lines if line.name not in (ALONE, story.mode_of(detector)))
        return Plot(f"curves/{part(detector)}/{kind}", name, *axes, lines, hidden)

    return {
        d: CurvePlots(
            candidate=plot(
                *("candidate_roc", "candidate ROC", (false, share), d),
                lambda c: (c.candidate.x, c.candidate.y),
                lambda b: b.candidate,
                _area,
            ),
            cars=plot(
                *("car_roc", "cars found, false positives", (rate, found), d),
                lambda c: (c.cars.x, c.cars.y),
                lambda b: b.cars,
                _precision,
                steps=True,
            ),
            precision=plot(
                *("precision_recall", "precision and recall", (found, precise), d),
                lambda c: (c.precision.recall, c.precision.precision),
                lambda b: b.precision,
                _precision,
            ),
        )
        for d in story.run.detectors
    }


def weight_plots(story: Story) -> tuple[Plot, ...]:
    """The objective over w on the validation set, a plot a detector; none where w was not tuned."""
    plots = []
    for detector, tuned in story.run.metrics.tuning.items():
        modes: Mapping[str, TunedWeight] = tuned.modes or {story.mode_of(detector): tuned}
        values = np.concatenate([np.array(t.objective, float) for t in modes.values()])
        low, high = np.floor(np.nanmin(values) * 10) / 10, np.ceil(np.nanmax(values) * 10 + 1e-9) / 10
        ticks = tuple(float(v) for v in np.linspace(low, high, round((high - low) * 10) + 1).round(1))
        ticks = ticks if len(ticks) <= 6 else ticks[::2]
        plots.append(
            Plot(
                f"curves/{part(detector)}/weight",
                f"{detector_name(detector, short=True)}: choice of w",
                Axis("w: 0 depth alone, 1 detector alone (broad: 95 % interval)", 0, 1, _SHARES),
                Axis(f"{tuned.objective_name.replace('_', ' ')} on the validation set", low, high, ticks),
                tuple(_weight_line(mode, t) for mode, t in modes.items()),
            )
        )
    return tuple(plots)


def _weight_line(mode: str, tuned: TunedWeight) -> Line:
    w, value = np.array(tuned.w_grid, float), np.array(tuned.objective, float)
    known = np.isfinite(value)
    thick = None
    if tuned.uncertainty is not None:
        inside = np.array(in_interval(tuned)) & known
        thick = (w[inside], value[inside])
    legend = f"{mode}: w = {tuned.w:.2f}"
    return Line(mode, legend, w[known], value[known], mode_colour(mode), thick=thick)


def _area(row: Row) -> str:
    return f"area {_figure(row.auc, None if row.intervals is None else row.intervals.auc)}"


def _precision(row: Row) -> str:
    ends = None if row.intervals is None else row.intervals.average_precision
    return f"AP {_figure(row.average_precision, ends)}"


def _figure(value: float | None, ends: Ends | None) -> str:
    """A figure of a row with its interval."""
    interval = "" if not ends or None in ends else f" ({number(ends[0], 2)}–{number(ends[1], 2)})"
    return f"{number(value)}{interval}"


def _cars_of_image(story: Story, detector: str) -> IntArray:
    """Annotated cars of each image in the order of the match table: those with candidates first, by id."""
    counts = {i: int((~t.ignore).sum()) for i, t in story.data.truth.items()}
    with_some = np.unique(story.run.of(detector)["image_id"]).tolist()
    others = [i for i in counts if i not in set(with_some)]
    return np.array([counts[i] for i in (*with_some, *others)], dtype=np.int64)
