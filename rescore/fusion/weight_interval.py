"""How well a validation set determines the weight of eq. 7: by tuning it again on resampled images."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict

from recon.arrays import BoolArray, FloatArray
from rescore.metrics.bootstrap import Kind, interval

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class WeightUncertainty:
    """What resamples of the validation images say of w."""

    w: float
    """Chosen weight of the detector, the middle of the plateau: where the data cannot tell weights apart, the
    one farthest from those that they can tell are worse."""
    low: float
    """Ends of the interval of w: quantiles of the w that resamples choose. A resample without cars chooses no
    w; it widens the interval as if it had chosen 0 or 1."""
    high: float
    standard_error: float
    """Standard error of the best objective, over resamples where it is finite; NaN where there are none."""
    plateau: tuple[float, float]
    """The run of w around the best one whose objective is within one standard error of the best."""
    separable: BoolArray
    """Whether each w of the grid is told from the chosen one, shape (n_grid,): it lies outside the interval,
    and the chosen w has the better objective in all but 2.5 % of the resamples."""
    n_resamples: int
    n_undefined: int
    """Resamples that choose no w."""


def weight_uncertainty(
    grid: FloatArray, best: int, gain: FloatArray, sample: FloatArray, n_images: int
) -> WeightUncertainty:
    """The choice of w, and how uncertain it is.

    Args:
        grid: every w tried, shape (g,).
        best: index of the one with the best objective.
        gain: objective on the validation set, larger is better, shape (g,); NaN or infinite where undefined.
        sample: the same on r resamples, shape (g, r).
        n_images: size of the validation set.
    """
    again = choices(grid, sample)
    ends = interval(np.concatenate([[grid[best]], again]), Kind(0, 1), CONFIDENCE, n_images)
    at_best = sample[best][np.isfinite(sample[best])]
    error = float(at_best.std()) if len(at_best) else float("nan")
    low, high = run_around(gain >= gain[best] - (0.0 if np.isnan(error) else error), best)
    chosen = (low + high + 1) // 2
    outside = (grid < ends.low) | (grid > ends.high)
    return WeightUncertainty(
        float(grid[chosen]),
        ends.low,
        ends.high,
        error,
        (float(grid[low]), float(grid[high])),
        outside & _beaten(sample, chosen),
        sample.shape[1],
        ends.n_undefined,
    )


def choices(grid: FloatArray, sample: FloatArray) -> FloatArray:
    """The w that each column of objectives (g, r), larger is better, chooses, shape (r,); NaN where none is
    finite."""
    chosen = np.full(sample.shape[1], np.nan)
    for i in np.flatnonzero(np.isfinite(sample).any(axis=0)):
        chosen[i] = grid[middle_of_plateau(sample[:, i])]
    return chosen


def middle_of_plateau(value: FloatArray) -> int:
    """Index of the middle of the longest run of the largest value (g,).

    Of two middles, and of two runs of one length, the larger index: the larger w, nearer to the detector.
    """
    best = value >= np.nanmax(value) - 1e-12
    edges = np.flatnonzero(np.diff(np.concatenate([[False], best, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2]
    longest = len(starts) - 1 - int(np.argmax((ends - starts)[::-1]))
    return int(starts[longest] + ends[longest]) // 2


def run_around(true: BoolArray, index: int) -> tuple[int, int]:
    """First and last index of the run of true values (g,) that holds ``index``, which counts as true."""
    before, after = np.flatnonzero(~true[:index]), np.flatnonzero(~true[index + 1 :])
    first = int(before[-1]) + 1 if len(before) else 0
    last = index + int(after[0]) if len(after) else len(true) - 1
    return first, last


def describe(grid: FloatArray, w: float, uncertainty: WeightUncertainty) -> str:
    """What the data can tell, in one sentence."""
    chosen = int(np.argmin(np.abs(grid - w)))
    first, last = run_around(~uncertainty.separable, chosen)
    if first == last:
        text, also = "separable from its neighbours on the grid", "but not"
    else:
        text, also = f"not separable from w = {grid[first]:.2f} to {grid[last]:.2f}", "nor"
    ends = {0: "depth alone (w = 0)", len(grid) - 1: "the detector alone (w = 1)"}
    others = {i: name for i, name in ends.items() if i != chosen}
    untold = [name for i, name in others.items() if not uncertainty.separable[i]]
    told = [name for i, name in others.items() if uncertainty.separable[i]]
    if untold:
        text += f", {also} from {' or from '.join(untold)}"
    return text + (f"; separable from {' and from '.join(told)}" if told else "")


def _beaten(sample: FloatArray, chosen: int) -> BoolArray:
    """Whether the chosen row beats each row (g,) of objectives (g, r) in all but 2.5 % of the columns."""
    # a comparison with NaN is false: what is undefined tells nothing
    return np.asarray((sample[chosen] > sample).mean(axis=1) >= (1 + CONFIDENCE) / 2)


class WeightInterval(BaseModel):
    """A ``WeightUncertainty`` as files hold it."""

    model_config = ConfigDict(frozen=True)

    w: float
    low: float
    high: float
    confidence: float = CONFIDENCE
    standard_error: float | None
    """None where it is not known."""
    plateau: tuple[float, float]
    separable: tuple[bool, ...]
    n_resamples: int
    n_undefined: int

    @classmethod
    def of(cls, uncertainty: WeightUncertainty) -> Self:
        """What a file holds of the uncertainty."""
        u = uncertainty
        return cls(
            w=u.w,
            low=u.low,
            high=u.high,
            standard_error=None if np.isnan(u.standard_error) else u.standard_error,
            plateau=u.plateau,
            separable=tuple(u.separable.tolist()),
            n_resamples=u.n_resamples,
            n_undefined=u.n_undefined,
        )

    def uncertainty(self) -> WeightUncertainty:
        """The uncertainty that ``of`` was given."""
        return WeightUncertainty(
            self.w,
            self.low,
            self.high,
            float("nan") if self.standard_error is None else self.standard_error,
            self.plateau,
            np.array(self.separable, dtype=bool),
            self.n_resamples,
            self.n_undefined,
        )
