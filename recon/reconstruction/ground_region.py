"""The ground region of a picture (section 4.3): how likely each pixel shows ground.

The report takes the geometric classes of Hoiem et al. for this. Here a small network judges cells of a
picture that is shrunk to a fixed height: the colour of a cell against that of the picture and of the
picture's lower edge, its texture, what lies between it and the lower edge, and its place against the
horizon. It is trained on rendered streets (``rescore learn-ground``) and lies beside this module.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.errors import RescoreError

FORMAT = "ground-pixels 1"
WORK_HEIGHT_PX = 240
"""Pictures are judged at this height, so that textures have one scale."""
CELL_PX = 2
"""Side of a cell in the shrunk picture."""
SMOOTH_CELLS = 1.5
"""Standard deviation of the blur of the probabilities, in cells: takes away specks."""
_BLURS = (5, 15)
"""Sides in cells of the neighbourhoods that a cell is judged by."""
_STRIP_ROWS = 10
"""Rows of cells at the lower edge whose colour is taken for that of the ground."""
PACKAGED = Path(__file__).parent / "data" / "ground_pixels.npz"
MIN_GROUND = 0.5
"""Where the probability of ground below a point is at least this, the point stands on the ground."""
REACH = 0.2
"""Ground is looked for within this share of the object's height below it, at least four pixels."""


@dataclass(frozen=True, eq=False)
class GroundPixels:
    """A network from features of a cell to the log odds of ground; hidden layers are cut at zero."""

    low: Float32Array
    """Smallest value told apart of each feature, shape (F,): real pictures go beyond rendered ones."""
    high: Float32Array
    """Largest, shape (F,)."""
    weights: tuple[Float32Array, ...]
    """Shapes (F, a), (a, b), ..., (z, 1)."""
    biases: tuple[Float32Array, ...]
    """Shapes (a,), (b,), ..., (1,)."""

    def __post_init__(self) -> None:
        sizes = [FEATURES, *(len(b) for b in self.biases)]
        shapes = [w.shape for w in self.weights]
        limits = self.low.shape == self.high.shape == (FEATURES,)
        if shapes != list(pairwise(sizes)) or sizes[-1] != 1 or not limits:
            raise ValueError(f"ground pixels: weights {shapes}, biases {sizes[1:]}")

    def probability(self, features: Float32Array) -> Float32Array:
        """Probability of ground, shape (...), of features (..., F)."""
        x = np.clip(features, self.low, self.high)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight + bias, np.float32(0))
        odds = (x @ self.weights[-1] + self.biases[-1])[..., 0]
        return np.asarray(1 / (1 + np.exp(-np.clip(odds, -30, 30))), np.float32)

    def save(self, path: Path) -> None:
        """Write an .npz of plain arrays; ``load`` gives back exactly this."""
        arrays: dict[str, Any] = {"format": np.array(FORMAT), "low": self.low, "high": self.high}
        arrays |= {f"weight_{i}": w for i, w in enumerate(self.weights)}
        arrays |= {f"bias_{i}": b for i, b in enumerate(self.biases)}
        with path.open("wb") as file:
            np.savez(file, **arrays)

    @staticmethod
    def load(path: Path) -> "GroundPixels":
        """Read a classifier.

        Raises:
            RescoreError: no such file, or something else in it.
        """
        if not path.is_file():
            raise RescoreError(
                f"{path}: expected a classifier of ground pixels, found no file; run `rescore learn-ground`"
            )
        try:
            with np.load(path, allow_pickle=False) as file:
                if str(file["format"]) != FORMAT:
                    raise ValueError(f"format {file['format']}")
                count = sum(name.startswith("weight_") for name in file.files)
                return GroundPixels(
                    np.asarray(file["low"], np.float32),
                    np.asarray(file["high"], np.float32),
                    tuple(np.asarray(file[f"weight_{i}"], np.float32) for i in range(count)),
                    tuple(np.asarray(file[f"bias_{i}"], np.float32) for i in range(count)),
                )
        except (ValueError, KeyError, OSError, EOFError) as error:
            raise RescoreError(
                f"{path}: expected {FORMAT!r}, could not read it ({type(error).__name__}: {error}); "
                "run `rescore learn-ground` again"
            ) from error


@lru_cache(maxsize=1)
def packaged_ground_pixels() -> GroundPixels:
    """The classifier that comes with the package."""
    return GroundPixels.load(PACKAGED)


