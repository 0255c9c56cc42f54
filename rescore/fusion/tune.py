"""The weight w of eq. 7, chosen for one detector on the validation set alone."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.data.splits import Splits, ValidationSet
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import CLASS_MODEL, Registration
from rescore.fusion.fuse import SMALLEST, LearnedFusion, fit_fusion, fuse
from rescore.fusion.weight_interval import WeightUncertainty, describe, middle_of_plateau, weight_uncertainty
from rescore.metrics.bootstrap import draw_images
from rescore.metrics.matching import HIT, IGNORED, MatchTable, TruthTable, greedy_match, ranking_of
from rescore.metrics.resampled import Levels, Weights, weighted_figures


class Objective(StrEnum):
    """What w is chosen by."""

    AVERAGE_PRECISION = "average_precision"
    """The default: it counts missed cars and weighs the top of the ranking, where a detector is used."""
    AREA = "area"
    """Area under the candidate ROC."""
    FPPI_AT_RECALL = "fppi_at_recall"
    """False positives an image where the share ``TuneConfig.recall`` of the cars is found, few as can be."""
    LOG_LOSS = "log_loss"
    """Mean of -log of what the posterior gives to what the candidate is, a hit or not; as small as can be.
    Ignored candidates are left out."""

    @property
    def sign(self) -> int:
        """-1 where smaller is better, else 1."""
        return -1 if self in (Objective.FPPI_AT_RECALL, Objective.LOG_LOSS) else 1


@dataclass(frozen=True)
class TuneConfig:
    """How w is chosen."""

    objective: Objective = Objective.AVERAGE_PRECISION
    recall: float = 0.7
    """Where objective ``FPPI_AT_RECALL`` reads false positives off."""
    n_grid: int = 101
    """w = 0, 1 / (n - 1), ..., 1."""
    min_iou: float = 0.5
    """Overlap from which a candidate counts as having found a car."""
    n_resamples: int = 1000
    """Resamples of the validation images for the interval of w."""

    def __post_init__(self) -> None:
        if self.n_grid < 2:
            raise RescoreError(f"tune: expected n_grid of at least 2, got {self.n_grid}; 101 is usual")
        for name, usual in (("min_iou", 0.5), ("recall", 0.7)):
            if not 0 < getattr(self, name) <= 1:
                raise RescoreError(
                    f"tune: expected {name} in (0, 1], got {getattr(self, name):g}; {usual} is usual"
                )
        if self.n_resamples < 100:
            raise RescoreError(
                f"tune: expected n_resamples of at least 100, got {self.n_resamples}; 1000 is usual"
            )


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
    uncertainty: WeightUncertainty | None = None
    """How well the validation set determines w; None where that was not asked for, or of fewer than two
    images."""
    learned: LearnedFusion | None = None
    """A fusion with free weights, fitted on the same set, to hold eq. 7 against."""
    depth_of: str = CLASS_MODEL
    """Whose depth it was chosen with (``rescore.evidence.predicted_files.PredictionFolder.depth_of``)."""

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
    weight = np.ones((1, truth.n_images), np.int32)
    if rng is not None and truth.n_images > 1:
        weight = np.concatenate([weight, draw_images(truth.n_images, config.n_resamples, rng)])
    value = objective_on_grid(table, truth, config, weight)
    _check_defined(detector, value[:, 0], config)
    gain = config.objective.sign * value
    best = middle_of_plateau(gain[:, 0])
    uncertainty = None
    if len(weight) > 1:
        uncertainty = weight_uncertainty(grid, best, gain[:, 0], gain[:, 1:], truth.n_images)
    return Tuning(
        detector,
        float(grid[best]) if uncertainty is None else uncertainty.w,
        config.objective,
        grid,
        value[:, 0],
        truth.n_images,
        truth.n_cars,
        uncertainty=uncertainty,
    )


def objective_on_grid(
    table: CandidateTable, truth: TruthTable, config: TuneConfig, weight: Weights
) -> FloatArray:
    """The objective at each w of the grid for each set of image weights (r, n_images), shape (n_grid, r).

    NaN where it is undefined; infinity for false positives at a recall that is never reached.
    """
    return np.stack(
        [_objective(table, truth, w, config, weight) for w in np.linspace(0, 1, config.n_grid).tolist()]
    )


def match_at(table: CandidateTable, truth: TruthTable, w: float, min_iou: float = 0.5) -> MatchTable:
    """The match table of candidates ranked by eq. 7 with weight w; w = 1 is the detector alone."""
    posterior = fuse(table.likelihood, table.depth_difference, w)
    ranking = ranking_of(posterior, table.score)
    return greedy_match(table.image_id, table.xyxy_px, ranking, truth, min_iou)


def _objective(
    table: CandidateTable, truth: TruthTable, w: float, config: TuneConfig, weight: Weights
) -> FloatArray:
    match = match_at(table, truth, w, config.min_iou)
    if config.objective is Objective.LOG_LOSS:
        return _log_loss(fuse(table.likelihood, table.depth_difference, w), match, weight)
    columns = (Objective.AREA, Objective.AVERAGE_PRECISION, Objective.FPPI_AT_RECALL)
    figures = weighted_figures(match, truth.cars_of_image, weight, Levels((), (config.recall,)))
    return np.asarray(figures[:, columns.index(config.objective)])


def _log_loss(posterior: FloatArray, match: MatchTable, weight: Weights) -> FloatArray:
    """Mean over the candidates of the weighted images, shape (r,); NaN where there is none."""
    counts = match.outcome != IGNORED
    p = np.clip(posterior, SMALLEST, 1 - SMALLEST)
    loss = -np.log(np.where(match.outcome == HIT, p, 1 - p))
    image, n_images = match.image[counts], match.n_images
    total = weight @ np.bincount(image, loss[counts], n_images)
    number = weight @ np.bincount(image, minlength=n_images)
    return np.asarray(np.divide(total, number, out=np.full(len(weight), np.nan), where=number > 0))


def _check_defined(detector: str, value: FloatArray, config: TuneConfig) -> None:
    if np.isfinite(value).any():
        return
    if np.isinf(value).any():
        raise RescoreError(
            f"tuning {detector}: expected a weight at which {config.recall:.0%} of the cars of the "
            "validation set are found, got none; choose a smaller recall"
        )
    raise RescoreError(
        f"tuning {detector}: expected both hits and false alarms on the validation set for objective "
        f"{config.objective.value!r}, got one kind only; use average_precision or a larger set"
    )


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
