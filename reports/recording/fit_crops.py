"""The pictures of one candidate of mode "instance": measured depth beside that of the fitted cars."""

import cv2
import numpy as np
import rerun as rr

from recon.arrays import Float32Array
from reports.palette import WHITE, rgb
from reports.recording.crop import Crop, depth_range, log_picture, residual_limit
from reports.recording.entities import picture
from reports.recording.frame import log_depth
from reports.recording.words import ColourRange
from reports.run.candidate_panels import RESIDUAL_LIMIT_M, colourise
from reports.run.fitted_cars import dashes, error_m, instance_depth
from reports.run.frame_view import CandidateView, FrameView

_DASH_PX = 3.0


def log_fit_crops(
    rec: rr.RecordingStream, root: str, c: CandidateView, view: FrameView, colour: tuple[int, int, int]
) -> ColourRange:
    """Log what depth shows in and around a box, beside the cars that were fitted; returns what the colours
    mean."""
    crop = log_picture(rec, root, c, view, colour)
    seen = framed = np.full(view.measured.shape, np.nan, np.float32)
    if c.fit is not None:
        seen, framed = (instance_depth(view, c.fit, one) for one in (c.fit.seen, c.fit.framed))
    _log_car(rec, f"{root}/car", c, crop)

    def cut(depth: Float32Array) -> Float32Array:
        return np.asarray(crop.cut(depth, cv2.INTER_NEAREST, np.nan), np.float32)

    measured, seen, framed = cut(view.measured), cut(seen), cut(framed)
    coarse_m = error_m(view, float(np.nanmedian(framed))) if np.isfinite(framed).any() else 0.0
    near, far = depth_range(measured, np.stack([seen, framed]), max(coarse_m, 0.5))
    for name, depth in (("measured_depth", measured), ("seen_depth", seen), ("framed_depth", framed)):
        log_depth(rec, f"{root}/{name}", depth, range_m=(near, far))
    limit = residual_limit(framed, max(coarse_m, RESIDUAL_LIMIT_M))
    rec.log(f"{root}/residual", picture(colourise(measured - framed, -limit, limit, "RdBu"), quality=90))
    return ColourRange(near, far, limit)


def _log_car(rec: rr.RecordingStream, path: str, c: CandidateView, crop: Crop) -> None:
    """Where the car that fits the depth best ends, as dashes."""
    strips = np.zeros((0, 2, 2))
    if c.fit is not None:
        strips = dashes(crop.points(c.fit.seen.silhouette_px.reshape(2, 2)).ravel(), _DASH_PX)
    rec.log(
        path,
        rr.LineStrips2D(
            strips, colors=[rgb(WHITE)] * len(strips), radii=rr.Radius.ui_points(1.2), draw_order=21
        ),
    )
