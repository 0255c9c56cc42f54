"""Tail lamps of road vehicles are red: evidence of which end a box shows, from colours of real pictures.

How a class looks is learned from rendered cars, and weighs gradients most; on real cars it takes rears for
fronts. Red lamps are the one mark of an end that law asks of every car.
"""

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.view_bins import ViewBins

_SIZE_PX = (64, 48)
"""Columns and rows that a box is scaled to."""
_BAND = slice(10, 36)
"""Rows where lamps are: below the roof, above bumper and road."""
_SIDES = slice(3, 61)
"""Columns where lamps are: beside the box there are other things."""
_LAMP_SHARE = 0.005
"""Share of the band's pixels that lamps have at least, seen from afar or with one of them hidden."""
_EVEN_REDNESS, _NATS_PER_REDNESS = 20.0, 1 / 6
"""Redness that says nothing, in units of Lab, and what each unit beyond it says."""
_LEAST_NATS, _MOST_NATS = -0.5, 3.0
"""Lamps may be dark, small or hidden, and red things stand beside a car."""


def tail_nats(rgb: UInt8Array, xyxy_px: FloatArray) -> float:
    """Log odds of a rear against a front in a box (4,), pixel edges, by red spots beside the paint."""
    size = np.array([rgb.shape[1], rgb.shape[0]])
    low = np.clip(np.rint(xyxy_px[:2]), 0, size - 1).astype(int)
    high = np.clip(np.rint(xyxy_px[2:]), low + 1, size).astype(int)
    cut = rgb[low[1] : high[1], low[0] : high[0]]
    small = cv2.resize(cut, _SIZE_PX, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small, cv2.COLOR_RGB2LAB)[_BAND, _SIDES].astype(float) - 128
    # blinkers, brick and yellow paint have more of yellow than of red
    red = lab[..., 1] - np.maximum(lab[..., 2] - lab[..., 1], 0)
    most = float(np.quantile(red - np.median(red), 1 - _LAMP_SHARE))
    return float(np.clip((most - _EVEN_REDNESS) * _NATS_PER_REDNESS, _LEAST_NATS, _MOST_NATS))


def tail_costs(rgb: UInt8Array, xyxy_px: FloatArray, bins: ViewBins) -> FloatArray:
    """Nats that speak against each view bin, shape (k,); those of the sides are 0."""
    nose = np.cos(2 * np.pi / bins.count * np.arange(bins.count))
    return np.asarray(tail_nats(rgb, xyxy_px) / 2 * nose)
