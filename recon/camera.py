"""Cameras and the ground plane.

Conventions, here and everywhere:

- camera frame: x right, y down, z forward, metres; depth is z, never ray length;
- pixel coordinates ``uv_px`` have integer values at pixel centres (OpenCV), and ``K`` is in that convention;
- boxes use pixel edges instead (COCO): column ``j`` covers ``[j, j + 1)``. ``uv_px = edge - 0.5``.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray
from recon.errors import RescoreError


@dataclass(frozen=True)
class PinholeCamera:
    """An ideal pinhole camera: the 3 x 4 matrix M of eq. 2 is ``[K | 0]`` in its own frame."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        if not (self.fx_px > 0 and self.fy_px > 0 and self.width_px > 0 and self.height_px > 0):
            raise RescoreError(
                f"camera: focal lengths and sizes must be positive, got {self}; check the calibration"
            )

    @property
    def matrix(self) -> FloatArray:
        """K, shape (3, 3)."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1]], dtype=float)

    def rays(self, uv_px: FloatArray) -> FloatArray:
        """Viewing rays with z = 1, so that depth times ray is the point; (..., 2) pixels to (..., 3)."""
        rays = np.ones((*uv_px.shape[:-1], 3))
        rays[..., 0] = (uv_px[..., 0] - self.cx_px) / self.fx_px
        rays[..., 1] = (uv_px[..., 1] - self.cy_px) / self.fy_px
        return rays

    def project(self, xyz_cam_m: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in front of the camera (eqs. 3 and 4)."""
        z = xyz_cam_m[..., 2]
        u = self.fx_px * xyz_cam_m[..., 0] / z + self.cx_px
        v = self.fy_px * xyz_cam_m[..., 1] / z + self.cy_px
        return np.stack([u, v], axis=-1)


@dataclass(frozen=True)
class StereoCamera:
    """A rectified pair; the right eye stands ``baseline_m`` along +x of the left camera."""

    left: PinholeCamera
    baseline_m: float

    def __post_init__(self) -> None:
        if not self.baseline_m > 0:
            raise RescoreError(
                f"camera: baseline_m must be positive metres, got {self.baseline_m}; "
                "left and right may be swapped"
            )

    @property
    def focal_baseline(self) -> float:
        """Focal length times baseline in px * m: disparity times depth."""
        return self.left.fx_px * self.baseline_m

    def depth_m(self, disparity_px: NDArray[np.floating]) -> Float32Array:
        """Depth in metres; NaN where the disparity is NaN or not positive."""
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = self.focal_baseline / disparity_px
        return np.where(disparity_px > 0, depth, np.nan).astype(np.float32)

    def disparity_px(self, depth_m: NDArray[np.floating]) -> Float32Array:
        """Disparity in pixels; NaN where the depth is NaN or not positive."""
        return self.depth_m(depth_m)

    def exact_depth_m(self, disparity_px: FloatArray) -> FloatArray:
        """Depth in metres of positive disparities in double precision, for further arithmetic."""
        return np.asarray(self.focal_baseline / disparity_px)

    def exact_disparity_px(self, depth_m: FloatArray | float) -> FloatArray:
        """Disparity in pixels of positive depths in double precision, for further arithmetic."""
        return np.asarray(self.focal_baseline / depth_m)

    def disparity_rays(self, uv_px: FloatArray) -> FloatArray:
        """Viewing rays with z = focal length times baseline, (..., 2) pixels to (..., 3) in px m.

        A plane ``normal . X + distance = 0`` has the disparity ``-(ray . normal) / distance`` there.
        """
        return self.left.rays(uv_px) * self.focal_baseline


@dataclass(frozen=True)
class DepthCamera:
    """A camera that measures depth without a pair, or whose pair is unknown."""

    left: PinholeCamera
    """Camera of the picture that depth is registered to."""


MOST_HEIGHT_M = 200.0
"""Height in metres up to which a camera is said to stand: a mast or a drone, and no millimetres."""


