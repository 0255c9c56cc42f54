"""What gloss mirrors of a street around it: houses with windows, trees, parked cars, the road.

It is painted as it looks from the middle of a street, at infinity: a mirror then shows it with a parallax of
its own, as real bodies do, and not that of the body. Nothing of it is seen directly.
"""

from functools import lru_cache

import cv2
import numpy as np

from recon.arrays import Float32Array
from recon.pixels import sample_bilinear

VARIANTS = 8
"""Number of different skylines."""
_SIZE_PX = (128, 1024)
"""Rows and columns of the picture: elevations and azimuths."""
_ELEVATION_RAD = (-0.25, 0.75)
"""Elevations of the last and the first row."""


def skyline(direction: Float32Array, variant: int) -> tuple[Float32Array, Float32Array]:
    """Albedo (3, n) of what stands around along unit world directions (n, 3), and how much it covers (n,).

    Args:
        direction: Where a mirror looks.
        variant: One of ``VARIANTS``; the same one is always the same street.
    """
    rows, columns = _SIZE_PX
    low, high = _ELEVATION_RAD
    x, y, z = direction.T
    elevation = np.arcsin(np.clip(z, -1, 1))
    column = np.arctan2(y, x) * np.float32(columns / (2 * np.pi)) % columns
    row = np.clip((high - elevation) / np.float32(high - low), 0, 1) * np.float32(rows - 1)
    seen = sample_bilinear(_painted(variant), np.stack([column, row], 1), cv2.BORDER_REPLICATE)
    return seen[:, :3].T, seen[:, 3]


@lru_cache(maxsize=VARIANTS)
def _painted(variant: int) -> Float32Array:
    """Albedo and cover (rows, columns + 1, 4), the first column again at the end."""
    rng = np.random.default_rng([20090602, variant])
    rows, columns = _SIZE_PX
    picture = np.zeros((rows, columns, 4), np.float32)
    horizon = round(rows * _ELEVATION_RAD[1] / (_ELEVATION_RAD[1] - _ELEVATION_RAD[0]))
    _put_houses(picture, horizon, rng)
    _put_trees(picture, horizon, rng)
    picture[horizon:] = (0.16, 0.16, 0.16, 1.0)
    _put_cars(picture, horizon, rng)
    soft = cv2.GaussianBlur(picture, (0, 0), 0.7, borderType=cv2.BORDER_REPLICATE)
    painted = np.concatenate([soft, soft[:, :1]], axis=1)
    painted.setflags(write=False)
    return painted


def _put_houses(picture: Float32Array, horizon: int, rng: np.random.Generator) -> None:
    column = 0
    while column < picture.shape[1]:
        width, height = int(rng.integers(24, 90)), int(rng.integers(10, 46))
        # sunlit fronts and those in the shade
        wall = np.array([0.5, 0.46, 0.4]) * rng.choice([0.15, 0.6, 2.0]) * rng.normal(1, 0.08, 3)
        if rng.random() < 0.6:
            front = picture[horizon - height : horizon, column : column + width]
            front[:] = (*wall, 1.0)
            front[: min(4, height // 4), :, :3] *= 0.45
            for top in range(5, height - 5, 7):
                for left in range(3, front.shape[1] - 5, 8):
                    front[top : top + 4, left : left + 4, :3] = rng.choice(
                        [0.03, 0.05, 1.5], p=[0.5, 0.3, 0.2]
                    )
        column += width


def _put_trees(picture: Float32Array, horizon: int, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(8, 22))):
        centre, radius = int(rng.integers(picture.shape[1])), int(rng.integers(8, 26))
        for _ in range(40):
            at = rng.normal(0, 0.45, 2) * radius
            leaf = np.array([0.06, 0.09, 0.03]) * rng.uniform(0.3, 2.0)
            spot = (int(centre + at[0]), int(horizon - 1.1 * radius + at[1]))
            cv2.circle(picture, spot, int(rng.integers(2, 6)), (*(float(v) for v in leaf), 1.0), -1)


def _put_cars(picture: Float32Array, horizon: int, rng: np.random.Generator) -> None:
    column = 0
    while column < picture.shape[1]:
        width = int(rng.integers(26, 60))
        if rng.random() < 0.7:
            tone = float(rng.choice([0.02, 0.06, 0.2, 0.7, 1.5]))
            picture[horizon - 3 : horizon + 10, column : column + width, :3] = tone
            picture[horizon - 3 : horizon + 2, column + 4 : column + width - 4, :3] = 0.04
            picture[horizon + 10 : horizon + 14, column : column + width, :3] = 0.02
            picture[horizon - 3 :, column : column + width, 3] = 1.0
        column += width + int(rng.integers(3, 20))
