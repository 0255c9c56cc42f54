"""Front or rear of an object that was fitted both ways round, by several cues that a class teaches.

How the surface looks is read into cells: the top along x, the side along x, and both ends. The surface is the
class's mean with front and rear made alike, so that its shape says nothing; reading it with front and rear
exchanged permutes the cells. Three things are read beside the paint around: redness, lightness, and how far a
colour is from the paint's, whichever way, since glass and lamps have any colour. What the weights of cells
sum up to is told by place: windows and lamps. Colours of ends and wheels differ too much from one object to
the next: on objects that others drew they were wrong as often as right. Beside the looks the fits themselves
speak: which way round the outline and the borders of the parts fit better.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.camera import GroundedCamera
from recon.localization.standing_box import StandingBox, cam_from_ground, turn
from recon.pixels import sample_bilinear
from recon.reading import json_of, reading

LOOKS = ("windows", "lamps")
"""Cues from how the surface looks: glass on top and on the upper side, and redness anywhere."""
FITS = ("outline", "borders")
"""Cues from the fits: their outlines, and the borders of their parts."""
CUES = (*LOOKS, *FITS)

_MOST = 6.0
"""A difference of one pixel beside the unit, at most: a lamp must not stand for all of its cell."""
_ROUNDING = 1e-9
"""A cue that never differs by more says nothing."""
_RED, _LIGHT, _OTHER = range(3)
_TOP, _SIDE, _ENDS = range(3)


@dataclass(frozen=True)
class HeadingConfig:
    """Settings of the reading and of learning."""

    along: int = 10
    """Cells along x, on the top and on the side."""
    across: int = 2
    """Cells from the middle to the side, on the top and at the ends."""
    up: int = 4
    """Cells from the ground to the top, on the side and at the ends."""
    smooth_sigma_px: float = 1.0
    """Standard deviation in pixels of the Gaussian over the picture."""
    redness: float = 10.0
    """A difference of a (of Lab) from the paint that is much; larger ones count little more."""
    colour: float = 20.0
    """A difference of lightness or of colour from the paint that is much."""
    outline: float = 0.33
    """A logarithm of the ratio of two costs of outlines that is much; larger ones count little more."""
    clearance_m: float = 0.06
    """A point of the surface is hidden where the way to the camera lies deeper than this in the object,
    metres of the shape space."""
    ridge: float = 1.0
    """Weight of the squared weights while learning the cells; chosen on shapes that are not tested on."""
    doubt: float = 0.1
    """Share of objects on which a cue of the looks misleads, however sure it is."""
    cue_ridge: float = 1.0
    """Weight of the squared weights while weighing the cues, each scaled to a mean square of 1."""


@dataclass(frozen=True, eq=False)
class Posed:
    """A shape on the ground: hull function on its grid, and the box in metres of the ground frame."""

    hull: Float32Array
    """Hull function on its grid in metres, below 0 inside, shape (nx, ny, nz)."""
    reach: tuple[float, float, float]
    box: StandingBox


@dataclass(frozen=True, eq=False)
class FitLooks:
    """What is compared of a fit and of the same object fitted the other way round."""

    reading: FloatArray
    """Looks of its surface, shape (3, cells)."""
    cost: float
    """Cost of its outline, above 0."""
    agreement: float
    """Correlation of the borders of its parts with edges of the picture."""


@dataclass(frozen=True)
class NoseOdds:
    """How sure it is that the nose is where a fit has it."""

    cues: Mapping[str, float]
    """Log odds by cue; they add up."""

    @property
    def log_odds(self) -> float:
        """Log odds of the nose against the tail."""
        return sum(self.cues.values())

    @property
    def probability(self) -> float:
        """Probability of the nose."""
        return float(1 / (1 + np.exp(-np.clip(self.log_odds, -500, 500))))

    @property
    def reversed(self) -> "NoseOdds":
        """The odds of the other end."""
        return NoseOdds({cue: -value for cue, value in self.cues.items()})


@dataclass(frozen=True, eq=False)
class Heading:
    """What front and rear of a class look like."""

    cells: FloatArray
    """Weights of the difference of the readings, shape (3, cells)."""
    config: HeadingConfig
    looks: float = 1.0
    """Weight of what the surface says."""
    fits: tuple[float, ...] = (0.0,) * len(FITS)
    """Weights of what the fits say, by cue of ``FITS``."""

    def odds(self, fit: FitLooks, turned: FitLooks) -> NoseOdds:
        """Odds that the nose is where a fit has it and not where the one turned round has it."""
        looks = self.looks * self._looks(fit, turned)
        said = np.array(self.fits) * _fits(fit, turned, self.config)
        return NoseOdds(dict(zip(CUES, [*looks.tolist(), *said.tolist()], strict=True)))

    def _looks(self, fit: FitLooks, turned: FitLooks) -> FloatArray:
        """Log odds by look cue, shape (len(LOOKS),)."""
        differences = [_difference(f.reading, self.config) for f in (fit, turned)]
        weighed = self.cells * (differences[0] - differences[1]) / 2
        sure = (weighed * _cells_of_cues(self.config)).sum(axis=(1, 2))
        # a cue may lie whatever it says: a red car, a rear window as large as a windscreen
        doubt = self.config.doubt
        right = doubt + (1 - 2 * doubt) / (1 + np.exp(-np.clip(sure, -500, 500)))
        return np.asarray(np.log(right / (1 - right)))

    @property
    def as_json(self) -> dict[str, Any]:
        """The weights as JSON values."""
        weights = {"looks": self.looks, "fits": list(self.fits), "cells": self.cells.tolist()}
        return {"config": asdict(self.config), **weights}

    @staticmethod
    def load(path: Path) -> "Heading":
        """The weights that a file has from ``as_json``.

        Raises:
            RescoreError: no such file, or something else in it.
        """
        what, advice = "what front and rear look like", "learn it again"
        value = json_of(path, what, advice)
        with reading(path, what, advice):
            config = HeadingConfig(**value["config"])
            cells = np.array(value["cells"], float).reshape(3, _cells(config))
            fits = tuple(float(w) for w in np.array(value["fits"], float).reshape(len(FITS)))
            return Heading(cells, config, float(value["looks"]), fits)


def _fits(fit: FitLooks, turned: FitLooks, config: HeadingConfig) -> FloatArray:
    """What the fits say before it is weighed, shape (len(FITS),)."""
    # a shape that is none of the class costs much both ways: only the ratio counts; for shapes that
    # nothing was learned from it is small, though nearly as often right
    outline = np.tanh(np.log(turned.cost / fit.cost) / config.outline)
    return np.array([outline, fit.agreement - turned.agreement])


def learn_heading(readings: Sequence[FloatArray], config: HeadingConfig) -> Heading:
    """Ridge logistic regression on readings (3, cells) with the right heading."""
    used = _cells_of_cues(config).any(axis=0)
    data = np.stack([_difference(r, config) * used for r in readings])
    weights = _logistic(data.reshape(len(data), -1), config.ridge)
    return Heading(weights.reshape(3, -1), config)


def weigh_cues(heading: Heading, pairs: Sequence[tuple[FitLooks, FitLooks]]) -> Heading:
    """The heading with its cues weighed by pairs of a right fit and the same object fitted turned round.

    The objects are others than those that the cells were learned from, so that no cue is trusted too much. No
    weight is below 0: a cue that misleads them is not believed the other way round.
    """
    unweighed = Heading(heading.cells, heading.config)
    data = np.array([[unweighed.odds(*pair).log_odds, *_fits(*pair, heading.config)] for pair in pairs])
    # a correlation differs by a tenth where log odds differ by one: the ridge must not forbid its weight
    scale = np.maximum(np.sqrt((data**2).mean(axis=0)), _ROUNDING)
    weights = _logistic(data / scale, heading.config.cue_ridge, lowest=0.0) / scale
    looks, *fits = weights.tolist()
    return Heading(heading.cells, heading.config, looks, tuple(fits))


def _logistic(data: FloatArray, ridge: float, lowest: float | None = None) -> FloatArray:
    """Weights (k,) by which the rows (n, k) are above 0, all of them being right."""

    def loss(w: FloatArray) -> tuple[float, FloatArray]:
        score = data @ w
        value = np.logaddexp(0, -score).sum() + 0.5 * ridge * w @ w
        slope = -1 / (1 + np.exp(np.clip(score, -500, 500)))
        return float(value), data.T @ slope + ridge * w

    start, bounds = np.zeros(data.shape[1]), [(lowest, None)] * data.shape[1]
    return np.asarray(minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x)


def neutral_hull(hull: Float32Array) -> Float32Array:
    """A hull function (nx, ny, nz) with front and rear made alike: its shape does not say which is which."""
    return np.ascontiguousarray((hull + hull[::-1]) / 2)


def read_surface(
    light: Float32Array, shape: Posed, seen_from: GroundedCamera, config: HeadingConfig
) -> FloatArray:
    """Looks (3, cells) of the visible surface beside its paint, in (-1, 1); 0 where a cell is hidden.

    Rows are redness, lightness, and the distance of the colour from the paint's.

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
    off = _beside_paint(_lab_at(light, uv, config), _faces(config)[cell], config)
    count = np.bincount(cell, minlength=_cells(config))
    total = np.stack([np.bincount(cell, row, len(count)) for row in off])
    return np.asarray(np.tanh(total / np.maximum(count, 1)))


