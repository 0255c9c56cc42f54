"""Boxes that stand on the ground, the ground frame, and how well two boxes agree (section 5.1).

The ground frame has its origin on the ground below the camera: x right, y away from the camera, z up, metres.
"""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray
from recon.camera import GroundPlane, cross


def cam_from_ground(ground: GroundPlane) -> FloatArray:
    """The pose (4, 4) of the ground frame in the camera frame."""
    up, right = ground.up, ground.right
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, cross(up, right), up], axis=1)
    pose[:3, 3] = -ground.height_m * up
    return pose


@dataclass(frozen=True, eq=False)
class StandingBox:
    """A box with its bottom on the ground, in the ground frame."""

    xy_m: FloatArray
    """Middle of the footprint, shape (2,)."""
    yaw_rad: float
    """Direction of its length (of the nose, where the front is known), counter-clockwise from x."""
    size_m: FloatArray
    """Length, width and height, shape (3,), positive."""

    def __post_init__(self) -> None:
        if self.xy_m.shape != (2,) or self.size_m.shape != (3,) or not (self.size_m > 0).all():
            raise ValueError(f"standing box: {self.xy_m}, {self.size_m}")

    @property
    def centroid_m(self) -> FloatArray:
        """Centre of the box, shape (3,)."""
        return np.append(self.xy_m, self.size_m[2] / 2)

    @property
    def footprint_m(self) -> FloatArray:
        """Corners on the ground, shape (4, 2), counter-clockwise from the front left one."""
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * self.size_m[:2] / 2
        return np.asarray(half @ turn(self.yaw_rad).T + self.xy_m)

    @property
    def corners_m(self) -> FloatArray:
        """The bottom corners, then the top ones, shape (8, 3)."""
        foot = self.footprint_m
        return np.concatenate([np.insert(foot, 2, z, axis=1) for z in (0.0, self.size_m[2])])


def turn(yaw_rad: float) -> FloatArray:
    """Rotation (2, 2) of the plane, counter-clockwise."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s], [s, c]])


def volume_overlap(a: StandingBox, b: StandingBox) -> float:
    """Volume of the intersection over the volume of the union of two boxes, in [0, 1]."""
    plane = polygon_area(clip_convex(a.footprint_m, b.footprint_m))
    both = plane * min(a.size_m[2], b.size_m[2])
    return float(both / (a.size_m.prod() + b.size_m.prod() - both))


def clip_convex(polygon: FloatArray, window: FloatArray) -> FloatArray:
    """The part of a convex polygon (n, 2) inside a convex one (m, 2), both counter-clockwise; may be empty.

    After I. E. Sutherland and G. W. Hodgman, "Reentrant polygon clipping", Comm. ACM 17(1), 1974.
    """
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        if not len(polygon):
            break
        edge = end - start
        left = edge[0] * (polygon[:, 1] - start[1]) - edge[1] * (polygon[:, 0] - start[0])
        polygon = _cut(polygon, left)
    return polygon


def _cut(polygon: FloatArray, side: FloatArray) -> FloatArray:
    """The part of a polygon (n, 2) where a linear function with these values (n,) is not negative."""
    after, side_after = np.roll(polygon, -1, axis=0), np.roll(side, -1)
    rows: list[FloatArray] = []
    for p, q, a, b in zip(polygon, after, side, side_after, strict=True):
        if a >= 0:
            rows.append(p)
        if (a >= 0) != (b >= 0):
            rows.append(p + (q - p) * (a / (a - b)))
    return np.array(rows).reshape(-1, 2)


def polygon_area(polygon: FloatArray) -> float:
    """Area of a polygon (n, 2), positive where it runs counter-clockwise; 0 for fewer than three corners."""
    if len(polygon) < 3:
        return 0.0
    x, y = polygon.T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def wrapped(angle_rad: FloatArray) -> FloatArray:
    """Angles brought into [-pi, pi) by whole turns."""
    return np.asarray((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def angle_between(a_rad: float, b_rad: float, period_rad: float = 2 * np.pi) -> float:
    """Absolute difference of two angles in [0, period / 2]."""
    return float(abs((a_rad - b_rad + period_rad / 2) % period_rad - period_rad / 2))
