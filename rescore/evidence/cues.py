"""Cues, the parts of the depth evidence of a candidate, and the modes made of cues."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from recon.arrays import Float32Array, FloatArray
from recon.camera import StereoCamera
from recon.depth_map import DepthMap
from rescore.data.frames import Frame
from rescore.evidence.align_depth import predicted_region
from rescore.evidence.guarded import GUARDED, GuardedConfig, guarded_alignment
from rescore.evidence.plausibility import PlausibilityConfig, plausibility
from rescore.evidence.surroundings import SURROUNDINGS, SurroundingsConfig, surroundings


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
