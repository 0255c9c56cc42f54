"""Input of the library as numpy arrays: one frame and the boxes in it, checked as they are made."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, UInt8Array
from recon.camera import DepthCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.errors import RescoreError
from recon.stereo.sgbm import SgbmConfig, disparity_of_scene
from rescore.data.depth_files import Quantity
from rescore.data.frames import Frame, disparity_of_depth
from rescore.data.units import refuse_other_unit
from rescore.detectors.platt import PlattScaling
from rescore.evidence.candidates import Candidates
from rescore.evidence.predicted_depth import kind_of
from rescore.evidence.settings import stereo_for

Float = NDArray[np.floating]
Number = NDArray[np.floating] | NDArray[np.integer]

MEASURED = ("disparity_px", "depth_m", "right_rgb")
"""Fields of ``StereoFrame`` of which one is given."""


@dataclass(frozen=True)
class Camera:
    """A rectified left camera and its distance to the right one, named as in ``annotations.json``."""

    fx: float
    """Focal lengths and principal point in pixels; the middle of the first pixel is (0, 0)."""
    fy: float
    cx: float
    cy: float
    baseline_m: float | None = None
    """Metres from left to right; None for a camera that measures depth without a pair: it then counts as the
    pair that would measure as finely (``Rescored.baseline_m``)."""

    def __post_init__(self) -> None:
        given = [self.fx, self.fy, self.cx, self.cy] + [self.baseline_m] * (self.baseline_m is not None)
        if not _finite(*given) or min(self.fx, self.fy, self.baseline_m or 1.0) <= 0 or self.baseline_m == 0:
            raise RescoreError(
                f"camera: expected finite numbers, focal lengths and baseline above 0, got {self}; "
                "check the calibration (pixels and metres)"
            )

    def of_size(self, width_px: int, height_px: int) -> StereoCamera | DepthCamera:
        """The camera for pictures of a size: the pair, where its baseline is known."""
        left = PinholeCamera(self.fx, self.fy, self.cx, self.cy, width_px, height_px)
        return DepthCamera(left) if self.baseline_m is None else StereoCamera(left, self.baseline_m)


@dataclass(frozen=True, eq=False)
class StereoFrame:
    """One picture with measured depth: exactly one of ``disparity_px``, ``depth_m`` and ``right_rgb``.

    Raises:
        RescoreError: none or several of these, another shape or type, or a camera that does not go with them.
    """

    left_rgb: UInt8Array
    """Shape (h, w, 3), red first, rectified."""
    disparity_px: Float | None = None
    """Shape (h, w), column in the left less column in the right picture; NaN, infinity, 0 and less: none."""
    depth_m: Float | None = None
    """Shape (h, w), z of the left camera in metres; NaN, infinity, 0 and less: none."""
    right_rgb: UInt8Array | None = None
    """Right picture, of the shape and type of ``left_rgb``; disparity is then matched."""
    camera: Camera | None = None
    """Camera of the left picture; None where unknown, which ``depth_m`` and mode "metric" cannot do
    without."""
    ground: GroundPlane | None = None
    """Height and pitch of the camera over the ground; None where unknown: then the ground plane fitted to the
    measured depth is used where it can be trusted."""

    def __post_init__(self) -> None:
        given = [name for name in MEASURED if getattr(self, name) is not None]
        if len(given) != 1:
            raise RescoreError(
                f"frame: expected one of {', '.join(MEASURED)}, got {' and '.join(given) or 'none'}; "
                "give the one that was measured"
            )
        size = _checked_rgb("left_rgb", self.left_rgb)
        if self.right_rgb is not None and _checked_rgb("right_rgb", self.right_rgb) != size:
            raise RescoreError(
                f"right_rgb: expected shape {self.left_rgb.shape} as the left picture has, got "
                f"{self.right_rgb.shape}; rectify the pair"
            )
        for name in MEASURED[:2]:
            if getattr(self, name) is not None:
                _check_map(name, getattr(self, name), size)
        if self.depth_m is not None and self.camera is None:
            raise RescoreError(
                "frame: expected a camera with depth_m, got none; give Camera(fx, fy, cx, cy), "
                "or disparity_px in place of depth"
            )
        if self.depth_m is None and self.camera is not None and self.camera.baseline_m is None:
            raise RescoreError(
                f"frame: expected a camera with baseline_m for {given[0]}, got none; "
                "give the metres from left to right"
            )
        ground = self.ground
        if ground is not None and not _finite(ground.height_m, ground.pitch_rad, ground.roll_rad):
            raise RescoreError(
                f"ground: expected finite height and angles, got {ground}; leave unknown ground out"
            )
        if ground is not None:
            GroundPlane.stated(ground.height_m, ground.pitch_rad, ground.roll_rad)

    @property
    def quantity(self) -> Quantity:
        """What was measured; of a pair, its disparity."""
        return Quantity.DISPARITY if self.depth_m is None else Quantity.DEPTH

    def loaded(self, stereo: SgbmConfig, nearest_m: float) -> Frame:
        """The frame as rescoring takes it.

        A pair is matched over at least the disparities of ``stereo``, and of surfaces from ``nearest_m`` on.

        Raises:
            RescoreError: all that is measured cannot be in metres and pixels (``rescore.data.units``).
        """
        height, width = self.left_rgb.shape[:2]
        camera = None if self.camera is None else self.camera.of_size(width, height)
        pair = camera if isinstance(camera, StereoCamera) else None
        left = np.ascontiguousarray(self.left_rgb)
        if self.right_rgb is not None:
            advised = stereo_for(width, [(pair, 0.0)] if pair else [], nearest_m).num_disparities
            matcher = replace(stereo, num_disparities=max(stereo.num_disparities, advised))
            right = np.ascontiguousarray(self.right_rgb)
            disparity = disparity_of_scene(left, right, matcher)
        elif self.depth_m is not None:
            assert camera is not None
            disparity, pair = disparity_of_depth(_measured(self.depth_m), camera)
        else:
            assert self.disparity_px is not None
            disparity = _measured(self.disparity_px)
        frame = Frame(0, left, disparity, pair, self.ground)
        refuse_other_unit("frame", frame, self.quantity)
        return frame.with_stereo_ground()


@dataclass(frozen=True, eq=False)
class Boxes:
    """The detections of one frame, in any order: boxes with a likelihood or a raw score each.

    Raises:
        RescoreError: neither or both of these, another shape or type, a box without size, NaN, or a
            likelihood outside [0, 1].
    """

    xyxy_px: Number
    """Left, top, right and bottom edge of each box, shape (n, 4); column j of the picture is [j, j + 1)."""
    likelihood: Float | None = None
    """l in [0, 1], shape (n,)."""
    score: Number | None = None
    """Raw scores of the detector that the rescorer's Platt scaling was fitted to, shape (n,)."""
    azimuth_deg: Number | None = None
    """Azimuth from which each object is seen, shape (n,), counter-clockwise from above: 0 its front, 90 its
    left side; NaN where unknown. Picks the view of the class model."""

    def __post_init__(self) -> None:
        _check_boxes(self.xyxy_px)
        if (self.likelihood is None) == (self.score is None):
            got = "neither" if self.score is None else "both"
            raise RescoreError(
                f"boxes: expected likelihood or score, got {got}; "
                "give likelihoods in [0, 1] where you have them"
            )
        n = len(self.xyxy_px)
        if self.likelihood is not None:
            _check_column("likelihood", self.likelihood, n)
            bad = np.flatnonzero(~((self.likelihood >= 0) & (self.likelihood <= 1)))
            if len(bad):
                raise RescoreError(
                    f"likelihood: expected numbers in [0, 1], got {self.likelihood[bad[0]]:g} for box "
                    f"{bad[0]}; give raw scores as score, with a rescorer that has their scaling"
                )
        if self.score is not None:
            _check_column("score", self.score, n)
            _check_finite("score", self.score)
        if self.azimuth_deg is not None:
            _check_column("azimuth_deg", self.azimuth_deg, n)
            _check_finite("azimuth_deg", self.azimuth_deg, "infinity")

    def __len__(self) -> int:
        return len(self.xyxy_px)

    @staticmethod
    def of(detections: Any) -> "Boxes":
        """The boxes of what a detector's library hands out, of all its classes: leave others out first.

        Args:
            detections: an object with ``xyxy`` and ``conf`` or ``confidence``, arrays or tensors on any
                device, such as ``results[0].boxes`` of Ultralytics or ``Detections`` of supervision.

        Raises:
            RescoreError: no such object, or boxes or confidences that ``Boxes`` does not take.
        """
        confidence = getattr(detections, "conf", None)
        confidence = getattr(detections, "confidence", None) if confidence is None else confidence
        xyxy = getattr(detections, "xyxy", None)
        if xyxy is None or confidence is None:
            lacks = "xyxy" if xyxy is None else "conf or confidence"
            raise RescoreError(
                f"detections: expected an object with xyxy and conf or confidence, got "
                f"{type(detections).__name__} without {lacks}; give results[0].boxes of Ultralytics, "
                "Detections of supervision, or Boxes(xyxy_px, likelihood=...)"
            )
        return Boxes(_array_of("xyxy", xyxy), likelihood=_array_of("confidence", confidence))

    def candidates(self, scaling: PlattScaling | None) -> Candidates:
        """The detections as rescoring takes them; ``scaling`` turns scores to likelihoods.

        Raises:
            RescoreError: scores, and no scaling.
        """
        boxes = np.array(self.xyxy_px, float).reshape(-1, 4)
        azimuth = None if self.azimuth_deg is None else np.array(self.azimuth_deg, float)
        if self.score is None:
            likelihood = np.array(self.likelihood, float)
            return Candidates(0, boxes, likelihood, likelihood, azimuth)
        if scaling is None:
            raise RescoreError(
                "score: expected a rescorer with Platt scaling to turn scores to likelihoods, got one "
                "without; give likelihoods, or name a scaling in the rescorer's file"
            )
        score = np.array(self.score, float)
        return Candidates(0, boxes, score, scaling.likelihood(score), azimuth)


