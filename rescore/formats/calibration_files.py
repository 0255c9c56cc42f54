"""Calibrations of rectified pairs, in pixels and metres, from the files of many tools.

Nothing is rectified here: the numbers are those of rectified pictures.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.camera import DepthCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from rescore.formats.calibrations.numbers import Values, matrix_of, number_of
from rescore.formats.calibrations.raw_pair import RawPair
from rescore.formats.calibrations.values import GROUND, ONE_CAMERA, calibration_values


@dataclass(frozen=True)
class Calibration:
    """A rectified pair, or a camera that measures depth."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    baseline_m: float | None = None
    """Distance of the two cameras in metres; None where the file has one camera only."""
    disparity_offset_px: float = 0.0
    """cx of the right less cx of the left picture."""
    width_px: int | None = None
    """Width and height of the pictures as the file says; None where it does not say."""
    height_px: int | None = None
    ground: GroundPlane | None = None
    """The ground where the file states the camera's height; else None."""

    def camera(self, where: Path, width_px: int, height_px: int) -> StereoCamera:
        """The pair for pictures of a size.

        Raises:
            RescoreError: the calibration is of another size, has no baseline, or no camera is like that.
        """
        camera = self.depth_camera(where, width_px, height_px)
        if isinstance(camera, StereoCamera):
            return camera
        raise RescoreError(
            f"{where}: expected a calibrated pair (P1 and P2, Q, or a baseline), got one camera; add the "
            "line 'baseline_m: ...' with metres"
        )

    def depth_camera(self, where: Path, width_px: int, height_px: int) -> StereoCamera | DepthCamera:
        """The camera for pictures of a size with measured depth, which may be one without a baseline.

        Raises:
            RescoreError: the calibration is of another size, or no camera is like that.
        """
        refuse_other_size(where, (self.width_px, self.height_px), (width_px, height_px))
        try:
            left = PinholeCamera(self.fx_px, self.fy_px, self.cx_px, self.cy_px, width_px, height_px)
            return DepthCamera(left) if self.baseline_m is None else StereoCamera(left, self.baseline_m)
        except RescoreError as error:
            raise RescoreError(f"{where}: {error}") from error


def refuse_other_size(where: Path, said: tuple[int | None, int | None], size_px: tuple[int, int]) -> None:
    """Raises RescoreError where a calibration says another width and height than the pictures have."""
    stated = (said[0] or size_px[0], said[1] or size_px[1])
    if stated != size_px:
        raise RescoreError(
            f"{where}: expected the calibration of pictures of {size_px[0]} x {size_px[1]} pixels, got that "
            f"of {stated[0]} x {stated[1]}; scale it or take the pictures it belongs to"
        )


def read_calibration(
    path: Path,
    right: Path | None = None,
    kitti_pair: tuple[int, int] = (2, 3),
    size_px: tuple[int, int] | None = None,
) -> Calibration:
    """A calibration file of any of the forms.

    Args:
        path: The file; that of the left camera for a pair of files.
        right: The right camera's file of such a pair.
        kitti_pair: Which of KITTI's four cameras the pictures are of.
        size_px: Width and height of the pictures, by which some files have their numbers.

    Raises:
        RescoreError: a file is missing, holds no calibration, or that of pictures that are not rectified.
    """
    return calibration_of(path, calibration_values(path, right, size_px), kitti_pair)


def calibration_of(path: Path, values: Values, kitti_pair: tuple[int, int] = (2, 3)) -> Calibration:
    """The calibration that the values of a file say; ``path`` names it.

    Raises:
        RescoreError: they say none, or that of pictures that are not rectified.
    """
    return replace(_cameras_of(path, values, kitti_pair), ground=_ground_of(path, values))


def _ground_of(path: Path, values: Values) -> GroundPlane | None:
    height_m, pitch_rad, roll_rad = (
        number_of(path, values, name) if name in values else None for name in GROUND
    )
    if height_m is None:
        if (pitch_rad, roll_rad) != (None, None):
            raise RescoreError(f"{path}: expected height_m beside pitch_rad and roll_rad, got none; add it")
        return None
    try:
        return GroundPlane.stated(height_m, pitch_rad, roll_rad)
    except RescoreError as error:
        raise RescoreError(f"{path}: {error}") from error


