"""Closed outlines: from masks to polygons and back, and even resampling."""

from collections.abc import Sequence

import cv2
import numpy as np

from recon.arrays import BoolArray, FloatArray, Int32Array


def mask_rings(mask: BoolArray) -> tuple[Int32Array, ...]:
    """Rings (m, 2) of pixel centres around every region and hole of a mask; ``fill_rings`` undoes it."""
    rings, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    return tuple(np.asarray(r, np.int32).reshape(-1, 2) for r in rings)


def fill_rings(rings: Sequence[Int32Array], height_px: int, width_px: int) -> BoolArray:
    """The mask (h, w) inside rings (m, 2) by the even-odd rule; pixels on a ring belong to the mask."""
    image = np.zeros((height_px, width_px), np.uint8)
    if rings:
        cv2.drawContours(image, [np.ascontiguousarray(r).reshape(-1, 1, 2) for r in rings], -1, 1, cv2.FILLED)
    return image.astype(bool)


def fill_polygon(polygon_px: FloatArray, height_px: int, width_px: int) -> BoolArray:
    """The mask (h, w) of pixels inside a closed polygon (m, 2) in pixel-centre coordinates, to 1/16 pixel."""
    image = np.zeros((height_px, width_px), np.uint8)
    cv2.fillPoly(image, [np.rint(polygon_px * 16).astype(np.int32)], 1, shift=4)
    return image.view(bool)


def largest_outline(mask: BoolArray) -> FloatArray | None:
    """The outer ring (m, 2) of the largest connected region, pixel centres; None for an empty mask."""
    rings = outer_rings(mask)
    return largest(rings) if rings else None


def outer_rings(mask: BoolArray) -> tuple[Int32Array, ...]:
    """Outer rings (m, 1, 2) of all connected regions, pixel centres."""
    rings, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return tuple(np.asarray(r, np.int32) for r in rings)


def largest(rings: Sequence[Int32Array]) -> FloatArray:
    """The ring (m, 2) of one or more (m, 1, 2) that encloses most."""
    ring = rings[0] if len(rings) == 1 else max(rings, key=lambda r: (cv2.contourArea(r), len(r)))
    return np.asarray(ring, float).reshape(-1, 2)


def resample(outline: FloatArray, count: int) -> FloatArray:
    """``count`` points (count, d) evenly spaced along a closed outline (m, d), from its first point on."""
    closed = np.concatenate([outline, outline[:1]])
    steps, length = closed[1:] - closed[:-1], np.zeros(len(closed))
    np.cumsum(np.sqrt((steps * steps).sum(axis=1)), out=length[1:])
    at, found = np.arange(count) * (length[-1] / count), np.empty((count, closed.shape[1]))
    for k in range(closed.shape[1]):
        found[:, k] = np.interp(at, length, closed[:, k])
    return found


def canonical_ring(outline_m: FloatArray, normal: FloatArray, count: int) -> FloatArray:
    """An outline (m, 3) resampled so that outlines of one part of several objects correspond, (count, 3).

    It runs counter-clockwise seen against the normal, from its foremost, uppermost, leftmost corner on; all
    outlines are in object axes (x forward, y left, z up).
    """
    newell = np.cross(outline_m, np.roll(outline_m, -1, axis=0)).sum(axis=0)
    ring = outline_m if newell @ normal > 0 else outline_m[::-1]
    start = int(np.argmax(ring @ np.array([1.0, 0.5, 0.6])))
    return resample(np.roll(ring, -start, axis=0), count)
