"""Poses of instances of a class on the ground: what each predicts of a box and of disparity."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray
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

    @staticmethod
    def concatenate(parts: "Sequence[Poses]") -> "Poses":
        """The poses of all parts, in their order."""
        return Poses(np.concatenate([p.place for p in parts]), np.concatenate([p.shape for p in parts]))

    def standing_box(self, i: int, views: DepthViews) -> StandingBox:
        """The bounding box of one."""
        distance, bearing, heading, _ = self.place[i]
        xy = distance * np.array([np.sin(bearing), np.cos(bearing)])
        return StandingBox(xy, float(heading - bearing), self.size_m(views)[i])


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
    """What one pose says of the samples (rows, columns) of its box."""

    log_ratio: Float32Array
    """Log likelihood of each measurement over that of the background, by the independent measurements that a
    sample counts as; 0 beside the silhouette and where nothing is measured."""
    disparity_px: Float32Array
    """Predicted; NaN beside the silhouette."""
    spread_px: Float32Array
    """Standard deviation of what is measured around what is predicted; NaN as that is."""
    residual: Float32Array
    """Measured less predicted disparity in standard deviations; NaN as both are."""
    weight: Float32Array
    """Number of independent measurements that a sample counts as."""


class PoseLikelihood:
    """The log likelihood ratio of the samples of boxes under poses.

    A sample within the silhouette is the surface of the instance, something nearer, or something farther; one
    at its edge counts less, since a matcher spreads disparity beyond edges.
    """

    def __init__(
        self,
        views: DepthViews,
        samples: Sequence[BoxSamples],
        noise: DisparityNoise,
        surface: SurfaceNoise,
    ) -> None:
        """Args:
        views: Maps of the class.
        samples: Of each box, at least one; all of one rig.
        noise: Of the disparity.
        surface: Of the instances.
        """
        from recon.localization import pose_loops as loops  # noqa: PLC0415 (Numba takes half a second)

        rig = samples[0].seen_from
        left = rig.stereo.left
        self._loops, self._samples = loops, {1: _flat(samples, 1)}
        self._boxes = samples
        self._maps = loops.Maps(
            views.relief_m.ravel(),
            views.inset_m.ravel(),
            views.extent_m.ravel(),
            views.border_m,
            len(views.distance_m),
            views.headings,
            views.relief_m.shape[3],
            views.relief_m.shape[4],
            views.ground_row,
            views.step_m,
        )
        camera = (left.fx_px, left.fy_px, left.cx_px, left.cy_px, left.width_px, left.height_px)
        lengths = (rig.stereo.focal_baseline, rig.ground.height_m)
        self._rig = loops.Rig(cam_from_ground(rig.ground), *(float(v) for v in (*camera, *lengths)))
        self._noise = loops.Noise(
            noise.sd_px,
            noise.bleeding_px,
            surface.shape_m,
            float((1 - surface.before) / np.sqrt(2 * np.pi)),
            surface.before / noise.largest_px,
            surface.behind / noise.largest_px,
        )

    def scan(
        self, poses: Poses, owner: IntArray, step: int = 1, *, fine: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """The box around the silhouette of each pose (m, 4), and the sum of its log ratios (m,).

        Boxes are pixel edges, cut off at the picture's edge; what reaches behind the camera has the whole
        picture as its box.

        Args:
            poses: The poses.
            owner: Index of the box whose samples each pose is asked about, shape (m,).
            step: Only every ``step``-th row and column is looked at, and counts for those between.
            fine: Go between the headings of the maps, which takes twice as long.
        """
        if step not in self._samples:
            self._samples[step] = _flat(self._boxes, step)
        boxes, ratio = np.empty((len(poses), 4)), np.empty(len(poses))
        arrays = (poses.place, poses.shape, owner, self._maps, self._samples[step], self._rig, self._noise)
        self._loops.scan(*arrays, fine, boxes, ratio)
        return boxes, ratio * step**2

    def explained(self, pose: Poses, owner: int) -> Explained:
        """What one pose says of each sample of its box, between the headings of the maps."""
        found = np.empty((5, *self._boxes[owner].known.shape), np.float32)
        arrays = (self._maps, self._samples[1], self._rig, self._noise)
        self._loops.look(pose.place[0], int(pose.shape[0]), owner, *arrays, found)
        return Explained(*found)


def _flat(samples: Sequence[BoxSamples], step: int) -> Any:
    """Every ``step``-th row and column of the samples of boxes, as the loops want them."""
    from recon.localization.pose_loops import Samples  # noqa: PLC0415 (Numba takes half a second)

    cut = np.s_[::step, ::step]
    uv, ray = np.stack([s.uv_px[cut] for s in samples]), np.stack([s.ray[cut] for s in samples])
    right, away, up = np.moveaxis(ray, -1, 0)
    return Samples(
        right.ravel(),
        away.ravel(),
        up.ravel(),
        np.stack([s.disparity_px[cut] for s in samples]).ravel(),
        np.stack([s.log_background[cut] for s in samples]).ravel(),
        uv.shape[1],
        uv.shape[2],
        np.concatenate([uv[:, 0, 0], uv[:, -1, -1]], axis=1),
        np.array([s.weight for s in samples]),
    )


def attainable(explained: Explained, samples: BoxSamples, surface: SurfaceNoise) -> float:
    """Log likelihood ratio, in nats, of an instance whose surface lies exactly where all is measured.

    It is the most that ``explained.log_ratio`` can sum to. A narrow
    rig, a far object and one low above the ground have less of it, however well the instance fits.
    """
    on = np.isfinite(explained.residual)
    peak = (1 - surface.before) / (np.sqrt(2 * np.pi) * explained.spread_px[on])
    return float((explained.weight[on] * (np.log(peak) - samples.log_background[on])).sum())