def _beside_paint(lab: FloatArray, face: NDArray[np.intp], config: HeadingConfig) -> FloatArray:
    """Redness, lightness and distance of colours (n, 3) beside the median, in units that are much, (3, n)."""
    off = np.zeros((3, len(lab)))
    off[_RED] = (lab[:, 1] - np.median(lab[:, 1])) / config.redness
    # top, side and ends are lit differently, and so is their paint
    for own in (face == f for f in (_TOP, _SIDE, _ENDS)):
        if own.any():
            away = lab[own] - np.median(lab[own], axis=0)
            off[_LIGHT, own] = away[:, 0] / config.colour
            off[_OTHER, own] = np.linalg.norm(away, axis=1) / config.colour
    return np.clip(off, -_MOST, _MOST)


def _cells(config: HeadingConfig) -> int:
    return config.along * (config.across + config.up) + 2 * config.across * config.up


def _faces(config: HeadingConfig) -> NDArray[np.intp]:
    """Face of each cell, shape (cells,)."""
    column = np.repeat([_TOP, _SIDE], [config.across, config.up])
    ends = np.full(2 * config.across * config.up, _ENDS)
    return np.concatenate([np.tile(column, config.along), ends]).astype(np.intp)


def _cells_of_cues(config: HeadingConfig) -> BoolArray:
    """Whether each entry of a reading belongs to each look cue, shape (len(LOOKS), 3, cells)."""
    face = _faces(config)
    side = np.tile(np.arange(config.across + config.up) - config.across, config.along)
    row = np.concatenate([side, np.zeros(len(face) - len(side), int)])
    upper = (face == _SIDE) & (row >= config.up // 2)
    used = np.zeros((len(LOOKS), 3, len(face)), bool)
    used[LOOKS.index("windows"), _LIGHT:] = (face == _TOP) | upper
    used[LOOKS.index("lamps"), _RED] = True
    return used


def _turned(config: HeadingConfig) -> NDArray[np.intp]:
    """The cell at the same place of each cell (cells,) where front and rear are exchanged."""
    long = config.along * (config.across + config.up)
    body = np.arange(long).reshape(config.along, -1)[::-1].ravel()
    front, rear = np.split(np.arange(long, _cells(config)), 2)
    return np.concatenate([body, rear, front])


def _difference(looks: FloatArray, config: HeadingConfig) -> FloatArray:
    """A reading (3, cells) less the same reading with front and rear exchanged."""
    return looks - looks[:, _turned(config)]


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
    for step in np.linspace(0.03, 0.8, 20):
        hidden |= _hull_at(shape, unit + step * toward) < -clearance_m
    return ~hidden


def _lab_at(light: Float32Array, uv_px: FloatArray, config: HeadingConfig) -> FloatArray:
    """CIE Lab (n, 3) at pixels (n, 2)."""
    low = np.maximum(np.floor(uv_px.min(axis=0)).astype(int) - 4, 0)
    high = np.ceil(uv_px.max(axis=0)).astype(int) + 5
    crop = np.ascontiguousarray(light[low[1] : high[1], low[0] : high[0]])
    lab = cv2.cvtColor(cv2.GaussianBlur(crop, (0, 0), config.smooth_sigma_px), cv2.COLOR_LRGB2Lab)
    return np.asarray(sample_bilinear(lab, uv_px - low, cv2.BORDER_REPLICATE), float)


def _hull_at(shape: Posed, unit: FloatArray) -> FloatArray:
    """Hull function (n,) at the nearest sample of points (n, 3) in units of the size; far off beyond it."""
    nx, ny, nz = shape.hull.shape
    rx, ry, rz = shape.reach
    i = np.round((unit[:, 0] / (2 * rx) + 0.5) * (nx - 1)).astype(int)
    j = np.round(np.abs(unit[:, 1]) / ry * (ny - 1)).astype(int)
    k = np.round(unit[:, 2] / rz * (nz - 1)).astype(int)
    on_grid = (i >= 0) & (i < nx) & (j < ny) & (k >= 0) & (k < nz)
    i, j, k = np.clip(i, 0, nx - 1), np.clip(j, 0, ny - 1), np.clip(k, 0, nz - 1)
    return np.where(on_grid, shape.hull[i, j, k], np.inf)
