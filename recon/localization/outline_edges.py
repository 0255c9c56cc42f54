"""Outline points moved to the edge that they stand for, to a fraction of a pixel.

A colour threshold lies where the threshold wants it: outside the blur of a pale object, or at the rim of the
soft shade under it. The object ends at the outermost sharp edge near by.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.outlines import resample
from recon.pixels import sample_bilinear

_DOWN = 0.3
"""Sine of the angle below the level from which on an outward normal faces down."""


@dataclass(frozen=True)
class OutlineEdgeConfig:
    """Settings of the search along the normals of the outline."""

    inward_px: float = 5.0
    """Distance in pixels inside the outline up to which an edge may lie."""
    inward_below_px: float = 20.0
    """Distance in pixels inside the outline up to which an edge may lie where the outline faces down: the
    soft shade under the object lies between outline and edge."""
    shade: float = 1.1
    """Where the outline faces down, light below this multiple of the background's shows no edge: it may be
    shade as well as a dark part."""
    outward_px: float = 3.0
    """Distance in pixels outside the outline up to which an edge may lie."""
    step_px: float = 0.5
    """Distance of samples along the normals, in pixels."""
    smooth_sigma_px: float = 1.0
    """Standard deviation in pixels of the Gaussian before the gradient."""
    least_gradient: float = 0.03
    """Smallest gradient of an edge a pixel, of the root of linear light (its noise is even)."""
    share_of_strongest: float = 0.35
    """Smallest gradient of an edge as a share of the strongest gradient on the same normal."""
    weak_weight: float = 0.15
    """Weight of points that find no edge; they stay where they are."""
    below_weight: float = 0.2
    """Weight, in [0, 1], of the object reaching beyond an edge that faces down: a dark part may follow."""


@dataclass(frozen=True, eq=False)
class OutlinePoints:
    """Points on an outline and how far they can be trusted."""

    uv_px: FloatArray
    """Shape (n, 2), image pixel centres."""
    outside_weight: FloatArray
    """Weight of a point that lies outside the object, shape (n,), in [0, 1]."""
    inside_weight: FloatArray
    """Weight of a point that lies inside the object, shape (n,), in [0, 1]."""

    def every(self, step: int) -> "OutlinePoints":
        """Each ``step``-th point."""
        return OutlinePoints(self.uv_px[::step], self.outside_weight[::step], self.inside_weight[::step])


def outline_points(ring_px: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Evenly spaced points (count, 2) on the outer edge of a region, and outward normals (count, 2).

    The ring holds the centres of the region's border pixels, so that the edge lies half a pixel outside.
    """
    points = resample(ring_px, count)
    along = np.roll(points, -2, axis=0) - np.roll(points, 2, axis=0)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    x, y = points.T
    if x @ np.roll(y, -1) - y @ np.roll(x, -1) < 0:
        normal = -normal
    return points + 0.5 * normal, normal


def points_on_edges(
    light: Float32Array,
    background: Float32Array,
    ring_px: FloatArray,
    count: int,
    config: OutlineEdgeConfig,
) -> OutlinePoints:
    """The points of an outline moved onto the outermost sharp edge of a picture.

    Where the outline faces down the object ends between that edge and the outline itself, which may be the
    rim of a shade: both are given, and the object should hold the first and not the second.

    Args:
        light: linear light, shape (h, w, 3), in [0, 1].
        background: the same without the object.
        ring_px: the outline, shape (m, 2), centres of its border pixels.
        count: number of points.
        config: settings.
    """
    points, normal = outline_points(ring_px, count)
    low = np.maximum(np.floor(ring_px.min(axis=0)) - 20, 0).astype(int)
    high = np.ceil(ring_px.max(axis=0)).astype(int) + 21
    rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
    plain = light[rows, columns]
    lit = np.maximum(plain, config.shade * background[rows, columns])
    offsets = np.arange(
        -config.inward_below_px - config.step_px, config.outward_px + 1.5 * config.step_px, config.step_px
    )
    at = (points[:, None] + offsets[None, :, None] * normal[:, None] - low).astype(np.float32)
    below = normal[:, 1] > _DOWN
    allowed = below[:, None] | (offsets[1:-1] >= -config.inward_px - config.step_px)
    slope = np.where(below[:, None], _slopes(lit, at, config), _slopes(plain, at, config))
    strongest = np.where(allowed, slope, 0).max(axis=1)
    least = np.maximum(config.least_gradient, config.share_of_strongest * strongest)
    shift, found = _outermost_peak(slope, offsets[1:-1], allowed, least, config.step_px)
    moved = points + np.where(found, shift, 0.0)[:, None] * normal
    outside = np.where(found, 1.0, config.weak_weight)
    inside = np.where(below & found, config.below_weight, np.where(below, 1.0, outside))
    rim = below & found
    return OutlinePoints(
        np.concatenate([moved, points[rim]]),
        np.concatenate([outside, np.zeros(rim.sum())]),
        np.concatenate([inside, np.ones(rim.sum())]),
    )


def _slopes(light: Float32Array, at_px: Float32Array, config: OutlineEdgeConfig) -> FloatArray:
    """Gradient a pixel of the root of light along rows of samples (n, s, 2), shape (n, s - 2)."""
    root = cv2.GaussianBlur(np.sqrt(np.maximum(light, 0)), (0, 0), config.smooth_sigma_px)
    profile = sample_bilinear(root, at_px, cv2.BORDER_REPLICATE)
    return np.asarray(np.linalg.norm(profile[:, 2:] - profile[:, :-2], axis=2) / (2 * config.step_px), float)


def _outermost_peak(
    slope: FloatArray, offsets: FloatArray, allowed: BoolArray, least: FloatArray, step_px: float
) -> tuple[FloatArray, BoolArray]:
    """Offset (n,) of the last local maximum of each row that is strong enough, and whether there is one."""
    middle = slope[:, 1:-1]
    peak = (middle >= slope[:, :-2]) & (middle > slope[:, 2:]) & (middle >= least[:, None]) & allowed[:, 1:-1]
    last = peak.shape[1] - 1 - np.argmax(peak[:, ::-1], axis=1)
    row = np.arange(len(slope))
    a, b, c = (slope[row, last + k] for k in range(3))
    bend = np.where(a - 2 * b + c < 0, a - 2 * b + c, -1.0)
    fraction = np.clip(0.5 * (a - c) / bend, -0.5, 0.5)
    return offsets[last + 1] + fraction * step_px, np.asarray(peak.any(axis=1))
