"""Front or rear, from how an object looks: what is redder or less red than its paint, and where.

Redness alone is read: lightness and whole colours differ more from one make to another than from front to
rear. It is read off the visible surface into cells: the top along x, the side along x, and both ends. Reading
the same surface with front and rear exchanged permutes the cells. What the readings differ in is weighed by a
logistic model, learned from pictures of the training instances, so that it gives the log odds of the nose.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.camera import GroundedCamera
from recon.localization.standing_box import StandingBox, cam_from_ground, turn
from recon.pixels import sample_bilinear

_MOST = 6.0
"""Redness of one pixel beside the unit, at most: a lamp must not stand for all of its cell."""


@dataclass(frozen=True)
class HeadingConfig:
    """Settings of the reading and of learning."""

    along: int = 6
    """Cells along x, on the top and on the side."""
    across: int = 2
    """Cells from the middle to the side, on the top and at the ends."""
    up: int = 4
    """Cells from the ground to the top, on the side and at the ends."""
    smooth_sigma_px: float = 1.0
    """Standard deviation in pixels of the Gaussian over the picture."""
    redness: float = 10.0
    """A difference of a (of Lab) from the paint that is much; larger ones count little more."""
    clearance_m: float = 0.06
    """A point of the surface is hidden where the way to the camera lies deeper than this in the object,
    metres of the shape space."""
    ridge: float = 3.0
    """Weight of the squared coefficients while learning."""


@dataclass(frozen=True, eq=False)
class Heading:
    """Log odds of a heading against its reverse are ``weights`` times the difference of the readings."""

    weights: FloatArray
    """Weight of each cell of a reading, shape (cells,)."""
    config: HeadingConfig

    def log_odds(self, reading: FloatArray) -> float:
        """Log odds that the nose is where the reading (cells,) took it."""
        return float(self.weights @ _difference(reading, self.config))


@dataclass(frozen=True, eq=False)
class Posed:
    """A shape on the ground: hull function on its grid, and the box in metres of the ground frame."""

    hull: Float32Array
    """Hull function on its grid in metres, below 0 inside, shape (nx, ny, nz)."""
    reach: tuple[float, float, float]
    box: StandingBox


def learn_heading(readings: Sequence[FloatArray], config: HeadingConfig) -> Heading:
    """Ridge logistic regression on readings (cells,) of training pictures with the right heading."""
    data = np.stack([_difference(r, config) for r in readings])

    def loss(w: FloatArray) -> tuple[float, FloatArray]:
        score = data @ w
        value = np.logaddexp(0, -score).sum() + 0.5 * config.ridge * w @ w
        slope = -1 / (1 + np.exp(np.clip(score, -500, 500)))
        return float(value), data.T @ slope + config.ridge * w

    found = minimize(loss, np.zeros(data.shape[1]), jac=True, method="L-BFGS-B")
    return Heading(np.asarray(found.x), config)


def read_surface(
    light: Float32Array, shape: Posed, seen_from: GroundedCamera, config: HeadingConfig
) -> FloatArray:
    """Redness (cells,) of the visible surface beside the paint, in (-1, 1); 0 where a cell is hidden.

    Args:
        light: linear light of the picture, shape (h, w, 3).
        shape: the object.
        seen_from: the camera M and the ground plane Q_g.
        config: settings.
    """
    pose = cam_from_ground(seen_from.ground)
    c, s = shape.box.xy_m, turn(shape.box.yaw_rad)
    eye = -pose[:3, :3].T @ pose[:3, 3]
    eye_unit = np.append((eye[:2] - c) @ s, eye[2]) / shape.box.size_m
    unit, cell = _surface(shape, 1.0 if eye_unit[1] > 0 else -1.0, config)
    seen = _seen(unit, eye_unit, shape, config.clearance_m)
    unit, cell = unit[seen], cell[seen]
    metres = unit * shape.box.size_m
    metres[:, :2] = metres[:, :2] @ s.T + c
    uv = seen_from.camera.project(metres @ pose[:3, :3].T + pose[:3, 3])
    red = _redness_at(light, uv, config)
    off = np.clip((red - np.median(red)) / config.redness, -_MOST, _MOST)
    count = np.bincount(cell, minlength=_cells(config))
    total = np.bincount(cell, off, minlength=len(count))
    return np.asarray(np.tanh(total / np.maximum(count, 1)))


def _cells(config: HeadingConfig) -> int:
    return config.along * (config.across + config.up) + 2 * config.across * config.up


def _difference(reading: FloatArray, config: HeadingConfig) -> FloatArray:
    """A reading less the same reading with front and rear exchanged, shape (cells,)."""
    long = config.along * (config.across + config.up)
    body = reading[:long].reshape(config.along, -1)
    front, rear = np.split(reading[long:], 2)
    return np.asarray(reading - np.concatenate([body[::-1].ravel(), rear, front]))


def _surface(shape: Posed, side: float, config: HeadingConfig) -> tuple[FloatArray, NDArray[np.intp]]:
    """Points (n, 3) on top, one side (sign of y), front and rear in units of the size, and their cells."""
    nx, ny, nz = shape.hull.shape
    rx, ry, rz = shape.reach
    x, y, z = np.linspace(-rx, rx, nx), np.linspace(0, ry, ny), np.linspace(0, rz, nz)
    # mirrors stand out beyond the box
    inside = (shape.hull < 0) & (y <= 0.5)[:, None] & (np.abs(x) <= 0.5)[:, None, None]
    column = np.clip(((x + 0.5) * config.along).astype(int), 0, config.along - 1)
    out_y = np.clip((y * 2 * config.across).astype(int), 0, config.across - 1)
    row = np.clip((z * config.up).astype(int), 0, config.up - 1)
    width, long = config.across + config.up, config.along * (config.across + config.up)
    points, cells = [], []

    i, j = np.nonzero(inside.any(axis=2))
    top = z[nz - 1 - np.argmax(inside[i, j, ::-1], axis=1)]
    for sign in (1.0, -1.0):
        points.append(np.stack([x[i], sign * y[j], top], axis=1))
        cells.append(column[i] * width + out_y[j])

    i, k = np.nonzero(inside.any(axis=1))
    flank = y[ny - 1 - np.argmax(inside[i, ::-1, k], axis=1)]
    points.append(np.stack([x[i], side * flank, z[k]], axis=1))
    cells.append(column[i] * width + config.across + row[k])

    j, k = np.nonzero(inside.any(axis=0))
    ends = (x[nx - 1 - np.argmax(inside[::-1, j, k], axis=0)], x[np.argmax(inside[:, j, k], axis=0)])
    for end, first in zip(ends, (long, long + config.across * config.up), strict=True):
        for sign in (1.0, -1.0):
            points.append(np.stack([end, sign * y[j], z[k]], axis=1))
            cells.append(first + out_y[j] * config.up + row[k])
    return np.concatenate(points), np.concatenate(cells)


def _seen(unit: FloatArray, eye_unit: FloatArray, shape: Posed, clearance_m: float) -> BoolArray:
    """Whether the eye sees each surface point (n, 3) past the rest of the object, shape (n,)."""
    toward = (eye_unit - unit) / np.abs(eye_unit - unit).max(axis=1, keepdims=True)
    hidden = np.zeros(len(unit), bool)
    nx, ny, nz = shape.hull.shape
    rx, ry, rz = shape.reach
    for step in np.linspace(0.03, 0.8, 20):
        p = unit + step * toward
        i = np.round((p[:, 0] / (2 * rx) + 0.5) * (nx - 1)).astype(int)
        j = np.round(np.abs(p[:, 1]) / ry * (ny - 1)).astype(int)
        k = np.round(p[:, 2] / rz * (nz - 1)).astype(int)
        on_grid = (i >= 0) & (i < nx) & (j < ny) & (k >= 0) & (k < nz)
        i, j, k = np.clip(i, 0, nx - 1), np.clip(j, 0, ny - 1), np.clip(k, 0, nz - 1)
        hidden |= on_grid & (shape.hull[i, j, k] < -clearance_m)
    return ~hidden


def _redness_at(light: Float32Array, uv_px: FloatArray, config: HeadingConfig) -> FloatArray:
    """a of CIE Lab (n,) at pixels (n, 2)."""
    low = np.maximum(np.floor(uv_px.min(axis=0)).astype(int) - 4, 0)
    high = np.ceil(uv_px.max(axis=0)).astype(int) + 5
    crop = np.ascontiguousarray(light[low[1] : high[1], low[0] : high[0]])
    lab = cv2.cvtColor(cv2.GaussianBlur(crop, (0, 0), config.smooth_sigma_px), cv2.COLOR_LRGB2Lab)
    return np.asarray(sample_bilinear(lab, uv_px - low, cv2.BORDER_REPLICATE)[:, 1], float)
