"""3D boxes that stand upright, as arrays, and the two orders in which files hold them.

Camera frame: x right, y down, z forward, metres. The turn about the camera's y axis is KITTI's ``rotation_y``
(Geiger, Lenz, Urtasun 2012): 0 is a nose along +x, pi / 2 one that faces the camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray
from recon.errors import RescoreError
from recon.localization.standing_box import wrapped

CAMERA_UP = np.array([0.0, -1.0, 0.0])
"""Up as KITTI takes it: against the camera's y axis, shape (3,)."""
BoxValues = tuple[float, float, float, float, float, float, float]
"""One box in the order of ``bbox3d`` in files: x, y, z of the centre, length, width, height, rotation_y."""

BOX_NAMES = ("x", "y", "z", "length", "width", "height", "rotation_y")
"""Name of each of the seven numbers, for columns of tables."""


@dataclass(frozen=True, eq=False)
class Boxes3D:
    """The 3D boxes of n detections or cars, NaN in every column of a row that has none.

    Raises:
        RescoreError: a size that is not positive, a negative deviation, or a row that is known in part.
    """

    centre_cam_m: FloatArray
    """Middle of each box in the camera frame, shape (n, 3)."""
    size_m: FloatArray
    """Length, width and height, shape (n, 3), positive."""
    rotation_y_rad: FloatArray
    """Turn of the nose about the camera's y axis as KITTI has it, shape (n,): the nose points along
    (cos, 0, -sin)."""
    deviations: FloatArray | None = None
    """Standard deviations of ``values``, shape (n, 7), NaN where unknown; None where all are."""

    def __post_init__(self) -> None:
        n = len(self.rotation_y_rad)
        spread = (n, 7) if self.deviations is None else self.deviations.shape
        shapes = [self.centre_cam_m.shape, self.size_m.shape, self.rotation_y_rad.shape, spread]
        if shapes != [(n, 3), (n, 3), (n,), (n, 7)]:
            raise ValueError(f"3D boxes: {shapes}")
        _check_rows("3D box", self.values)
        if (self.size_m <= 0).any():
            bad = self.size_m[(self.size_m <= 0).any(axis=1)][0].tolist()
            raise RescoreError(f"3D box: expected length, width and height above 0, got {bad}; mend it")
        if self.deviations is not None:
            _check_rows("deviations of a 3D box", self.deviations)
            if (self.deviations < 0).any():
                raise RescoreError(
                    f"deviations of a 3D box: expected 0 or more, got {np.nanmin(self.deviations):g}; mend"
                )

    def __len__(self) -> int:
        return len(self.rotation_y_rad)

    def __getitem__(self, rows: NDArray[Any] | Sequence[int] | slice | int) -> "Boxes3D":
        """The rows of a mask, of indices or a slice; the row of one index as the only one."""
        rows = [int(rows)] if isinstance(rows, int | np.integer) else rows
        deviations = None if self.deviations is None else self.deviations[rows]
        if deviations is not None and np.isnan(deviations).all():
            deviations = None
        return Boxes3D(self.centre_cam_m[rows], self.size_m[rows], self.rotation_y_rad[rows], deviations)

    @property
    def known(self) -> BoolArray:
        """Mask of the rows that hold a box, shape (n,)."""
        return ~np.isnan(self.rotation_y_rad)

    @property
    def values(self) -> FloatArray:
        """Centre, size and turn side by side, shape (n, 7), in the order of ``BoxValues``."""
        return np.column_stack([self.centre_cam_m, self.size_m, self.rotation_y_rad])

    @property
    def deviations_or_nan(self) -> FloatArray:
        """Standard deviations of ``values``, shape (n, 7), NaN where unknown."""
        return np.full((len(self), 7), np.nan) if self.deviations is None else self.deviations

    @property
    def nose_cam(self) -> FloatArray:
        """Unit direction of each nose in the camera frame, shape (n, 3)."""
        turn = self.rotation_y_rad
        return np.column_stack([np.cos(turn), 0.0 * turn, -np.sin(turn)])

    @property
    def alpha_rad(self) -> FloatArray:
        """KITTI's observation angle in [-pi, pi), shape (n,): the turn less the direction of the box."""
        direction = np.arctan2(self.centre_cam_m[:, 0], self.centre_cam_m[:, 2])
        return wrapped(self.rotation_y_rad - direction)

    @property
    def azimuth_deg(self) -> FloatArray:
        """Azimuth in [0, 360) from which each is seen, shape (n,), counter-clockwise from above: 0 its front,
        90 its left side; as ``rescore.data.frames.Truth`` has it."""
        return np.asarray((np.degrees(self.alpha_rad) - 90) % 360)

    @property
    def distance_m(self) -> FloatArray:
        """Distance of each centre from the camera along the ground, shape (n,)."""
        return np.hypot(self.centre_cam_m[:, 0], self.centre_cam_m[:, 2])

    @staticmethod
    def of_values(values: FloatArray, deviations: FloatArray | None = None) -> "Boxes3D":
        """The boxes of rows (n, 7) in the order of ``BoxValues``, with their deviations (n, 7)."""
        v = np.asarray(values, float).reshape(-1, 7)
        if deviations is None or np.isnan(deviations).all():
            return Boxes3D(v[:, :3], v[:, 3:6], v[:, 6])
        return Boxes3D(v[:, :3], v[:, 3:6], v[:, 6], np.asarray(deviations, float).reshape(-1, 7))

    @staticmethod
    def of_rows(
        rows: Sequence[Sequence[float] | None], deviations: Sequence[Sequence[float] | None] = ()
    ) -> "Boxes3D | None":
        """The boxes of rows as files have them, None for an object without one; None where none has one.

        Args:
            rows: ``BoxValues`` of each box.
            deviations: their standard deviations; may be left out.
        """
        if all(r is None for r in rows):
            return None
        return Boxes3D.of_values(_filled(rows), _filled(deviations) if deviations else None)

    @staticmethod
    def none(n: int) -> "Boxes3D":
        """No box for any of n objects."""
        return Boxes3D.of_values(np.full((n, 7), np.nan))

    @staticmethod
    def filled(boxes: "Boxes3D | None", n: int) -> "Boxes3D":
        """The boxes of n objects, none for any where None is given."""
        return Boxes3D.none(n) if boxes is None else boxes

    def or_else(self, other: "Boxes3D | None") -> "Boxes3D":
        """Boxes with those of another in the rows that hold none."""
        if other is None:
            return self
        own = self.known[:, None]
        deviations = np.where(own, self.deviations_or_nan, other.deviations_or_nan)
        return Boxes3D.of_values(np.where(own, self.values, other.values), deviations)

    @staticmethod
    def concatenate(parts: "Sequence[Boxes3D]") -> "Boxes3D":
        """The boxes of one part below those of the other."""
        values = np.concatenate([np.zeros((0, 7)), *(p.values for p in parts)])
        deviations = np.concatenate([np.zeros((0, 7)), *(p.deviations_or_nan for p in parts)])
        return Boxes3D.of_values(values, deviations)

    @staticmethod
    def of_kitti(
        location_m: FloatArray,
        size_hwl_m: FloatArray,
        rotation_y_rad: FloatArray,
        up_cam: FloatArray = CAMERA_UP,
    ) -> "Boxes3D":
        """The boxes of KITTI's columns.

        Args:
            location_m: middle of the bottom of each box, camera frame, shape (n, 3).
            size_hwl_m: height, width and length, shape (n, 3).
            rotation_y_rad: turn about the camera's y axis, shape (n,).
            up_cam: unit direction from bottom to top, shape (3,), such as ``GroundPlane.up``.
        """
        centre = location_m + size_hwl_m[:, :1] / 2 * up_cam
        return Boxes3D(centre, size_hwl_m[:, ::-1], np.asarray(rotation_y_rad, float))

    def kitti_location_m(self, up_cam: FloatArray = CAMERA_UP) -> FloatArray:
        """Middle of the bottom of each box in the camera frame, shape (n, 3): KITTI's location."""
        return self.centre_cam_m - self.size_m[:, 2:] / 2 * up_cam

    @property
    def kitti_size_m(self) -> FloatArray:
        """Height, width and length, shape (n, 3): KITTI's order."""
        return self.size_m[:, ::-1]


def _filled(rows: Sequence[Sequence[float] | None]) -> FloatArray:
    return np.array([[np.nan] * 7 if r is None else list(r) for r in rows], float).reshape(-1, 7)


def _check_rows(what: str, values: FloatArray) -> None:
    """Raises RescoreError where a row is neither known nor unknown as a whole, or infinite."""
    unknown = np.isnan(values)
    part = (unknown.any(axis=1) & ~unknown.all(axis=1)) | np.isinf(values).any(axis=1)
    if part.any():
        raise RescoreError(
            f"{what}: expected seven finite numbers, or none, got {values[part][0].tolist()}; mend it"
        )
