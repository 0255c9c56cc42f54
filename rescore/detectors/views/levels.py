"""The sizes of a picture at which windows of one height are looked for."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.errors import RescoreError


@dataclass(frozen=True)
class HeightRange:
    """Sizes of cars that are searched for: heights, which change little with the view, as widths do."""

    smallest_px: float = 20.0
    """Height of the smallest car."""
    largest_px: float = 240.0
    """Height of the largest car."""
    scale_step: float = 1.15
    """Ratio of sizes from one level of the pyramid to the next."""

    def __post_init__(self) -> None:
        if not (0 < self.smallest_px <= self.largest_px and self.scale_step > 1):
            raise RescoreError(
                f"scan: expected 0 < smallest <= largest car and a step above 1, got {self}; mend the config"
            )

    def heights_px(self) -> FloatArray:
        """Car heights of all levels, smallest first."""
        octaves = np.log(self.largest_px / self.smallest_px) / np.log(self.scale_step)
        return np.asarray(self.smallest_px * self.scale_step ** np.arange(1 + int(np.ceil(octaves - 1e-9))))


def levels_of(
    picture: UInt8Array, object_height_px: int, heights_px: FloatArray, padding_px: int
) -> Iterator[tuple[float, UInt8Array]]:
    """Sizes of a grey picture (h, w), each with the pixels of the level over those of the picture.

    At each, cars of one of the heights (n,) are ``object_height_px`` high. A mirrored border is added.
    """
    height, width = picture.shape
    for car_px in heights_px:
        zoom = object_height_px / float(car_px)
        size = max(1, round(width * zoom)), max(1, round(height * zoom))
        # area means do not alias
        level = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if zoom < 1 else cv2.INTER_LINEAR)
        p = padding_px
        padded = cv2.copyMakeBorder(level, p, p, p, p, cv2.BORDER_REFLECT_101)
        yield zoom, np.asarray(padded, np.uint8)
