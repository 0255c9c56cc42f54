"""GentleBoost on regression stumps (Friedman, Hastie and Tibshirani, 2000)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray
from recon.errors import RescoreError


@dataclass(frozen=True, eq=False)
class Stumps:
    """Regression stumps; each adds ``above`` where its feature exceeds the threshold, else ``below``."""

    feature: IntArray
    """Shape (m,): column of the feature matrix."""
    threshold: Float32Array
    """Shape (m,)."""
    below: Float32Array
    """Shape (m,)."""
    above: Float32Array
    """Shape (m,)."""

    def __post_init__(self) -> None:
        shape = self.feature.shape
        if len(shape) != 1 or not (self.threshold.shape == self.below.shape == self.above.shape == shape):
            raise ValueError("stumps: feature, threshold, below and above must have one length")

    def __len__(self) -> int:
        return len(self.feature)

    def score(self, features: Float32Array) -> Float32Array:
        """Scores of features (f, ...), shape (...); positive where a car is likelier than not."""
        total = np.full(features.shape[1:], self.below.sum(dtype=np.float32), np.float32)
        for k, threshold, step in zip(self.feature, self.threshold, self.above - self.below, strict=True):
            total += step * (features[k] > threshold)
        return total

    def used(self) -> IntArray:
        """The columns that some stump reads, ascending."""
        return np.unique(self.feature)

    def renumbered(self, used: IntArray) -> "Stumps":
        """The stumps with column numbers for a matrix that holds only the ``used`` columns."""
        return Stumps(np.searchsorted(used, self.feature), self.threshold, self.below, self.above)


@dataclass(frozen=True)
class BoostConfig:
    """How many stumps, and where each looks for its feature."""

    rounds: int = 120
    """Number of stumps."""
    features_per_round: int = 200
    """Features tried in a round, drawn at random; more is slower and hardly better."""


@dataclass(frozen=True, eq=False)
class SortedFeatures:
    """Feature values sorted once: every round of boosting reads them."""

    order: NDArray[np.int32]
    """Shape (f, n): samples of each feature, ascending values."""
    value: Float32Array
    """Shape (f, n): the values in that order."""

    @staticmethod
    def of(features: Float32Array) -> "SortedFeatures":
        """Sort features (f, n)."""
        order = np.argsort(features, axis=1, kind="stable").astype(np.int32)
        return SortedFeatures(order, np.take_along_axis(features, order, axis=1))


def fit_stump(
    sorted_features: SortedFeatures, columns: IntArray, target: FloatArray, weight: FloatArray
) -> tuple[int, float, float, float]:
    """The stump (feature, threshold, below, above) of least weighted squared error among ``columns``.

    For a split, the best constants are the weighted means of ``target`` (n,) on either side, and the error
    is sum w z^2 - (sum w z)^2 / sum w of the left - the same of the right. Cumulative sums over the sorted
    samples give it for every split of every feature at once. Thresholds lie midway between two values.
    """
    order = sorted_features.order[columns]
    value = sorted_features.value[columns]
    weight_left = np.cumsum(weight[order], axis=1)[:, :-1]
    target_left = np.cumsum((weight * target)[order], axis=1)[:, :-1]
    weight_all, target_all = weight.sum(), (weight * target).sum()
    weight_right = weight_all - weight_left
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = target_left**2 / weight_left + (target_all - target_left) ** 2 / weight_right
    # samples of one value cannot be parted; no weight on a side is no split
    splits = (value[:, 1:] > value[:, :-1]) & (weight_left > 0) & (weight_right > 1e-12 * weight_all)
    gain = np.where(splits, gain, -np.inf)
    row, at = np.unravel_index(int(np.argmax(gain)), gain.shape)
    if not np.isfinite(gain[row, at]):
        mean = float(target_all / weight_all)
        return int(columns[0]), float(value[0, -1]), mean, mean
    below = target_left[row, at] / weight_left[row, at]
    above = (target_all - target_left[row, at]) / weight_right[row, at]
    return int(columns[row]), _between(value[row, at], value[row, at + 1]), float(below), float(above)


def _between(low: np.float32, high: np.float32) -> float:
    middle = np.float32((float(low) + float(high)) / 2)
    # neighbouring float32 numbers have nothing between them; "above" means strictly greater
    return float(low if middle >= high else middle)


def gentle_boost(
    features: Float32Array, is_car: BoolArray, config: BoostConfig, rng: np.random.Generator
) -> Stumps:
    """Stumps fitted to features (f, n) and labels (n,).

    Each round fits a stump to the labels -1 and 1 under the weights exp(-label * score). Cars and street
    start with equal total weight, whatever their numbers.

    Raises:
        RescoreError: one of the two classes is empty.
    """
    n_cars = int(is_car.sum())
    if not 0 < n_cars < len(is_car):
        raise RescoreError(
            f"training: expected crops of cars and of street, got {n_cars} cars of {len(is_car)} crops; "
            "add training frames"
        )
    label = np.where(is_car, 1.0, -1.0)
    weight = np.where(is_car, 0.5 / n_cars, 0.5 / (len(is_car) - n_cars))
    sorted_features = SortedFeatures.of(features)
    tried = min(config.features_per_round, len(features))
    chosen: list[tuple[int, float, float, float]] = []
    for _ in range(config.rounds):
        columns = np.sort(rng.choice(len(features), tried, replace=False))
        stump = fit_stump(sorted_features, columns, label, weight)
        chosen.append(stump)
        k, threshold, below, above = stump
        weight *= np.exp(-label * np.where(features[k] > np.float32(threshold), above, below))
        weight /= weight.sum()
    k_all, threshold_all, below_all, above_all = (np.array(x) for x in zip(*chosen, strict=True))
    return Stumps(
        k_all.astype(np.int64), *(x.astype(np.float32) for x in (threshold_all, below_all, above_all))
    )
