"""How well 3D boxes agree: overlaps from above and in space, and errors of place, size and heading.

Boxes are paired row by row; a pair with a row that holds no box overlaps by 0 and has NaN errors. As in
KITTI's evaluation (Geiger, Lenz, Urtasun 2012) a box stands upright in the camera's frame: its footprint
lies in the plane of x and z, its height along y. Errors are those of nuScenes' true positives (Caesar et al.
2020).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray, IntArray
from recon.localization.standing_box import wrapped
from rescore.data.boxes3d import Boxes3D

_CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
"""Corners of a footprint as shares of length and width, counter-clockwise."""


def box_overlaps(a: Boxes3D, b: Boxes3D) -> tuple[FloatArray, FloatArray]:
    """Intersection over union of each a with the b of its row, from above and in space, shapes (n,)."""
    both = a.known & b.known
    from_above, in_space = np.zeros(len(a)), np.zeros(len(a))
    from_above[both], in_space[both] = _known_overlaps(a[both], b[both])
    return from_above, in_space


def _known_overlaps(a: Boxes3D, b: Boxes3D) -> tuple[FloatArray, FloatArray]:
    plane = _shared_footprint(a, b)
    area_a, area_b = (np.prod(x.size_m[:, :2], axis=1) for x in (a, b))
    volume_a, volume_b = (np.prod(x.size_m, axis=1) for x in (a, b))
    top = np.maximum(*(x.centre_cam_m[:, 1] - x.size_m[:, 2] / 2 for x in (a, b)))
    bottom = np.minimum(*(x.centre_cam_m[:, 1] + x.size_m[:, 2] / 2 for x in (a, b)))
    shared = plane * np.clip(bottom - top, 0, None)
    return plane / (area_a + area_b - plane), shared / (volume_a + volume_b - shared)


def footprint_shares(a: Boxes3D, b: Boxes3D) -> FloatArray:
    """Share of the smaller footprint that lies in the other, of each a and the b of its row, shape (n,)."""
    both, shares = a.known & b.known, np.zeros(len(a))
    smaller = np.minimum(*(np.prod(x.size_m[both][:, :2], axis=1) for x in (a, b)))
    shares[both] = _shared_footprint(a[both], b[both]) / smaller
    return shares


def _shared_footprint(a: Boxes3D, b: Boxes3D) -> FloatArray:
    """Area that two footprints share (n,): that of a, cut by the four sides of b in the frame of b."""
    from rescore.metrics.box_loops import areas_within  # noqa: PLC0415 (compiles a loop)

    relative = _turned(a.centre_cam_m[:, ::2] - b.centre_cam_m[:, ::2], b.rotation_y_rad)
    corners = _CORNERS * a.size_m[:, None, :2]
    polygon = _turned(corners, (b.rotation_y_rad - a.rotation_y_rad)[:, None]) + relative[:, None, :]
    return np.asarray(areas_within(polygon, b.size_m[:, :2] / 2))


def _turned(xz: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Vectors (..., 2) of the plane of x and z turned by angles (...), counter-clockwise from x to z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([c * xz[..., 0] - s * xz[..., 1], s * xz[..., 0] + c * xz[..., 1]], axis=-1)


@dataclass(frozen=True, eq=False)
class BoxErrors:
    """Errors of 3D boxes against the true ones, NaN where one of the two is missing; each of shape (n,)."""

    translation_m: FloatArray
    """Distance of the centres along the ground: nuScenes' translation error."""
    scale: FloatArray
    """1 less the IoU of the two boxes with centres and headings aligned: nuScenes' scale error."""
    orientation_rad: FloatArray
    """Angle between the noses, in [0, pi]: nuScenes' orientation error."""

    def __getitem__(self, rows: BoolArray | IntArray) -> "BoxErrors":
        """The rows of a mask or an index."""
        return BoxErrors(self.translation_m[rows], self.scale[rows], self.orientation_rad[rows])

    @staticmethod
    def joined(parts: "Sequence[BoxErrors]") -> "BoxErrors":
        """The errors of one part below those of the other."""
        names = ("translation_m", "scale", "orientation_rad")
        return BoxErrors(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))


def box_errors(found: Boxes3D, true: Boxes3D) -> BoxErrors:
    """The errors of each box against the true one of its row."""
    apart = found.centre_cam_m - true.centre_cam_m
    shared = np.prod(np.minimum(found.size_m, true.size_m), axis=1)
    union = np.prod(found.size_m, axis=1) + np.prod(true.size_m, axis=1) - shared
    return BoxErrors(
        translation_m=np.hypot(apart[:, 0], apart[:, 2]),
        scale=1 - shared / union,
        orientation_rad=np.abs(wrapped(found.rotation_y_rad - true.rotation_y_rad)),
    )