def _array_of(name: str, value: Any) -> Float:
    """An array of double precision of an array or a tensor, wherever it lies."""
    for step in ("detach", "cpu", "numpy"):
        value = getattr(value, step)() if hasattr(value, step) else value
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise RescoreError(
            f"{name}: expected an array or tensor of numbers, got {kind_of(value)}; convert it"
        ) from error


def _measured(values: Float) -> Float32Array:
    """Measured values as float32, NaN where nothing was measured."""
    known = np.isfinite(values) & (values > 0)
    return np.where(known, values, np.nan).astype(np.float32)


def _finite(*numbers: Any) -> bool:
    return all(isinstance(v, int | float | np.number) and bool(np.isfinite(v)) for v in numbers)


def _checked_rgb(name: str, value: Any) -> tuple[int, int]:
    """Height and width of a picture."""
    right = isinstance(value, np.ndarray) and value.ndim == 3 and value.shape[2] == 3
    if not right or value.dtype != np.uint8 or 0 in value.shape:
        raise RescoreError(
            f"{name}: expected an array (h, w, 3) of uint8, red first, got {kind_of(value)}; "
            "convert the picture"
        )
    return value.shape[0], value.shape[1]


def _check_map(name: str, value: Any, size: tuple[int, int]) -> None:
    unit = "pixels" if name == "disparity_px" else "metres"
    if not (isinstance(value, np.ndarray) and np.issubdtype(value.dtype, np.floating)):
        raise RescoreError(
            f"{name}: expected an array of floats in {unit}, got {kind_of(value)}; divide by the factor of "
            "the sensor, such as 1000 for millimetres"
        )
    if value.shape != size:
        raise RescoreError(
            f"{name}: expected shape {size} as the left picture has, got {value.shape}; "
            "register it to the left picture"
        )


