"""Measured disparity in and around a box, on a grid, and what it would be if no object stood there."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.camera import GroundedStereo
from recon.localization.standing_box import cam_from_ground
from recon.pixels import sample_nearest


@dataclass(frozen=True)
class DisparityNoise:
    """How measured disparity differs from that of the surfaces that are there."""

    sd_px: float = 0.7
    """Standard deviation of a good measurement."""
    largest_px: float = 208.0
    """A measurement of something else lies anywhere from 0 to this."""
    independent_px: float = 60.0
    """Number of pixels that are as good as one measurement, since a matcher errs alike in neighbours."""
    bleeding_px: float = 3.0
    """How far a matcher spreads disparity beyond an edge."""
    ground_share: float = 0.4
    """Share of the ground among what lies behind objects and below the horizon."""
    ground_sd_px: float = 1.0


@dataclass(frozen=True)
class SampleGrid:
    """The grid on a box."""

    rows: int = 24
    columns: int = 36
    beside: float = 0.7
    """The grid reaches this share of the box's width beyond each side."""
    above: float = 0.6
    """The grid reaches this share of the box's height above it."""
    below: float = 0.4


@dataclass(frozen=True, eq=False)
class BoxSamples:
    """Samples (rows, columns) on a grid around one box; the disparity is NaN where nothing is measured."""

    uv_px: FloatArray
    """Pixels, shape (rows, columns, 2)."""
    inside: BoolArray
    """Whether a sample lies in the box, shape (rows, columns)."""
    disparity_px: Float32Array
    """Shape (rows, columns)."""
    ray: Float32Array
    """Viewing rays in the ground frame, of which depth times ray is the way from the eye, shape (rows,
    columns, 3)."""
    ground_px: Float32Array
    """Disparity of the ground, 0 above the horizon, shape (rows, columns)."""
    log_background: Float32Array
    """Logarithm of the density of the disparity where no object stands, shape (rows, columns)."""
    weight: float
    """Number of independent measurements that a sample counts as, in (0, 1]."""
    seen_from: GroundedStereo

    @property
    def known(self) -> BoolArray:
        """Whether a sample is measured, shape (rows, columns)."""
        return np.asarray(np.isfinite(self.disparity_px))

    @property
    def depth_m(self) -> Float32Array:
        """Depth of each sample, shape (rows, columns); NaN where there is none."""
        return self.seen_from.stereo.depth_m(self.disparity_px)

    @property
    def height_m(self) -> Float32Array:
        """Height above the ground of each sample, shape (rows, columns); NaN where there is none."""
        height = self.depth_m * self.ray[..., 2] + self.seen_from.ground.height_m
        return np.asarray(height, np.float32)

    @property
    def forward_m(self) -> Float32Array:
        """Distance along the ground of each sample, shape (rows, columns); NaN where there is none."""
        return np.asarray(self.depth_m * np.hypot(self.ray[..., 0], self.ray[..., 1]), np.float32)

    @property
    def standing(self) -> BoolArray:
        """Whether a sample is measured and clearly not on the ground, shape (rows, columns)."""
        return np.asarray(self.known & (np.abs(self.disparity_px - self.ground_px) > 1.5))


def box_samples(
    disparity_px: Float32Array,
    xyxy_px: FloatArray,
    seen_from: GroundedStereo,
    noise: DisparityNoise,
    grid: SampleGrid,
) -> tuple[BoxSamples, ...]:
    """The samples around each box.

    Args:
        disparity_px: Measured, shape (h, w), NaN in holes.
        xyxy_px: Boxes, shape (n, 4), pixel edges.
        seen_from: The pair and the ground.
        noise: Of the disparity.
        grid: Of the samples.
    """
    low, high = xyxy_px[:, :2], xyxy_px[:, 2:]
    extent = high - low
    first = low - extent * [grid.beside, grid.above]
    last = high + extent * [grid.beside, grid.below]
    u = np.linspace(first[:, 0], last[:, 0], grid.columns, axis=1)[:, None]
    v = np.linspace(first[:, 1], last[:, 1], grid.rows, axis=1)[..., None]
    column, row = np.broadcast_arrays(np.floor(u).astype(int), np.floor(v).astype(int))
    seen = sample_nearest(disparity_px, column, row).astype(np.float32)
    uv = np.stack([column, row], axis=-1).astype(float)
    ground = np.nan_to_num(seen_from.ground_disparity_px(uv)).astype(np.float32)
    area_px = np.maximum((last - first) / [grid.columns - 1, grid.rows - 1], 1.0).prod(axis=1)
    middle = uv + 0.5
    inside = (middle > low[:, None, None]) & (middle < high[:, None, None])
    ray = (seen_from.stereo.left.rays(uv) @ cam_from_ground(seen_from.ground)[:3, :3]).astype(np.float32)
    inside = np.asarray(inside.all(axis=-1))
    background = _log_background(seen, ground, noise)
    weight = np.minimum(1.0, area_px / noise.independent_px).tolist()
    return tuple(
        BoxSamples(uv[i], inside[i], seen[i], ray[i], ground[i], background[i], weight[i], seen_from)
        for i in range(len(xyxy_px))
    )


def _log_background(seen_px: Float32Array, ground_px: Float32Array, noise: DisparityNoise) -> Float32Array:
    anything = 1 / noise.largest_px
    off = (seen_px - ground_px) / noise.ground_sd_px
    on_ground = np.exp(-0.5 * off**2) / (np.sqrt(2 * np.pi) * noise.ground_sd_px)
    below = noise.ground_share * on_ground + (1 - noise.ground_share) * anything
    return np.log(np.where(ground_px > 0, below, anything)).astype(np.float32)
