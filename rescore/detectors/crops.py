"""Training pictures that are crops: one folder of cars, one of street, all of one size."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from rescore.detectors.boosted import BoostedConfig
from rescore.detectors.hog_svm import CELL_PX, HogConfig
from rescore.detectors.mining import ScanRange
from rescore.detectors.windows import WindowGeometry
from rescore.formats.labels import PICTURES


@dataclass(frozen=True, eq=False)
class Crops:
    """Crops of cars and of street, each as large as the window of a car."""

    cars: UInt8Array
    """Shape (n, height, width)."""
    street: UInt8Array
    """Shape (m, height, width)."""

    def __post_init__(self) -> None:
        if self.cars.ndim != 3 or self.street.ndim != 3 or self.cars.shape[1:] != self.street.shape[1:]:
            raise RescoreError(
                f"crops: expected cars and street of one size, got {self.cars.shape[1:]} and "
                f"{self.street.shape[1:]} (height, width); resize them"
            )
        if not len(self.cars) or not len(self.street):
            raise RescoreError(
                f"crops: expected crops of cars and of street, got {len(self.cars)} and {len(self.street)}"
            )

    @property
    def width_px(self) -> int:
        """Width of a crop."""
        return int(self.cars.shape[2])

    @property
    def height_px(self) -> int:
        """Height of a crop."""
        return int(self.cars.shape[1])


def read_crops(cars: Path, street: Path) -> Crops:
    """The crops of two folders, or of two patterns such as ``TrainImages/pos-*.pgm``.

    Raises:
        RescoreError: no pictures, an unreadable one, or pictures of several sizes.
    """
    return Crops(_read_all(cars), _read_all(street))


def _read_all(place: Path) -> UInt8Array:
    files = sorted(place.iterdir()) if place.is_dir() else sorted(place.parent.glob(place.name))
    files = [f for f in files if f.suffix.lower() in PICTURES]
    if not files:
        raise RescoreError(
            f"{place}: expected a folder of pictures, or a pattern such as 'crops/pos-*.png', got no picture"
        )
    pictures = [_read(file) for file in files]
    for file, picture in zip(files, pictures, strict=True):
        if picture.shape != pictures[0].shape:
            height, width = pictures[0].shape
            raise RescoreError(
                f"{file}: expected {width} x {height} px as {files[0].name} has, got {picture.shape[1]} x "
                f"{picture.shape[0]}; resize the crops to one size"
            )
    return np.stack(pictures)


def _read(file: Path) -> UInt8Array:
    picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise RescoreError(f"{file}: expected a picture, could not read it; mend or remove it")
    return np.asarray(picture, np.uint8)


def config_for_crops(
    config: HogConfig | BoostedConfig, width_px: int, height_px: int
) -> HogConfig | BoostedConfig:
    """The settings with a window that is the whole crop, and with sizes of cars from the crop's on.

    The window keeps its height and takes the crops' ratio of sides, for HOG in whole cells. What is found is
    then the crop, with whatever margin it has, and not the car's own box.
    """
    cell = CELL_PX if isinstance(config, HogConfig) else 1
    height = config.window.height_px
    width = max(cell, cell * round(height * width_px / height_px / cell))
    scan = ScanRange(width_px, max(width_px, config.scan.largest_car_px), config.scan.scale_step)
    return replace(config, window=WindowGeometry(width, height, 0, 0), scan=scan)
