"""How wide the choice of w is, by the number of validation images: tuning on subsets of a large set."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from rescore.data.splits import ValidationSet
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import Registration
from rescore.fusion.tune import TuneConfig, objective_on_grid, tune_weight
from rescore.fusion.weight_interval import choices
from rescore.metrics.matching import TruthTable


@dataclass(frozen=True)
class WeightWidth:
    """What tuning on so many images chooses."""

    n_images: int
    low: float
    """2.5 % quantile of the chosen w."""
    lower_quartile: float
    median: float
    upper_quartile: float
    high: float
    """97.5 % quantile of the chosen w."""
    loss: float
    """Mean of what the choices lose on all images against the best w there, in units of the objective."""
    n_undefined: int
    """Subsets that choose no w, since they have no car."""


@dataclass(frozen=True, eq=False)
class WeightStudy:
    """The choice of w for one detector in one mode."""

    detector: str
    registration: Registration
    n_images: int
    """Images that subsets are drawn from."""
    n_cars: int
    n_draws: int
    w: float
    """Weight of the detector chosen on all images."""
    grid: FloatArray
    """Every w tried, shape (n_grid,)."""
    value: FloatArray
    """The objective on all images at each w of ``grid``, shape (n_grid,)."""
    widths: tuple[WeightWidth, ...]
    """Width of w at each size of subset."""


def study_weight(
    detector: str,
    registration: Registration,
    table: CandidateTable,
    validation: ValidationSet,
    sizes: Sequence[int],
    n_draws: int,
    config: TuneConfig,
    rng: np.random.Generator,
) -> WeightStudy:
    """Tune on ``n_draws`` subsets of each size, images drawn with replacement.

    Subsets of as many images as there are repeat images as the bootstrap does; larger ones would say that w
    is narrower than it is.

    Args:
        detector: its name.
        registration: mode that D of ``table`` comes from.
        table: candidates on the validation set, with D.
        validation: the images; never test images, as for every choice of w.
        sizes: images in a subset.
        n_draws: subsets of each size.
        config: how w is chosen.
        rng: draws the images.

    Raises:
        RescoreError: a size is larger than the set, or w cannot be chosen on the whole set.
    """
    truth = TruthTable.of(validation.data)
    if not sizes or min(sizes) < 1 or max(sizes) > truth.n_images:
        raise RescoreError(
            f"weight study: expected sizes from 1 to the {truth.n_images} validation images, got "
            f"{', '.join(map(str, sizes)) or 'none'}; choose others or render more images"
        )
    whole = tune_weight(detector, table, validation, config)
    share = np.full(truth.n_images, 1 / truth.n_images)
    widths = []
    for size in sizes:
        weight = rng.multinomial(size, share, size=n_draws).astype(np.int32)
        sample = objective_on_grid(table, truth, config, weight)
        widths.append(_width(size, whole.grid, whole.value, choices(whole.grid, sample)))
    return WeightStudy(
        detector,
        registration,
        truth.n_images,
        truth.n_cars,
        n_draws,
        whole.w,
        whole.grid,
        whole.value,
        tuple(widths),
    )


def _width(size: int, grid: FloatArray, gain: FloatArray, chosen: FloatArray) -> WeightWidth:
    known = chosen[np.isfinite(chosen)]
    if not len(known):
        raise RescoreError(
            f"weight study: expected a subset of {size} images with a car, got none; choose a larger size"
        )
    shares = (0.025, 0.25, 0.5, 0.75, 0.975)
    low, lower, median, upper, high = np.quantile(known, shares, method="inverted_cdf").tolist()
    at = np.argmin(np.abs(grid[:, None] - known), axis=0)
    loss = float((np.nanmax(gain) - gain[at]).mean())
    return WeightWidth(size, low, lower, median, upper, high, loss, len(chosen) - len(known))
