"""The weight w of eq. 7, chosen for one detector on the validation set alone."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from recon.arrays import FloatArray, IntArray
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.data.splits import Splits, ValidationSet
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import CLASS_MODEL, Registration
from rescore.fusion.fuse import LearnedFusion, fit_fusion, fuse
from rescore.fusion.weight_interval import WeightUncertainty, describe, middle_of_plateau, weight_uncertainty
from rescore.metrics.bootstrap import draw_images
from rescore.metrics.matching import MatchTable, TruthTable, greedy_match, ranking_of
from rescore.metrics.resampled import Weights, average_precisions

Objective = Callable[[MatchTable, IntArray, Weights], FloatArray]
"""What w is chosen by: from a match table, the cars of each image (n_images,) and weights of images
(r, n_images) to one figure for each row of weights, shape (r,). Larger is better; NaN where undefined."""


OBJECTIVES: dict[str, Objective] = {"average_precision": average_precisions}
"""The objectives by the name that settings and files of results use. Average precision counts missed cars and
weighs the top of the ranking, where a detector is used."""


@dataclass(frozen=True)
class TuneConfig:
    """How w is chosen."""

    objective: str = "average_precision"
    """A name of ``OBJECTIVES``."""
    n_grid: int = 101
    """Number of weights w that are tried, 0 to 1 in even steps."""
    min_iou: float = 0.5
    """Overlap from which a candidate counts as having found a car."""
    n_resamples: int = 1000
    """Resamples of the validation images for the interval of w."""

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise RescoreError(
                f"tune: expected objective {' or '.join(OBJECTIVES)}, got {self.objective!r}; choose one"
            )
        if self.n_grid < 2:
            raise RescoreError(f"tune: expected n_grid of at least 2, got {self.n_grid}; 101 is usual")
        if not 0 < self.min_iou <= 1:
            raise RescoreError(f"tune: expected min_iou in (0, 1], got {self.min_iou:g}; 0.5 is usual")
        if self.n_resamples < 100:
            raise RescoreError(
                f"tune: expected n_resamples of at least 100, got {self.n_resamples}; 1000 is usual"
            )


@dataclass(frozen=True, eq=False)
class Tuning:
    """The chosen weight with the whole curve it was chosen from."""

    detector: str
    w: float
    grid: FloatArray
    """All weights w that were tried, rising, shape (n_grid,)."""
    value: FloatArray
    """The objective at each, shape (n_grid,)."""
    n_images: int
    """Size of the validation set."""
    n_cars: int
    registration: Registration = Registration.PAPER
    """Mode that D comes from."""
    objective: str = "average_precision"
    """Name of the objective."""
    uncertainty: WeightUncertainty | None = None
    """How well the validation set determines w; None where that was not asked for, or of fewer than two
    images."""
    learned: LearnedFusion | None = None
    """A fusion with free weights, fitted on the validation set too, for comparison with eq. 7."""
    depth_of: str = CLASS_MODEL
    """Name of what predicted the depth that w was chosen with
    (``rescore.evidence.predicted_depth_files.PredictionFolder.depth_of``)."""

    @property
    def sentence(self) -> str:
        """What the validation set can tell of w, in one sentence; "" where that is unknown."""
        return "" if self.uncertainty is None else describe(self.grid, self.w, self.uncertainty)


def tune_weight(
    detector: str,
    table: CandidateTable,
    validation: ValidationSet,
    config: TuneConfig,
    rng: np.random.Generator | None = None,
) -> Tuning:
    """The w of eq. 7 for the best objective on the validation set.

    A small validation set does not tell many w apart, and the very best of them is chance. So the middle of
    those within one standard error of the best is taken (``WeightUncertainty.plateau``); without ``rng``,
    the best itself, or the middle of the longest run of equal ones.

    Args:
        detector: its name.
        table: its candidates with D on the validation set.
        validation: the images.
        config: settings.
        rng: draws images for the standard error and the interval of w, which are left out without.

    Raises:
        RescoreError: the validation set holds no car.
        ValueError: ``table`` holds a candidate of another image.
    """
    truth = TruthTable.of(validation.data)
    if not truth.n_cars:
        raise RescoreError(
            f"tuning {detector}: expected annotated cars in split 'validation', got none in "
            f"{truth.n_images} images; add some"
        )
    grid = np.linspace(0, 1, config.n_grid)
    weight = np.ones((1, truth.n_images), np.int32)
    if rng is not None and truth.n_images > 1:
        weight = np.concatenate([weight, draw_images(truth.n_images, config.n_resamples, rng)])
    value = objective_on_grid(table, truth, config, weight)
    best = middle_of_plateau(value[:, 0])
    uncertainty = None
    if len(weight) > 1:
        uncertainty = weight_uncertainty(grid, best, value[:, 0], value[:, 1:], truth.n_images)
    return Tuning(
        detector,
        float(grid[best]) if uncertainty is None else uncertainty.w,
        grid,
        value[:, 0],
        truth.n_images,
        truth.n_cars,
        objective=config.objective,
        uncertainty=uncertainty,
    )


def objective_on_grid(
    table: CandidateTable, truth: TruthTable, config: TuneConfig, weight: Weights
) -> FloatArray:
    """The objective at each w of the grid for each set of image weights (r, n_images), shape (n_grid, r).

    NaN where it is undefined.
    """
    matches = [match_at(table, truth, w, config.min_iou) for w in np.linspace(0, 1, config.n_grid).tolist()]
    objective = OBJECTIVES[config.objective]
    return np.stack([objective(m, truth.cars_of_image, weight) for m in matches])


def match_at(table: CandidateTable, truth: TruthTable, w: float, min_iou: float = 0.5) -> MatchTable:
    """The match table of candidates ranked by eq. 7 with weight w; w = 1 is the detector alone."""
    posterior = fuse(table.likelihood, table.depth_difference, w)
    ranking = ranking_of(posterior, table.score)
    return greedy_match(table.image_id, table.xyxy_px, ranking, truth, min_iou)


def tune_on_validation(
    detector: str,
    table: CandidateTable,
    data: DataSet,
    config: TuneConfig,
    registration: Registration,
    seed: int,
) -> Tuning:
    """The weight w for a detector from candidates with D of a mode, on the split "validation" alone.

    With its interval, and the learned fusion that eq. 7 is compared with.
    """
    validation = Splits.of(data).validation_set
    tuning = tune_weight(detector, table, validation, config, np.random.default_rng([seed, 3]))
    learned = fit_fusion(table, validation, config.min_iou)
    return replace(tuning, registration=registration, learned=learned)
