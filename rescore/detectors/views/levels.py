"""The sizes of a picture at which windows of one height are looked for."""

from collections.abc import Iterator

import cv2
import numpy as np

from recon.arrays import FloatArray, UInt8Array


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
