"""Cars to learn views from: which are examples of which bin, their windows, and what is no example."""

from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.errors import RescoreError
from recon.view_bins import ViewBins
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.pictures import read_rgb
from rescore.detectors.mining import MiningConfig
from rescore.detectors.windows import WindowGeometry, crop_windows, gray


@dataclass(frozen=True)
class ViewExamples:
    """Limits on the cars that are examples of a view bin."""

    bins: int = 12
    """View bins around the circle, see ``recon.view_bins``."""
    reach_deg: float = 22.5
    """A car seen from within this of the middle of a bin is an example of it. Above half a bin's width a car
    can be one of two bins: some are rare in streets."""
    apart_deg: float = 75.0
    """A car seen from further away than this is an example of what the bin does not show."""
    min_cars: int = 5
    """A bin with fewer examples, mirrored ones counted, is not learned and never found."""
    min_height_px: float = 16.0
    """Lower cars are no examples."""
    folds: int = 2
    """Parts of the frames: what has not seen a part tells how high its street scores."""
    max_truncated: float = 0.05
    """Cars of which more lies outside the picture are no examples: their box does not tell their size."""

    def away_deg(self, azimuth_deg: FloatArray, view_bin: int) -> FloatArray:
        """Angles in [0, 180] between azimuths (n,) and the middle of a bin."""
        return np.asarray(np.abs((azimuth_deg - self.middle_deg(view_bin) + 180) % 360 - 180))

    def middle_deg(self, view_bin: int) -> float:
        """Azimuth of the middle of a bin."""
        return float(np.rad2deg(ViewBins(self.bins).azimuth_rad(view_bin)))

    def mirrored(self, view_bin: int) -> int:
        """The bin that a bin becomes in a mirrored picture."""
        return -view_bin % self.bins

    def to_learn(self) -> tuple[int, ...]:
        """Bins that are learned; the others are these, mirrored."""
        return tuple(b for b in range(self.bins) if b <= self.mirrored(b))


@dataclass(frozen=True, eq=False)
class CarViews:
    """The cars of one frame that are examples, each once as it is and once mirrored."""

    record: FrameRecord
    xyxy_px: FloatArray
    """Shape (2 n, 4), in the picture as it is; the second half is to be mirrored."""
    azimuth_deg: FloatArray
    """Shape (2 n,), after mirroring."""

    @property
    def mirrored(self) -> BoolArray:
        """Mask (2 n,) of the cars that are to be mirrored."""
        return np.arange(len(self.xyxy_px)) >= len(self.xyxy_px) // 2


def car_views(data: DataSet, examples: ViewExamples, mining: MiningConfig) -> tuple[CarViews, ...]:
    """The examples of each frame, empty where it has none.

    Raises:
        RescoreError: no car of the frames that is seen well has an azimuth.
    """
    found = tuple(_car_views_of(f, data.truth[f.image_id], examples, mining) for f in data.frames)
    if not any(len(cars.xyxy_px) for cars in found):
        raise RescoreError(
            f"training: expected whole cars with azimuth_deg, at least {mining.min_visibility:.0%} visible, "
            f"in {len(data.frames)} frames, got none; annotate azimuths or train hog or boosted"
        )
    return found


def _car_views_of(
    record: FrameRecord, truth: Truth, examples: ViewExamples, mining: MiningConfig
) -> CarViews:
    if truth.azimuth_deg is None:
        return CarViews(record, np.zeros((0, 4)), np.zeros(0))
    boxes = truth.xyxy_px
    use = ~truth.ignore & ~(truth.visibility < mining.min_visibility) & np.isfinite(truth.azimuth_deg)
    use &= (boxes[:, 3] - boxes[:, 1] >= examples.min_height_px) & (boxes[:, 2] > boxes[:, 0])
    # a data set may lack the share that is cut; the edges tell too
    use &= (boxes[:, 0] > 0) & (boxes[:, 2] < record.width_px)
    if truth.truncated is not None:
        use &= ~(truth.truncated > examples.max_truncated)
    azimuth = truth.azimuth_deg[use]
    return CarViews(record, np.tile(boxes[use], (2, 1)), np.concatenate([azimuth, -azimuth % 360]))


def aspects(cars: tuple[CarViews, ...], examples: ViewExamples) -> dict[int, float]:
    """Width over height of each bin that is learned: the median of its examples.

    Raises:
        RescoreError: no bin has enough examples.
    """
    boxes = np.concatenate([c.xyxy_px for c in cars])
    azimuth = np.concatenate([c.azimuth_deg for c in cars])
    fold = np.repeat(np.arange(len(cars)) % examples.folds, [len(c.xyxy_px) for c in cars])
    found = {}
    for b in examples.to_learn():
        rows = examples.away_deg(azimuth, b) <= examples.reach_deg
        # of the bins that are their own mirrored ones, each car stands here twice
        count = rows.sum() // (1 + (b == examples.mirrored(b)))
        if count >= examples.min_cars and len(np.unique(fold[rows])) > 1:
            width, height = (boxes[rows, 2:] - boxes[rows, :2]).T
            found[b] = float(np.median(width / height))
    if not found:
        raise RescoreError(
            f"training: expected at least {examples.min_cars} cars of some view bin, not all in one frame, "
            "got fewer of each; add frames with cars to the train split"
        )
    return found


def score_exceeded(score: FloatArray, times: int) -> float:
    """The score of which at most so many others are greater; the least where there are fewer."""
    return float(np.sort(score)[::-1][min(times, len(score) - 1)])


def windows_around(xyxy_px: FloatArray, window: WindowGeometry) -> FloatArray:
    """Windows (n, 4) whose object has the area, the middle and the bottom edge of each box (n, 4).

    Neither width nor height alone: within a bin the width changes with the azimuth, the height with the car.
    """
    size = xyxy_px[:, 2:] - xyxy_px[:, :2]
    scale = np.sqrt(size.prod(axis=1) / (window.object_width_px * window.object_height_px))
    return windows_of_scale(xyxy_px, scale, window)


def windows_of_scale(xyxy_px: FloatArray, scale: FloatArray, window: WindowGeometry) -> FloatArray:
    """Windows (n, 4) with the middle and the bottom edge of each box (n, 4).

    ``scale`` (n,) is picture over window pixels.
    """
    middle = (xyxy_px[:, 0] + xyxy_px[:, 2]) / 2
    x0 = middle - scale * window.width_px / 2
    y1 = xyxy_px[:, 3] + scale * window.margin_y_px
    return np.stack([x0, y1 - scale * window.height_px, x0 + scale * window.width_px, y1], axis=1)


def read_gray(record: FrameRecord) -> UInt8Array:
    """The left picture of a frame, grey, shape (h, w)."""
    return gray(read_rgb(record.left_path, record.width_px, record.height_px))


def cut_like_a_scan(picture: UInt8Array, windows_px: FloatArray, window: WindowGeometry) -> UInt8Array:
    """Canonical crops (n, height, width) of windows (n, 4), resized as ``levels_of`` resizes pictures."""
    crops = np.empty((len(windows_px), window.height_px, window.width_px), np.uint8)
    shrinks = windows_px[:, 3] - windows_px[:, 1] > window.height_px
    for rows, how in ((shrinks, cv2.INTER_AREA), (~shrinks, cv2.INTER_LINEAR)):
        crops[rows] = crop_windows(picture, windows_px[rows], window, how)
    return crops