@dataclass(frozen=True)
class GroundPlane:
    """The ground Qg of eq. 5 as height and angles of the camera: ``up . X + height_m = 0`` in its frame."""

    height_m: float
    """Distance of the camera from the plane."""
    pitch_rad: float = 0.0
    """Positive when the camera looks down."""
    roll_rad: float = 0.0
    """Positive when the camera leans to its right, so that the ground is nearer there."""

    def __post_init__(self) -> None:
        if not self.height_m > 0:
            raise RescoreError(
                f"ground plane: the camera must be above the ground, got height_m={self.height_m}"
            )

    @staticmethod
    def stated(height_m: float, pitch_rad: float | None, roll_rad: float | None) -> "GroundPlane":
        """A plane that a user states, level where no angle is.

        Raises:
            RescoreError: the height or an angle can be none in metres and radians.
        """
        for name, angle in (("pitch_rad", pitch_rad or 0.0), ("roll_rad", roll_rad or 0.0)):
            if not abs(angle) < np.pi / 2:
                raise RescoreError(
                    f"ground plane: expected {name} below a right angle (1.57), got {angle:g}; write radians"
                )
        if height_m > MOST_HEIGHT_M:
            raise RescoreError(
                f"ground plane: expected height_m up to {MOST_HEIGHT_M:g} m, got {height_m:g}; write metres, "
                "not millimetres"
            )
        return GroundPlane(height_m, pitch_rad or 0.0, roll_rad or 0.0)

    @cached_property
    def up(self) -> FloatArray:
        """Unit normal (ag, bg, cg), pointing up, in the camera frame, shape (3,)."""
        level = np.cos(self.roll_rad)
        up = np.array(
            [0.0 - np.sin(self.roll_rad), -np.cos(self.pitch_rad) * level, -np.sin(self.pitch_rad) * level]
        )
        up.flags.writeable = False
        return up

    @property
    def right(self) -> FloatArray:
        """Unit vector along the ground to the right of the camera, in the camera frame, shape (3,)."""
        lean = 0.0 - np.sin(self.roll_rad)
        return np.array([np.cos(self.roll_rad), lean * np.cos(self.pitch_rad), lean * np.sin(self.pitch_rad)])

    def intersect(self, rays: FloatArray) -> FloatArray:
        """Points (..., 3) where rays (..., 3) meet the ground (eqs. 2 to 5); NaN on or above the horizon."""
        slope = rays @ self.up
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(slope < -1e-6, -self.height_m / slope, np.nan)
        return rays * t[..., None]


@dataclass(frozen=True)
class GroundedCamera:
    """Where a picture is seen from: a camera, and the ground plane in its frame."""

    camera: PinholeCamera
    """M; ``default_camera`` where none is known."""
    ground: GroundPlane
    """Q_g; ``DEFAULT_GROUND`` where none is known."""

    def ground_points_m(self, uv_px: FloatArray) -> FloatArray:
        """Ground points (..., 3) seen at pixels (..., 2), camera frame; NaN on or above the horizon."""
        return self.ground.intersect(self.camera.rays(uv_px))

    def level_direction(self, uv_px: FloatArray) -> FloatArray:
        """Unit direction (3,) along the ground towards what is seen at a pixel (2,), camera frame."""
        ray = self.camera.rays(uv_px)
        forward = ray - (ray @ self.ground.up) * self.ground.up
        return np.asarray(forward / np.sqrt(forward @ forward))

    def height_above_ground_m(self, uv_px: FloatArray, depth_m: FloatArray) -> FloatArray:
        """Height above the ground (...) in metres of what is seen at pixels (..., 2) at depths (...)."""
        return np.asarray(depth_m * (self.camera.rays(uv_px) @ self.ground.up) + self.ground.height_m)


@dataclass(frozen=True)
class GroundedStereo:
    """Where a rectified pair is seen from: the pair, and the ground plane in the frame of its left camera."""

    stereo: StereoCamera
    ground: GroundPlane

    @property
    def left(self) -> GroundedCamera:
        """Where the left picture is seen from."""
        return GroundedCamera(self.stereo.left, self.ground)

    def ground_disparity_px(self, uv_px: FloatArray) -> FloatArray:
        """Disparity (...) in pixels of the ground at pixels (..., 2); NaN on or above the horizon."""
        slope = self.stereo.left.rays(uv_px) @ self.ground.up
        return np.where(slope < 0, -slope * self.stereo.focal_baseline / self.ground.height_m, np.nan)

    def ground_disparity_of_picture(self) -> Float32Array:
        """Disparity in pixels of the ground at each pixel, (h, w); 0 or less on and above the horizon."""
        left, up = self.stereo.left, self.ground.up * (-self.stereo.focal_baseline / self.ground.height_m)
        across = (np.arange(left.width_px) - left.cx_px) / left.fx_px * up[0] + up[2]
        down = (np.arange(left.height_px) - left.cy_px) / left.fy_px * up[1]
        return np.asarray(np.add.outer(down.astype(np.float32), across.astype(np.float32)))


def default_camera(width_px: int, height_px: int) -> PinholeCamera:
    """The camera assumed where none is known, after Hoiem et al. 2005 (the report, section 6).

    Focal length 1.4 times the picture height (about 40 degrees vertically), principal point in the middle.
    """
    focal_px = 1.4 * height_px
    return PinholeCamera(focal_px, focal_px, (width_px - 1) / 2, (height_px - 1) / 2, width_px, height_px)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross product of two vectors (3,); ``np.cross`` takes ten times as long for one pair."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


DEFAULT_GROUND = GroundPlane(height_m=1.5, pitch_rad=0.0)
"""The ground assumed where none is known: an eye at 1.5 m, horizon in the middle of the picture."""
