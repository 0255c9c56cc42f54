"""An object of three blocks that looks different from every side, its labelled views and painted pictures."""

import numpy as np
from scipy.spatial import ConvexHull

from recon.arrays import FloatArray, UInt8Array
from recon.class_model import ClassModel
from recon.outlines import fill_polygon
from recon.part_views import PartView
from recon.view_bins import ViewBins

BINS = ViewBins()
PART_NAMES = ("base", "tower", "wing")
# low and high corner of each block: x forward, y left, z up
BLOCKS = np.array(
    [
        [(-2.0, -0.8, 0.0), (2.0, 0.8, 0.7)],
        [(0.9, 0.1, 0.7), (1.7, 0.8, 2.0)],
        [(-1.6, -1.7, 0.2), (-0.7, -0.8, 1.2)],
    ]
)
COLOURS = np.array([(90, 100, 90), (180, 60, 50), (230, 210, 90), (50, 70, 170)], np.uint8)
"""sRGB colours of the background and of the parts."""


def view_labels(view_bin: int, width_px: int = 240) -> UInt8Array:
    """Part labels under scaled orthography, far blocks first, without a margin."""
    rotation = BINS.view_from_object(view_bin)
    corners = [
        np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(8, 3)
        @ rotation.T
        for low, high in BLOCKS
    ]
    flat = np.concatenate(corners)[:, :2]
    low = flat.min(axis=0)
    scale = width_px / float(np.ptp(flat, axis=0).max())
    width, height = np.ceil((flat.max(axis=0) - low) * scale).astype(int)
    labels = np.zeros((height, width), np.uint8)
    for k in sorted(range(len(corners)), key=lambda k: -corners[k][:, 2].mean()):
        points = (corners[k][:, :2] - low) * scale
        labels[fill_polygon(points[ConvexHull(points).vertices] - 0.5, height, width)] = k + 1
    return labels


def toy_model(view_bins: tuple[int, ...] = tuple(range(12))) -> ClassModel:
    """A model of labelled views alone, which is all that the choice of a view looks at."""
    views = tuple(PartView(b, view_labels(b), "toy") for b in view_bins)
    return ClassModel("toy", PART_NAMES, BINS, (), views)


def paint(labels: UInt8Array, seed: int = 0, margin_px: int = 30) -> tuple[UInt8Array, FloatArray]:
    """A noisy picture (h, w, 3) of labels, each in a colour of its own, and the box (4,) of the object."""
    padded = np.pad(labels, margin_px)
    noise = np.random.default_rng(seed).normal(0, 6, (*padded.shape, 3))
    rgb = np.clip(COLOURS[padded] + noise, 0, 255).astype(np.uint8)
    rows, cols = np.nonzero(padded)
    return rgb, np.array([cols.min(), rows.min(), cols.max() + 1, rows.max() + 1], float)
