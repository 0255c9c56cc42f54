"""Colour segmentation of a car on the black table: what differs in colour from the known empty table."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synth.photos.table_scene import photograph_empty, table_mask
from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.errors import Failure, Reason
from recon.pixels import linear_from_srgb


@dataclass(frozen=True)
class TableSegmentConfig:
    """Settings of the segmentation."""

    smooth_sigma_px: float = 1.2
    """Gaussian over the picture, against noise."""
    brighter: float = 0.06
    """A pixel this share brighter than the table is the car ..."""
    darkest_shadow: float = 0.36
    """... as is one that is darker than this share of the table, which a shadow outside the footprint hardly
    is. In between it is shadow, unless it has a colour of its own:"""
    tint: float = 0.09
    """difference of a channel from the table in this light, as a share of the brighter of the two."""
    beside: float = 0.03
    """No shadow falls on what is seen beside the table, so that there a pixel whose light differs by this
    share in any channel is the car."""
    noise: float = 0.004
    """Linear light that is lost in noise; it keeps shares of dark pixels calm."""
    close_px: int = 9
    """Gaps up to this width are closed: seams and mirrored table in dark paint."""
    group_px: int = 15
    """Pieces with gaps up to this width belong to one thing: between them may lie panels as dark as shade."""
    panel_differs: float = 0.08
    """Relative difference of light from the table's by which a pixel inside the pieces' convex hull may be of
    a dark panel; shade may differ as much."""
    panel_area: float = 0.02
    """Share of the pieces' convex hull that pixels of ``panel_differs`` fill in one piece, slivers dropped,
    where they are a dark panel."""
    panel_sliver_px: int = 7
    """Width of slivers: shade in dents of the outline."""
    min_area_px: int = 400
    """Regions of fewer pixels are no car."""


@dataclass(frozen=True, eq=False)
class EmptyTable:
    """Light of the empty table, smoothed as pictures of the table are."""

    light: Float32Array
    """Mean linear light, shape (h, w, 3)."""
    on_table: BoolArray
    """Where the picture shows the table or its blurred edge, shape (h, w)."""
    config: TableSegmentConfig

    @staticmethod
    def of_pictures(light: Float32Array, on_table: BoolArray, config: TableSegmentConfig) -> "EmptyTable":
        """The empty table from the mean linear light (h, w, 3) of pictures of it, and the mask (h, w) of the
        table."""
        edge = np.ones((7, 7), np.uint8)
        return EmptyTable(
            _smooth(light, config), cv2.dilate(on_table.astype(np.uint8), edge).astype(bool), config
        )


@lru_cache(maxsize=1)
def empty_table(config: TableSegmentConfig) -> EmptyTable:
    """The empty table, photographed once in a process."""
    return EmptyTable.of_pictures(photograph_empty(), table_mask(), config)


def _smooth(light: Float32Array, config: TableSegmentConfig) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(light, (0, 0), config.smooth_sigma_px), np.float32)


@dataclass(frozen=True, eq=False)
class TableRegion:
    """One thing on the table."""

    mask: BoolArray
    """Shape (h, w), holes filled."""
    ring_px: FloatArray
    """Centres of its border pixels, shape (m, 2)."""


def segment_table(rgb: UInt8Array, table: EmptyTable) -> list[TableRegion] | Failure:
    """The things on the table in a picture (h, w, 3), the largest first; a failure where there is none."""
    config = table.config
    light = _smooth(linear_from_srgb(rgb), config)
    grey, grey_empty = (_mean(of) + config.noise for of in (light, table.light))
    share = grey / grey_empty
    # in units of the table where it is the brighter one: in a deep shadow noise would have a colour
    own = _largest(np.abs(light - share[..., None] * table.light))
    tint = own / np.maximum(grey, grey_empty)
    on_table = (share > 1 + config.brighter) | (share < config.darkest_shadow) | (tint > config.tint)
    beside = _largest(np.abs(light - table.light) - config.beside * table.light) > 0
    sure = _without_specks(np.where(table.on_table, on_table, beside), config)
    differs = np.abs(cv2.GaussianBlur(share, (0, 0), 1.5) - 1) > config.panel_differs
    return _regions(_with_dark_panels(sure, differs, config), config)


# NumPy is many times slower along an axis of three
def _mean(channels: Float32Array) -> Float32Array:
    """The mean (h, w) of three channels (h, w, 3)."""
    return np.asarray((channels[..., 0] + channels[..., 1] + channels[..., 2]) / np.float32(3))


def _largest(channels: Float32Array) -> Float32Array:
    """The largest (h, w) of three channels (h, w, 3)."""
    return np.asarray(np.maximum(np.maximum(channels[..., 0], channels[..., 1]), channels[..., 2]))


def _without_specks(car: BoolArray, config: TableSegmentConfig) -> UInt8Array:
    """A mask (h, w) with specks dropped and small gaps closed."""
    speck = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    mask = cv2.morphologyEx(car.astype(np.uint8), cv2.MORPH_OPEN, speck)
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _disc(config.close_px)), np.uint8)


def _disc(width_px: int) -> UInt8Array:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width_px, width_px)), np.uint8)


def _with_dark_panels(sure: UInt8Array, differs: BoolArray, config: TableSegmentConfig) -> UInt8Array:
    """A mask (h, w) with what lies between the pieces of a thing, dark as shade and as large as a panel."""
    groups = cv2.morphologyEx(sure, cv2.MORPH_CLOSE, _disc(config.group_px))
    rings, _ = cv2.findContours(groups, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    out = sure.copy()
    for ring in (r for r in rings if cv2.contourArea(r) >= config.min_area_px):
        hull = np.zeros_like(sure)
        cv2.fillConvexPoly(hull, cv2.convexHull(ring), 1)
        solid = cv2.drawContours(np.zeros_like(sure), [ring], -1, 1, cv2.FILLED)
        lost = ((hull > 0) & differs & (solid == 0)).astype(np.uint8)
        lost = cv2.morphologyEx(lost, cv2.MORPH_OPEN, _disc(config.panel_sliver_px))
        _, label, stats, _ = cv2.connectedComponentsWithStats(lost)
        large = np.nonzero(stats[:, cv2.CC_STAT_AREA] >= config.panel_area * hull.sum())[0]
        panels = np.isin(label, large[large > 0])
        if panels.any():
            wide = cv2.dilate(panels.astype(np.uint8), _disc(3))
            out[(solid > 0) | (wide > 0)] = 1
    return np.asarray(cv2.morphologyEx(out, cv2.MORPH_CLOSE, _disc(config.close_px)), np.uint8)


def _regions(mask: UInt8Array, config: TableSegmentConfig) -> list[TableRegion] | Failure:
    """Regions of a mask (h, w), holes filled."""
    rings, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rings = sorted(rings, key=cv2.contourArea, reverse=True)
    largest = cv2.contourArea(rings[0]) if rings else 0.0
    if largest < config.min_area_px:
        return Failure(
            Reason.NO_OUTLINE,
            f"a region of at least {config.min_area_px} pixels expected on the table, got {largest:.0f}",
        )
    return [_filled(r, mask.shape) for r in rings if cv2.contourArea(r) >= config.min_area_px]


def _filled(ring: NDArray[Any], shape: tuple[int, ...]) -> TableRegion:
    out = np.zeros(shape, np.uint8)
    cv2.drawContours(out, [ring], -1, 1, cv2.FILLED)
    return TableRegion(out.astype(bool), np.asarray(ring, float).reshape(-1, 2))
