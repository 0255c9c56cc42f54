"""Poses of instances of a class on the ground: what each predicts of a box and of disparity."""

from dataclasses import dataclass, fields

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray
from recon.camera import GroundedCamera
from recon.localization.box_samples import BoxSamples, DisparityNoise
from recon.localization.depth_views import DepthViews
from recon.localization.standing_box import StandingBox, cam_from_ground


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses (m,) of instances that stand on the ground."""

    place: FloatArray
    """Distance along the ground in metres, bearing (to the right of straight ahead), heading (of the nose,
    counter-clockwise from the picture's right as one looks along the bearing), both in radians, and the
    logarithm of the size over that of the shape, shape (m, 4)."""
    shape: IntArray
    """Index of the shape in ``DepthViews``, shape (m,)."""

    def __len__(self) -> int:
        return len(self.shape)

    def __getitem__(self, chosen: IntArray | BoolArray | slice) -> "Poses":
        return Poses(self.place[chosen], self.shape[chosen])

    @property
    def azimuth_rad(self) -> FloatArray:
        """Side from which each is seen, 0 its front, counter-clockwise from above, shape (m,)."""
        return np.asarray((1.5 * np.pi - self.place[:, 2]) % (2 * np.pi))

    def size_m(self, views: DepthViews) -> FloatArray:
        """Length, width and height of each, shape (m, 3)."""
        return np.asarray(views.size_m[self.shape] * np.exp(self.place[:, 3:]))

    def standing_box(self, i: int, views: DepthViews) -> StandingBox:
        """The bounding box of one."""
        distance, bearing, heading, _ = self.place[i]
        xy = distance * np.array([np.sin(bearing), np.cos(bearing)])
        return StandingBox(xy, float(heading - bearing), self.size_m(views)[i])


def silhouette_boxes(poses: Poses, views: DepthViews, seen_from: GroundedCamera) -> FloatArray:
    """Boxes (m, 4) around the silhouettes, pixel edges, cut off at the picture's edge.

    What reaches behind the camera has the whole picture as its box.
    """
    distance, bearing, heading, log_scale = poses.place.T
    at = views.nearest(distance * np.exp(-log_scale), heading)
    left, right, foot, top = (views.extent_m[poses.shape, *at] * np.exp(poses.place[:, 3:])).T
    across = np.stack([left, right, (left + right) / 2, (left + right) / 2])
    up = np.stack([(foot + top) / 2, (foot + top) / 2, top, foot])
    sin, cos = np.sin(bearing), np.cos(bearing)
    ground = np.stack([distance * sin + across * cos, distance * cos - across * sin, up], axis=-1)
    pose = cam_from_ground(seen_from.ground)
    cam = ground @ pose[:3, :3].T + pose[:3, 3]
    ahead = cam[..., 2] > _NEAREST_M
    uv = seen_from.camera.project(np.where(ahead[..., None], cam, 1.0)) + 0.5
    width, height = seen_from.camera.width_px, seen_from.camera.height_px
    boxes = np.stack([uv[0, :, 0], uv[2, :, 1], uv[1, :, 0], uv[3, :, 1]], axis=1)
    boxes = np.where(np.asarray(ahead.all(axis=0))[:, None], boxes, [0, 0, width, height])
    return np.asarray(np.clip(boxes, 0, [width, height, width, height]))


_NEAREST_M = 0.3
"""Points nearer to the camera than this are not projected."""


@dataclass(frozen=True)
class SurfaceNoise:
    """How an instance differs from its shape, and what hides it."""

    shape_m: float = 0.12
    """Standard deviation of the surface beside that of the shape."""
    before: float = 0.10
    """Share of measurements of something nearer, such as what hides the object."""
    behind: float = 0.03
    """Share of measurements of something farther, such as what is seen through its windows."""


@dataclass(frozen=True, eq=False)
class Explained:
    """What poses (m,) say of samples (n,) of one box."""

    log_ratio: Float32Array
    """Log likelihood of each measurement over that of the background, by the independent measurements that a
    sample counts as, shape (m, n); 0 beside the silhouette and where nothing is measured."""
    disparity_px: Float32Array
    """Predicted, shape (m, n); NaN beside the silhouette."""
    spread_px: Float32Array
    """Standard deviation of what is measured around what is predicted, shape (m, n); NaN as that is."""
    residual: Float32Array
    """Measured less predicted disparity in standard deviations, shape (m, n); NaN as both are."""
    weight: Float32Array
    """Number of independent measurements that a sample counts as, shape (m, n)."""

    def on_grid(self, samples: BoxSamples) -> "Explained":
        """What one pose says, each array of the shape (rows, columns) of the samples."""
        return Explained(*(getattr(self, f.name).reshape(samples.known.shape) for f in fields(self)))


def explain(
    poses: Poses,
    views: DepthViews,
    samples: BoxSamples,
    noise: DisparityNoise,
    surface: SurfaceNoise,
    step: int = 1,
    *,
    fine: bool = False,
) -> Explained:
    """The log likelihood ratio of the samples of a box under each pose.

    A sample within the silhouette is the surface of the instance, something nearer, or something farther; one
    at its edge counts less, since a matcher spreads disparity beyond edges.

    Args:
        poses: The poses.
        views: Maps of the class.
        samples: Of the box.
        noise: Of the disparity.
        surface: Of the instances.
        step: Only every ``step``-th row and column is looked at.
        fine: Go between the headings of the maps, which takes twice as long.
    """
    cut = np.s_[::step, ::step]
    ray = samples.ray[cut].reshape(-1, 3)
    seen, background = samples.disparity_px[cut].ravel(), samples.log_background[cut].ravel()
    distance, bearing, heading, log_scale = poses.place.astype(np.float32).T[..., None]
    scale = np.exp(log_scale)
    sin, cos = np.sin(bearing), np.cos(bearing)
    forward = ray[:, 0] * sin + ray[:, 1] * cos
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(forward > 0, distance / forward, np.float32(0))
    across = depth * (ray[:, 0] * cos - ray[:, 1] * sin)
    up = depth * ray[:, 2] + np.float32(samples.seen_from.ground.height_m)
    at = (poses.shape, (distance / scale)[:, 0], heading[:, 0], across / scale, up / scale)
    relief, inset = _between_headings(views, *at) if fine else _at_heading(views, *at)
    fb = np.float32(samples.seen_from.stereo.focal_baseline)
    predicted = fb * forward / (distance + relief * scale)
    spread = np.sqrt(noise.sd_px**2 + (predicted * (surface.shape_m / distance)) ** 2)
    residual = (seen - predicted) / spread
    other = np.where(residual > 0, np.float32(surface.before), np.float32(surface.behind)) / noise.largest_px
    share = np.float32((1 - surface.before) / np.sqrt(2 * np.pi))
    density = share * np.exp(-0.5 * residual * residual) / spread + other
    focal = np.float32(samples.seen_from.stereo.left.fx_px)
    margin = np.maximum(noise.bleeding_px * distance / focal, np.float32(1e-3))
    weight = np.clip(inset * scale / margin, 0, 1) * np.float32(samples.weight)
    ratio = np.where(np.isfinite(residual), (np.log(density) - background) * weight, np.float32(0))
    return Explained(ratio, predicted, spread, residual, weight)


def attainable(explained: Explained, samples: BoxSamples, surface: SurfaceNoise) -> float:
    """Log likelihood ratio, in nats, of an instance whose surface lies exactly where all is measured.

    It is the most that ``explained.log_ratio`` of one pose, on the grid of the samples, can sum to. A narrow
    rig, a far object and one low above the ground have less of it, however well the instance fits.
    """
    on = np.isfinite(explained.residual)
    peak = (1 - surface.before) / (np.sqrt(2 * np.pi) * explained.spread_px[on])
    return float((explained.weight[on] * (np.log(peak) - samples.log_background[on])).sum())


def _at_heading(
    views: DepthViews,
    shape: IntArray,
    distance_m: Float32Array,
    heading_rad: Float32Array,
    across_m: Float32Array,
    up_m: Float32Array,
) -> tuple[Float32Array, Float32Array]:
    """Relief and inset (m, n) of the nearest maps."""
    return views.look_up(shape, *views.nearest(distance_m, heading_rad), across_m, up_m)


def _between_headings(
    views: DepthViews,
    shape: IntArray,
    distance_m: Float32Array,
    heading_rad: Float32Array,
    across_m: Float32Array,
    up_m: Float32Array,
) -> tuple[Float32Array, Float32Array]:
    """Relief and inset (m, n) between the maps of two headings, or of the nearer one where one is empty."""
    turn = np.float32(2 * np.pi / views.headings)
    share = (heading_rad / turn - np.floor(heading_rad / turn))[:, None]
    low = np.floor(heading_rad / turn) * turn
    (one, one_inset), (two, two_inset) = (
        _at_heading(views, shape, distance_m, heading, across_m, up_m) for heading in (low, low + turn)
    )
    mixed = (1 - share) * one + share * two
    nearer = np.where(share < np.float32(0.5), one, two)
    relief = np.where(np.isnan(mixed), nearer, mixed)
    inset = np.where(np.isnan(relief), np.float32(0), (1 - share) * one_inset + share * two_inset)
    return relief, inset
