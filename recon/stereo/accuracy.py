"""How far a disparity map is from the truth, counted as the stereo benchmarks count.

KITTI: Menze and Geiger, Object Scene Flow for Autonomous Vehicles, CVPR 2015. Middlebury: Scharstein et al.,
High-Resolution Stereo Datasets with Subpixel-Accurate Ground Truth, GCPR 2014.
"""

from dataclasses import dataclass, fields

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray


@dataclass(frozen=True)
class WrongRule:
    """The rule by which a disparity is wrong: off by more than both limits."""

    absolute_px: float
    relative: float = 0.0
    """The relative limit, as a share of the true disparity."""

    def wrong(self, error_px: FloatArray, truth_px: FloatArray) -> BoolArray:
        """Whether errors (n,) in pixels of true disparities (n,) are wrong; NaN is not."""
        return (error_px > self.absolute_px) & (error_px > self.relative * truth_px)


D1 = WrongRule(3.0, 0.05)
"""The rule D1 of KITTI 2015: wrong by more than 3 px and more than 5 % of the true disparity."""
BAD_1, BAD_2 = WrongRule(1.0), WrongRule(2.0)
"""The rules bad 1.0 and bad 2.0 of Middlebury: wrong by more than 1 px and more than 2 px."""


@dataclass(frozen=True)
class DisparityError:
    """Counts of how far measured disparity is from the truth, over the pixels with truth inside a mask.

    Counts, which add up over frames, and the shares that follow. Shares are NaN where they have no pixels.
    """

    n_truth: int = 0
    """Pixels with truth inside the mask."""
    n_measured: int = 0
    """Pixels with truth inside the mask that have a measurement."""
    absolute_error_px: float = 0.0
    """Sum of the absolute differences over the measured pixels."""
    n_wrong_measured: int = 0
    """Measured pixels that are wrong."""
    n_wrong_filled: int = 0
    """Pixels with truth that are wrong after filling holes from the background."""

    def __add__(self, other: "DisparityError") -> "DisparityError":
        """The error over the pixels of both operands."""
        return DisparityError(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def density(self) -> float:
        """Share of the pixels with truth that have a measurement."""
        return _share(self.n_measured, self.n_truth)

    @property
    def end_point_error_px(self) -> float:
        """Mean absolute difference over the measured pixels."""
        return _share(self.absolute_error_px, self.n_measured)

    @property
    def wrong_share_measured(self) -> float:
        """Wrong pixels / measured pixels (KITTI's D1-est)."""
        return _share(self.n_wrong_measured, self.n_measured)

    @property
    def wrong_share_filled(self) -> float:
        """Wrong pixels / all truth pixels after filling holes from the background.

        This is the number to hold against KITTI's table, where it is said of background, foreground and all.
        """
        return _share(self.n_wrong_filled, self.n_truth)


def _share(part: float, whole: int) -> float:
    return part / whole if whole else float("nan")


def fill_holes(disparity_px: Float32Array) -> Float32Array:
    """Disparity (h, w) without holes: KITTI's background interpolation.

    Each hole takes the smaller disparity (the farther surface) of its two measured neighbours in the row; at
    the ends of a row it takes the one there is; empty rows copy the nearest measured row above, else below.
    Where nothing at all is measured, the result is NaN.
    """
    before = _last_measured(disparity_px)
    after = _last_measured(disparity_px[:, ::-1])[:, ::-1]
    in_rows = np.fmin(before, after)
    above = _last_measured(in_rows.T).T
    below = _last_measured(in_rows.T[:, ::-1])[:, ::-1].T
    return np.where(np.isnan(above), below, above)


def _last_measured(disparity_px: Float32Array) -> Float32Array:
    """The last measured value at or before each column of its row; NaN before the first."""
    column = np.where(np.isnan(disparity_px), 0, np.arange(disparity_px.shape[1]))
    return np.take_along_axis(disparity_px, np.maximum.accumulate(column, axis=1), axis=1)


def disparity_error(
    measured_px: Float32Array,
    truth_px: Float32Array,
    mask: BoolArray,
    rule: WrongRule = D1,
    filled_px: Float32Array | None = None,
) -> DisparityError:
    """Density, end-point error and wrong pixels of a map, all of shape (h, w).

    Args:
        measured_px: NaN where there is no measurement.
        truth_px: NaN where there is no truth (sky).
        mask: The pixels to count.
        rule: What is wrong.
        filled_px: The map with its holes filled, where that is known already; else ``fill_holes`` of it.

    Raises:
        ValueError: The shapes differ.
    """
    if not measured_px.shape == truth_px.shape == mask.shape:
        raise ValueError(f"shapes differ: {measured_px.shape}, {truth_px.shape}, {mask.shape}")
    counted = mask & ~np.isnan(truth_px)
    truth = truth_px[counted].astype(np.float64)
    error = np.abs(measured_px[counted] - truth)
    filled = fill_holes(measured_px) if filled_px is None else filled_px
    # a hole in a map without any measurement stays NaN, which is wrong too
    filled_error = np.nan_to_num(np.abs(filled[counted] - truth), nan=np.inf)
    has = ~np.isnan(error)
    return DisparityError(
        n_truth=len(truth),
        n_measured=int(has.sum()),
        absolute_error_px=float(error[has].sum()),
        n_wrong_measured=int(rule.wrong(error, truth).sum()),
        n_wrong_filled=int(rule.wrong(filled_error, truth).sum()),
    )
