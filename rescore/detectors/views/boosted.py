"""Boosted fragments for all views: every stump is shared by the view bins that it serves.

As in Torralba, Murphy and Freeman (PAMI 2007) all bins have one window, so a fragment is looked for once. A
find has a box as wide as the cars of its bin, in the middle of the window.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.boxes import iou_matrix
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.detectors.base import Detections, SuppressionConfig, best_candidates, ordered
from rescore.detectors.files import write_detector
from rescore.detectors.fragments import (
    Dictionary,
    FragmentConfig,
    cut_dictionary,
    features_of_crops,
    level_features,
)
from rescore.detectors.mining import MiningConfig, ScanRange, hard_negatives, jittered, over_frames
from rescore.detectors.platt import fit_platt
from rescore.detectors.views.examples import (
    CarViews,
    ViewExamples,
    aspects,
    car_views,
    cut_like_a_scan,
    read_gray,
    windows_of_scale,
)
from rescore.detectors.views.joint_boosting import JointBoostConfig, SharedStumps, joint_boost
from rescore.detectors.views.levels import levels_of
from rescore.detectors.windows import WindowGeometry, gray
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread

MINING_FLOOR = -4.0
"""Street that scores less than this weighs next to nothing in boosting."""


@dataclass(frozen=True)
class BoostedViewsConfig:
    """Fragments, joint boosting and scan."""

    object_height_px: int = 24
    """Height of a car in the window; its width is that of the bin's examples."""
    margin_px: int = 8
    """Margin around the widest car."""
    scan: ScanRange = field(default_factory=lambda: ScanRange(24.0, 240.0, 1.15))
    """Heights of cars, which change little with the view, as widths do."""
    stride: int = 2
    """Step of the window in grid steps of the fragments."""
    padding_px: int = 24
    """Mirrored border of each level: for cars cut by the edge."""
    floor: float = -0.5
    """Windows that score less are not reported by the scan."""
    fragments: FragmentConfig = field(default_factory=lambda: FragmentConfig(count=480, sizes_px=(9, 13)))
    boosting: JointBoostConfig = field(default_factory=JointBoostConfig)
    examples: ViewExamples = field(default_factory=ViewExamples)
    mining: MiningConfig = field(
        default_factory=lambda: MiningConfig(
            jitter_copies=4, max_car_iou=0.4, random_per_frame=40, hard_per_frame=60, rounds=1
        )
    )
    suppression: SuppressionConfig = field(default_factory=lambda: SuppressionConfig(max_iou=0.4))


