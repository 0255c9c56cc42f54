"""A pair of cameras as they stand, whose pictures are not rectified, and how to rectify them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.camera import PinholeCamera, StereoCamera
from recon.errors import RescoreError
from rescore.formats.calibrations.numbers import Values, matrix_of
from rescore.formats.calibrations.tools import FISHEYE, rotation

MAX_APART_PX = 0.5
"""Pictures whose rows are at most this far apart count as rectified."""
MAX_ASIDE = 0.01
"""Pictures count as rectified when the right camera lies at most this share of the baseline above, below or
behind the left one."""
_SIDE_POINTS = 17
"""Points on each side of a box that are mapped."""


@dataclass(frozen=True, eq=False)
class RawCamera:
    """One camera of a pair as it stands."""

    matrix: FloatArray
    """K, shape (3, 3)."""
    distortion: FloatArray
    """Shape (n,), in OpenCV's order."""
    fisheye: bool
    """Whether the distortion is that of OpenCV's fisheye camera."""


@dataclass(frozen=True, eq=False)
class Rectified:
    """What rectification makes of one camera."""

    raw: RawCamera
    turn: FloatArray
    """R1 or R2 of OpenCV, shape (3, 3)."""
    projection: FloatArray
    """P1 or P2, shape (3, 4)."""

    def places(self, width_px: int, height_px: int) -> tuple[Float32Array, Float32Array]:
        """Column and row in the picture as taken of each pixel of the rectified one, each (h, w)."""
        raw, size = self.raw, (width_px, height_px)
        make = cv2.fisheye.initUndistortRectifyMap if raw.fisheye else cv2.initUndistortRectifyMap
        maps = make(raw.matrix, raw.distortion, self.turn, self.projection[:, :3], size, cv2.CV_32FC1)
        return np.asarray(maps[0], np.float32), np.asarray(maps[1], np.float32)

    def boxes(self, xyxy_px: FloatArray, width_px: int, height_px: int) -> FloatArray:
        """The boxes (n, 4) around the mapped edges of boxes of the picture as taken, cut at the picture.

        One of which nothing is left has width or height 0.
        """
        return np.array(
            [self._box(box, width_px, height_px) for box in xyxy_px.tolist()], dtype=float
        ).reshape(-1, 4)

    def _box(self, box: list[float], width_px: int, height_px: int) -> FloatArray:
        x0, y0, x1, y1 = box
        x, y = np.linspace(x0, x1, _SIDE_POINTS), np.linspace(y0, y1, _SIDE_POINTS)
        edges = [(x, np.full_like(x, y0)), (x, np.full_like(x, y1))]
        edges += [(np.full_like(y, x0), y), (np.full_like(y, x1), y)]
        # edges lie half a pixel before the middles of pixels
        points = np.concatenate([np.stack(e, axis=1) for e in edges])[:, None] - 0.5
        undo = cv2.fisheye.undistortPoints if self.raw.fisheye else cv2.undistortPoints
        mapped = (
            undo(points, self.raw.matrix, self.raw.distortion, R=self.turn, P=self.projection)[:, 0] + 0.5
        )
        limits = np.array([width_px, height_px], dtype=float)
        return np.concatenate([np.clip(mapped.min(0), 0, limits), np.clip(mapped.max(0), 0, limits)])


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """What rectification makes of a pair."""

    left: Rectified
    right: Rectified

    def camera(self, width_px: int, height_px: int) -> StereoCamera:
        """The rectified camera.

        Raises:
            RescoreError: the right camera is not on the right.
        """
        p, q = self.left.projection, self.right.projection
        fx, fy, cx, cy = (float(v) for v in (p[0, 0], p[1, 1], p[0, 2], p[1, 2]))
        left = PinholeCamera(fx, fy, cx, cy, width_px, height_px)
        return StereoCamera(left, float((p[0, 3] - q[0, 3]) / p[0, 0]))

    @property
    def disparity_offset_px(self) -> float:
        """cx of the right less cx of the left picture."""
        return float(self.right.projection[0, 2] - self.left.projection[0, 2])