def ground_probability(
    rgb: UInt8Array, horizon_row_px: float | None = None, classifier: GroundPixels | None = None
) -> Float32Array:
    """Probability that each pixel shows ground, shape (h, w), in [0, 1].

    Args:
        rgb: the picture, shape (h, w, 3).
        horizon_row_px: row of the horizon (``GroundPlane.horizon_row_px``); None where no camera is known,
            which takes the middle of the picture, as ``DEFAULT_GROUND`` does.
        classifier: None for the one that comes with the package.
    """
    classifier = classifier or packaged_ground_pixels()
    cells = cv2.GaussianBlur(
        classifier.probability(ground_features(rgb, horizon_row_px)), (0, 0), SMOOTH_CELLS
    )
    smooth = cv2.resize(cells, (rgb.shape[1], rgb.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(smooth, np.float32)


def ground_features(rgb: UInt8Array, horizon_row_px: float | None = None) -> Float32Array:
    """Features of each cell of a picture (h, w, 3), shape (120, columns, F)."""
    height, width = rgb.shape[:2]
    horizon = (height - 1) / 2 if horizon_row_px is None else horizon_row_px
    columns = max(4, round(width * WORK_HEIGHT_PX / height / CELL_PX))
    rows = WORK_HEIGHT_PX // CELL_PX
    size = (columns * CELL_PX, WORK_HEIGHT_PX)
    # shrinking by areas keeps textures from aliasing; it does not enlarge
    how = cv2.INTER_AREA if height > WORK_HEIGHT_PX else cv2.INTER_LINEAR
    small = cv2.resize(rgb, size, interpolation=how)
    lab = cv2.cvtColor(small.astype(np.float32) * np.float32(1 / 255), cv2.COLOR_RGB2Lab) * np.float32(0.01)
    light = np.ascontiguousarray(lab[..., 0])
    dx = np.abs(cv2.Sobel(light, cv2.CV_32F, 1, 0, ksize=3))
    dy = np.abs(cv2.Sobel(light, cv2.CV_32F, 0, 1, ksize=3))
    fine = np.dstack([lab, dx, dy])
    cells = cv2.resize(fine, (columns, rows), interpolation=cv2.INTER_AREA)
    colour, texture = cells[..., :3], np.log(cells[..., 3:] + np.float32(0.01))
    # against the means of the picture, so that light, haze and sharpness count for less
    colour, texture = colour - colour.mean(axis=(0, 1)), texture - texture.mean(axis=(0, 1))
    both = np.dstack([colour, texture])
    near = [np.asarray(cv2.blur(both, (side, side)), np.float32) for side in _BLURS]
    return np.concatenate(
        [
            colour,
            texture,
            *near,
            _spread(colour),
            _below(near[0], texture),
            _place(rows, columns, horizon / height),
        ],
        axis=2,
    )


FEATURES = 5 * (1 + len(_BLURS)) + 3 + 9 + 2
"""F, the number of features of a cell."""


def _spread(colour: Float32Array) -> Float32Array:
    """Standard deviation of each colour channel around each cell, shape (rows, columns, 3)."""
    side = (_BLURS[0], _BLURS[0])
    variance = cv2.blur(colour * colour, side) - cv2.blur(colour, side) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, 0)), np.float32)


def _below(near: Float32Array, texture: Float32Array) -> Float32Array:
    """What lies between each cell and the lower edge of the picture, shape (rows, columns, 9).

    Signed difference to the colour of the lower edge around the column, its size, the largest size on the way
    up, and the largest values and means of the two gradients on the way.
    """
    strip = near[-_STRIP_ROWS:, :, :3].mean(axis=0, keepdims=True)
    side = max(3, strip.shape[1] // 4) | 1
    difference = near[..., :3] - cv2.blur(strip, (side, 1))
    size = np.sqrt((difference * difference).sum(axis=2, keepdims=True))
    smooth = cv2.blur(texture, (3, 3))
    upward = np.concatenate([size, smooth], axis=2)[::-1]
    largest = np.maximum.accumulate(upward, axis=0)[::-1]
    count = np.arange(1, len(texture) + 1, dtype=np.float32)[:, None, None]
    mean = (np.cumsum(texture[::-1], axis=0) / count)[::-1]
    return np.concatenate([difference, size, largest, mean], axis=2)


def _place(rows: int, columns: int, horizon: float) -> Float32Array:
    """How far each cell is below the horizon, shape (rows, columns, 2): in picture heights, and on the way
    from the horizon to the lower edge."""
    below = (np.arange(rows) + 0.5) / rows - horizon
    both = np.stack([below, below / max(1 - horizon, 0.1)], axis=1)
    return np.repeat(both[:, None], columns, axis=1).astype(np.float32)


def ground_below(uv_px: FloatArray, ground_region: Float32Array, reach_px: float) -> FloatArray:
    """Mean probability of ground in the strip of pixels below each point (n, 2), shape (n,).

    The strip begins with the first whole pixel under the point and is ``reach_px`` high. NaN where no pixel
    of it lies inside the picture.
    """
    height, width = ground_region.shape
    column = np.round(uv_px[:, 0]).astype(int)
    first = np.floor(uv_px[:, 1]).astype(int) + 1
    rows = first[:, None] + np.arange(max(1, round(reach_px)))[None]
    inside = (rows >= 0) & (rows < height) & ((column >= 0) & (column < width))[:, None]
    found = ground_region[np.clip(rows, 0, height - 1), np.clip(column, 0, width - 1)[:, None]]
    count = inside.sum(axis=1)
    mean = (found * inside).sum(axis=1, dtype=float) / np.maximum(count, 1)
    return np.asarray(np.where(count > 0, mean, np.nan))


def reach_px(object_height_px: float) -> float:
    """How far below an object of a height in the image ground is looked for."""
    return max(4.0, REACH * object_height_px)


def touching_points(outline_px: FloatArray, ground_region: Float32Array) -> FloatArray:
    """The lower points of an outline (k, 2), below which ground lies, shape (m, 2), from left to right.

    For each column of pixels that the outline crosses its lowest point there; pixel centres.
    """
    closed = np.concatenate([outline_px, outline_px[:1]])
    # points at every half pixel along the outline, so that no column is left out
    steps = np.maximum(1, np.ceil(np.abs(np.diff(closed[:, 0])) * 2)).astype(int)
    edge = np.repeat(np.arange(len(steps)), steps)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(steps) - steps, steps)) / steps[edge]
    points = closed[edge] + share[:, None] * (closed[edge + 1] - closed[edge])
    order = np.lexsort((points[:, 1], np.round(points[:, 0])))
    points = points[order]
    column = np.round(points[:, 0])
    lowest: FloatArray = points[np.append(column[1:] != column[:-1], True)]
    height = float(np.ptp(outline_px[:, 1]))
    return lowest[ground_below(lowest, ground_region, reach_px(height)) >= MIN_GROUND]