def _is_numbers(value: Any) -> bool:
    return isinstance(value, np.ndarray) and (
        np.issubdtype(value.dtype, np.floating) or np.issubdtype(value.dtype, np.integer)
    )


def _check_boxes(value: Any) -> None:
    # a detector that found nothing often gives an empty list of no particular shape
    empty = isinstance(value, np.ndarray) and value.shape == (0,)
    if not (_is_numbers(value) and (empty or (value.ndim == 2 and value.shape[1] == 4))):
        raise RescoreError(
            f"xyxy_px: expected an array (n, 4) of numbers, a box a row, got {kind_of(value)}; "
            "convert the boxes"
        )
    if empty:
        return
    _check_finite("xyxy_px", value)
    bad = np.flatnonzero(~((value[:, 2] > value[:, 0]) & (value[:, 3] > value[:, 1])))
    if len(bad):
        raise RescoreError(
            f"xyxy_px: expected right above left and bottom above top, got {value[bad[0]].tolist()} for box "
            f"{bad[0]}; give edges, not width and height"
        )


def _check_column(name: str, value: Any, n: int) -> None:
    if not (_is_numbers(value) and value.shape == (n,)):
        raise RescoreError(
            f"{name}: expected an array ({n},) of numbers, one a box, got {kind_of(value)}; mend the "
            "detections"
        )


def _check_finite(name: str, value: Number, bad: str = "NaN or infinity") -> None:
    wrong = np.isinf(value) if bad == "infinity" else ~np.isfinite(value)
    rows = np.nonzero(wrong)[0]
    if len(rows):
        raise RescoreError(
            f"{name}: expected finite numbers, got {bad} for box {rows[0]}; leave such detections out"
        )
