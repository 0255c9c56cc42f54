"""Joint boosting: regression stumps that several view bins share (Torralba, Murphy and Freeman, PAMI 2007).

A stump reads one feature for all bins. The bins that share it add the same two numbers; each other bin adds a
constant of its own, so that a stump can be left to those that it serves.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from recon.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from recon.errors import RescoreError

OF_OTHER_VIEWS = 0.1
"""Share of the weight of a bin that cars of other bins have at first."""


@dataclass(frozen=True, eq=False)
class SharedStumps:
    """Stumps; each adds ``below`` to the score of a bin, and ``step`` too where its feature exceeds
    ``threshold``."""

    feature: IntArray
    """Shape (m,): row of the feature matrix."""
    threshold: Float32Array
    """Shape (m,)."""
    below: Float32Array
    """Shape (m, bins)."""
    step: Float32Array
    """Shape (m, bins): 0 for bins that do not share the stump."""

    def __post_init__(self) -> None:
        m = len(self.feature)
        if (
            self.threshold.shape != (m,)
            or self.below.shape[:1] != (m,)
            or self.step.shape != self.below.shape
        ):
            raise ValueError("stumps: expected as many thresholds and rows of numbers as features")

    def __len__(self) -> int:
        return len(self.feature)

    def score(self, features: Float32Array) -> Float32Array:
        """Scores (bins, ...) of features (f, ...)."""
        exceeds = np.empty((len(self), int(np.prod(features.shape[1:]))), np.float32)
        for i, (k, threshold) in enumerate(zip(self.feature, self.threshold, strict=True)):
            exceeds[i] = (features[k] > threshold).ravel()
        total = self.step.T @ exceeds + self.below.sum(axis=0, dtype=np.float32)[:, None]
        return np.asarray(total.reshape(self.step.shape[1], *features.shape[1:]), np.float32)

    def used(self) -> IntArray:
        """The rows that some stump reads, ascending."""
        return np.unique(self.feature)

    def renumbered(self, used: IntArray) -> "SharedStumps":
        """The stumps with row numbers for a matrix that holds only the ``used`` rows."""
        return SharedStumps(np.searchsorted(used, self.feature), self.threshold, self.below, self.step)

    def shifted(self, offset: FloatArray) -> "SharedStumps":
        """Stumps whose scores are greater by an offset for each bin (bins,)."""
        return replace(self, below=(self.below + offset / len(self)).astype(np.float32))


@dataclass(frozen=True)
class JointBoostConfig:
    """How many stumps, and what each is chosen from."""

    rounds: int = 320
    """Number of stumps."""
    features_per_round: int = 200
    """Features tried in a round, drawn at random."""
    thresholds: int = 12
    """Thresholds tried of a feature: quantiles of its values."""

    def draws(self, n_features: int, rng: np.random.Generator) -> IntArray:
        """The features tried in each round, shape (rounds, tried), ascending in a row."""
        tried = min(self.features_per_round, n_features)
        return np.array(
            [np.sort(rng.choice(n_features, tried, replace=False)) for _ in range(self.rounds)], np.int64
        )


@dataclass(frozen=True, eq=False)
class Steps:
    """Features cut into steps at their thresholds, once for all rounds."""

    threshold: Float32Array
    """Shape (f, t), ascending."""
    sample: Int32Array
    """Shape (f, n): samples of each feature, lowest step first."""
    count: Int32Array
    """Shape (f, t + 1): samples of each step; the last exceed all thresholds."""

    @staticmethod
    def of(features: Float32Array, thresholds: int) -> "Steps":
        """The steps of features (f, n)."""
        shares = np.arange(1, thresholds + 1) / (thresholds + 1)
        threshold = np.quantile(features, shares, axis=1).T.astype(np.float32)
        step = np.stack(
            [np.searchsorted(t, x, side="left") for t, x in zip(threshold, features, strict=True)]
        )
        sample = np.argsort(step, axis=1, kind="stable").astype(np.int32)
        count = np.stack([np.bincount(s, minlength=thresholds + 1) for s in step]).astype(np.int32)
        return Steps(threshold, sample, count)

    def among(self, chosen: BoolArray) -> "Steps":
        """Steps of the chosen samples (n,) alone, which are numbered anew."""
        kept = chosen[self.sample]
        number = np.cumsum(chosen, dtype=np.int32) - np.int32(1)
        sample = number[self.sample[kept]].reshape(len(kept), -1)
        until = np.concatenate([np.zeros((len(kept), 1), int), np.cumsum(kept, axis=1)], axis=1)
        at_ends = np.take_along_axis(until, np.cumsum(self.count, axis=1), axis=1)
        return Steps(self.threshold, sample, np.diff(at_ends, axis=1, prepend=0).astype(np.int32))

    def sums_above(self, rows: IntArray, values: FloatArray) -> FloatArray:
        """Sums (k, t, v) of values (n, v), over the samples that exceed each threshold of features (k,)."""
        count = self.count[rows]
        starts = np.concatenate([[0], np.cumsum(count.ravel())])
        ones = np.ones(count.sum())
        table = csr_array((ones, self.sample[rows].ravel(), starts), shape=(count.size, len(values)))
        sums = (table @ values).reshape(*count.shape, values.shape[1])
        return np.asarray(np.cumsum(sums[:, ::-1], axis=1)[:, ::-1][:, 1:])


def joint_boost(features: Float32Array, label: IntArray, tries: IntArray, thresholds: int) -> SharedStumps:
    """Stumps fitted to features (f, n) and labels (n, bins) of 1, -1, and 0 for what says nothing of a bin.

    ``tries`` (rounds, tried) are the features that each round chooses from, see ``JointBoostConfig.draws``.
    Each round fits a stump to the labels under the weights exp(-label * score). In each bin three groups
    start with total weights of their own, whatever their numbers: its cars, street, and cars of other bins.
    These have little, or stumps would part views rather than cars and street, and serve few bins.

    Raises:
        RescoreError: a bin has no example of a car, or nothing else.
    """
    cars, others = (label == 1).sum(axis=0), (label == -1).sum(axis=0)
    if not (cars.all() and others.all()):
        raise RescoreError(
            f"training: expected crops of cars and of street for each bin, got {cars.tolist()} of cars and "
            f"{others.tolist()} of street; add training frames"
        )
    weight = _balanced(label)
    steps = Steps.of(features, thresholds)
    of_cars = steps.among((label == 1).any(axis=1))
    feature, threshold, below, step = [], [], [], []
    for rows in tries:
        k, t, low, high = best_shared_stump(steps, of_cars, rows, label, weight)
        feature.append(k)
        threshold.append(steps.threshold[k, t])
        below.append(low)
        step.append(high - low)
        exceeds = features[k] > steps.threshold[k, t]
        weight *= np.exp(-label * np.where(exceeds[:, None], high, low))
        weight /= weight.sum()
    as_float = (np.asarray(v, np.float32) for v in (threshold, below, step))
    return SharedStumps(np.array(feature, np.int64), *as_float)


def _balanced(label: IntArray) -> FloatArray:
    elsewhere = (label == -1) & (label == 1).any(axis=1)[:, None]
    street = (label == -1) & ~elsewhere
    weight = np.zeros(label.shape)
    for group, total in ((label == 1, 0.5), (street, 0.5 - OF_OTHER_VIEWS), (elsewhere, OF_OTHER_VIEWS)):
        weight += group * (total / np.maximum(group.sum(axis=0), 1))
    return np.asarray(weight / weight.sum())


def best_shared_stump(
    steps: Steps, of_cars: Steps, rows: IntArray, label: IntArray, weight: FloatArray
) -> tuple[int, int, FloatArray, FloatArray]:
    """The feature, the number of its threshold, and what bins (bins,) get below and above it.

    The weighted squared error is a constant less the sum, over groups that get one number, of (sum w z)^2 /
    sum w. For each threshold, bins join those that share one by one, each time the one that lowers the error
    most (the greedy search of the paper); the best of all is kept. Weights (n, bins) are 0 where labels are;
    ``of_cars`` are the steps of the samples that are cars of some bin.
    """
    is_car = label == 1
    w_above = steps.sums_above(rows, weight).reshape(-1, label.shape[1])
    # few samples are cars, and all others have the label -1 where they have weight
    w_of_cars = of_cars.sums_above(rows, (weight * is_car)[is_car.any(axis=1)]).reshape(w_above.shape)
    z_above = 2 * w_of_cars - w_above
    w_all, z_all = weight.sum(axis=0), (weight * label).sum(axis=0)
    sides = np.stack([w_above, z_above, w_all - w_above, z_all - z_above])
    chosen, shares = _best_threshold(sides, z_all**2 / w_all)
    above, below = (
        float(z[chosen, shares].sum() / max(w[chosen, shares].sum(), 1e-300))
        for w, z in (sides[:2], sides[2:])
    )
    constant = z_all / w_all
    row, t = divmod(chosen, steps.threshold.shape[1])
    return int(rows[row]), t, np.where(shares, below, constant), np.where(shares, above, constant)


FIRST = 64
"""Thresholds that are searched before the bound is known that spares the others."""


def _best_threshold(sides: FloatArray, alone: FloatArray) -> tuple[int, BoolArray]:
    """The place of the threshold with the greatest gain, and the bins (bins,) that share it.

    ``sides`` (4, m, bins) are weights and weighted labels above and below each threshold, ``alone`` (bins,)
    the gain of each bin without a stump. No sharing gains more than bins do that have numbers of their own,
    so the search is spared where even that is less than what another threshold gains.
    """
    w_above, z_above, w_below, z_below = sides
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.nan_to_num(z_above**2 / w_above) + np.nan_to_num(z_below**2 / w_below)
    bound = np.maximum(bound, alone).sum(axis=1)
    first = bound >= np.partition(bound, -min(FIRST, len(bound)))[-min(FIRST, len(bound))]
    gain, shares = np.full(len(bound), -np.inf), np.zeros(sides.shape[1:], bool)
    gain[first], shares[first] = _greedy(sides[:, first], alone)
    # rounding may put the bound a little below the gain
    rest = ~first & (bound >= gain.max() - 1e-9)
    gain[rest], shares[rest] = _greedy(sides[:, rest], alone)
    best = int(np.argmax(gain))
    return best, shares[best]


def _greedy(sides: FloatArray, alone: FloatArray) -> tuple[FloatArray, BoolArray]:
    """The greatest gain at each threshold, shape (m,), and the bins that share it, shape (m, bins)."""
    shape = sides.shape[1:]
    shares, best_shares = np.zeros(shape, bool), np.zeros(shape, bool)
    sums = np.zeros((4, shape[0], 1))
    left, best = np.full((shape[0], 1), alone.sum()), np.full(shape[0], -np.inf)
    for _ in range(shape[1]):
        wa, za, wb, zb = sums + sides
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = za**2 / wa + zb**2 / wb + left - alone
        # a side without weight parts nothing
        gain = np.where(shares | ~np.isfinite(gain), -np.inf, gain)
        joins = gain.argmax(axis=1)[:, None]
        value = np.take_along_axis(gain, joins, axis=1)
        if not np.isfinite(value).any():
            break
        np.put_along_axis(shares, joins, True, axis=1)
        sums += np.take_along_axis(sides, np.broadcast_to(joins, (4, *joins.shape)), axis=2)
        left = left - alone[joins]
        better = value[:, 0] > best
        best = np.where(better, value[:, 0], best)
        best_shares = np.where(better[:, None], shares, best_shares)
    return best, best_shares