def _cameras_of(path: Path, values: Values, kitti_pair: tuple[int, int]) -> Calibration:
    if "cam0" in values:
        return _middlebury(path, values)
    a, b = kitti_pair
    if path.suffix.lower() == ".txt" and "P0" in values:
        return _of_projections(path, values, f"P{a}", f"P{b}")
    for first, second in (("P1", "P2"), ("P2", "P3"), (f"P_rect_0{a}", f"P_rect_0{b}")):
        if first in values and second in values:
            return _of_projections(path, values, first, second)
    if "Q" in values:
        return _of_q(path, values)
    pair = RawPair.of(path, values)
    if pair is None or pair.move is None:
        return _of_one_matrix(path, values)
    if pair.doubt:
        raise RescoreError(
            f"{path}: expected the cameras of rectified pictures, got {pair.doubt}; rectify by "
            "`rescore import FOLDER --rectify --out NEW`, or write P1 and P2 where the pictures are rectified"
        )
    k1, k2 = pair.left.matrix, pair.right.matrix
    column = np.array([[pair.move[1][0] * k2[0, 0]], [0], [0]])
    values = values | {"P1": np.hstack([k1, np.zeros((3, 1))]), "P2": np.hstack([k2, column])}
    return _of_projections(path, values, "P1", "P2")


def notes_of(path: Path, values: Values) -> tuple[str, ...]:
    """What a calibration says of the lenses that rectified pictures no longer have, for the user to see."""
    pair = RawPair.of(path, values)
    if pair is not None and pair.doubt:
        return (
            f"{path}: its pair is of rectified pictures, and it has {pair.doubt} besides; where the "
            "pictures are as the cameras took them, rectify by `rescore import FOLDER --rectify --out NEW`",
        )
    bent = [float(np.abs(values[k]).max()) for k in ("D", "D1", "D2") if pair is None and k in values]
    if any(bent):
        return (f"{path}: lens distortion (up to {max(bent):.2g}) is not undone; give undistorted pictures",)
    return ()


def size_of(path: Path, values: Values) -> tuple[int | None, int | None]:
    """Width and height of the pictures in pixels, None where a calibration does not say them."""
    both = next((values[k] for k in ("imageSize", "image_size") if k in values and values[k].size == 2), None)
    if both is not None:
        return int(both.flat[0]), int(both.flat[1])
    width, height = (
        next((int(number_of(path, values, k)) for k in (name, f"image_{name}") if k in values), None)
        for name in ("width", "height")
    )
    return width, height


def _of_projections(path: Path, values: Values, first: str, second: str) -> Calibration:
    """Calibration from two 3 x 4 projection matrices: column 3 of each is -fx times the camera's x."""
    p, q = (matrix_of(path, values, name, 3, 4) for name in (first, second))
    if not p.any() or not q.any():
        raise RescoreError(
            f"{path}: expected the projections of a calibrated pair, got {second if p.any() else first} "
            "of zeros alone; calibrate both cameras as a pair"
        )
    if not p[0, 0] > 0 or abs(q[0, 0] - p[0, 0]) > 0.01 * p[0, 0]:
        raise RescoreError(
            f"{path}: expected projections of a rectified pair with one focal length, got fx {p[0, 0]:g} and "
            f"{q[0, 0]:g}; calibrate after rectification"
        )
    baseline = (p[0, 3] - q[0, 3]) / p[0, 0]
    if baseline == 0:
        raise RescoreError(
            f"{path}: expected the right camera beside the left one, got {first} and {second} with "
            f"one last column ({p[0, 3]:g}); calibrate them as a pair, or write -fx baseline in {second}"
        )
    width, height = size_of(path, values)
    return _checked(
        path,
        Calibration(p[0, 0], p[1, 1], p[0, 2], p[1, 2], baseline, q[0, 2] - p[0, 2], width, height),
    )


def _of_q(path: Path, values: Values) -> Calibration:
    """Calibration from OpenCV's Q, which takes (u, v, disparity, 1) to the homogeneous point."""
    q = matrix_of(path, values, "Q", 4, 4)
    if not q[3, 2] or not q[2, 3] > 0:
        raise RescoreError(f"{path}: Q: expected Q[2, 3] > 0 and Q[3, 2] other than 0; mend Q")
    # stereoRectify writes -1 / Tx with Tx negative where the second camera stands on the right
    baseline, offset = 1 / q[3, 2], q[3, 3] / q[3, 2]
    width, height = size_of(path, values)
    return _checked(path, Calibration(q[2, 3], q[2, 3], -q[0, 3], -q[1, 3], baseline, offset, width, height))


def _middlebury(path: Path, values: Values) -> Calibration:
    """cam0 is [f 0 cx; 0 f cy; 0 0 1], baseline in millimetres, doffs in pixels (Scharstein et al. 2014)."""
    k = matrix_of(path, values, "cam0", 3, 3)
    width, height = size_of(path, values)
    return _checked(
        path,
        Calibration(
            fx_px=k[0, 0],
            fy_px=k[1, 1],
            cx_px=k[0, 2],
            cy_px=k[1, 2],
            baseline_m=number_of(path, values, "baseline") / 1000,
            disparity_offset_px=number_of(path, values, "doffs") if "doffs" in values else 0.0,
            width_px=width,
            height_px=height,
        ),
    )


