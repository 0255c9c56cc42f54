"""A frame seen from above: measured points, the cars that were fitted, distances."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from recon.arrays import FloatArray
from reports.palette import NIGHT, NIGHT_AXIS, NIGHT_GRID, NIGHT_INK, NIGHT_SKY
from reports.publishing.street_boxes import StreetBox
from reports.run.fitted_cars import nose_marks, solid_corners
from reports.run.frame_view import FrameView
from reports.run.overlay import apply_transform, points_of_depth, world_from_camera
from rescore.data.boxes3d import Boxes3D

FARTHEST_M = 40.0
"""Farther things are not shown: the disparity of a narrow pair says little there."""
_BEHIND_M = 1.5
_HEIGHTS_M = (0.3, 2.5)
"""Points of these heights are shown: not the ground, and nothing that hangs over it."""
_STEP = 2
_RINGS_M = (10, 20, 30)


def draw_birds_eye(ax: Axes, view: FrameView, boxes: Sequence[StreetBox], text_px: float) -> None:
    """Draw measured points, rings of distance and 3D boxes.

    Boxes are solid where depth speaks for a car; else dashed, where one would have to stand.

    Args:
        ax: axes that fill their part of the figure.
        view: the frame.
        boxes: its boxes.
        text_px: height of words.
    """
    shown = [b for b in boxes if b.has_evidence and b.view.box3d is not None]
    shown = [b for b in shown if _box(b).distance_m[0] < FARTHEST_M]
    far = min(FARTHEST_M, max((float(_box(b).distance_m[0]) for b in shown), default=FARTHEST_M) + 6)
    wide, tall = ax.bbox.width, ax.bbox.height
    half = (far + _BEHIND_M) * wide / tall / 2
    ax.set(xlim=(-half, half), ylim=(-_BEHIND_M, far), facecolor=NIGHT_SKY, xticks=[], yticks=[])
    metre_px = tall / (far + _BEHIND_M)
    size = text_px * 72 / ax.figure.dpi
    _draw_rings(ax, view, far, half, size, text_px / metre_px)
    points = _points(view)
    near = points[:, 1] < far
    ax.scatter(points[near, 0], points[near, 1], s=1.2, color=NIGHT_AXIS, alpha=0.35, linewidths=0)
    ax.add_patch(Polygon([(-0.55, -0.9), (0.55, -0.9), (0, 0.5)], color=NIGHT_INK, zorder=5))
    for b in shown:
        _draw_car(ax, b, view, size, 0.9 * text_px / metre_px)


def _box(b: StreetBox) -> Boxes3D:
    assert b.view.box3d is not None
    return b.view.box3d


def _draw_rings(ax: Axes, view: FrameView, far: float, half: float, size: float, size_m: float) -> None:
    """The edges of the view and circles of equal distance, with words of a size in points and metres."""
    camera = view.seen_from.camera
    for edge_px in (-0.5, camera.width_px - 0.5):
        slope = (edge_px - camera.cx_px) / camera.fx_px
        ax.plot([0, slope * 2 * far], [0, 2 * far], color=NIGHT_GRID, lw=1.2, zorder=1)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    for ring in (r for r in _RINGS_M if r < far - 1):
        ax.plot(ring * np.sin(angle), ring * np.cos(angle), color=NIGHT_GRID, lw=1.2, zorder=1)
        # beside the view, where nothing is measured, or at the edge of the panel
        x = min(ring * np.sin(_WORDS_RAD), half - 3.6 * size_m)
        y = float(np.sqrt(ring**2 - x**2))
        ax.text(x, y, f" {ring} m", color=NIGHT_AXIS, fontsize=size, ha="left", va="top", zorder=2)


_WORDS_RAD = 1.05
"""Bearing at which the distance of a ring is told."""


def _points(view: FrameView) -> FloatArray:
    """Measured points above the ground, thinned, world frame, shape (n, 3)."""
    depth = view.measured[::_STEP, ::_STEP]
    whole = points_of_depth(view.measured, view.seen_from.camera)[::_STEP, ::_STEP]
    points = apply_transform(world_from_camera(view.seen_from.ground), whole[np.isfinite(depth)])
    low, high = _HEIGHTS_M
    return np.asarray(points[(points[:, 2] > low) & (points[:, 2] < high)])


def _draw_car(ax: Axes, b: StreetBox, view: FrameView, size: float, line_m: float) -> None:
    """One box with its nose, its number and its distance."""
    ground = view.seen_from.ground
    world = world_from_camera(ground)
    corners = apply_transform(world, solid_corners(_box(b), ground)[0])[:4, :2]
    nose = nose_marks(_box(b), ground)[0, :, :2]
    solid = b.speaks_for
    how: dict[str, Any] = {"ls": "-" if solid else (0, (3, 2)), "lw": 2.4, "zorder": 4}
    inside = to_rgba(b.colour, 0.35 if solid else 0.0)
    ax.add_patch(Polygon(corners, facecolor=inside, edgecolor=b.colour, **how))
    ax.plot(*nose.T, color=b.colour, lw=2.0, zorder=4)
    beside = np.concatenate([corners, nose])[:, 0].max() + 0.4 * line_m
    words = f"{b.number}   {_box(b).distance_m[0]:.0f} m"
    y = corners[:, 1].mean()
    text = ax.text(beside, y, words, color=b.colour, fontsize=size, va="center", zorder=6, clip_on=True)
    text.set_path_effects([withStroke(linewidth=4, foreground=NIGHT)])