@dataclass(frozen=True, eq=False)
class BoostedViewsDetector:
    """A trained detector of all views."""

    kind: ClassVar[str] = "boosted_views"
    view_bin: IntArray
    """Shape (bins,), ascending; bins without examples are missing."""
    object_width_px: IntArray
    """Shape (bins,): width of a car of each bin in the window."""
    dictionary: Dictionary
    """Fragments of the dictionary that some stump reads."""
    stumps: SharedStumps
    config: BoostedViewsConfig
    name: str = "boosted_views"

    @property
    def window(self) -> WindowGeometry:
        """The window of all bins, around the widest car."""
        margin = self.config.margin_px
        return WindowGeometry(int(self.object_width_px.max()), self.config.object_height_px, margin, margin)

    def detect(self, rgb: UInt8Array) -> Detections:
        """The candidates of an (h, w, 3) uint8 picture after suppression over all bins; may be none."""
        return best_candidates(self.scan(rgb), self.config.suppression, rgb.shape[1], rgb.shape[0])

    def scan(self, rgb: UInt8Array) -> Detections:
        """The best bin of each window above the floor, before suppression and clipping."""
        return self.windows(gray(rgb), self.config.floor)

    def windows(self, picture: UInt8Array, floor: float) -> Detections:
        """The best bin of each window of a grey picture (h, w) that scores more than a floor."""
        config, window, parts = self.config, self.window, []
        step = config.stride * config.fragments.grid_px
        with one_thread():
            heights = config.scan.car_sizes_px()
            for zoom, level in levels_of(picture, config.object_height_px, heights, config.padding_px):
                scores = self.stumps.score(level_features(level, self.dictionary, window, config.stride))
                best = scores.argmax(axis=0)
                score = scores.max(axis=0)
                at = tuple(np.argwhere(score > floor).T)
                corner = (np.stack(at[::-1], axis=1) * step - config.padding_px) / zoom
                parts.append((self.boxes(corner, 1 / zoom, best[at]), score[at].astype(float), best[at]))
        boxes, score, bins = (np.concatenate(p) for p in zip(*parts, strict=True))
        middles = np.array([config.examples.middle_deg(b) for b in self.view_bin.tolist()])
        return ordered(boxes, score, middles[bins])

    def boxes(self, left_top_px: FloatArray, scale: FloatArray | float, bins: IntArray) -> FloatArray:
        """Objects (n, 4) of places in ``view_bin`` (n,), for windows with corners (n, 2)."""
        whole = self.window.boxes(left_top_px, scale)
        narrower = (self.window.object_width_px - self.object_width_px[bins]) / 2 * np.asarray(scale)
        return np.asarray(whole + narrower[:, None] * [1.0, 0.0, -1.0, 0.0])

    def save(self, path: Path) -> None:
        """Write the detector to one file."""
        stumps = ("feature", "threshold", "below", "step")
        arrays = {f"stump_{key}": getattr(self.stumps, key) for key in stumps} | self.dictionary.as_arrays()
        arrays |= {"view_bin": self.view_bin, "object_width_px": self.object_width_px}
        write_detector(path, self.kind, self.name, asdict(self.config), arrays)

    @staticmethod
    def from_parts(
        name: str, config: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> "BoostedViewsDetector":
        """A detector from the header and the arrays of its file."""
        settings = TypeAdapter(BoostedViewsConfig).validate_python(config)
        stumps = SharedStumps(*(arrays[f"stump_{key}"] for key in ("feature", "threshold", "below", "step")))
        dictionary = Dictionary.of_arrays(arrays, settings.fragments)
        return BoostedViewsDetector(
            arrays["view_bin"], arrays["object_width_px"], dictionary, stumps, settings, name
        )


@dataclass(frozen=True, eq=False)
class _Crops:
    """Crops of windows and what they say of each bin."""

    pixels: UInt8Array
    """Shape (n, height, width)."""
    label: IntArray
    """Shape (n, bins): 1 a car of the bin, -1 none, 0 neither for sure."""
    frame: IntArray
    """Shape (n,): place of the frame that each comes from."""
    is_copy: BoolArray
    """Shape (n,): a shifted copy of another one."""

    @staticmethod
    def joined(parts: "Sequence[_Crops]") -> "_Crops":
        names = ("pixels", "label", "frame", "is_copy")
        return _Crops(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))


def train_boosted_views(
    data: DataSet, config: BoostedViewsConfig, rng: np.random.Generator, jobs: int = 1
) -> BoostedViewsDetector:
    """A detector trained on the cars of ``data`` that have an azimuth, with rounds of hard-negative mining.

    Raises:
        RescoreError: too few cars of every bin are seen well enough, or none has an azimuth.
    """
    cars = car_views(data, config.examples, config.mining)
    blank = _blank(aspects(cars, config.examples), config)
    crops = _car_crops(blank, cars, rng)
    dictionary = _cut_dictionary(blank, crops, rng)
    features = features_of_crops(crops.pixels, dictionary, jobs)
    detector = blank
    for mined in range(1 + config.mining.rounds):
        street = _street(detector, data, rng, jobs, mined=mined > 0)
        features = np.concatenate([features, features_of_crops(street.pixels, dictionary, jobs)], axis=1)
        crops = _Crops.joined([crops, street])
        stumps = _fitted(features, crops, config, rng, jobs, last=mined == config.mining.rounds)
        used = stumps.used()
        detector = replace(blank, dictionary=dictionary.chosen(used), stumps=stumps.renumbered(used))
    return detector


