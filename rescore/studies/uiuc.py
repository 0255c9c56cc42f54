"""What a detector trained on crops finds in the test pictures of the UIUC car set."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.errors import RescoreError
from rescore.detectors.crop_training import WindowDetector, at_one_size
from rescore.detectors.registry import load_detector
from rescore.detectors.uiuc_rule import RecallPrecision, hits, lone, recall_precision
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.formats.uiuc import CAR_HEIGHT_PX, CAR_WIDTH_PX, TestPicture, read_uiuc
from rescore.parallel import one_thread


@dataclass(frozen=True, eq=False)
class Found:
    """What one detector finds in the test pictures."""

    detector: str
    n_pictures: int
    curve: RecallPrecision

    def as_json(self) -> dict[str, Any]:
        """The figures of the curve's summary, as JSON values."""
        curve = self.curve
        return {
            "detector": self.detector,
            "n_pictures": self.n_pictures,
            "n_cars": curve.n_cars,
            "equal_error_recall": curve.equal_error_recall,
            "recall_at_precision": {str(p): curve.recall_at_precision(p) for p in (0.9, 0.99)},
            "greatest_recall": float(curve.hit.sum() / curve.n_cars),
        }


def evaluate_files(folder: Path, detectors: Sequence[Path], jobs: Workers) -> Iterator[Found]:
    """What each detector finds in the test pictures of a folder, as they are done.

    Raises:
        RescoreError: the folder is not the set, or a file holds no detector that was trained on its crops.
    """
    pictures = read_uiuc(folder)
    for path in detectors:
        detector = load_detector(path)
        if not isinstance(detector, WindowDetector):
            raise RescoreError(f"{path}: expected a detector that scans for sizes, got {detector.name}")
        yield Found(detector.name, len(pictures), evaluate_uiuc(detector, pictures, jobs))


def evaluate_uiuc(
    detector: WindowDetector, pictures: Sequence[TestPicture], jobs: Workers
) -> RecallPrecision:
    """Recall and precision on the single-scale test pictures, by the set's own rule.

    The detector looks for cars of the set's size alone; its boxes must be windows such as the set's crops.

    Raises:
        RescoreError: the detector was trained on other windows than the set's, or a picture is unreadable.
    """
    smallest = detector.config.scan.smallest_car_px
    window = detector.config.window
    if smallest != CAR_WIDTH_PX or window.margin_x_px or window.margin_y_px:
        raise RescoreError(
            f"detector {detector.name}: expected one trained on the set's crops, {CAR_WIDTH_PX} px wide, got "
            f"one for cars from {smallest:g} px on; train it with rescore train --crops"
        )
    return recall_precision(list(map_frames(_picture_hits, pictures, at_one_size(detector), jobs)))


def _picture_hits(picture: TestPicture, detector: WindowDetector) -> tuple[FloatArray, BoolArray, int]:
    with one_thread():
        found = lone(detector.scan(_read(picture)))
    hit = hits(found.xyxy_px[:, :2], found.score, picture.left_top_px, CAR_WIDTH_PX, CAR_HEIGHT_PX)
    return found.score, hit, len(picture.left_top_px)


def _read(picture: TestPicture) -> UInt8Array:
    gray = cv2.imread(str(picture.path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if gray is None:
        raise RescoreError(f"{picture.path}: expected a picture, could not read it; fetch the set again")
    return np.asarray(gray, np.uint8)
