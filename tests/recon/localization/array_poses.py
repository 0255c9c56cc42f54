"""The likelihood of poses as array arithmetic, all samples of a box at once, to compare the loops with."""

import numpy as np

from recon.arrays import FloatArray
from recon.camera import GroundedCamera
from recon.localization.box_samples import BoxSamples, DisparityNoise
from recon.localization.depth_views import DepthViews
from recon.localization.poses import Poses, SurfaceNoise
from recon.localization.standing_box import cam_from_ground


def silhouette_boxes(poses: Poses, views: DepthViews, seen_from: GroundedCamera) -> FloatArray:
    """Boxes (m, 4) around the silhouettes, cut off at the picture's edge."""
    distance, bearing, heading, log_scale = poses.place.T
    at = _nearest(views, distance * np.exp(-log_scale)), _turns(views, heading)
    left, right, foot, top = (views.extent_m[poses.shape, *at] * np.exp(poses.place[:, 3:])).T
    across = np.stack([left, right, (left + right) / 2, (left + right) / 2])
    up = np.stack([(foot + top) / 2, (foot + top) / 2, top, foot])
    sin, cos = np.sin(bearing), np.cos(bearing)
    ground = np.stack([distance * sin + across * cos, distance * cos - across * sin, up], axis=-1)
    pose = cam_from_ground(seen_from.ground)
    cam = ground @ pose[:3, :3].T + pose[:3, 3]
    ahead = cam[..., 2] > 0.3
    uv = seen_from.camera.project(np.where(ahead[..., None], cam, 1.0)) + 0.5
    size = [seen_from.camera.width_px, seen_from.camera.height_px]
    boxes = np.stack([uv[0, :, 0], uv[2, :, 1], uv[1, :, 0], uv[3, :, 1]], axis=1)
    boxes = np.where(ahead.all(axis=0)[:, None], boxes, [0, 0, *size])
    return np.clip(boxes, 0, [*size, *size])


def explained(
    poses: Poses,
    views: DepthViews,
    samples: BoxSamples,
    noise: DisparityNoise,
    surface: SurfaceNoise,
    step: int,
    fine: bool,
) -> tuple[FloatArray, FloatArray]:
    """Log ratios and predicted disparities, each of shape (m, n), of every ``step``-th row and column."""
    cut = np.s_[::step, ::step]
    ray = samples.ray[cut].reshape(-1, 3).astype(float)
    seen, background = samples.disparity_px[cut].ravel(), samples.log_background[cut].ravel()
    distance, bearing, heading, log_scale = poses.place.T[..., None]
    scale, sin, cos = np.exp(log_scale), np.sin(bearing), np.cos(bearing)
    forward = ray[:, 0] * sin + ray[:, 1] * cos
    across = distance / forward * (ray[:, 0] * cos - ray[:, 1] * sin)
    up = distance / forward * ray[:, 2] + samples.seen_from.ground.height_m
    at = _nearest(views, (distance / scale)[:, 0])
    turn = heading * views.headings / (2 * np.pi)
    low = np.floor(turn)
    maps = [_look_up(views, poses.shape, at, _turns(views, heading)[:, 0], across / scale, up / scale)]
    if fine:
        maps = [
            _look_up(
                views,
                poses.shape,
                at,
                (low + k)[:, 0].astype(int) % views.headings,
                across / scale,
                up / scale,
            )
            for k in (0, 1)
        ]
        share = turn - low
        mixed = (1 - share) * maps[0][0] + share * maps[1][0]
        relief = np.where(np.isnan(mixed), np.where(share < 0.5, maps[0][0], maps[1][0]), mixed)
        inset = np.where(np.isnan(relief), 0, (1 - share) * maps[0][1] + share * maps[1][1])
    else:
        relief, inset = maps[0]
    predicted = samples.seen_from.stereo.focal_baseline * forward / (distance + relief * scale)
    spread = np.sqrt(noise.sd_px**2 + (predicted * (surface.shape_m / distance)) ** 2)
    residual = (seen - predicted) / spread
    other = np.where(residual > 0, surface.before, surface.behind) / noise.largest_px
    density = (1 - surface.before) / np.sqrt(2 * np.pi) * np.exp(-0.5 * residual**2) / spread + other
    margin = np.maximum(noise.bleeding_px * distance / samples.seen_from.stereo.left.fx_px, 1e-3)
    weight = np.clip(inset * scale / margin, 0, 1) * samples.weight
    return np.where(np.isfinite(residual), (np.log(density) - background) * weight, 0), predicted


def _nearest(views: DepthViews, distance_m: FloatArray) -> FloatArray:
    return np.searchsorted(views.border_m, distance_m)


def _turns(views: DepthViews, heading_rad: FloatArray) -> FloatArray:
    return np.rint(heading_rad * (views.headings / (2 * np.pi))).astype(int) % views.headings


def _look_up(
    views: DepthViews,
    shape: FloatArray,
    distance: FloatArray,
    heading: FloatArray,
    across_m: FloatArray,
    up_m: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    rows, columns = views.relief_m.shape[3:]
    column = np.clip(np.rint(across_m / views.step_m) + columns // 2, 0, columns - 1).astype(int)
    row = np.clip(np.rint(up_m / views.step_m) + views.ground_row, 0, rows - 1).astype(int)
    at = (shape[:, None], distance[:, None], heading[:, None], row, column)
    return views.relief_m[at].astype(float), views.inset_m[at].astype(float)
