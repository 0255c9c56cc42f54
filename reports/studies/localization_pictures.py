"""Pictures of localised cars: boxes and fitted parts drawn into photographs, and a reconstruction in 3D."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
    Line3DCollection,
    Poly3DCollection,
)

from recon.arrays import FloatArray, UInt8Array
from recon.camera import GroundedCamera
from recon.files import atomic_path
from recon.localization.standing_box import StandingBox, cam_from_ground
from recon.outlines import fill_polygon
from reports.palette import BAND_INK, ESTIMATE, TRUTH, part_colour, rgb

TRUTH_RGB, ESTIMATE_RGB = rgb(TRUTH), rgb(ESTIMATE)
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
"""Edges of a box as pairs of ``StandingBox.corners_m``; the front is 0, 3, 4, 7."""
TILE_PX = (300, 240)
_TITLE_PX = 36
_CAPTION_PX = 36
"""Height of the two lines above a tile."""
_LEAST_INSIDE = 0.85
"""A part with less of its area inside the outline is not drawn."""
_GAIN = 1.15
"""Pictures of a black table are brightened to be looked at."""


@dataclass(frozen=True, eq=False)
class Instance3DView:
    """What is drawn of one localised car."""

    truth: StandingBox
    estimate: StandingBox | None
    part_labels: tuple[int, ...]
    parts_m: FloatArray
    """Part outlines in the ground frame, shape (p, m, 3)."""
    caption: str
    ring_px: FloatArray | None = None
    """The segmented outline, shape (r, 2); parts that lie beside it are not drawn into the photograph."""


class TableCamera:
    """Projects points of the ground frame into (a crop of) the picture."""

    def __init__(self, seen_from: GroundedCamera) -> None:
        self.camera, self.pose = seen_from.camera, cam_from_ground(seen_from.ground)

    def __call__(self, points_m: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 3)."""
        return self.camera.project(points_m @ self.pose[:3, :3].T + self.pose[:3, 3])

    def faces(self, outline_m: FloatArray) -> bool:
        """Whether a part outline (m, 3), counter-clockwise from outside, is seen from outside."""
        normal = np.cross(outline_m, np.roll(outline_m, -1, axis=0)).sum(axis=0)
        eye = -self.pose[:3, :3].T @ self.pose[:3, 3]
        return bool(normal @ (eye - outline_m.mean(axis=0)) > 0)


def brightened(picture: UInt8Array) -> UInt8Array:
    """A picture (h, w, 3) of the dark table, to be looked at."""
    return np.asarray(np.clip(picture.astype(np.float32) * _GAIN, 0, 255), np.uint8)


def draw(
    picture: UInt8Array,
    crop_xy_px: tuple[int, int],
    views: Sequence[Instance3DView],
    camera: TableCamera,
    zoom: float,
) -> UInt8Array:
    """The picture (h, w, 3) enlarged and brighter, with the parts that face the camera and the boxes."""
    bright = brightened(picture)
    out = np.asarray(cv2.resize(bright, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC), np.uint8)
    for view in views:
        _draw_instance(out, crop_xy_px, view, camera, zoom)
    return out


def _draw_instance(
    out: UInt8Array, crop_xy_px: tuple[int, int], view: Instance3DView, camera: TableCamera, zoom: float
) -> None:

    def lines(points_m: FloatArray, colour: tuple[int, int, int], width: int) -> None:
        at = ((camera(points_m) + 0.5 - np.array(crop_xy_px)) * zoom - 0.5) * 8
        cv2.polylines(out, [np.round(at).astype(np.int32)], False, colour, width, cv2.LINE_AA, 3)

    for label, outline in zip(view.part_labels, view.parts_m, strict=True):
        if camera.faces(outline) and _share_inside(camera(outline), view.ring_px) >= _LEAST_INSIDE:
            lines(np.concatenate([outline, outline[:1]]), rgb(part_colour(label)), 1)
    for box, colour in ((view.truth, TRUTH_RGB), (view.estimate, ESTIMATE_RGB)):
        if box is not None:
            for a, b in _EDGES:
                front = {a, b} <= {0, 3, 4, 7}
                lines(box.corners_m[[a, b]], colour, 2 if front else 1)


