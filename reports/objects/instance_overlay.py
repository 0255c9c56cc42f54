"""The picture of an instance, overlaid with its outline, parts, ground line and 3D box."""

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.reconstruction.instance import NEAR_M, Instance3D
from recon.reconstruction.reconstruct import Reconstruction
from reports import palette

_EDGES = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
"""Corners of a box that an edge joins: their numbers differ in one bit."""


def instance_overlay(
    rgb: UInt8Array, found: Reconstruction, instance: Instance3D, camera: PinholeCamera
) -> UInt8Array:
    """The picture (h, w, 3) with part regions tinted, outline, ground line and box drawn."""
    out = rgb.copy()
    window = out[found.depth.window]
    for label in (int(k) for k in np.unique(found.part_labels) if k):
        own = found.part_labels == label
        tint = np.array(palette.rgb(palette.part_colour(label)))
        window[own] = (0.5 * window[own] + 0.5 * tint).astype(np.uint8)
    width = max(1, round(max(rgb.shape) / 600))
    _lines(out, [found.outline_px], True, palette.rgb(palette.YELLOW), width)
    corners = instance.corners_m
    if corners[:, 2].min() > NEAR_M:
        at = camera.project(corners)
        _lines(out, [at[list(edge)] for edge in _EDGES], False, palette.rgb(palette.SKY), width)
        # the nose: the upper front edge
        _lines(out, [at[[5, 7]]], False, palette.rgb(palette.VERMILION), width + 1)
    _lines(out, [found.ground_line_px], False, palette.rgb(palette.GREEN), width + 1)
    return out


def _lines(
    picture: UInt8Array,
    lines_px: list[FloatArray],
    closed: bool,
    colour: tuple[int, int, int],
    width_px: int,
) -> None:
    points = [np.round(line * 16).astype(np.int32).reshape(-1, 1, 2) for line in lines_px]
    cv2.polylines(picture, points, closed, colour, width_px, cv2.LINE_AA, shift=4)