def _blank(aspect: Mapping[int, float], config: BoostedViewsConfig) -> BoostedViewsDetector:
    """The detector before it has learned anything.

    Widths leave a whole number of grid steps on either side, so that fragments of each bin fit the grid.
    """
    quantum = 2 * config.fragments.grid_px
    width = {b: quantum * round(a * config.object_height_px / quantum) for b, a in aspect.items()}
    width |= {config.examples.mirrored(b): w for b, w in width.items()}
    bins = np.array(sorted(width), np.int64)
    none = np.zeros((0, len(bins)), np.float32)
    nothing = np.zeros(0, np.int64)
    dictionary = Dictionary.empty(config.fragments)
    stumps = SharedStumps(nothing, np.zeros(0, np.float32), none, none)
    return BoostedViewsDetector(bins, np.array([width[int(b)] for b in bins]), dictionary, stumps, config)


def _car_crops(blank: BoostedViewsDetector, cars: tuple[CarViews, ...], rng: np.random.Generator) -> _Crops:
    """The cars with shifted copies, labelled by how far each bin is from where they are seen."""
    parts = [
        _car_crops_of(blank, views, frame, rng) for frame, views in enumerate(cars) if len(views.xyxy_px)
    ]
    return _Crops.joined(parts)


def _car_crops_of(
    blank: BoostedViewsDetector, views: CarViews, frame: int, rng: np.random.Generator
) -> _Crops:
    config, limits, n = blank.config, blank.config.examples, len(views.xyxy_px)
    height = views.xyxy_px[:, 3] - views.xyxy_px[:, 1]
    windows = windows_of_scale(views.xyxy_px, height / config.object_height_px, blank.window)
    windows = jittered(windows, config.mining, rng)
    pixels = cut_like_a_scan(read_gray(views.record), windows, blank.window)
    which = np.concatenate([np.arange(n), np.repeat(np.arange(n), config.mining.jitter_copies)])
    mirror = views.mirrored[which]
    pixels[mirror] = pixels[mirror][:, :, ::-1]
    away = np.stack([limits.away_deg(views.azimuth_deg, int(b)) for b in blank.view_bin], axis=1)
    label = np.where(away <= limits.reach_deg, 1, np.where(away > limits.apart_deg, -1, 0))[which]
    # a car of a bin that is not learned teaches nothing
    use = (label == 1).any(axis=1)
    is_copy = np.arange(len(which)) >= n
    return _Crops(pixels[use], label[use], np.full(use.sum(), frame), is_copy[use])


