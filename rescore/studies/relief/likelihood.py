"""How likely measured disparity is for a surface, and the plane that explains it best."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray


@dataclass(frozen=True)
class MeasurementNoise:
    """How measured disparity differs from that of the surface; the same for all that is compared."""

    sd_px: float = 0.7
    """Standard deviation of a good measurement."""
    outliers: float = 0.1
    """Share of measurements of something else."""
    largest_px: float = 208.0
    """A measurement of something else lies anywhere from 0 to this."""
    independent_px: float = 60.0
    """Number of pixels that are as good as one measurement, since a matcher errs alike in neighbours."""

    def log_density(self, residual_px: FloatArray) -> FloatArray:
        """Log density of residuals of any shape; where one is NaN, that of measuring something else."""
        return np.asarray(np.log(self._good(residual_px) + self.outliers / self.largest_px))

    def trust(self, residual_px: FloatArray) -> FloatArray:
        """Probability that each measurement is a good one, shape as given; 0 where the residual is NaN."""
        good = self._good(residual_px)
        return np.asarray(good / (good + self.outliers / self.largest_px))

    def _good(self, residual_px: FloatArray) -> FloatArray:
        scaled = np.nan_to_num(residual_px / self.sd_px, nan=np.inf)
        with np.errstate(over="ignore"):
            return np.asarray((1 - self.outliers) * np.exp(-0.5 * scaled**2) / (_ROOT * self.sd_px))

    def drawn(self, disparity_px: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Measurements (n,) of surfaces with these disparities (n,), as this noise makes them."""
        good = disparity_px + rng.normal(0, self.sd_px, len(disparity_px))
        other = rng.uniform(0, self.largest_px, len(disparity_px))
        return np.where(rng.uniform(size=len(disparity_px)) < self.outliers, other, good)


_ROOT = float(np.sqrt(2 * np.pi))


def best_plane(
    uv_px: FloatArray, disparity_px: FloatArray, noise: MeasurementNoise, rng: np.random.Generator
) -> FloatArray:
    """Disparity (n,) at the pixels of the plane in space that is likeliest to have been measured.

    A plane in space is linear in disparity over the picture, so all of its three numbers are free. The search
    starts from least squares and from planes through three samples, and goes on from the best of these by
    expectation and maximisation, which never makes the likelihood smaller.

    Args:
        uv_px: Pixels, shape (n, 2), not all on one line.
        disparity_px: Measured there, shape (n,).
        noise: Of the measurements.
        rng: Draws the samples that planes go through.
    """
    linear = np.column_stack(
        [(uv_px - uv_px.mean(axis=0)) / np.ptp(uv_px, axis=0).max(), np.ones(len(uv_px))]
    )
    starts = [np.linalg.lstsq(linear, disparity_px, rcond=None)[0]]
    for rows in rng.integers(len(linear), size=(_TRIALS, 3)):
        starts.append(np.linalg.lstsq(linear[rows], disparity_px[rows], rcond=None)[0])
    score = noise.log_density(disparity_px - np.array(starts) @ linear.T).sum(axis=1)
    climbed = [
        _climbed_plane(linear, disparity_px, starts[i], noise)
        for i in np.argsort(-score, kind="stable")[:_KEPT]
    ]
    return np.asarray(linear @ max(climbed, key=lambda found: found[0])[1])


_TRIALS = 200
_KEPT = 10
"""Starts that are climbed from."""
_ROUNDS = 200
_SMALL_STEP = 1e-3
"""Gain of log likelihood, summed over the samples, below which climbing ends."""


def _climbed_plane(
    linear: FloatArray, disparity_px: FloatArray, start: FloatArray, noise: MeasurementNoise
) -> tuple[float, FloatArray]:
    """Log likelihood and coefficients (3,) of the plane that a start leads to."""
    plane: FloatArray = start
    value = -np.inf
    for _ in range(_ROUNDS):
        residual = disparity_px - linear @ plane
        before, value = value, float(noise.log_density(residual).sum())
        if value - before < _SMALL_STEP:
            break
        weighted = linear * noise.trust(residual)[:, None]
        plane = np.asarray(np.linalg.lstsq(weighted.T @ linear, weighted.T @ disparity_px, rcond=None)[0])
    return value, plane
