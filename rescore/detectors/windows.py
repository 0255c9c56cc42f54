"""Sliding windows: how a box sits in its window, and the cutting of canonical crops."""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.errors import RescoreError


@dataclass(frozen=True)
class WindowGeometry:
    """The canonical window: an object of one size with a margin of context around it."""

    object_width_px: int = 88
    object_height_px: int = 32
    margin_x_px: int = 8
    margin_y_px: int = 8

    def __post_init__(self) -> None:
        if (
            min(self.object_width_px, self.object_height_px) < 1
            or min(self.margin_x_px, self.margin_y_px) < 0
        ):
            raise RescoreError(
                f"window: sizes must be positive and margins not negative, got {self}; mend the config"
            )

    @property
    def width_px(self) -> int:
        """Width of the whole window."""
        return self.object_width_px + 2 * self.margin_x_px

    @property
    def height_px(self) -> int:
        """Height of the whole window."""
        return self.object_height_px + 2 * self.margin_y_px

    def boxes(self, left_top_px: FloatArray, scale: FloatArray | float) -> FloatArray:
        """Object boxes (n, 4) of windows with corners (n, 2); ``scale`` is picture over window pixels."""
        corner = np.asarray(left_top_px, dtype=float).reshape(-1, 2)
        s = np.broadcast_to(np.asarray(scale, dtype=float), len(corner))[:, None]
        low = corner + s * [self.margin_x_px, self.margin_y_px]
        return np.concatenate([low, low + s * [self.object_width_px, self.object_height_px]], axis=1)

    def windows(self, xyxy_px: FloatArray) -> FloatArray:
        """Windows (n, 4) whose object has the width, the middle and the bottom edge of each box (n, 4).

        A scan knows one aspect ratio. Width and ground line put the wheels of all cars in one place;
        what differs then is the height of the roof.
        """
        boxes = np.asarray(xyxy_px, dtype=float).reshape(-1, 4)
        s = (boxes[:, 2] - boxes[:, 0]) / self.object_width_px
        x0 = boxes[:, 0] - s * self.margin_x_px
        y1 = boxes[:, 3] + s * self.margin_y_px
        return np.stack([x0, y1 - s * self.height_px, x0 + s * self.width_px, y1], axis=1)


def gray(rgb: UInt8Array) -> UInt8Array:
    """The picture (h, w, 3) or (h, w) as (h, w) uint8 luminance."""
    if rgb.dtype != np.uint8 or rgb.ndim not in (2, 3) or (rgb.ndim == 3 and rgb.shape[2] != 3):
        raise RescoreError(
            f"picture: expected (h, w, 3) uint8 RGB, got {rgb.shape} {rgb.dtype}; convert it first"
        )
    picture = rgb if rgb.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY)
    return np.ascontiguousarray(picture, dtype=np.uint8)


def crop_windows(
    picture: UInt8Array, windows_px: FloatArray, geometry: WindowGeometry, interpolation: int
) -> UInt8Array:
    """Canonical crops (n, height, width) of windows (n, 4); outside the picture it is mirrored.

    ``interpolation`` is the one by which the scan shrinks its pictures, so that a crop looks as a scanned
    window does.
    """
    size = (geometry.width_px, geometry.height_px)
    crops = np.empty((len(windows_px), geometry.height_px, geometry.width_px), np.uint8)
    for i, window in enumerate(windows_px):
        crops[i] = cv2.resize(_cut(picture, window), size, interpolation=interpolation)
    return crops


def _cut(picture: UInt8Array, window_px: FloatArray) -> UInt8Array:
    x0, y0 = np.round(window_px[:2]).astype(int)
    x1, y1 = np.maximum(np.round(window_px[2:]).astype(int), (x0 + 1, y0 + 1))
    height, width = picture.shape
    before = max(0, -x0), max(0, -y0)
    after = max(0, x1 - width), max(0, y1 - height)
    inside = picture[max(0, y0) : min(height, y1), max(0, x0) : min(width, x1)]
    if inside.size == 0:
        raise RescoreError(
            f"window {window_px.tolist()} lies outside the {width} x {height} picture; mend the boxes"
        )
    if not any(before + after):
        return inside
    # the whole picture is mirrored, so that a mirror wider than the cut piece still has pixels to show
    padded = cv2.copyMakeBorder(picture, before[1], after[1], before[0], after[0], cv2.BORDER_REFLECT_101)
    return np.asarray(padded[y0 + before[1] : y1 + before[1], x0 + before[0] : x1 + before[0]], np.uint8)


def clip_boxes(xyxy_px: FloatArray, width_px: int, height_px: int) -> FloatArray:
    """Boxes (n, 4) cut to the picture, as annotations are."""
    return np.clip(xyxy_px, 0.0, [width_px, height_px, width_px, height_px])