@dataclass(frozen=True, eq=False)
class RawPair:
    """Two cameras as they stand, and how they stand to each other or what their rectified cameras are."""

    left: RawCamera
    right: RawCamera
    move: tuple[FloatArray, FloatArray] | None
    """R (3, 3) and T (3,), which take the left camera's coordinates to the right one's."""
    stated: tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None
    """R1, P1, R2, P2 as the file states them."""

    @staticmethod
    def of(path: Path, values: Values) -> "RawPair | None":
        """The pair of a calibration's values; None where they say too little of two cameras.

        Raises:
            RescoreError: a matrix has another shape.
        """
        if "K1" not in values or "K2" not in values:
            return None
        cameras = [_camera(path, values, n) for n in (1, 2)]
        stated = None
        if all(k in values for k in ("R1", "P1", "R2", "P2")):
            (r1, r2), (p1, p2) = (
                [matrix_of(path, values, f"{k}{n}", 3, columns) for n in (1, 2)]
                for k, columns in (("R", 3), ("P", 4))
            )
            stated = (r1, p1, r2, p2)
        move = None
        if "T" in values:
            turn = matrix_of(path, values, "R", 3, 3) if "R" in values else np.eye(3)
            move = (rotation(path, "R", turn), matrix_of(path, values, "T", 3, 1)[:, 0])
        if stated is None and move is None:
            return None
        return RawPair(cameras[0], cameras[1], move, stated)

    @property
    def doubt(self) -> str:
        """What says that pictures of these cameras are not rectified; empty where nothing does."""
        bent = [
            f"D{n} up to {np.abs(c.distortion).max():.2g}" for n, c in self._numbered if c.distortion.any()
        ]
        if bent:
            return f"lens distortion ({', '.join(bent)})"
        moved = self._moved_px
        if moved > MAX_APART_PX:
            return f"P or R that move pixels by about {moved:.1f} px"
        turn, place = self._turn_and_place()
        k, other = self.left.matrix, self.right.matrix
        apart = float(np.abs(other[1] - k[1]).max() + k[0, 0] * np.abs(turn - np.eye(3)).max())
        if apart > MAX_APART_PX:
            return f"rows that are about {apart:.1f} px apart"
        aside = float(np.abs(place[1:]).max())
        if aside > MAX_ASIDE * abs(place[0]):
            return f"a camera that is {aside:g} m above, below or behind the other"
        return ""

    @property
    def _numbered(self) -> list[tuple[int, RawCamera]]:
        return [(1, self.left), (2, self.right)]

    @property
    def _moved_px(self) -> float:
        """How far the stated rectification moves pixels; 0 where none is stated."""
        if self.stated is None:
            return 0.0
        r1, p1, r2, p2 = self.stated
        cameras = ((self.left, r1, p1), (self.right, r2, p2))
        return max(
            float(np.abs(p[:2, :3] - c.matrix[:2]).max() + p[0, 0] * np.abs(r - np.eye(3)).max())
            for c, r, p in cameras
        )

    def _turn_and_place(self) -> tuple[FloatArray, FloatArray]:
        if self.move is not None:
            return self.move
        assert self.stated is not None
        return self.stated[2].T @ self.stated[0], np.array([1.0, 0, 0])

    def rectified(self, path: Path, width_px: int, height_px: int) -> RectifiedPair:
        """The pair rectified as the file states it, else by OpenCV so that no pixel is empty.

        Raises:
            RescoreError: the cameras do not stand side by side; ``path`` names the calibration.
        """
        r1, p1, r2, p2 = self.stated or self._by_opencv(path, (width_px, height_px))
        pair = RectifiedPair(Rectified(self.left, r1, p1), Rectified(self.right, r2, p2))
        beside = p1[0, 3] - p2[0, 3]
        if abs(p2[1, 3]) > abs(beside) or not beside > 0:
            raise RescoreError(
                f"{path}: expected the right camera to the right of the left one, got it "
                f"{'above or below' if abs(p2[1, 3]) > abs(beside) else 'on the left'}; check R and T, or "
                "exchange left and right"
            )
        return pair

    def _by_opencv(self, path: Path, size: tuple[int, int]) -> tuple[FloatArray, ...]:
        assert self.move is not None
        cameras = (self.left.matrix, self.left.distortion, self.right.matrix, self.right.distortion)
        found: Sequence[Any]
        try:
            if self.left.fisheye:
                flags = cv2.fisheye.CALIB_ZERO_DISPARITY
                found = cv2.fisheye.stereoRectify(*cameras, size, *self.move, flags)
            else:
                flags = cv2.CALIB_ZERO_DISPARITY
                found = cv2.stereoRectify(*cameras, size, *self.move, flags=flags, alpha=0)
        except cv2.error as error:
            raise RescoreError(
                f"{path}: expected a pair that OpenCV rectifies, got {error.err}; check it"
            ) from error
        r1, r2, p1, p2 = (np.asarray(v, float) for v in found[:4])
        return r1, p1, r2, p2


def _camera(path: Path, values: Values, number: int) -> RawCamera:
    matrix = matrix_of(path, values, f"K{number}", 3, 3)
    distortion = values.get(f"D{number}", np.zeros(4)).ravel()
    fisheye = FISHEYE in values
    lengths = (4,) if fisheye else (4, 5, 8, 12, 14)
    if len(distortion) not in lengths:
        raise RescoreError(
            f"{path}: D{number}: expected {' or '.join(map(str, lengths))} numbers, got "
            f"{len(distortion)}; mend it"
        )
    return RawCamera(matrix, distortion, fisheye)
