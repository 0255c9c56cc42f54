"""The curves of a run: their points, by rescore.metrics on the run's match table, and the charts they make.

Titles, axes and lines are said here once; the painters that ``reports.charts`` names draw them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from reports.charts import Axis, Chart, Line, Look
from reports.palette import detector_name, mode_name
from reports.run.tables import number, weight_text
from rescore.metrics.curve_bands import Band, CurveBands
from rescore.metrics.curves import Curve, candidate_roc, recall_curve
from rescore.metrics.matching import MatchTable
from rescore.results import candidate_file
from rescore.results.candidate_file import ALONE, score_column
from rescore.results.metrics_file import Metrics, ReliabilityRow, Row, TunedWeight
from rescore.results.run_folder import Run


@dataclass(frozen=True, eq=False)
class PrecisionRecall:
    """Precision at every point of the recall curve but its first, where nothing is accepted."""

    recall: FloatArray
    """Share of all cars that are found, shape (t,)."""
    precision: FloatArray
    """Share of the accepted candidates that are hits, shape (t,)."""
    threshold: FloatArray
    """Score of the worst candidate that is accepted, shape (t,)."""


@dataclass(frozen=True, eq=False)
class CurveSet:
    """All curves of one detector in one mode. Thresholds are scores: l, or the posterior."""

    detector: str
    mode: str
    w: float | None
    """Weight of eq. 7; None where it is not known."""
    candidate: Curve
    """x: share of the false candidates kept; y: share of the hits kept."""
    cars: Curve
    """x: false positives an image; y: share of all annotated cars found."""
    precision: PrecisionRecall
    row: Row
    """Row of metrics.json of the detector and mode."""

    @property
    def name(self) -> str:
        """Name for people."""
        return f"{detector_name(self.detector)}, {mode_name(self.mode)}"


def match_table(run: Run, detector: str, mode: str) -> MatchTable:
    """The match table of one detector and mode, from candidates.parquet."""
    return candidate_file.match_table(run.of(detector), mode, run.metrics.n_images, run.metrics.n_cars)


def scores(run: Run, detector: str, mode: str) -> FloatArray:
    """Score in [0, 1] of every candidate of a detector: l, or the posterior of the mode."""
    return np.asarray(run.of(detector)[score_column(mode)], dtype=float)


def curve_sets(run: Run) -> tuple[CurveSet, ...]:
    """The curves of every row of metrics.json, in its order."""
    return tuple(_curve_set(run, row) for row in run.metrics.rows)


def _curve_set(run: Run, row: Row) -> CurveSet:
    detector, mode = row.detector, row.mode
    match = match_table(run, detector, mode)
    score_of = dict(zip(match.ranking.tolist(), scores(run, detector, mode).tolist(), strict=True))

    def named(curve: Curve) -> Curve:
        threshold = np.array([score_of.get(t, np.inf) for t in curve.threshold.tolist()])
        return Curve(curve.x, curve.y, threshold)

    cars = named(recall_curve(match))
    hits, false = cars.y[1:] * match.n_cars, cars.x[1:] * match.n_images
    precision = PrecisionRecall(cars.y[1:], hits / (hits + false), cars.threshold[1:])
    return CurveSet(detector, mode, row.w, named(candidate_roc(match)), cars, precision, row)


CARS, CANDIDATES, PRECISION = "Cars found", "Candidate ROC", "Precision and recall"
"""The kinds of curves, as a reader chooses among them."""
RIGHT_EDGE_FPPI = 20.0
RIGHT_EDGE_LINEAR_FPPI = 5.0


@dataclass(frozen=True, eq=False)
class DrawnCurves:
    """The curves of one detector and mode with what a chart shows beside them."""

    curves: CurveSet
    name: str
    look: Look
    tags: tuple[str, ...]
    """As in ``Line``."""
    bands: CurveBands | None = None

    @classmethod
    def of_mode(cls, curves: CurveSet, bands: CurveBands | None = None) -> "DrawnCurves":
        """The curves with the name and the look of their mode."""
        return cls(curves, mode_name(curves.mode), Look.of_mode(curves.mode), (curves.mode,), bands)

    def line(self, kind: str, left_fppi: float) -> Line:
        """The line of a kind of chart; the axis of false positives per image begins at ``left_fppi``."""
        c, b, row = self.curves, self.bands, self.curves.row
        area, precision = f"area {number(row.auc)}", f"AP {number(row.average_precision)}"
        common: dict[str, Any] = {"name": self.name, "look": self.look, "tags": self.tags}
        if kind == CANDIDATES:
            roc = c.candidate
            return Line(
                **common, figure=area, x=roc.x, y=roc.y, threshold=roc.threshold, read="last",
                band=None if b is None else _band(b.candidate),
            )  # fmt: skip
        if kind == PRECISION:
            pr = c.precision
            return Line(
                **common, figure=precision, x=pr.recall, y=pr.precision, threshold=pr.threshold, read="first",
                band=None if b is None else _band(b.precision),
            )  # fmt: skip
        band = None if b is None else Band(np.maximum(b.cars.x, left_fppi), b.cars.low, b.cars.high)
        return Line(
            **common, figure=precision, x=c.cars.x, y=c.cars.y, threshold=c.cars.threshold, read="last",
            band=None if band is None else _band(band), step=True,
            ceiling=row.recall_ceiling if c.mode == ALONE else None,
        )  # fmt: skip


def curve_charts(drawn: Sequence[DrawnCurves], metrics: Sequence[Metrics]) -> dict[str, dict[str, Chart]]:
    """The three kinds of charts of some curves, by kind and by detector.

    Args:
        drawn: the curves.
        metrics: the figures of every run they come from.
    """
    left = min(left_edge(m) for m in metrics)
    cars, images = count_text(m.n_cars for m in metrics), count_text(m.n_images for m in metrics)
    candidates = count_text(m.n_candidates for m in metrics)
    found = f"share of all {cars}annotated cars found"
    axes = {
        CARS: (
            Axis(
                "false positives per image", left, RIGHT_EDGE_FPPI, log=True,
                linear_high=RIGHT_EDGE_LINEAR_FPPI, edge="none",
            ),
            _share(found, "cars found"),
        ),
        CANDIDATES: (
            _share("share of the false candidates accepted"),
            _share("share of the hits accepted", "hits accepted"),
        ),
        PRECISION: (_share(f"recall: {found}"), _share("precision: hits among the accepted", "precision")),
    }  # fmt: skip
    keys = {CARS: "dotted: all candidates accepted", CANDIDATES: f"{candidates}candidates of {images}images"}
    charts: dict[str, dict[str, Chart]] = {kind: {} for kind in axes}
    for detector in dict.fromkeys(d.curves.detector for d in drawn):
        title = detector_name(detector)
        for kind, (x, y) in axes.items():
            lines = tuple(d.line(kind, left) for d in drawn if d.curves.detector == detector)
            alt, diagonal = alt_text(f"{kind}, {title}", lines), "chance" if kind == CANDIDATES else ""
            charts[kind][detector] = Chart(title, alt, x, y, lines, diagonal, keys.get(kind, ""))
    return charts


def weight_chart(title: str, alt: str, lines: Sequence[Line], objective: str) -> Chart:
    """The objective over w on the validation set."""
    values = np.array([v for line in lines for v in np.asarray(line.y, float) if np.isfinite(v)])
    room = 0.06 * float(np.ptp(values)) + 1e-3
    low, high = float(values.min()) - room, float(values.max()) + room
    return Chart(
        title,
        alt_text(alt, lines),
        Axis("w: 0 trusts the depth alone, 1 the detector alone", 0.0, 1.0),
        Axis(f"{objective.replace('_', ' ')} on the validation set", low, high, digits=3),
        tuple(lines),
        key="broad line: interval of 95 % of w" if any(line.broad for line in lines) else "",
    )


def weight_line(name: str, look: Look, tags: tuple[str, ...], tuned: TunedWeight) -> Line:
    """The objective over w of one tuning, with the chosen w marked."""
    w, value = np.array(tuned.w_grid, float), np.array(tuned.objective, float)
    u = tuned.uncertainty
    chosen = int(np.argmin(np.abs(w - tuned.w)))
    return Line(
        name,
        f"w = {weight_text(tuned)}",
        look,
        w,
        value,
        tags,
        broad=None if u is None else (u.low, u.high),
        mark=(float(w[chosen]), float(value[chosen])),
    )


def reliability_charts(shown: Sequence[ReliabilityRow]) -> dict[str, Chart]:
    """The share of hits over score in groups of candidates, by detector."""
    charts = {}
    for detector in dict.fromkeys(r.detector for r in shown):
        title = detector_name(detector)
        lines = tuple(_reliability_line(r) for r in shown if r.detector == detector)
        charts[detector] = Chart(
            title,
            alt_text(f"Share of hits over score, {title}", lines),
            Axis("mean score of a group of candidates", 0.0, 1.0, digits=3),
            Axis("share of hits in the group", 0.0, 1.0, percent=True),
            lines,
            diagonal="as it should be",
        )
    return charts


def _reliability_line(r: ReliabilityRow) -> Line:
    rate = np.array(r.hit_rate, float)
    return Line(
        mode_name(r.mode),
        f"Brier {number(r.brier_score)}",
        Look.of_mode(r.mode),
        np.array(r.likelihood, float),
        rate,
        (r.mode,),
        text=tuple(f"{v:.1%} of {n} are hits" for v, n in zip(rate, r.count, strict=True)),
        markers=True,
        bars={"low": np.array(r.low, float), "high": np.array(r.high, float)},
    )


def left_edge(metrics: Metrics) -> float:
    """Left end of the log axis of false positives per image: half of one false positive in all images."""
    return 0.5 / max(metrics.n_images, 1)


def count_text(of_runs: Iterable[int]) -> str:
    """A number and a space where all runs have the same one, else nothing."""
    values = set(of_runs)
    return f"{values.pop()} " if len(values) == 1 else ""


def alt_text(what: str, lines: Sequence[Line]) -> str:
    """What a chart shows and the figure of each of its lines, for those who do not see it."""
    return f"{what}. " + "; ".join(f"{line.name}: {line.figure}" for line in lines)


def _share(label: str, short: str = "") -> Axis:
    return Axis(label, 0.0, 1.0, percent=True, short=short)


def _band(band: Band) -> dict[str, FloatArray]:
    return {"x": band.x, "low": band.low, "high": band.high}
