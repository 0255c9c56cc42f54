"""The single-plane baseline of section 5.1, after Hoiem et al. 2005: one vertical surface for the object."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.errors import Failure, Reason
from recon.localization.standing_box import cam_from_ground
from recon.outlines import fill_polygon


@dataclass(frozen=True, eq=False)
class SinglePlane:
    """The object as one vertical surface. It has no depth along its normal, so no bounding box."""

    plane: FloatArray
    """(a, b, c, d), shape (4,), camera frame, metres; the unit normal is level and faces the camera."""
    outline_m: FloatArray
    """The object's outline (m, 3) on the plane."""
    centroid_m: FloatArray
    """Area centroid of the outline on the plane, shape (3,)."""
    yaw_rad: float
    """Direction of the surface on the ground about the up axis, from the camera's right, in [-pi/2, pi/2)."""

    def on_ground(self, ground: GroundPlane) -> "UprightSurface":
        """The surface with its place and direction in the ground frame."""
        pose = cam_from_ground(ground)
        return UprightSurface((self.centroid_m - pose[:3, 3]) @ pose[:3, :3], self.yaw_rad)


@dataclass(frozen=True, eq=False)
class UprightSurface:
    """Place and direction of a vertical surface in the ground frame; it has no box and no front."""

    centroid_m: FloatArray
    """Shape (3,)."""
    yaw_rad: float
    """Direction of its ground line, in [-pi/2, pi/2)."""


def lower_edge(mask: BoolArray) -> FloatArray | Failure:
    """The ground line (2, 2) of a region (h, w), pixel centres, fitted to each column's lowest pixel.

    It ends in the first and last column of the region.
    """
    columns = np.nonzero(mask.any(axis=0))[0]
    if len(columns) < 2:
        return Failure(Reason.NO_OUTLINE, f"a region of two columns or more expected, got {len(columns)}")
    lowest = mask.shape[0] - 1 - np.argmax(mask[::-1, columns], axis=0) + 0.5
    slope, offset = np.polyfit(columns.astype(float), lowest, 1)
    ends = columns[[0, -1]].astype(float)
    return np.stack([ends, slope * ends + offset], axis=1)


def single_plane(
    outline_px: FloatArray, ground_line_px: FloatArray, seen_from: GroundedCamera
) -> SinglePlane | Failure:
    """The vertical surface that stands on the ground line of an object and shows its outline.

    Args:
        outline_px: closed outline (m, 2), pixel centres.
        ground_line_px: two points (2, 2) of the line where the object touches the ground.
        seen_from: the camera M and the ground plane Q_g.
    """
    a, b = seen_from.ground_points_m(ground_line_px)
    if not np.isfinite([a, b]).all():
        return Failure(
            Reason.ABOVE_HORIZON,
            "a ground line below the horizon expected, got rows "
            f"{np.round(ground_line_px[:, 1], 1).tolist()}",
        )
    along, up = b - a, seen_from.ground.up
    normal = np.cross(along, up)
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        return Failure(Reason.NO_GROUND_CONTACT, "a ground line of two points expected, got one point")
    normal /= length
    normal = -normal if normal @ a > 0 else normal
    plane = np.append(normal, -normal @ a)
    rows, cols = np.nonzero(_inside(outline_px))
    uv = np.stack([cols, rows], axis=1) + np.floor(outline_px.min(axis=0))
    outline, inner = _lift(outline_px, plane, seen_from.camera), _lift(uv, plane, seen_from.camera)
    if outline is None or inner is None:
        return Failure(
            Reason.PARTS_NOT_PLACED, "a surface before the camera expected, the ground line is too steep"
        )
    # a pixel covers more of the surface where it is far: z^3 / |d|, up to what all pixels share
    centroid = np.average(inner, axis=0, weights=inner[:, 2] ** 3)
    right = np.array([1.0, 0.0, 0.0]) - up[0] * up
    yaw = float(np.arctan2(along @ np.cross(up, right), along @ right))
    return SinglePlane(plane, outline, centroid, (yaw + np.pi / 2) % np.pi - np.pi / 2)


def _inside(outline_px: FloatArray) -> BoolArray:
    low = np.floor(outline_px.min(axis=0))
    width, height = (np.ceil(outline_px.max(axis=0)) - low + 1).astype(int).tolist()
    return fill_polygon(outline_px - low, height, width)


def _lift(uv_px: FloatArray, plane: FloatArray, camera: PinholeCamera) -> FloatArray | None:
    """Points (m, 3) of pixels (m, 2) on a plane; None where a ray misses it."""
    rays = camera.rays(uv_px)
    with np.errstate(divide="ignore"):
        z = -plane[3] / (rays @ plane[:3])
    return rays * z[:, None] if (np.isfinite(z) & (z > 0)).all() else None
