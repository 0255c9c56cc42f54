"""Fitted instances as pictures show them: their depth, the part of the picture to show, their 3D boxes."""

from itertools import pairwise

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, IntArray
from recon.camera import GroundPlane, StereoCamera
from reports.run.frame_view import CandidateView, FrameView
from reports.run.overlay import apply_transform, world_from_camera
from rescore.data.boxes3d import Boxes3D
from rescore.evidence.fit_summaries import FitSummary, FittedInstance, area_of_fit


def instance_depth(view: FrameView, fit: FitSummary, instance: FittedInstance) -> Float32Array:
    """Depth (h, w) of a fitted instance in metres, between its samples; NaN beside its silhouette."""
    h, w = view.measured.shape
    found = np.full((h, w), np.nan, np.float32)
    known = np.isfinite(instance.disparity_px)
    columns, rows = _inside(fit.column_px, w), _inside(fit.row_px, h)
    if not known.any() or not len(columns) or not len(rows):
        return found
    at = np.meshgrid(
        np.interp(columns, fit.column_px, np.arange(len(fit.column_px))),
        np.interp(rows, fit.row_px, np.arange(len(fit.row_px))),
    )
    x, y = (a.astype(np.float32) for a in at)
    share = cv2.remap(known.astype(np.float32), x, y, cv2.INTER_LINEAR)
    value = cv2.remap(np.where(known, instance.disparity_px, 0).astype(np.float32), x, y, cv2.INTER_LINEAR)
    disparity = np.where(share > _MOSTLY, value / np.maximum(share, _MOSTLY), np.nan)
    stereo = StereoCamera(view.seen_from.camera, view.baseline)
    found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = stereo.depth_m(disparity)
    return found


_MOSTLY = 0.5
"""A pixel is on the instance where more than this share of the samples around it is."""


_ERROR_PX = 2.0
"""An error of disparity that a matcher makes now and then; colours of depth span at least what it does."""


def error_m(view: FrameView, depth_m: float) -> float:
    """What ``_ERROR_PX`` of disparity do to depth at a distance, in metres."""
    return _ERROR_PX * depth_m**2 / StereoCamera(view.seen_from.camera, view.baseline).focal_baseline


def _inside(sampled_px: FloatArray, size: int) -> IntArray:
    """Pixels from the first to the last sample that lie in the picture."""
    return np.arange(max(int(sampled_px[0]), 0), min(int(sampled_px[-1]) + 1, size))


def shown_area(c: CandidateView) -> FloatArray:
    """The box of a candidate, widened to the end of the car that fits the depth best, pixel edges (4,)."""
    if c.fit is None:
        return c.xyxy_px
    return area_of_fit(c.xyxy_px, c.fit.seen.silhouette_px)


def dashes(xyxy_px: FloatArray, dash_px: float) -> FloatArray:
    """The sides of a box as dashes, from and to, shape (n, 2, 2); as long as the gaps between them."""
    x0, y0, x1, y1 = xyxy_px
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    found = []
    for start, end in pairwise(corners):
        count = max(1, round(float(np.linalg.norm(end - start)) / (2 * dash_px)))
        first = (np.arange(count) + 0.25) / count
        found.append(np.stack([first, first + 0.5 / count], axis=1)[..., None] * (end - start) + start)
    return np.concatenate(found)


def box_axes(boxes: Boxes3D, ground: GroundPlane) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 3) and axes (n, 3, 3), nose, left and up as columns, of boxes in the world of pictures."""
    world = world_from_camera(ground)
    nose = boxes.nose_cam @ world[:3, :3].T * [1, 1, 0]
    nose /= np.linalg.norm(nose, axis=1, keepdims=True)
    up = np.broadcast_to([0.0, 0.0, 1.0], nose.shape)
    return apply_transform(world, boxes.centre_cam_m), np.stack([nose, np.cross(up, nose), up], axis=2)


def solid_corners(boxes: Boxes3D, ground: GroundPlane) -> FloatArray:
    """The corners of each box in the camera frame, shape (n, 8, 3): nose left, nose right, tail right and
    tail left on the ground, then those above them."""
    centre, axes = box_axes(boxes, ground)
    corners = centre[:, None] + np.einsum("nij,nkj->nki", axes, boxes.size_m[:, None] / 2 * _SIGNS)
    world = world_from_camera(ground)
    return np.asarray((corners - world[:3, 3]) @ world[:3, :3])


_SIGNS = np.array([(nose, left, up) for up in (-1, 1) for nose, left in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
"""Where each corner lies along nose, left and up."""


def nose_marks(boxes: Boxes3D, ground: GroundPlane) -> FloatArray:
    """A triangle before the front of each box, on the ground of it, as three points (n, 3, 3) of a line."""
    centre, axes = box_axes(boxes, ground)
    half = boxes.size_m / 2
    corners = np.stack([half * [1, 1, -1], half * [1.5, 0, -1], half * [1, -1, -1]], axis=1)
    return np.asarray(centre[:, None] + np.einsum("nij,nkj->nki", axes, corners))
