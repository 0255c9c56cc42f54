"""Errors of reconstructed objects against their truth: centroid, size by axis, orientation."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray
from recon.camera import GroundPlane
from recon.localization.single_plane import SinglePlane
from recon.reconstruction.instance import Instance3D


@dataclass(frozen=True, eq=False)
class BoxTruth:
    """Where an object is and how large."""

    cam_from_object: FloatArray
    """Pose (4, 4), metres: object frame (x forward, y left, z up) to camera frame."""
    low_m: FloatArray
    """Lowest corner (3,) of the object's box in its own frame."""
    high_m: FloatArray
    """Highest corner (3,)."""

    @property
    def size_m(self) -> FloatArray:
        """Length, width, height, shape (3,)."""
        return self.high_m - self.low_m

    @property
    def centroid_m(self) -> FloatArray:
        """Middle of the box (3,), camera frame."""
        middle = (self.low_m + self.high_m) / 2
        return np.asarray(self.cam_from_object[:3, :3] @ middle + self.cam_from_object[:3, 3])


@dataclass(frozen=True, eq=False)
class InstanceErrors:
    """Errors of one estimate."""

    centroid_share: float
    """Distance of the centroids in units of the largest true size."""
    size_share: FloatArray | None
    """Estimated over true size minus 1, along length, width and height, shape (3,); None for a surface."""
    orientation_deg: float
    """Angle of the headings on the ground in [0, 180]; of a surface, which has no front, in [0, 90]."""


def instance_errors(instance: Instance3D, truth: BoxTruth) -> InstanceErrors:
    """Errors of a 3D instance."""
    nose = truth.cam_from_object[:3, :3].T @ instance.cam_from_object[:3, 0]
    return InstanceErrors(
        _centroid_share(instance.centroid_m, truth),
        instance.size_m / truth.size_m - 1,
        float(np.degrees(abs(np.arctan2(nose[1], nose[0])))),
    )


def surface_errors(surface: SinglePlane, truth: BoxTruth, ground: GroundPlane) -> InstanceErrors:
    """Errors of the single-plane baseline; its direction is compared with the object's length."""
    right = np.array([1.0, 0.0, 0.0]) - ground.up[0] * ground.up
    away = np.cross(ground.up, right)
    along = np.cos(surface.yaw_rad) * right + np.sin(surface.yaw_rad) * away
    local = truth.cam_from_object[:3, :3].T @ along
    return InstanceErrors(
        _centroid_share(surface.centroid_m, truth),
        None,
        float(np.degrees(np.arctan2(abs(local[1]), abs(local[0])))),
    )


def _centroid_share(centroid_m: FloatArray, truth: BoxTruth) -> float:
    return float(np.linalg.norm(centroid_m - truth.centroid_m) / truth.size_m.max())