def _of_one_matrix(path: Path, values: Values) -> Calibration:
    """Calibration from the left camera's matrix or ROS's projection matrix, and a baseline if there is
    one."""
    told = [n for n in ONE_CAMERA if n in values]
    name = next((n for n in told if values[n].any()), None)
    if told and name is None:
        raise RescoreError(
            f"{path}: expected a calibrated camera, got {told[0]} of zeros alone; calibrate it"
        )
    if name is None:
        raise RescoreError(
            f"{path}: expected a calibration (P1 and P2, Q, K1, cameraMatrix, projection_matrix, "
            "cam0, or fx with fy, cx, cy), "
            f"got {', '.join(sorted(values)) or 'none of them'}; write one"
        )
    columns = 4 if values[name].size == 12 else 3
    k = matrix_of(path, values, name, 3, columns)
    width, height = size_of(path, values)
    return _checked(
        path,
        Calibration(
            fx_px=k[0, 0],
            fy_px=k[1, 1],
            cx_px=k[0, 2],
            cy_px=k[1, 2],
            baseline_m=_baseline(path, values),
            disparity_offset_px=_offset(path, values, k),
            width_px=width,
            height_px=height,
        ),
    )


def _baseline(path: Path, values: Values) -> float | None:
    """The baseline that is written out, or the length of T along the rows."""
    for name in ("baseline_m", "baseline"):
        if name in values:
            return number_of(path, values, name)
    if "T" in values and values["T"].size == 3:
        return float(-values["T"].flat[0])
    return None


def _offset(path: Path, values: Values, left: FloatArray) -> float:
    return float(matrix_of(path, values, "K2", 3, 3)[0, 2] - left[0, 2]) if "K2" in values else 0.0


def _checked(path: Path, c: Calibration) -> Calibration:
    """The calibration as plain numbers, where a camera can be like that.

    Raises:
        RescoreError: a focal length or the baseline is not positive.
    """
    if not (c.fx_px > 0 and c.fy_px > 0):
        raise RescoreError(
            f"{path}: expected positive focal lengths, got {c.fx_px:g} and {c.fy_px:g}; mend it"
        )
    if c.baseline_m is not None and not c.baseline_m > 0:
        raise RescoreError(
            f"{path}: expected a right camera to the right of the left one, got a baseline of "
            f"{c.baseline_m:g}; left and right may be swapped"
        )
    return Calibration(
        fx_px=float(c.fx_px),
        fy_px=float(c.fy_px),
        cx_px=float(c.cx_px),
        cy_px=float(c.cy_px),
        baseline_m=None if c.baseline_m is None else float(c.baseline_m),
        disparity_offset_px=float(c.disparity_offset_px),
        width_px=c.width_px,
        height_px=c.height_px,
    )


@dataclass(frozen=True)
class Doubt:
    """Something unlikely about a calibration."""

    text: str
    """What is unlikely, and what to do."""
    serious: bool
    """Whether depth must be wrong if it is as it looks."""


def doubts(camera: StereoCamera | DepthCamera) -> list[Doubt]:
    """What of a calibration is unlikely."""
    left, found = camera.left, []
    if not 0.3 <= left.fx_px / left.width_px <= 4:
        text = f"fx of {left.fx_px:g} px is outside 0.3 to 4 picture widths ({left.width_px} px)"
        found.append(Doubt(f"{text}; calibrate in pixels of these pictures", True))
    if abs(left.fy_px / left.fx_px - 1) > 0.1:
        text = f"fx {left.fx_px:g} and fy {left.fy_px:g} px differ by over 10 %"
        found.append(Doubt(f"{text}; check the calibration", False))
    x, y = left.cx_px / left.width_px, left.cy_px / left.height_px
    if not (0.25 <= x <= 0.75 and 0.25 <= y <= 0.75):
        text = (
            f"principal point ({left.cx_px:g}, {left.cy_px:g}) is outside the middle half of "
            f"{left.width_px} x {left.height_px} pixels"
        )
        found.append(Doubt(f"{text}; check that the calibration is of this picture size", False))
    if isinstance(camera, StereoCamera) and not 0.02 <= camera.baseline_m <= 2:
        text = f"baseline of {camera.baseline_m:g} m is outside 0.02 to 2 m"
        found.append(Doubt(f"{text}; {_unit(camera.baseline_m)}", True))
    return found


def _unit(baseline: float) -> str:
    """Advice on the unit that the baseline is likely in, for an error message."""
    for name, factor in (("centimetres", 100), ("millimetres", 1000)):
        if baseline > 2 and 0.02 <= baseline / factor <= 0.8:
            return f"if it is in {name}, write {baseline / factor:g}"
    return "write it in metres"
