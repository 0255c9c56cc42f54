"""What every detector offers, and what it returns."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, UInt8Array
from recon.boxes import suppress
from rescore.data.frames import FrameRecord, Truth
from rescore.detectors.windows import clip_boxes


@dataclass(frozen=True, eq=False)
class Detections:
    """Found boxes of one picture, best score first."""

    xyxy_px: FloatArray
    """Shape (n, 4), pixel edges inside the picture."""
    score: FloatArray
    """Shape (n,), raw: any range, not a probability."""
    azimuth_deg: FloatArray | None = None
    """Shape (n,), the middle of the view bin that each is found in (see ``rescore.data.frames.Truth``); None
    of a detector that does not tell views apart."""

    def __post_init__(self) -> None:
        if self.score.ndim != 1 or self.xyxy_px.shape != (len(self.score), 4):
            raise ValueError(f"detections: {self.xyxy_px.shape} boxes and {self.score.shape} scores")
        if self.azimuth_deg is not None and self.azimuth_deg.shape != self.score.shape:
            raise ValueError(f"detections: {self.score.shape} scores and {self.azimuth_deg.shape} azimuths")

    def __len__(self) -> int:
        return len(self.score)

    def take(self, rows: NDArray[Any]) -> "Detections":
        """The detections of a mask or an index."""
        azimuth = None if self.azimuth_deg is None else self.azimuth_deg[rows]
        return Detections(self.xyxy_px[rows], self.score[rows], azimuth)


@dataclass(frozen=True)
class SuppressionConfig:
    """Limits on overlap and number of the windows of a scan that become candidates."""

    max_iou: float = 0.5
    """A window whose IoU with a better one is larger is dropped."""
    max_count: int = 15
    """Largest number of candidates of a picture; the report keeps the 15 best."""


class Detector(Protocol):
    """A trained detector."""

    @property
    def name(self) -> str:
        """Short name, used in file names and tables."""

    def detect(self, rgb: UInt8Array) -> Detections:
        """The candidates of an (h, w, 3) uint8 picture after suppression; may be none."""

    def scan(self, rgb: UInt8Array) -> Detections:
        """All windows above the scan's floor, before suppression and clipping; what mining reads."""

    def save(self, path: Path) -> None:
        """Write the detector to one file (see rescore.detectors.files)."""


@runtime_checkable
class FrameDetector(Protocol):
    """A detector that needs more of a frame than its left picture."""

    def detect_frame(self, record: FrameRecord, truth: Truth) -> Detections:
        """The candidates of a frame, in place of ``Detector.detect``."""


MOST_WINDOWS = 2000
"""Windows of a scan that are kept before suppression, the best."""


def ordered(
    xyxy_px: FloatArray,
    score: FloatArray,
    azimuth_deg: FloatArray | None = None,
    *,
    max_count: int = MOST_WINDOWS,
) -> Detections:
    """The best detections, ordered by their values alone: threads deliver them in any order."""
    found = Detections(xyxy_px, score, azimuth_deg).take(best_rows(score, max_count))
    return found.take(np.lexsort((*found.xyxy_px.T[::-1], -found.score))[:max_count])


def best_rows(score: FloatArray, count: int) -> NDArray[np.intp]:
    """Ascending rows of the ``count`` best scores (n,), with all that score as the last of these."""
    if len(score) <= count:
        return np.arange(len(score))
    return np.flatnonzero(score >= np.partition(score, -count)[-count])


def best_candidates(
    found: Detections, config: SuppressionConfig, width_px: int, height_px: int
) -> Detections:
    """The highest-scoring detections after clipping to the picture and suppression; raw scores are kept."""
    clipped = replace(found, xyxy_px=clip_boxes(found.xyxy_px, width_px, height_px))
    size = clipped.xyxy_px[:, 2:] - clipped.xyxy_px[:, :2]
    solid = clipped.take(np.flatnonzero((size > 1.0).all(axis=1)))
    return solid.take(suppress(solid.xyxy_px, solid.score, config.max_iou, config.max_count))
