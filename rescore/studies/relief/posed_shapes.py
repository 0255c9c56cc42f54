"""Shapes of a shape space in a pose: the disparity that they predict, and the likeliest ones near a start."""

from dataclasses import dataclass, replace

import numpy as np

from recon.arrays import FloatArray, IntArray
from recon.camera import GroundedStereo, StereoCamera
from recon.localization.depth_views import DepthViewsConfig, first_coefficients, first_hit
from recon.localization.disparity_fit import PlacedInstance
from recon.localization.standing_box import cam_from_ground, turn
from recon.shape_space import ShapeSpace
from rescore.studies.relief.likelihood import MeasurementNoise


@dataclass(frozen=True, eq=False)
class PosedShape:
    """A shape of a space, and where it stands."""

    space: ShapeSpace
    cam_from_object: FloatArray
    """Pose (4, 4) with the origin on the ground below the middle, metres."""
    coefficients: FloatArray
    """Shape (k,)."""
    size_m: FloatArray
    """Length, width and height, shape (3,)."""

    def disparity_px(self, uv_px: FloatArray, stereo: StereoCamera) -> FloatArray:
        """Disparity (n,) at pixels (n, 2); NaN where the shape is not seen."""
        rays = stereo.left.rays(uv_px)
        reach = np.linalg.norm(rays, axis=1)
        rotation = self.cam_from_object[:3, :3]
        origin = np.broadcast_to(-rotation.T @ self.cam_from_object[:3, 3], rays.shape)
        hull = self.space.hull(self.coefficients)
        ahead = first_hit(self.space, hull, self.size_m, origin, rays / reach[:, None] @ rotation)
        return np.asarray(stereo.focal_baseline * reach / ahead)

    def moved(self, step: FloatArray) -> "PosedShape":
        """The shape after a step (7 + k,).

        Its numbers: along the line of sight and across it in metres, turn of the heading in radians,
        logarithm of the size, logarithms of length, width and height beside that, coefficients.
        """
        pose, up, place = (
            self.cam_from_object.copy(),
            self.cam_from_object[:3, 2],
            self.cam_from_object[:3, 3],
        )
        ahead = place - (place @ up) * up
        ahead = ahead / np.linalg.norm(ahead)
        pose[:3, :3] = pose[:3, :3] @ about_up(float(step[2]))
        pose[:3, 3] = place + step[0] * ahead + step[1] * np.cross(ahead, up)
        size = self.size_m * np.exp(step[3] + step[4:7])
        return replace(self, cam_from_object=pose, coefficients=self.coefficients + step[7:], size_m=size)


def about_up(angle_rad: float) -> FloatArray:
    """Rotation (3, 3) about z, counter-clockwise seen from above."""
    rotation = np.eye(3)
    rotation[:2, :2] = turn(angle_rad)
    return rotation


def posed_instance(
    placed: PlacedInstance, space: ShapeSpace, config: DepthViewsConfig, seen_from: GroundedStereo
) -> PosedShape:
    """The shape that a fit has placed."""
    ground, box = cam_from_ground(seen_from.ground), placed.box
    pose = np.eye(4)
    pose[:3, :3], pose[:2, 3] = about_up(box.yaw_rad), box.xy_m
    return PosedShape(space, ground @ pose, fit_shapes(space, config)[int(placed.pose.shape[0])], box.size_m)


def fit_shapes(space: ShapeSpace, config: DepthViewsConfig) -> FloatArray:
    """Coefficients of the shapes that the fit tries, shape (shapes, k)."""
    return np.stack([first_coefficients(space, first) for first in config.coefficients])


NONE_FREE = (0.0,) * 7
POSE_FREE = (0.5, 0.3, 0.2, 0.05, 0.0, 0.0, 0.0)
"""Standard deviations around a start of the first seven numbers of ``PosedShape.moved``, 0 for those that are
held: here its pose and its size as a whole."""
ALL_FREE = (0.5, 0.3, 0.2, 0.05, 0.03, 0.03, 0.03)


@dataclass(frozen=True, eq=False)
class Climb:
    """The likeliest shape near a start, by expectation and maximisation with Gauss-Newton steps."""

    uv_px: FloatArray
    """Pixels, shape (n, 2)."""
    disparity_px: FloatArray
    """What is to be explained there, shape (n,)."""
    weight: float
    """Number of independent measurements that one of them counts as."""
    stereo: StereoCamera
    noise: MeasurementNoise

    def climbed(self, start: PosedShape, free: tuple[float, ...], shape_sd: float) -> PosedShape:
        """The shape that a start leads to; never a less likely one.

        Args:
            start: Where climbing begins.
            free: Standard deviations around the start of the first seven numbers of ``PosedShape.moved``, 0
                for those that are held.
            shape_sd: Those of the coefficients around the mean shape; 0 holds them.
        """
        k = start.space.count
        sd = np.array([*free, *[shape_sd] * k])
        home = np.concatenate([np.zeros(7), -start.coefficients])
        target = _Target(sd, home, np.flatnonzero(sd > 0), _probes(k))
        step, damping = np.zeros(len(sd)), 1.0
        predicted = start.disparity_px(self.uv_px, self.stereo)
        value = self._value(predicted, step, target)
        for _ in range(_ROUNDS):
            tried = step + damping * self._newton(start, step, predicted, target)
            at = start.moved(tried).disparity_px(self.uv_px, self.stereo)
            gain = self._value(at, tried, target) - value
            if gain > 0:
                step, predicted, value = tried, at, value + gain
            if 0 < gain < _SMALL_GAIN or damping < _LEAST_DAMPING:
                break
            damping = min(1.0, 2 * damping) if gain > 0 else damping / 4
        return start.moved(step)

    def _value(self, predicted: FloatArray, step: FloatArray, target: "_Target") -> float:
        """Log posterior up to a constant."""
        off = (step - target.home)[target.free] / target.sd[target.free]
        likelihood = self.noise.log_density(self.disparity_px - predicted).sum()
        return float(self.weight * likelihood - np.square(off).sum() / 2)

    def _newton(
        self, start: PosedShape, step: FloatArray, predicted: FloatArray, target: "_Target"
    ) -> FloatArray:
        """The step to the best of a quadratic, with what is measured trusted as it is now."""
        columns = []
        for i in target.free:
            beside = step.copy()
            beside[i] += target.probe[i]
            moved = start.moved(beside).disparity_px(self.uv_px, self.stereo)
            columns.append((moved - predicted) / target.probe[i])
        # where a shape is not seen, small steps do not tell which way to go
        slope = np.nan_to_num(np.stack(columns, axis=1))
        residual = self.disparity_px - predicted
        trust = self.noise.trust(residual) * self.weight / self.noise.sd_px**2
        precision = 1 / target.sd[target.free] ** 2
        pull = (target.home - step)[target.free] * precision
        system = (slope * trust[:, None]).T @ slope + np.diag(precision)
        found = np.zeros(len(step))
        found[target.free] = np.linalg.solve(system, slope.T @ (trust * np.nan_to_num(residual)) + pull)
        return found


@dataclass(frozen=True, eq=False)
class _Target:
    """What is free in a climb, each array of shape (7 + k,) but ``free``."""

    sd: FloatArray
    home: FloatArray
    """Step to the middle of the prior."""
    free: IntArray
    probe: FloatArray
    """Steps by which slopes are measured."""


_ROUNDS = 12
_SMALL_GAIN = 0.01
_LEAST_DAMPING = 0.01


def _probes(k: int) -> FloatArray:
    return np.array([0.04, 0.04, 0.02, 0.01, 0.01, 0.01, 0.01, *[0.2] * k])