def _share_inside(uv_px: FloatArray, ring_px: FloatArray | None) -> float:
    """Share of a polygon's area inside an outline; 1 where there is none."""
    if ring_px is None:
        return 1.0
    both = np.concatenate([uv_px, ring_px])
    low = np.floor(both.min(axis=0))
    width, height = (np.ceil(both.max(axis=0)) - low + 1).astype(int).tolist()
    part = fill_polygon(uv_px - low, height, width)
    inside = fill_polygon(ring_px - low, height, width)
    return float((part & inside).sum() / max(part.sum(), 1))


def titled(picture: UInt8Array, title: str) -> UInt8Array:
    """A picture below a line that says what it shows and what the colours mean."""
    band = np.full((_TITLE_PX, picture.shape[1], 3), 25, np.uint8)
    x = 12
    for text, colour in ((title, rgb(BAND_INK)), ("true box", TRUTH_RGB), ("estimate", ESTIMATE_RGB)):
        cv2.putText(band, text, (x, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 1, cv2.LINE_AA)
        x += cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)[0][0] + 28
    return np.concatenate([band, picture], axis=0)


def tile(
    picture: UInt8Array, crop_xy_px: tuple[int, int], view: Instance3DView, camera: TableCamera
) -> UInt8Array:
    """A picture of fixed size with a caption."""
    width, height = TILE_PX
    zoom = min(width / picture.shape[1], (height - _CAPTION_PX) / picture.shape[0])
    drawn = draw(picture, crop_xy_px, [view], camera, zoom)
    out = np.full((height, width, 3), 25, np.uint8)
    h, w = min(drawn.shape[0], height - _CAPTION_PX), min(drawn.shape[1], width)
    x = (width - w) // 2
    out[_CAPTION_PX : _CAPTION_PX + h, x : x + w] = drawn[:h, :w]
    for line, text in enumerate(view.caption.splitlines()):
        at = 4, 14 + 16 * line
        cv2.putText(out, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.38, rgb(BAND_INK), 1, cv2.LINE_AA)
    return out


def sheet(tiles: Sequence[UInt8Array], columns: int) -> UInt8Array:
    """Tiles of one size in rows."""
    blank = np.full_like(tiles[0], 25)
    padded = [*tiles, *[blank] * (-len(tiles) % columns)]
    rows = [np.concatenate(padded[i : i + columns], axis=1) for i in range(0, len(padded), columns)]
    return np.concatenate(rows, axis=0)


def save_png(path: Path, picture: UInt8Array) -> None:
    """Write a picture (h, w, 3)."""
    _, png = cv2.imencode(".png", picture[..., ::-1])
    with atomic_path(path) as beside:
        beside.write_bytes(png.tobytes())


def save_reconstruction(path: Path, picture: UInt8Array, view: Instance3DView, title: str) -> None:
    """One reconstruction in 3D beside its picture under a title, as in figure 7 of the report."""
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(11, 4.6), dpi=120)
        scene = figure.add_subplot(1, 2, 1, projection="3d")
        colours = [part_colour(label) for label in view.part_labels]
        scene.add_collection3d(
            Poly3DCollection(
                1000 * view.parts_m, facecolors=colours, edgecolors="black", linewidths=0.4, alpha=0.75
            )
        )
        for box, colour, name in (
            (view.truth, TRUTH_RGB, "true box"),
            (view.estimate, ESTIMATE_RGB, "estimate"),
        ):
            if box is not None:
                segments = [1000 * box.corners_m[[a, b]] for a, b in _EDGES]
                rgb01 = tuple(c / 255 for c in colour)
                scene.add_collection3d(Line3DCollection(segments, colors=[rgb01], label=name, linewidths=1.2))
        corners = 1000 * view.truth.corners_m
        middle, half = corners.mean(axis=0), 0.55 * np.ptp(corners, axis=0).max()
        scene.set_xlim(middle[0] - half, middle[0] + half)
        scene.set_ylim(middle[1] - half, middle[1] + half)
        scene.set_zlim(0, half)
        scene.set_box_aspect((1, 1, 0.5), zoom=1.15)
        # from the left side and ahead, whatever way the car points
        scene.view_init(24, float(np.rad2deg(view.truth.yaw_rad)) + 55)
        scene.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
        scene.xaxis.labelpad = scene.yaxis.labelpad = 10
        scene.locator_params(nbins=5)
        figure.legend(loc="upper left")
        figure.suptitle(title)
        photo = figure.add_subplot(1, 2, 2)
        photo.imshow(picture)
        photo.set_axis_off()
        with atomic_path(path) as beside:
            figure.savefig(beside)
