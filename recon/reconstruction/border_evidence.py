"""Do the borders of labelled parts lie where a picture has edges of their direction?

A class model holds labels and no colours, so that edges are all it can be compared with. Edges and borders
are drawn alike: one channel for each direction of the normal, blurred, so that a border that lies a little
aside still counts. The normalised correlation of the two pays for edges that the borders explain, and charges
for borders without an edge and for edges without a border. ``EdgeWindow`` asks the same of parts that are
projected into the picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.outlines import resample
from recon.pixels import smooth_gradient

_ROUNDING = 0.02
"""Gradients below this, in units of Lab a pixel, come from rounding; a blank window must have no edges."""
_MARGIN_PX = 2


@dataclass(frozen=True)
class BorderEvidenceConfig:
    """Settings; lengths in pixels of a canonical grid."""

    directions: int = 8
    """Channels, over half a turn: a border has no light and dark side."""
    smooth_sigma_px: float = 0.7
    """Standard deviation in pixels of the Gaussian before the gradient."""
    local_sigma_px: float = 8.0
    """Gradients are compared with their mean around here, so that one strong edge does not outvote many."""
    blur_sigma_px: float = 2.0
    """How far a border may lie off its edge."""


def edge_channels(lab: Float32Array, config: BorderEvidenceConfig) -> Float32Array:
    """Edge strength by direction of a colour window (h, w, 3), shape (h, w, directions), at least 0."""
    dx, dy = smooth_gradient(lab, config.smooth_sigma_px)
    xx, yy, xy = (dx * dx).sum(axis=2), (dy * dy).sum(axis=2), (dx * dy).sum(axis=2)
    size = np.sqrt(xx + yy)
    along, aslant = xx - yy, 2 * xy
    double = np.sqrt(along * along + aslant * aslant)
    # 1 where the gradients of all colours agree in direction
    coherence = double / (xx + yy + np.float32(1e-6))
    # half a unit of Lab a pixel is noise
    around = cv2.GaussianBlur(size, (0, 0), config.local_sigma_px) + np.float32(0.5)
    strength = coherence * np.maximum(size - np.float32(_ROUNDING), 0) / (size + around)
    centre = (2 * np.pi / config.directions * np.arange(config.directions)).astype(np.float32)
    # the cosine of twice the angle to each direction
    towards = np.stack([along, aslant], axis=-1) / np.maximum(double, np.float32(1e-12))[..., None]
    share = np.maximum(towards @ np.stack([np.cos(centre), np.sin(centre)]), 0) ** 2
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


@dataclass(frozen=True)
class EdgeWindowConfig:
    """Settings of the comparison."""

    longer_side_px: int = 160
    """Longer side in pixels that larger windows are reduced to: edges and borders are compared coarsely."""
    borders: BorderEvidenceConfig = field(default_factory=BorderEvidenceConfig)


class EdgeWindow:
    """The edges of a picture in the box of an outline."""

    def __init__(
        self,
        picture: UInt8Array | Float32Array,
        ring_px: FloatArray,
        config: EdgeWindowConfig,
    ) -> None:
        """Finds the edges of a picture (h, w, 3), sRGB bytes or linear light in [0, 1], around an outline (m,
        2)."""
        self.config = config
        self.low_px = np.maximum(np.floor(ring_px.min(axis=0)).astype(int) - _MARGIN_PX, 0)
        high = np.ceil(ring_px.max(axis=0)).astype(int) + _MARGIN_PX + 1
        crop = picture[self.low_px[1] : high[1], self.low_px[0] : high[0]]
        self.zoom = min(config.longer_side_px / max(crop.shape[:2]), 1.0)
        small = cv2.resize(crop, None, fx=self.zoom, fy=self.zoom, interpolation=cv2.INTER_AREA)
        lab = (
            cv2.cvtColor(small.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2Lab)
            if picture.dtype == np.uint8
            else cv2.cvtColor(small, cv2.COLOR_LRGB2Lab)
        )
        self.edges = edge_channels(np.asarray(lab, np.float32), config.borders)

    def agreement(self, instances: Sequence[Sequence[FloatArray]]) -> FloatArray:
        """Correlation in [-1, 1] of the edges with the borders of each instance's visible parts, shape (n,).

        An instance is a sequence of part outlines (m, 2), image pixel centres.
        """
        height, width = self.edges.shape[:2]
        drawn = [
            border_channels(tuple(self._inside(p) for p in parts), height, width, self.config.borders)
            for parts in instances
        ]
        return agreement(self.edges, np.stack(drawn))

    def _inside(self, uv_px: FloatArray) -> FloatArray:
        return np.asarray((uv_px + 0.5 - self.low_px) * self.zoom - 0.5)