def _cut_dictionary(blank: BoostedViewsDetector, crops: _Crops, rng: np.random.Generator) -> Dictionary:
    """Fragments cut in equal numbers from the cars of each bin, where they are cars, placed in the window."""
    config, window = blank.config, blank.window
    share = replace(config.fragments, count=max(1, config.fragments.count // len(blank.view_bin)))
    parts = []
    for k, width in enumerate(blank.object_width_px.tolist()):
        aside = (window.object_width_px - width) // 2
        own = replace(window, object_width_px=width)
        of_bin = crops.pixels[(crops.label[:, k] == 1) & ~crops.is_copy]
        found = cut_dictionary(of_bin[:, :, aside : aside + own.width_px], own, share, rng)
        moved = tuple(place + np.array([aside // config.fragments.grid_px, 0]) for place in found.place)
        parts.append(replace(found, place=moved))
    return Dictionary.joined(parts)


def _street(
    detector: BoostedViewsDetector, data: DataSet, rng: np.random.Generator, jobs: int, *, mined: bool
) -> _Crops:
    """Windows of street: random ones, or those that the detector takes for cars."""
    limits, n = detector.config.mining, len(data.frames)
    per_frame = limits.hard_of_frame(n) if mined else limits.random_of_frame(n)
    work = partial(_street_of, detector=detector, mined=mined, per_frame=per_frame)
    return _Crops.joined(list(over_frames(work, data, rng, jobs)))


def _street_of(
    frame: int,
    record: FrameRecord,
    truth: Truth,
    rng: np.random.Generator,
    *,
    detector: BoostedViewsDetector,
    mined: bool,
    per_frame: int,
) -> _Crops:
    config, window = detector.config, detector.window
    picture = read_gray(record)
    found = detector.windows(picture, MINING_FLOOR) if mined else _random_windows(detector, record, rng)
    chosen = found.take(hard_negatives(found, truth, config.mining, per_frame))
    scale = (chosen.xyxy_px[:, 3] - chosen.xyxy_px[:, 1]) / config.object_height_px
    windows = windows_of_scale(chosen.xyxy_px, scale, window)
    label = np.stack(
        [_is_street(detector, windows, scale, k, truth) for k in range(len(detector.view_bin))], 1
    )
    pixels = cut_like_a_scan(picture, windows, window)
    return _Crops(pixels, label, np.full(len(pixels), frame), np.zeros(len(pixels), bool))


def _is_street(
    detector: BoostedViewsDetector, windows_px: FloatArray, scale: FloatArray, k: int, truth: Truth
) -> IntArray:
    """-1 for windows (n, 4) whose object of a bin is away from every car, 0 for the others, shape (n,)."""
    if not len(truth.xyxy_px):
        return np.full(len(windows_px), -1)
    boxes = detector.boxes(windows_px[:, :2], scale, np.full(len(windows_px), k))
    near = iou_matrix(boxes, truth.xyxy_px).max(axis=1) > detector.config.mining.max_car_iou
    return np.where(near, 0, -1)


def _random_windows(
    detector: BoostedViewsDetector, record: FrameRecord, rng: np.random.Generator
) -> Detections:
    """Objects of random bins, sizes, places and scores; more than training takes of a frame."""
    config, n = detector.config, 4 * detector.config.mining.random_per_frame
    bins = rng.integers(len(detector.view_bin), size=n)
    scale = rng.choice(config.scan.car_sizes_px(), n) / config.object_height_px
    size = np.stack([detector.object_width_px[bins], np.full(n, config.object_height_px)], axis=1)
    size = size * scale[:, None]
    room = np.maximum(np.array([record.width_px, record.height_px]) - size, 1)
    corner = rng.uniform(size=(n, 2)) * room
    return Detections(np.concatenate([corner, corner + size], axis=1), rng.random(n))


def _fitted(
    features: Float32Array,
    crops: _Crops,
    config: BoostedViewsConfig,
    rng: np.random.Generator,
    jobs: int,
    *,
    last: bool,
) -> SharedStumps:
    """Stumps fitted to all crops; the last ones are shifted so that at 0 cars are as likely as street."""
    folds = config.examples.folds if last else 0
    fold = crops.frame % config.examples.folds
    parts = [np.ones(len(fold), bool), *(fold != f for f in range(folds))]
    draws = [(part, config.boosting.draws(len(features), rng)) for part in parts]
    fitted = list(map_frames(_boosted, draws, (features, crops.label, config.boosting.thresholds), jobs))
    if not last:
        return fitted[0]
    held_out = np.zeros(crops.label.shape)
    for part, of_others in zip(parts[1:], fitted[1:], strict=True):
        held_out[~part] = of_others.score(features[:, ~part]).T
    return fitted[0].shifted(-_even_odds(held_out, crops))


def _boosted(part: tuple[BoolArray, IntArray], shared: tuple[Float32Array, IntArray, int]) -> SharedStumps:
    (rows, draws), (features, label, thresholds) = part, shared
    return joint_boost(features[:, rows], label[rows], draws, thresholds)


def _even_odds(held_out: FloatArray, crops: _Crops) -> FloatArray:
    """The score (bins,) at which cars are as likely as street, by scores (n, bins) of crops not seen before.

    Here the rate of false alarms would not do: the fewer cars a bin has, the wider its scores are spread.
    """
    is_street = (crops.label != 1).all(axis=1)
    scalings = []
    for score, label in zip(held_out.T, crops.label.T, strict=True):
        # cars seen from elsewhere are left out: their own bins find them
        rows = ~crops.is_copy & ((label == 1) | (is_street & (label == -1)))
        scalings.append(fit_platt(score[rows], label[rows] == 1))
    return np.array([-s.b / s.a for s in scalings])
