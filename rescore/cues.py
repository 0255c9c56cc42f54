"""The parts of the depth evidence of a candidate, kept for inspection, and the modes made of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.camera import StereoCamera
from recon.depth_map import DepthMap
from recon.errors import RescoreError
from rescore.align_depth import predicted_region
from rescore.frames import Frame
from rescore.guarded import GUARDED, GuardedConfig, guarded_alignment
from rescore.plausibility import CHECKS, PlausibilityConfig, plausibility
from rescore.surroundings import SURROUNDINGS, SurroundingsConfig, surroundings

_METRIC = (*GUARDED, *SURROUNDINGS, "depth_ratio")
CUES = (*_METRIC, *CHECKS)
"""Columns of ``CandidateTable.cues``. ``depth_ratio`` is the median logarithm of measured over predicted
depth: 0 where the thing stands where the ground line and the part planes put it. ``CHECKS`` say nothing for
or against a car, but whether the others can be believed."""


class Registration(StrEnum):
    """How predicted and measured depth are compared."""

    PAPER = "paper"
    """Eq. 6 as printed: free scale and offset, D is the root mean square of what is left."""
    GUARDED = "guarded"
    """The same two unknowns, the scale positive and bounded, a robust fit, judged against a flat surface.
    Needs no calibration."""
    METRIC = "metric"
    """That, and what a calibrated camera tells: size, depth edges, ground contact, the planes' own depths."""

    @property
    def cues(self) -> tuple[str, ...]:
        """The parts of the evidence; none for ``PAPER``, whose D has a formula."""
        return {Registration.PAPER: (), Registration.GUARDED: GUARDED, Registration.METRIC: _METRIC}[self]

    @property
    def checks(self) -> tuple[str, ...]:
        """Columns that must not be lower than where the mode was fitted, or a candidate has no evidence."""
        return {
            Registration.PAPER: (),
            Registration.GUARDED: CHECKS[:1],
            Registration.METRIC: ("measured", *CHECKS),
        }[self]


CLASS_MODEL = "the class model"
"""Whose depth w or D was fitted with, where it is not another system's."""


def check_depth_of(where: str, fitted_with: str, used: str) -> None:
    """Raises RescoreError where what was fitted with one prediction of depth is to be used with another."""
    if fitted_with != used:
        raise RescoreError(
            f"{where}: expected what was fitted with depth of {used}, got what was fitted with depth of "
            f"{fitted_with}; fit it again with the predictions that it is used with"
        )


LEARNED = tuple(r for r in Registration if r.cues)
"""Modes whose D is calibrated."""


@dataclass(frozen=True)
class CueConfig:
    """Settings of all parts of the evidence."""

    guarded: GuardedConfig = field(default_factory=GuardedConfig)
    surroundings: SurroundingsConfig = field(default_factory=SurroundingsConfig)
    plausibility: PlausibilityConfig = field(default_factory=PlausibilityConfig)
    depth_ratio_limit: float = 2.0
    """Logarithms of depth ratios are clipped to this, both ways."""


def frame_cues(
    frame: Frame,
    xyxy_px: FloatArray,
    predicted: Sequence[DepthMap | None],
    azimuth_rad: FloatArray,
    config: CueConfig,
) -> FloatArray:
    """The cues of the candidates of a frame, shape (n, k), columns ``CUES``; NaN where one cannot be had.

    Args:
        frame: picture, disparity, camera and ground. Without a camera only the guarded cues are had.
        xyxy_px: boxes, shape (n, 4).
        predicted: depth predicted in each box; None, which leaves out what needs it, where there is none or
            its scale and offset are unknown.
        azimuth_rad: side from which each is taken to be seen, shape (n,); NaN where nothing says it.
        config: settings.
    """
    relief = np.full((len(xyxy_px), len(GUARDED)), np.nan)
    around = np.full((len(xyxy_px), len(SURROUNDINGS)), np.nan)
    ratio = np.full((len(xyxy_px), 1), np.nan)
    if frame.camera is not None:
        around = surroundings(
            frame.disparity_px, xyxy_px, azimuth_rad, frame.camera, frame.ground, config.surroundings
        )
    for i, depth in enumerate(predicted):
        if depth is None:
            continue
        fit = guarded_alignment(depth, frame.disparity_px, xyxy_px[i], config.guarded)
        if fit is None:
            continue
        relief[i] = fit.cues
        if frame.camera is not None:
            logarithm = _depth_ratio(depth, frame.disparity_px, xyxy_px[i], frame.camera)
            ratio[i] = np.clip(logarithm, -config.depth_ratio_limit, config.depth_ratio_limit)
    believable = plausibility(frame.disparity_px, xyxy_px, frame.camera, frame.ground, config.plausibility)
    return np.hstack([relief, around, ratio, believable])


def _depth_ratio(
    predicted: DepthMap,
    disparity_px: Float32Array,
    box_px: FloatArray,
    camera: StereoCamera,
) -> float:
    """Median logarithm of measured over predicted depth, over the predicted region in the box."""
    measured = disparity_px[predicted.window]
    use = predicted_region(predicted, box_px) & np.isfinite(measured)
    focal_baseline = camera.left.fx_px * camera.baseline_m
    return float(np.median(np.log(focal_baseline / measured[use] / predicted.depth[use])))
