"""Do the borders of labelled parts lie where a picture has edges of their direction?

A class model holds labels and no colours, so that edges are all it can be compared with. Edges and borders
are drawn alike: one channel for each direction of the normal, blurred, so that a border that lies a little
aside still counts. The normalised correlation of the two pays for edges that the borders explain, and charges
for borders without an edge and for edges without a border.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.gradients import smooth_gradient
from recon.outlines import resample

_ROUNDING = 0.02
"""Gradients below this, in units of Lab a pixel, come from rounding; a blank window must have no edges."""


@dataclass(frozen=True)
class BorderEvidenceConfig:
    """Settings; lengths in pixels of a canonical grid."""

    directions: int = 8
    """Channels, over half a turn: a border has no light and dark side."""
    smooth_sigma_px: float = 0.7
    """Gaussian before the gradient."""
    local_sigma_px: float = 8.0
    """Gradients are compared with their mean around here, so that one strong edge does not outvote many."""
    blur_sigma_px: float = 2.0
    """How far a border may lie off its edge."""


def edge_channels(lab: Float32Array, config: BorderEvidenceConfig) -> Float32Array:
    """Edge strength by direction of a colour window (h, w, 3), shape (h, w, directions), at least 0."""
    dx, dy = smooth_gradient(lab, config.smooth_sigma_px)
    xx, yy, xy = (dx * dx).sum(axis=2), (dy * dy).sum(axis=2), (dx * dy).sum(axis=2)
    size = np.sqrt(xx + yy)
    # 1 where the gradients of all colours agree in direction
    coherence = np.hypot(xx - yy, 2 * xy) / (xx + yy + np.float32(1e-6))
    # half a unit of Lab a pixel is noise
    around = cv2.GaussianBlur(size, (0, 0), config.local_sigma_px) + np.float32(0.5)
    strength = coherence * np.maximum(size - np.float32(_ROUNDING), 0) / (size + around)
    double = np.arctan2(2 * xy, xx - yy)
    centre = (2 * np.pi / config.directions * np.arange(config.directions)).astype(np.float32)
    share = np.maximum(np.cos(double[..., None] - centre), 0) ** 2
    return _blurred(strength[..., None] * share, config)


def border_channels(
    polygons: tuple[FloatArray, ...], height_px: int, width_px: int, config: BorderEvidenceConfig
) -> Float32Array:
    """The borders of polygons (m, 2), pixel centres, drawn as ``edge_channels`` draws edges."""
    dense = [_every_pixel(polygon) for polygon in polygons]
    points = np.concatenate([p for p, _ in dense])
    double = np.concatenate([d for _, d in dense]) / (2 * np.pi) * config.directions
    column, row = np.round(points).astype(np.intp).T
    use = (column >= 0) & (column < width_px) & (row >= 0) & (row < height_px)
    low = np.floor(double).astype(np.intp)
    part = double - low
    place = (row * width_px + column) * config.directions
    index = np.concatenate(
        [(place + low % config.directions)[use], (place + (low + 1) % config.directions)[use]]
    )
    drawn = np.bincount(
        index, np.concatenate([1 - part[use], part[use]]), height_px * width_px * config.directions
    )
    # the border of two parts is drawn by both
    once = np.minimum(drawn, 1).astype(np.float32).reshape(height_px, width_px, config.directions)
    return _blurred(once, config)


def agreement(edges: Float32Array, borders: Float32Array) -> FloatArray:
    """Normalised correlation in [-1, 1] of edges (h, w, k) with each of borders (n, h, w, k), shape (n,)."""
    image = edges.ravel() - edges.mean()
    drawn = borders.reshape(len(borders), -1)
    drawn = drawn - drawn.mean(axis=1, keepdims=True)
    size = np.linalg.norm(drawn, axis=1) * np.linalg.norm(image)
    return np.asarray(drawn @ image / np.maximum(size, 1e-12), float)


def _every_pixel(polygon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (m, 2) a pixel apart on a closed polygon, and twice the angle of the normal there, (m,)."""
    length = float(np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1).sum())
    points = resample(polygon, max(8, round(length)))
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    return points, 2 * np.arctan2(-along[:, 0], along[:, 1])


def _blurred(channels: FloatArray | Float32Array, config: BorderEvidenceConfig) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(channels, (0, 0), config.blur_sigma_px), np.float32)
