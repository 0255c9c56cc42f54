"""Training examples: crops of cars, crops of street, and street that a detector takes for a car."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, UInt8Array
from recon.boxes import iou_matrix, suppress
from recon.errors import RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.pictures import read_rgb
from rescore.detectors.base import Detections, Detector, best_rows
from rescore.detectors.windows import WindowGeometry, crop_windows, gray
from rescore.engines.map_frames import map_frames

T = TypeVar("T")


@dataclass(frozen=True)
class MiningConfig:
    """Settings of the choice of crops that a detector learns from."""

    min_visibility: float = 0.6
    """Cars seen less are neither examples of cars nor of street."""
    min_car_share: float = 0.7
    """Cars narrower than this share of the smallest car searched for are no examples."""
    min_inside: float = 0.9
    """Share of a car's window that must lie inside the picture."""
    jitter_copies: int = 3
    """Further crops of each car, shifted and scaled by as much as a scan's steps miss a car."""
    jitter_shift: float = 0.04
    """Largest shift of a copy, as a share of the object's width."""
    jitter_scale: float = 0.05
    """Largest relative change of size of a copy."""
    max_car_iou: float = 0.35
    """A window that overlaps a car by more is no example of street."""
    random_per_frame: int = 40
    """Street windows at random from each frame, before the first round."""
    hard_per_frame: int = 25
    """False alarms taken from each frame in a round, best scores first."""
    hard_max_iou: float = 0.6
    """False alarms that overlap by more count once."""
    rounds: int = 3
    """Rounds of mining, each followed by another training."""
    max_negatives: int = 20_000
    """Upper limit of street crops in memory; with many frames, each gives fewer."""

    def random_of_frame(self, n_frames: int) -> int:
        """Street windows at random from each of some frames."""
        return min(self.random_per_frame, max(1, self.max_negatives // (2 * n_frames)))

    def hard_of_frame(self, n_frames: int) -> int:
        """False alarms from each of some frames in a round."""
        return min(self.hard_per_frame, max(1, self.max_negatives // (2 * self.rounds * n_frames)))


@dataclass(frozen=True)
class ScanRange:
    """Sizes of cars that are searched for: widths, or heights where cars are seen from all sides."""

    smallest_car_px: float = 58.0
    """Size of the smallest car."""
    largest_car_px: float = 350.0
    """Size of the largest car."""
    scale_step: float = 1.12
    """Ratio of sizes from one level of the pyramid to the next."""

    def __post_init__(self) -> None:
        if not (0 < self.smallest_car_px <= self.largest_car_px and self.scale_step > 1):
            raise RescoreError(
                f"scan: expected 0 < smallest <= largest car and a step above 1, got {self}; mend the config"
            )

    def car_sizes_px(self) -> FloatArray:
        """Car sizes of all levels, smallest first."""
        count = 1 + int(
            np.ceil(np.log(self.largest_car_px / self.smallest_car_px) / np.log(self.scale_step) - 1e-9)
        )
        return np.asarray(self.smallest_car_px * self.scale_step ** np.arange(count), dtype=float)


@dataclass(frozen=True)
class CropStyle:
    """How a detector wants its crops."""

    window: WindowGeometry
    interpolation: int
    scan: ScanRange
    mining: MiningConfig


@dataclass(frozen=True, eq=False)
class _FrameTask:
    """What the crops of one frame are made from."""

    record: FrameRecord
    truth: Truth
    n_frames: int
    style: CropStyle
    rng: np.random.Generator

    def picture(self) -> UInt8Array:
        return gray(read_rgb(self.record.left_path, self.record.width_px, self.record.height_px))

    def cut(self, picture: UInt8Array, windows_px: FloatArray) -> UInt8Array:
        return crop_windows(picture, windows_px, self.style.window, self.style.interpolation)


def car_crops(data: DataSet, style: CropStyle, rng: np.random.Generator, jobs: int = 1) -> UInt8Array:
    """Crops (n, height, width) of the cars that are seen well enough.

    Raises:
        RescoreError: no such car in the data.
    """
    found = _crops_over_frames(_car_crops_of, data, style, rng, jobs)
    if not len(found):
        raise RescoreError(
            f"training: expected cars at least {style.mining.min_visibility:.0%} visible in "
            f"{len(data.frames)} frames, got none; add frames with cars to the train split"
        )
    return found


def street_crops(data: DataSet, style: CropStyle, rng: np.random.Generator, jobs: int = 1) -> UInt8Array:
    """Random crops (n, height, width) without a car, over all sizes of the scan."""
    return _crops_over_frames(_street_crops_of, data, style, rng, jobs)


def hard_crops(
    detector: Detector, data: DataSet, style: CropStyle, rng: np.random.Generator, *, jobs: int = 1
) -> UInt8Array:
    """Crops (n, height, width) of the detector's highest-scoring false alarms in each frame."""
    return _crops_over_frames(partial(_hard_crops_of, detector=detector), data, style, rng, jobs)


def hard_negatives(found: Detections, truth: Truth, config: MiningConfig, max_count: int) -> NDArray[np.intp]:
    """Indices of the false alarms to learn from: away from every car, no near-copies, best first."""
    looked_at = 40 * max_count
    while True:
        # suppression never looks at less than it needs: the best ones tell which the best are
        best = best_rows(found.score, looked_at)
        away = best[_car_overlap(found.xyxy_px[best], truth) <= config.max_car_iou]
        keep = suppress(found.xyxy_px[away], found.score[away], config.hard_max_iou, max_count)
        if len(keep) == max_count or len(best) == len(found):
            return np.asarray(away[keep], dtype=np.intp)
        looked_at *= 4


def _car_overlap(boxes_px: FloatArray, truth: Truth) -> FloatArray:
    # cars that are ignored or hardly seen count here: they must not become examples of street
    if not len(truth.xyxy_px):
        return np.zeros(len(boxes_px))
    return np.asarray(iou_matrix(boxes_px, truth.xyxy_px).max(axis=1))


def over_frames(
    work: Callable[[int, FrameRecord, Truth, np.random.Generator], T],
    data: DataSet,
    rng: np.random.Generator,
    jobs: int,
) -> Iterator[T]:
    """What some work makes of the place, the record and the truth of each frame, in their order.

    Each frame has a generator of its own, so what comes does not depend on which worker takes which frame.
    """
    own = rng.spawn(len(data.frames))
    frames = (
        (place, record, data.truth[record.image_id], frame_rng)
        for place, (record, frame_rng) in enumerate(zip(data.frames, own, strict=True))
    )
    return map_frames(_of_frame, frames, work, jobs)


def _of_frame(
    frame: tuple[int, FrameRecord, Truth, np.random.Generator],
    work: Callable[[int, FrameRecord, Truth, np.random.Generator], T],
) -> T:
    return work(*frame)


def _crops_over_frames(
    crops_of: Callable[[_FrameTask], UInt8Array],
    data: DataSet,
    style: CropStyle,
    rng: np.random.Generator,
    jobs: int,
) -> UInt8Array:
    work = partial(_crops_of_frame, crops_of=crops_of, n_frames=len(data.frames), style=style)
    none = np.empty((0, style.window.height_px, style.window.width_px), np.uint8)
    return np.concatenate([none, *over_frames(work, data, rng, jobs)])


def _crops_of_frame(
    _place: int,
    record: FrameRecord,
    truth: Truth,
    rng: np.random.Generator,
    *,
    crops_of: Callable[[_FrameTask], UInt8Array],
    n_frames: int,
    style: CropStyle,
) -> UInt8Array:
    return crops_of(_FrameTask(record, truth, n_frames, style, rng))


def _car_crops_of(task: _FrameTask) -> UInt8Array:
    record, truth, style, config = task.record, task.truth, task.style, task.style.mining
    seen = ~truth.ignore & ~(truth.visibility < config.min_visibility)
    boxes = truth.xyxy_px[seen]
    boxes = boxes[(boxes[:, 2] - boxes[:, 0]) >= config.min_car_share * style.scan.smallest_car_px]
    windows = style.window.windows(boxes)
    inside = np.clip(windows, 0, [record.width_px, record.height_px] * 2)
    share = np.prod(inside[:, 2:] - inside[:, :2], axis=1) / np.prod(windows[:, 2:] - windows[:, :2], axis=1)
    windows = jittered(windows[share >= config.min_inside], config, task.rng)
    return task.cut(task.picture(), windows)


def jittered(windows_px: FloatArray, config: MiningConfig, rng: np.random.Generator) -> FloatArray:
    """Windows (n, 4), followed by their shifted and scaled copies."""
    n = config.jitter_copies * len(windows_px)
    copies = np.repeat(windows_px, config.jitter_copies, axis=0)
    size = copies[:, 2:] - copies[:, :2]
    middle = copies[:, :2] + size / 2
    middle += size[:, :1] * rng.uniform(-config.jitter_shift, config.jitter_shift, (n, 2))
    size *= np.exp(rng.uniform(-config.jitter_scale, config.jitter_scale, (n, 1)))
    return np.concatenate([windows_px, np.concatenate([middle - size / 2, middle + size / 2], axis=1)])


def _street_crops_of(task: _FrameTask) -> UInt8Array:
    window, scan, config = task.style.window, task.style.scan, task.style.mining
    picture_px = np.array([task.record.width_px, task.record.height_px], dtype=float)
    window_px = np.array([window.width_px, window.height_px], dtype=float)
    wanted = config.random_of_frame(task.n_frames)
    tries = 4 * wanted  # most of a street is no car, so a quarter is left after those near cars are dropped
    widths = np.exp(task.rng.uniform(np.log(scan.smallest_car_px), np.log(scan.largest_car_px), tries))
    scale = np.minimum(widths / window.object_width_px, (picture_px / window_px).min())[:, None]
    corner = task.rng.uniform(size=(tries, 2)) * (picture_px - scale * window_px)
    away = _car_overlap(window.boxes(corner, scale[:, 0]), task.truth) <= config.max_car_iou
    windows = np.concatenate([corner, corner + scale * window_px], axis=1)[away][:wanted]
    return task.cut(task.picture(), windows)


def _hard_crops_of(task: _FrameTask, detector: Detector) -> UInt8Array:
    config = task.style.mining
    picture = task.picture()
    found = detector.scan(picture)
    boxes = found.xyxy_px[hard_negatives(found, task.truth, config, config.hard_of_frame(task.n_frames))]
    return task.cut(picture, task.style.window.windows(boxes))
