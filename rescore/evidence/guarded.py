"""Eq. 6 with its two unknowns made honest: a scale that is positive and bounded, and a fit that is robust.

As printed, eq. 6 is won by any flat surface: with a1 near 0 nothing of the prediction is left to be wrong.
Here a1 stays within bounds around the value at which the predicted relief has its own size, and the residual
is compared with that of the flat surface, so a wall has nothing to win by being flat. Streaks of the matcher
and background in the box count no more than a cap.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from recon.arrays import Float32Array, FloatArray, median

GUARDED = ("relief_scale", "relief_residual", "relief_gain", "roughness")
"""Cues of ``guarded_alignment``."""


@dataclass(frozen=True)
class GuardedConfig:
    """Settings of the guarded fit."""

    scale_limits: tuple[float, float] = (0.3, 3.0)
    """Bounds of the scale; 1 gives the predicted relief its own size."""
    n_scales: int = 15
    """Scales tried between the bounds, evenly in the logarithm."""
    cap: float = 0.1
    """A residual counts no more than this share of the depth."""
    noise_px: float = 0.25
    """Disparity that the matcher is taken to be off by, pixels: gains below it are none."""
    min_valid_px: int = 30
    """Smallest number of measured pixels for a fit."""
    max_pixels: int = 600
    """Largest number of pixels that are looked at, evenly spread."""

    @cached_property
    def scales(self) -> FloatArray:
        """The scales that are tried, shape (n_scales,)."""
        return np.geomspace(*self.scale_limits, self.n_scales)


@dataclass(frozen=True)
class GuardedAlignment:
    """The fit of one candidate. Relief is that of inverse depth as a share of its median."""

    scale: float
    """Logarithm of the scale, within its bounds: 0 where the predicted relief has its own size."""
    residual: float
    """Mean capped distance from the fit, as a share of the depth."""
    gain: float
    """By how much the fit is better than a flat surface: logarithm of the ratio of their residuals, each with
    the noise of the matcher added; positive where the predicted relief is there."""
    roughness: float
    """Mean capped distance from the flat surface, as a share of the depth."""
    predicted_px: float
    """Mean distance of the predicted relief from flat, in pixels of disparity: what is to be told."""

    @property
    def cues(self) -> FloatArray:
        """Shape (4,), columns ``GUARDED``."""
        return np.array([self.scale, self.residual, self.gain, self.roughness])


def guarded_alignment(
    predicted: Float32Array, disparity_px: Float32Array, config: GuardedConfig
) -> GuardedAlignment | None:
    """The fit of a candidate's predicted depth to the measured disparity; None with too few measurements.

    Args:
        predicted: Zi of the pixels in the box that are measured, shape (m,).
        disparity_px: measured there, shape (m,). Only its relief counts: no calibration.
        config: settings.
    """
    if len(predicted) < config.min_valid_px:
        return None
    some = slice(None, None, -(-len(predicted) // config.max_pixels))
    disparity, depth = disparity_px[some].astype(float), predicted[some].astype(float)
    middle = median(disparity)
    noise = config.noise_px / middle
    # inverse depth, since the noise of stereo is even there
    shown, model = disparity / middle - 1, _relief(1 / depth)
    scales = config.scales
    distance = _capped_distance(shown - np.append(scales, 0.0)[:, None] * model, config.cap)
    best, flat = int(np.argmin(distance[:-1])), float(distance[-1])
    residual = float(distance[best])
    gain = float(np.log((flat + noise) / (residual + noise)))
    predicted_px = float(np.abs(model - median(model)).mean() * middle)
    return GuardedAlignment(float(np.log(scales[best])), residual, gain, flat, predicted_px)


def _relief(values: FloatArray) -> FloatArray:
    """Values (m,) as a share of their median, less 1."""
    return values / median(values) - 1


def _capped_distance(difference: FloatArray, cap: float) -> FloatArray:
    """Mean capped distance of each row (k, m) from its median, shape (k,): the offset a2 is that median."""
    low, high = (difference.shape[1] - 1) // 2, difference.shape[1] // 2
    ordered = np.partition(difference, (low, high), axis=1)
    offset = (ordered[:, low] + ordered[:, high])[:, None] / 2
    return np.asarray(np.minimum(np.abs(difference - offset), cap).mean(axis=1))
