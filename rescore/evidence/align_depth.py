"""Eq. 6: how far a candidate's predicted depth is from the measured one after the best scale and offset.

``D = min over a1, a2 of sqrt(mean((Zs - (a1 Zi + a2))^2))``, over the depth region inside the box: the pixels
that have both a predicted depth Zi and a measured depth Zs. The report leaves three things open; here they
are options:

- *normalised* stereo depth: see ``Normalisation``;
- the printed root of a square is read as the root of the *mean* square, or D would grow with the box;
- pixels without a measurement (holes) are left out, and a region with too few measurements has no D at all.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import ceil
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, FloatArray, percentiles
from recon.camera import StereoCamera
from recon.depth_map import DepthMap
from recon.errors import Failure, Reason


class Normalisation(StrEnum):
    """What maps measured depth to [0, 1] before eq. 6."""

    BOX_PERCENTILES = "box_percentiles"
    """Two percentiles of the region go to 0 and 1, what lies outside is clipped.

    The default. Per box, so that D asks whether the *shape* fits, and a car at 10 m and one at 40 m are
    judged alike; percentiles, because one streak of a stereo matcher would stretch the range of the box and
    shrink every residual with it.
    """
    IMAGE_RANGE = "image_range"
    """Two percentiles of the whole picture go to 0 and 1, clipped.

    The most literal reading of "the normalised stereo depth map". A car then fills a few per cent of the
    range, so every D is near 0 and says little.
    """


@dataclass(frozen=True)
class AlignConfig:
    """Settings of eq. 6."""

    normalisation: Normalisation = Normalisation.BOX_PERCENTILES
    percentiles: tuple[float, float] = (2.0, 98.0)
    """What goes to 0 and to 1; 0 and 100 are minimum and maximum, without protection from outliers."""
    min_valid_px: int = 30
    """Fewer measured pixels than this give no D; two unknowns are fitted, and stereo noise is not white."""
    min_valid_share: float = 0.2
    """A smaller measured share of the predicted region than this gives no D."""


@dataclass(frozen=True)
class DepthAlignment:
    """The solution of eq. 6 for one candidate."""

    scale: float
    """a1 of eq. 6: normalised stereo depth a unit of predicted depth."""
    offset: float
    """a2 of eq. 6, in normalised stereo depth."""
    difference: float
    """D in [0, 1]; never above 0.5, since a1 = 0 with a2 = 0.5 is among the choices."""
    valid_share: float
    """Share of the predicted region in the box that has a measured depth."""
    stereo_low: float
    """Measured depth that was normalised to 0 (metres, or the unit of ``measured_depth``)."""
    stereo_span: float
    """Measured depth from 0 to 1: ``(scale * Zi + offset) * span + low`` is Zi as measured depth."""


def measured_depth(
    disparity_px: Float32Array, camera: StereoCamera | None, *, inverse: bool = False
) -> Float32Array:
    """Measured depth Zs (h, w), NaN where there is none: metres, or ``1 / disparity`` without a camera.

    Depth is ``fx * baseline / disparity``, so without calibration it is known up to one factor, and eq. 6
    does not see that factor: the normalisation takes it out.

    Args:
        disparity_px: shape (h, w), NaN where there is none.
        camera: the pair; None where it is not known.
        inverse: whether the inverse of that depth is wanted, for predictions of inverse depth.
    """
    if camera is not None:
        depth = camera.depth_m(disparity_px)
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(disparity_px > 0, 1 / disparity_px, np.nan).astype(np.float32)
    return np.float32(1) / depth if inverse else depth


class WithDepth(Protocol):
    """What holds the predicted depth of one candidate."""

    @property
    def depth(self) -> DepthMap:
        """Zi, NaN outside the depth region."""


def align_instances(
    predicted: Sequence[WithDepth | Failure], measured: Float32Array, xyxy_px: FloatArray, config: AlignConfig
) -> tuple[DepthAlignment | Failure, ...]:
    """The outcome of eq. 6 for each candidate of a frame; why nothing is predicted where nothing is.

    Args:
        predicted: what is predicted of each candidate, or why nothing is.
        measured: Zs of the whole picture (h, w), NaN where there is no measurement.
        xyxy_px: the boxes, shape (n, 4), pixel edges.
        config: the options.
    """
    limits = None
    if config.normalisation is Normalisation.IMAGE_RANGE:
        limits = depth_range(measured, config.percentiles)
    return tuple(
        one if isinstance(one, Failure) else align_depth(one.depth, measured, box, config, limits)
        for one, box in zip(predicted, xyxy_px, strict=True)
    )


def align_depth(
    predicted: DepthMap,
    measured: Float32Array,
    xyxy_px: FloatArray,
    config: AlignConfig,
    image_range: tuple[float, float] | None = None,
) -> DepthAlignment | Failure:
    """The best scale, offset and D of eq. 6 for one candidate, or NO_STEREO.

    Args:
        predicted: Zi, NaN outside the depth region.
        measured: Zs of the whole picture (h, w), NaN where there is no measurement.
        xyxy_px: the box b_i, shape (4,), pixel edges.
        config: the options.
        image_range: low and high of ``Normalisation.IMAGE_RANGE`` where the caller has them from
            ``depth_range``; else they are computed.
    """
    region = predicted_region(predicted, xyxy_px)
    window = measured[predicted.window]
    valid = np.flatnonzero(region & np.isfinite(window))
    n_region, n_valid = int(np.count_nonzero(region)), len(valid)
    share = n_valid / n_region if n_region else 0.0
    if n_valid < config.min_valid_px or share < config.min_valid_share:
        return Failure(
            Reason.NO_STEREO,
            f"expected at least {config.min_valid_px} measured pixels and a share of "
            f"{config.min_valid_share:g} of the predicted region, got {n_valid} of {n_region}",
        )
    z_s, z_i = window.take(valid), predicted.depth.take(valid).astype(float)
    low, span = _range(z_s, measured, config, image_range)
    normalised = np.clip((z_s.astype(float) - low) / span, 0, 1) if span > 0 else np.zeros(n_valid)
    scale, offset, difference = fit_scale_offset(z_i, normalised)
    return DepthAlignment(scale, offset, difference, share, low, span)


def fit_scale_offset(z_i: FloatArray, z_s: FloatArray) -> tuple[float, float, float]:
    """a1, a2 and the root mean square of ``z_s - (a1 z_i + a2)``: the closed form of least squares on a line.

    A prediction without spread says nothing about the scale: a1 is 0 there, and a2 the mean.
    """
    mean_i, mean_s = z_i.mean(), z_s.mean()
    centred_i, centred_s = z_i - mean_i, z_s - mean_s
    variance = centred_i @ centred_i
    # below float32's resolution of the predicted depth, spread is rounding
    flat = variance <= len(z_i) * (1e-6 * np.abs(z_i).max()) ** 2
    scale = 0.0 if flat else float(centred_i @ centred_s / variance)
    residual = centred_s - scale * centred_i
    return scale, float(mean_s - scale * mean_i), float(np.sqrt(residual @ residual / len(z_i)))


def depth_range(measured: Float32Array, percent: tuple[float, float]) -> tuple[float, float]:
    """Low and high percentile of the measured depths of a picture; (0, 0) where nothing was measured."""
    values = measured[np.isfinite(measured)]
    if not len(values):
        return 0.0, 0.0
    low, high = percentiles(values, percent)
    return low, high


def predicted_region(predicted: DepthMap, xyxy_px: FloatArray) -> BoolArray:
    """Pixels of the window that have a predicted depth and whose middle lies in the box, shape (h, w)."""
    left, top, right, bottom = xyxy_px.tolist()
    columns = slice(*(max(0, ceil(x - 0.5 - predicted.x0_px)) for x in (left, right)))
    rows = slice(*(max(0, ceil(y - 0.5 - predicted.y0_px)) for y in (top, bottom)))
    region = np.zeros(predicted.depth.shape, bool)
    np.isfinite(predicted.depth[rows, columns], out=region[rows, columns])
    return region


def measured_pixels(predicted: DepthMap, measured: Float32Array, xyxy_px: FloatArray) -> NDArray[np.intp]:
    """Pixels of the window in ``predicted_region`` that are measured too, numbered from its corner on, (m,).

    Args:
        predicted: Zi, NaN outside the depth region.
        measured: depth or disparity in the window, shape (h, w), NaN where there is no measurement.
        xyxy_px: the box, shape (4,), pixel edges.
    """
    return np.flatnonzero(predicted_region(predicted, xyxy_px) & np.isfinite(measured))


def _range(
    values: Float32Array,
    measured: Float32Array,
    config: AlignConfig,
    image_range: tuple[float, float] | None,
) -> tuple[float, float]:
    """The measured depth that becomes 0, and the span that becomes 1."""
    match config.normalisation:
        case Normalisation.BOX_PERCENTILES:
            low, high = percentiles(values, config.percentiles)
        case Normalisation.IMAGE_RANGE:
            low, high = image_range or depth_range(measured, config.percentiles)
    return low, high - low
