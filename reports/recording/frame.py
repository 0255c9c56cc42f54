"""One frame of a recording without its candidates: pictures, measured depth, points, ground, cameras."""

import cv2
import numpy as np
import rerun as rr

from recon.arrays import Float32Array
from recon.camera import GroundPlane
from reports.palette import GROUND, LEFT_EYE, RIGHT_EYE, rgb
from reports.recording.entities import (
    CAMERA,
    HOLE_CLASS,
    IMAGE,
    RIGHT_CAMERA,
    RIGHT_IMAGE,
    WORLD,
    padded,
    picture,
    pinhole,
)
from reports.run.frame_view import FrameView
from reports.run.overlay import apply_transform, stereo_points, world_from_camera

DEPTH_UNIT = 100.0
"""Stored depth a metre: centimetres, finer than stereo resolves and far smaller on disk than millimetres."""
DEPTH_RANGE_M = (2.0, 40.0)


def log_frame(rec: rr.RecordingStream, view: FrameView, size_px: tuple[int, int]) -> None:
    """Log one frame at the time that is set.

    Args:
        rec: the recording.
        view: the frame.
        size_px: width and height that pictures are stored with, those of the largest.
    """
    h, w = view.measured.shape
    world = world_from_camera(view.seen_from.ground)
    look = {"image_plane_distance": 0.55, "color": rgb(LEFT_EYE)}
    rec.log(CAMERA, rr.Transform3D(translation=world[:3, 3], mat3x3=world[:3, :3]))
    rec.log(IMAGE, pinhole(view.seen_from.camera.matrix, w, h, **look))
    rec.log(f"{IMAGE}/left", picture(padded(view.rgb, size_px, 0)))
    if view.right_rgb is not None:
        right = apply_transform(world, np.array([view.baseline, 0.0, 0.0]))
        rec.log(RIGHT_CAMERA, rr.Transform3D(translation=right, mat3x3=world[:3, :3]))
        rec.log(
            RIGHT_IMAGE, pinhole(view.seen_from.camera.matrix, w, h, **(look | {"color": rgb(RIGHT_EYE)}))
        )
        rec.log(f"{RIGHT_IMAGE}/right", picture(padded(view.right_rgb, size_px, 0)))
    depth = in_metres(view.measured, view)
    log_depth(rec, f"{IMAGE}/measured_depth", padded(depth, size_px, np.nan))
    boxes = np.array([c.xyxy_px for some in view.candidates.values() for c in some]).reshape(-1, 4)
    xyz, colours = stereo_points(depth, view.rgb, view.seen_from.camera, boxes)
    rec.log(
        f"{WORLD}/stereo_points",
        rr.Points3D(apply_transform(world, xyz), colors=colours, radii=rr.Radius.ui_points(1.6)),
    )
    rec.log(f"{WORLD}/ground", _ground_grid(view.seen_from.ground))


def in_metres(depth: Float32Array, view: FrameView) -> Float32Array:
    """Depth for 3D: as it is where it is in metres, else scaled so that the median of the frame is 10 m."""
    if view.metric:
        return depth
    middle = np.nanmedian(view.measured) if np.isfinite(view.measured).any() else 1.0
    return (depth * (10.0 / middle)).astype(np.float32)


def log_depth(
    rec: rr.RecordingStream,
    path: str,
    depth_m: Float32Array,
    range_m: tuple[float, float] = DEPTH_RANGE_M,
) -> None:
    """Log depth at ``path/depth``, and above it at ``path/holes`` a mask that shows holes as dark pixels."""
    rec.log(f"{path}/depth", depth_picture(depth_m, range_m))
    holes = np.where(np.isfinite(depth_m) & (depth_m > 0), 0, HOLE_CLASS).astype(np.uint8)
    rec.log(f"{path}/holes", rr.SegmentationImage(holes, opacity=1.0, draw_order=5))


def depth_picture(depth_m: Float32Array, range_m: tuple[float, float]) -> rr.EncodedDepthImage:
    """A depth picture of 16 bits, as PNG; holes are 0."""
    steps = np.nan_to_num(depth_m * DEPTH_UNIT, nan=0.0, posinf=0.0, neginf=0.0)
    steps = np.where(steps < np.iinfo(np.uint16).max, np.clip(np.rint(steps), 0, None), 0).astype(np.uint16)
    shown = [v * DEPTH_UNIT for v in range_m]
    _, png = cv2.imencode(".png", steps)
    return rr.EncodedDepthImage(
        png.tobytes(), media_type="image/png", meter=DEPTH_UNIT, colormap="viridis", depth_range=shown
    )


def _ground_grid(
    ground: GroundPlane, half_width_m: int = 12, far_m: int = 48, step_m: int = 4
) -> rr.LineStrips3D:
    """A patch of the ground plane as a grid of lines, z = 0 in the world frame."""
    across = [[(-half_width_m, y, 0), (half_width_m, y, 0)] for y in range(0, far_m + 1, step_m)]
    along = [[(x, 0, 0), (x, far_m, 0)] for x in range(-half_width_m, half_width_m + 1, step_m)]
    return rr.LineStrips3D(across + along, colors=[rgb(GROUND)], radii=rr.Radius.ui_points(0.6))
