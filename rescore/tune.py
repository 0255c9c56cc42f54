"""The weight w of eq. 7, chosen for one detector on the validation set alone."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from recon.errors import RescoreError
from rescore.cues import Registration
from rescore.evidence import CandidateTable
from rescore.frames import ValidationSet
from rescore.fuse import fuse
from rescore.matching import MatchTable, TruthTable, greedy_match, ranking_of
from rescore.metrics import area_under_recall, area_under_roc, average_precision, candidate_roc, recall_curve

FloatArray = NDArray[np.float64]


class Objective(StrEnum):
    """What w makes as large as it can."""

    AVERAGE_PRECISION = "average_precision"
    """The default: it counts missed cars and weighs the top of the ranking, where a detector is used."""
    AREA = "area"
    """Area under the candidate ROC."""
    FPPI_AREA = "fppi_area"
    """Mean true-positive rate over the first false positives per image."""


@dataclass(frozen=True)
class TuneConfig:
    """How w is chosen."""

    objective: Objective = Objective.AVERAGE_PRECISION
    n_grid: int = 101
    """w = 0, 1 / (n - 1), ..., 1."""
    min_iou: float = 0.5
    """Overlap from which a candidate counts as having found a car."""

    def __post_init__(self) -> None:
        if self.n_grid < 2:
            raise RescoreError(f"tune: expected n_grid of at least 2, got {self.n_grid}; 101 is usual")
        if not 0 < self.min_iou <= 1:
            raise RescoreError(f"tune: expected min_iou in (0, 1], got {self.min_iou:g}; 0.5 is usual")


@dataclass(frozen=True, eq=False)
class Tuning:
    """The chosen weight with the whole curve it was chosen from."""

    detector: str
    w: float
    objective: Objective
    grid: FloatArray
    """Every w tried, shape (n_grid,)."""
    value: FloatArray
    """The objective at each, shape (n_grid,)."""
    n_images: int
    """Size of the validation set."""
    n_cars: int
    registration: Registration = Registration.PAPER
    """Mode that D comes from."""


def tune_weight(
    detector: str, table: CandidateTable, validation: ValidationSet, config: TuneConfig
) -> Tuning:
    """The w on the grid with the largest objective on the validation set.

    Many w rank a small validation set alike, so the largest value is often a plateau: then the middle of its
    longest run is taken (of two middles, and of two runs of one length, the larger w, nearer to the
    detector).

    Raises:
        RescoreError: the validation set holds no car, or the objective is undefined on it.
        ValueError: ``table`` holds a candidate of another image.
    """
    truth = TruthTable.of(validation.data)
    if not truth.n_cars:
        raise RescoreError(
            f"tuning {detector}: expected annotated cars in split 'validation', got none in "
            f"{truth.n_images} images; add some"
        )
    grid = np.linspace(0, 1, config.n_grid)
    value = np.array([_objective(table, truth, float(w), config) for w in grid])
    if not np.isfinite(value).any():
        raise RescoreError(
            f"tuning {detector}: expected both hits and false alarms on the validation set for objective "
            f"{config.objective.value!r}, got one kind only; use average_precision or a larger set"
        )
    w = float(grid[middle_of_plateau(value)])
    return Tuning(detector, w, config.objective, grid, value, truth.n_images, truth.n_cars)


def middle_of_plateau(value: FloatArray) -> int:
    """Index of the middle of the longest run of the largest value (see ``tune_weight`` for ties)."""
    best = value >= np.nanmax(value) - 1e-12
    edges = np.flatnonzero(np.diff(np.concatenate([[False], best, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2]
    longest = len(starts) - 1 - int(np.argmax((ends - starts)[::-1]))
    return int(starts[longest] + ends[longest]) // 2


def match_at(table: CandidateTable, truth: TruthTable, w: float, min_iou: float = 0.5) -> MatchTable:
    """The match table of candidates ranked by eq. 7 with weight w; w = 1 is the detector alone."""
    posterior = fuse(table.likelihood, table.depth_difference, w)
    ranking = ranking_of(posterior, table.score)
    return greedy_match(table.image_id, table.xyxy_px, ranking, truth, min_iou)


def _objective(table: CandidateTable, truth: TruthTable, w: float, config: TuneConfig) -> float:
    match = match_at(table, truth, w, config.min_iou)
    if config.objective is Objective.AREA:
        return area_under_roc(candidate_roc(match))
    if config.objective is Objective.FPPI_AREA:
        return area_under_recall(recall_curve(match))
    return average_precision(match)
