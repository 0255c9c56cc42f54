"""The canonical window of a box: the picture on the class model's grid, and the outlines found there."""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.errors import Failure, Reason
from recon.outlines import largest, outer_rings
from recon.reconstruction.part_registration import CanonicalGrid

_PIECE = 0.1
"""Share of the object's area above which a separate region counts as a piece of the object."""


@dataclass(frozen=True, eq=False)
class GridToImage:
    """Canonical to image coordinates for one box."""

    scale: FloatArray
    """Pixels of the picture that a pixel of the grid spans, shape (2,)."""
    shift: FloatArray
    """Where the grid's first pixel lies in the picture, shape (2,)."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """Pixel centres of the picture (n, 2) of points (n, 2) of the canonical grid."""
        return points * self.scale + self.shift


def grid_to_image(grid: CanonicalGrid, box_px: FloatArray) -> GridToImage:
    """The coordinates of the picture for a box (4,) on a canonical grid."""
    scale, shift = grid.image_from_grid(box_px[None])
    return GridToImage(scale[0], shift[0])


def canonical_windows(rgb: UInt8Array, xyxy_px: FloatArray, grid: CanonicalGrid) -> Float32Array:
    """Each box with its margin on the canonical grid in CIE Lab, shape (n, h, w, 3), borders repeated."""
    scales, shifts = grid.image_from_grid(xyxy_px)
    out = np.empty((len(xyxy_px), grid.height_px, grid.width_px, 3), np.float32)
    for i, (scale, shift) in enumerate(zip(scales, shifts, strict=True)):
        reach = np.array([grid.width_px, grid.height_px]) * scale
        low = np.clip(np.floor(shift) - 8, 0, np.array(rgb.shape[1::-1]) - 1).astype(int)
        high = np.clip(np.ceil(shift + reach) + 8, low + 1, rgb.shape[1::-1]).astype(int)
        crop = rgb[low[1] : high[1], low[0] : high[0]]
        if (scale > 1).any():
            # shrinking needs a blur first, or edges alias; a box filter of one grid pixel is enough
            blurred = cv2.blur(crop, (max(1, round(scale[0])), max(1, round(scale[1]))))
            crop = np.asarray(blurred, np.uint8)
        affine = np.array([[scale[0], 0, shift[0] - low[0]], [0, scale[1], shift[1] - low[1]]])
        window = cv2.warpAffine(
            crop,
            affine,
            (grid.width_px, grid.height_px),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        out[i] = cv2.cvtColor(window.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2Lab)
    return out


def zero_level(phi: Float32Array, start: Float32Array, min_iou: float) -> FloatArray | Failure:
    """The outline of the largest region, to a quarter of a canonical pixel.

    Args:
        phi: the level set after its evolution, shape (h, w), negative inside.
        start: the level set before.
        min_iou: smallest intersection over union of the two regions.
    """
    inside, before = phi < 0, start < 0
    fine = cv2.resize(phi, None, fx=4, fy=4, interpolation=cv2.INTER_LINEAR) < 0
    rings = outer_rings(fine)
    if len(rings) > 1:
        rings = outer_rings(_in_one_piece(fine, start))
    if not rings:
        return Failure(Reason.NO_OUTLINE, "an outline expected, the level set vanished")
    outline = (largest(rings) + 0.5) / 4 - 0.5
    iou = int(np.count_nonzero(inside & before)) / max(int(np.count_nonzero(inside | before)), 1)
    if iou < min_iou:
        return Failure(
            Reason.NO_OUTLINE,
            f"an outline that keeps {min_iou:g} of its start (IoU) expected, got {iou:.2f}",
        )
    return outline


def _in_one_piece(mask: BoolArray, start: Float32Array) -> BoolArray:
    """The mask (4 h, 4 w) with its larger regions joined where a thin limb was pinched off.

    What joins them lies inside the start (h, w); nothing is added where one region has nearly all.
    """
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = np.sort(stats[1:, cv2.CC_STAT_AREA])[::-1]
    if len(areas) < 2 or areas[1] < _PIECE * areas.sum():
        return mask
    inside = cv2.resize(start, mask.shape[::-1], interpolation=cv2.INTER_LINEAR) < 0
    pieces = int((areas >= _PIECE * areas.sum()).sum())
    for across in range(9, max(10, mask.shape[0] // 5), 8):
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across))
        closed = mask | (inside & (cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc) > 0))
        _, _, stats, _ = cv2.connectedComponentsWithStats(closed.astype(np.uint8))
        large = int((stats[1:, cv2.CC_STAT_AREA] >= _PIECE * areas.sum()).sum())
        if large < pieces:
            mask, pieces = closed, large
        if pieces < 2:
            break
    return mask
