"""The curves of a run, as arrays that every picture draws: rescore.metrics on the run's match table."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from reports.palette import detector_name, mode_name
from rescore.metrics.curves import Curve, candidate_roc, recall_curve
from rescore.metrics.matching import MatchTable
from rescore.results import candidate_file as candidate_columns
from rescore.results.candidate_file import score_column
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
    row: dict[str, Any]
    """Row of metrics.json of the detector and mode."""

    @property
    def name(self) -> str:
        """Name for people."""
        return f"{detector_name(self.detector)}, {mode_name(self.mode)}"


def match_table(run: Run, detector: str, mode: str) -> MatchTable:
    """The match table of one detector and mode, from candidates.parquet."""
    n_images, n_cars = int(run.metrics["n_images"]), int(run.metrics["n_cars"])
    return candidate_columns.match_table(run.of(detector), mode, n_images, n_cars)


def scores(run: Run, detector: str, mode: str) -> FloatArray:
    """Score in [0, 1] of every candidate of a detector: l, or the posterior of the mode."""
    return np.asarray(run.of(detector)[score_column(mode)], dtype=float)


def curve_sets(run: Run) -> tuple[CurveSet, ...]:
    """The curves of every row of metrics.json, in its order."""
    return tuple(_curve_set(run, str(row["detector"]), str(row["mode"])) for row in run.metrics["rows"])


def _curve_set(run: Run, detector: str, mode: str) -> CurveSet:
    match = match_table(run, detector, mode)
    score_of = dict(zip(match.ranking.tolist(), scores(run, detector, mode).tolist(), strict=True))

    def named(curve: Curve) -> Curve:
        threshold = np.array([score_of.get(t, np.inf) for t in curve.threshold.tolist()])
        return Curve(curve.x, curve.y, threshold)

    cars = named(recall_curve(match))
    hits, false = cars.y[1:] * match.n_cars, cars.x[1:] * match.n_images
    precision = PrecisionRecall(cars.y[1:], hits / (hits + false), cars.threshold[1:])
    row = dict(run.row(detector, mode))
    return CurveSet(detector, mode, row["w"], named(candidate_roc(match)), cars, precision, row)
