"""Outlines by distance-regularised level-set evolution (section 4.1).

After C. Li, C. Xu, C. Gui and M. D. Fox, "Distance regularized level set evolution and its application to
image segmentation", IEEE Trans. Image Processing 19(12), 2010. The level set phi is negative inside. All
candidates of a frame evolve together, as one stack of small images on the canonical grid of their view bin.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.pixels import smooth_gradient

_COLOURS = 16
"""Cells of the colour histograms along each axis of CIE Lab."""
_FLOOR = 1e-4


@dataclass(frozen=True)
class SegmentConfig:
    """Settings of the level-set evolution; names and signs as in the paper of Li et al."""

    steps: int = 30
    """Steps of the evolution."""
    time_step: float = 4.0
    """Pseudo time of one step; ``time_step * distance_weight`` must stay below 1/4."""
    distance_weight: float = 0.05
    """mu: weight of the double-well distance regulariser."""
    length_weight: float = 1.5
    """lambda: weight of the edge-weighted length."""
    area_weight: float = 0.0
    """alpha: weight of the edge-weighted area; positive shrinks, negative grows."""
    region_weight: float = 0.0
    """Weight of the colours inside and outside the start (``colour_evidence``); 0 goes by edges alone. Edges
    alone let thin limbs shrink away and stop at shadows as well as at the object."""
    inward_share: float = 0.4
    """Share of that weight for colours of the outside, which shrink the outline."""
    dirac_width_px: float = 1.5
    """epsilon: half width of the smoothed delta function."""
    smooth_sigma_px: float = 0.7
    """Gaussian before the gradient, canonical pixels."""
    edge_scale: float = 1.0
    """The gradient that halves the edge indicator, in root-mean-square gradients of the window."""
    max_shift: float = 0.15
    """The outline stays within this share of the box height of where it started."""

    def __post_init__(self) -> None:
        if not 0 < self.time_step * self.distance_weight < 0.25:
            raise ValueError(f"time_step * distance_weight must be in (0, 0.25), got {self}")


def signed_distance(mask: BoolArray) -> Float32Array:
    """Distance to the border of a mask (h, w) in pixels, negative inside, half a pixel off on either side."""
    return np.where(mask, 0.5 - _distance(mask), _distance(~mask) - 0.5).astype(np.float32)


def _distance(mask: BoolArray) -> Float32Array:
    """Distance in pixels from each pixel of a mask (h, w) to the nearest pixel outside; 0 outside the
    mask."""
    found = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # on one thread the last bits of OpenCV depend on where the arrays lie in memory, on more they are others;
    # squares of these distances are whole numbers
    return np.sqrt(np.rint(np.square(found, dtype=np.float64))).astype(np.float32)


def edge_indicator(lab: Float32Array, config: SegmentConfig) -> Float32Array:
    """g = 1 / (1 + |grad I|^2 / K^2) of colour windows (n, h, w, c), shape (n, h, w), in (0, 1]."""
    energy = np.empty(lab.shape[:3], np.float32)
    for i, window in enumerate(lab):
        dx, dy = smooth_gradient(window, config.smooth_sigma_px)
        square = dx * dx + dy * dy
        # the few channels one by one: sums over a short last axis are slow
        energy[i] = sum(np.moveaxis(square, 2, 0)) if square.ndim == 3 else square
    half = config.edge_scale**2 * energy.mean(axis=(1, 2), keepdims=True)
    # the floor is far below one grey level a pixel, so that a blank window has no edges
    return np.asarray(1.0 / (1.0 + energy / np.maximum(half, np.float32(1e-4))), np.float32)


def colour_evidence(lab: Float32Array, phi: Float32Array) -> Float32Array:
    """Whether colours speak for the outside, shape (n, h, w), in (-1, 1); negative for the inside.

    The hyperbolic tangent of the log likelihood ratio of each pixel's colour under two histograms, one of the
    pixels of colour windows (n, h, w, 3) where ``phi`` (n, h, w) is positive, one of the others.
    """
    low, high = np.array([0.0, -64.0, -64.0]), np.array([100.0, 64.0, 64.0])
    out = np.empty(phi.shape, np.float32)
    for i, window in enumerate(lab):
        share = (window - low) / (high - low)
        cell = tuple(np.moveaxis(np.clip(share * _COLOURS, 0, _COLOURS - 1).astype(np.intp), -1, 0))
        index = np.ravel_multi_index(cell, (_COLOURS,) * 3)
        outside, inside = (_colour_histogram(index[side]) for side in (phi[i] > 0, phi[i] <= 0))
        # the floor keeps a colour that one side never has from deciding alone
        ratio = np.log((outside + _FLOOR) / (inside + _FLOOR))[index]
        out[i] = np.tanh(cv2.GaussianBlur(ratio.astype(np.float32), (0, 0), 1.0))
    return out


def _colour_histogram(index: NDArray[np.intp]) -> FloatArray:
    """Smoothed share of each of the colour cells among their indices (m,), flat."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415 (a third of a second)

    counts = np.bincount(index, minlength=_COLOURS**3).reshape((_COLOURS,) * 3).astype(float)
    return np.asarray(gaussian_filter(counts, 0.6, mode="constant").ravel() / max(len(index), 1))


def evolve(
    phi: Float32Array, edge: Float32Array, config: SegmentConfig, region: Float32Array | None = None
) -> Float32Array:
    """phi after the evolution, shape (n, h, w), from ``phi`` and the edge indicator ``edge``, both (n, h, w).

    Gradient descent on mu R(phi) + lambda L_g(phi) + alpha A_g(phi) (eq. 22 of Li et al.), and on the area
    weighted by ``region`` (n, h, w), negative where it should grow. Outside ``max_shift`` of the start
    nothing pulls, so the outline stays there. The pull of each step acts where the smoothed delta function
    (1 + cos(pi phi / eps)) / (2 eps) is not 0; the distance regulariser acts everywhere.
    """
    band = np.abs(phi) <= config.max_shift * phi.shape[1] + config.dirac_width_px
    edge = edge * band
    push = config.area_weight * edge
    if region is not None:
        # limbs of the ground's colour would shrink away, so colours pull inwards less than outwards
        push += config.region_weight * np.where(region > 0, config.inward_share * region, region) * band
    weights = (config.time_step, config.distance_weight, config.length_weight, config.dirac_width_px)
    numbers = (np.float32(v) for v in weights)
    from recon.reconstruction.level_set import evolved  # noqa: PLC0415 (takes half a second with Numba)

    out: Float32Array = evolved(
        *(_plain(a) for a in (phi, edge, push)), config.steps, *map(np.float32, numbers)
    )
    return out


def _plain(stack: FloatArray | Float32Array) -> Float32Array:
    return np.ascontiguousarray(stack, np.float32)
