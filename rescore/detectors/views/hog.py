"""Dalal and Triggs for all views: a linear SVM a view bin over one pyramid of gradient histograms.

All filters are correlated with the same features. The window of a filter has the shape of its bin's cars; the
filter of a mirrored bin is the mirrored filter. In each bin street scores above 0 once a frame, so that bins
compare.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pydantic import TypeAdapter

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.detectors.base import Detections, SuppressionConfig, best_candidates, ordered
from rescore.detectors.files import write_detector
from rescore.detectors.mining import MiningConfig, ScanRange, hard_negatives, jittered, over_frames
from rescore.detectors.views.examples import (
    CarViews,
    ViewExamples,
    aspects,
    car_views,
    cut_like_a_scan,
    read_gray,
    score_exceeded,
    windows_around,
)
from rescore.detectors.views.hog_blocks import BINS, CELL_PX, LENGTH, block_features
from rescore.detectors.views.levels import levels_of
from rescore.detectors.windows import WindowGeometry, gray
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread

MINING_FLOOR = -1.0
"""Where the margin of an SVM ends: street that scores less teaches nothing."""


@dataclass(frozen=True)
class HogViewsConfig:
    """Filters, training and scan; cells of 8 px, blocks of 2 x 2 and 9 bins as in the paper."""

    object_height_px: int = 32
    """Height of a car in the window of every bin; its width is that of the bin's examples."""
    margin_px: int = 8
    """Least margin around it."""
    scan: ScanRange = field(default_factory=lambda: ScanRange(20.0, 240.0, 1.15))
    """Heights of cars, which change little with the view, as widths do."""
    stride_px: int = 4
    """Step of a window on a level of the pyramid: a cell or half of one."""
    padding_px: int = 48
    """Mirrored border of each level: for cars cut by the edge."""
    svm_c: float = 0.03
    """Soft margin of the SVMs; looser than in the paper, since some bins have few examples."""
    floor: float = -0.1
    """Windows that score less are not reported by the scan."""
    examples: ViewExamples = field(default_factory=ViewExamples)
    mining: MiningConfig = field(
        default_factory=lambda: MiningConfig(
            jitter_copies=9, max_car_iou=0.4, random_per_frame=20, hard_per_frame=25, rounds=2
        )
    )
    """Settings of mining; the street windows of a frame are counted for each bin."""
    suppression: SuppressionConfig = field(default_factory=lambda: SuppressionConfig(max_iou=0.4))


@dataclass(frozen=True, eq=False)
class ViewFilter:
    """A filter: score of a window = weight . blocks + bias."""

    view_bin: int
    window: WindowGeometry
    weight: Float32Array
    """Shape (rows, columns, 36) of blocks a cell apart."""
    bias: float = 0.0

    def mirrored(self, view_bin: int) -> "ViewFilter":
        """The filter of a mirrored picture."""
        return replace(self, view_bin=view_bin, weight=mirrored_blocks(self.weight))


def filter_scores(filters: Sequence[ViewFilter], blocks: Float32Array, step: int) -> list[Float32Array]:
    """Scores (r, c) of filters of one height at all places of blocks (R, C, 36), ``step`` to a cell."""
    height, columns = len(filters[0].weight), blocks.shape[1]
    rows = max(0, blocks.shape[0] - (height - 1) * step)
    # one product for the columns of all filters, then sums of shifted maps
    weight = np.concatenate([f.weight.transpose(1, 0, 2).reshape(-1, height * LENGTH) for f in filters])
    widths = [f.weight.shape[1] for f in filters]
    scores = [
        np.full((rows, max(0, columns - (width - 1) * step)), f.bias, np.float32)
        for f, width in zip(filters, widths, strict=True)
    ]
    for phase in range(min(step, rows)):
        of_phase = [score[phase::step] for score in scores]
        # rows that lie a cell apart come one below the other, so that the blocks of a column are one vector
        apart = np.ascontiguousarray(blocks[phase::step].transpose(0, 2, 1)).reshape(-1, columns)
        views = sliding_window_view(apart, height * LENGTH, axis=0)[::LENGTH].transpose(0, 2, 1)
        at_once = max(1, 1_000_000 // (len(weight) * columns))  # maps that fit in the processor's cache
        found = np.empty((min(at_once, len(views)), len(weight), columns), np.float32)
        for first in range(0, len(views), at_once):
            some = views[first : first + at_once]
            maps = np.matmul(weight, some, out=found[: len(some)])
            of_filters = np.split(maps, np.cumsum(widths)[:-1], axis=1)
            for score, of_filter in zip(of_phase, of_filters, strict=True):
                _add_shifted(score[first : first + at_once], of_filter, step)
    return scores


def _add_shifted(score: Float32Array, maps: Float32Array, step: int) -> None:
    """Add maps (r, columns of the filter, C) to scores (r, c), each from its column on."""
    for x in range(maps.shape[1] if score.size else 0):
        score += maps[:, x, x * step : x * step + score.shape[1]]


@dataclass(frozen=True, eq=False)
class Places:
    """Windows of a scan: which filter found each, and where its blocks lie."""

    filter_index: IntArray
    """Shape (n,)."""
    level: IntArray
    """Shape (n,)."""
    row_column: IntArray
    """Shape (n, 2): first block in the grid of the level."""
    xyxy_px: FloatArray
    """Shape (n, 4): the object in the picture."""
    score: FloatArray
    """Shape (n,)."""

    @staticmethod
    def joined(parts: "Sequence[Places]") -> "Places":
        """One after the other."""
        names = ("filter_index", "level", "row_column", "xyxy_px", "score")
        return Places(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})


@dataclass(frozen=True, eq=False)
class HogViewsDetector:
    """A trained detector of all views."""

    kind: ClassVar[str] = "hog_views"
    filters: tuple[ViewFilter, ...]
    """Ascending bins; bins without examples have none."""
    config: HogViewsConfig
    name: str = "hog_views"

    def detect(self, rgb: UInt8Array) -> Detections:
        """The candidates of an (h, w, 3) uint8 picture after suppression over all bins; may be none."""
        return best_candidates(self.scan(rgb), self.config.suppression, rgb.shape[1], rgb.shape[0])

    def scan(self, rgb: UInt8Array) -> Detections:
        """All windows above the floor, each with the azimuth of its bin, before suppression and clipping."""
        with one_thread():
            levels = pyramid(gray(rgb), self.config, self.config.scan.car_sizes_px())
            found = self.places(levels, self.config.floor)
        middles = np.array([self.config.examples.middle_deg(f.view_bin) for f in self.filters])
        return ordered(found.xyxy_px, found.score, middles[found.filter_index])

    def places(self, levels: "Sequence[Level]", floor: float) -> Places:
        """All windows of a pyramid that score more than a floor."""
        stride, parts = self.config.stride_px, []
        for number, level in enumerate(levels):
            scores = filter_scores(self.filters, level.blocks, CELL_PX // stride)
            for k, (found, score) in enumerate(zip(self.filters, scores, strict=True)):
                at = np.argwhere(score > floor)
                corner = (at[:, ::-1] * stride - self.config.padding_px) / level.zoom
                boxes = found.window.boxes(corner, 1 / level.zoom)
                which, where = (np.full(len(at), i, np.int64) for i in (k, number))
                parts.append(Places(which, where, at, boxes, score[tuple(at.T)].astype(float)))
        return Places.joined(parts)

    def save(self, path: Path) -> None:
        """Write the detector to one file."""
        arrays: dict[str, NDArray[Any]] = {"view_bin": np.array([f.view_bin for f in self.filters])}
        arrays["bias"] = np.array([f.bias for f in self.filters])
        arrays["object_width_px"] = np.array([f.window.object_width_px for f in self.filters])
        arrays |= {f"weight_{f.view_bin}": f.weight for f in self.filters}
        write_detector(path, self.kind, self.name, asdict(self.config), arrays)

    @staticmethod
    def from_parts(
        name: str, config: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> "HogViewsDetector":
        """A detector from the header and the arrays of its file."""
        settings = TypeAdapter(HogViewsConfig).validate_python(config)
        rows = zip(arrays["view_bin"], arrays["object_width_px"], arrays["bias"], strict=True)
        filters = tuple(
            ViewFilter(int(b), window_of(int(width), settings), arrays[f"weight_{b}"], float(bias))
            for b, width, bias in rows
        )
        return HogViewsDetector(filters, settings, name)


@dataclass(frozen=True, eq=False)
class Level:
    """One size of a picture."""

    zoom: float
    """Pixels of the level over those of the picture."""
    blocks: Float32Array
    """Shape (rows, columns, 36), ``stride_px`` apart."""


def pyramid(picture: UInt8Array, config: HogViewsConfig, heights_px: FloatArray) -> list[Level]:
    """The features of a grey picture (h, w) at some sizes of cars."""
    levels = levels_of(picture, config.object_height_px, heights_px, config.padding_px)
    return [Level(zoom, block_features(level, config.stride_px)) for zoom, level in levels]


def window_of(object_width_px: int, config: HogViewsConfig) -> WindowGeometry:
    """The window of a bin: whole cells around an object of an even width."""
    across, down = (
        -(-(size + 2 * config.margin_px) // CELL_PX) * CELL_PX
        for size in (object_width_px, config.object_height_px)
    )
    margins = (across - object_width_px) // 2, (down - config.object_height_px) // 2
    return WindowGeometry(object_width_px, config.object_height_px, *margins)


def mirrored_blocks(blocks: Float32Array) -> Float32Array:
    """Blocks (..., rows, columns, 36) of the mirrored window."""
    # a block is its left cells, then its right ones, each of unsigned directions from 0 to 180 degrees;
    # OpenCV weighs pixels about a point half a pixel beside its middle, which mirrors nearly
    inside = blocks[..., ::-1, :].reshape(*blocks.shape[:-1], 2, 2, BINS)
    return np.ascontiguousarray(inside[..., ::-1, :, ::-1]).reshape(blocks.shape)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Descriptors of windows of one bin."""

    blocks: Float32Array
    """Shape (n, rows, columns, 36)."""
    frame: IntArray
    """Shape (n,): place of the frame that each comes from."""

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: BoolArray) -> "_Rows":
        return _Rows(self.blocks[rows], self.frame[rows])

    @staticmethod
    def joined(parts: "Sequence[_Rows]") -> "_Rows":
        return _Rows(np.concatenate([p.blocks for p in parts]), np.concatenate([p.frame for p in parts]))


@dataclass(frozen=True, eq=False)
class _BinExamples:
    """What one filter learns from."""

    view_bin: int
    window: WindowGeometry
    cars: _Rows
    others: _Rows
    """Cars that are seen from elsewhere, which the filter learns to score low."""
    street: _Rows | None = None

    def with_street(self, parts: "Sequence[_Rows]") -> "_BinExamples":
        before = () if self.street is None else (self.street,)
        return replace(self, street=_Rows.joined([*before, *parts]))

    def without(self, fold: int, folds: int) -> "_BinExamples":
        """The examples less those of the frames of a fold."""
        assert self.street is not None
        cars, others, street = (
            r.take(r.frame % folds != fold) for r in (self.cars, self.others, self.street)
        )
        return replace(self, cars=cars, others=others, street=street)

    def fit(self, svm_c: float) -> ViewFilter:
        """The linear SVM between the cars and all else."""
        from sklearn.svm import LinearSVC  # noqa: PLC0415 (takes a second; fitting alone needs it)

        assert self.street is not None
        rows = _Rows.joined([self.cars, self.others, self.street])
        is_car = np.arange(len(rows)) < len(self.cars)
        svm = LinearSVC(C=svm_c, dual=True, max_iter=5000, random_state=0)
        with one_thread():
            svm.fit(rows.blocks.reshape(len(rows), -1), is_car)
        weight = svm.coef_[0].astype(np.float32).reshape(rows.blocks.shape[1:])
        return ViewFilter(self.view_bin, self.window, weight, float(svm.intercept_[0]))

    def fit_comparable(self, svm_c: float, folds: int, false_alarms: int) -> ViewFilter:
        """The SVM, shifted so that street scores above 0 that often, as told by SVMs that have not seen it.

        The rates of finds would compare better still, but rare bins have too few cars to tell them.
        """
        assert self.street is not None
        scores = []
        for fold in range(folds):
            unseen = self.without(fold, folds).fit(svm_c)
            blocks = self.street.take(self.street.frame % folds == fold).blocks
            with one_thread():
                scores.append(np.tensordot(blocks, unseen.weight, axes=3) + unseen.bias)
        fitted = self.fit(svm_c)
        return replace(fitted, bias=fitted.bias - score_exceeded(np.concatenate(scores), false_alarms))


def train_hog_views(
    data: DataSet, config: HogViewsConfig, rng: np.random.Generator, jobs: int = 1
) -> HogViewsDetector:
    """A detector trained on the cars of ``data`` that have an azimuth, with rounds of hard-negative mining.

    Raises:
        RescoreError: too few cars of every bin are seen well enough, or none has an azimuth.
    """
    cars = car_views(data, config.examples, config.mining)
    bins = _examples(cars, config, rng, jobs)
    blank = [ViewFilter(b, e.window, np.zeros_like(e.cars.blocks[0])) for b, e in bins.items()]
    detector = _with_mirrored(blank, config)
    for mined in range(1 + config.mining.rounds):
        street = _street(detector, data, rng, jobs, mined=mined > 0)
        bins = {b: e.with_street(street[b]) for b, e in bins.items()}
        # bins are compared at the end alone: mining takes the best windows of each filter
        last = mined == config.mining.rounds
        fitted = map_frames(_fit, bins.values(), (config, len(data.frames), last), jobs)
        detector = _with_mirrored(list(fitted), config)
    return detector


def _fit(examples: _BinExamples, shared: tuple[HogViewsConfig, int, bool]) -> ViewFilter:
    config, n_frames, last = shared
    if not last:
        return examples.fit(config.svm_c)
    # the street of two mirrored bins lies together
    once_a_frame = n_frames * (1 + (config.examples.mirrored(examples.view_bin) != examples.view_bin))
    return examples.fit_comparable(config.svm_c, config.examples.folds, once_a_frame)


def _with_mirrored(learned: Sequence[ViewFilter], config: HogViewsConfig) -> HogViewsDetector:
    partner = config.examples.mirrored
    others = [f.mirrored(partner(f.view_bin)) for f in learned if partner(f.view_bin) != f.view_bin]
    return HogViewsDetector(tuple(sorted([*learned, *others], key=lambda f: f.view_bin)), config)


@dataclass(frozen=True, eq=False)
class _Cuts:
    """Windows of a frame, to be cut for a bin."""

    window: WindowGeometry
    windows_px: FloatArray
    """Shape (n, 4), in the picture as it is."""
    mirrored: BoolArray
    """Mask (n,) of those that are to be mirrored."""

    @staticmethod
    def around(
        views: CarViews,
        rows: BoolArray,
        window: WindowGeometry,
        mining: MiningConfig,
        rng: np.random.Generator,
    ) -> "_Cuts":
        """The windows of some cars with their shifted copies."""
        windows = jittered(windows_around(views.xyxy_px[rows], window), mining, rng)
        which = views.mirrored[rows]
        return _Cuts(window, windows, np.concatenate([which, np.repeat(which, mining.jitter_copies)]))


def _examples(
    cars: tuple[CarViews, ...], config: HogViewsConfig, rng: np.random.Generator, jobs: int
) -> dict[int, _BinExamples]:
    """The cars of each bin with shifted copies, and the cars seen from elsewhere."""
    limits, alone = config.examples, replace(config.mining, jitter_copies=0)
    windows = {
        b: window_of(2 * round(aspect * config.object_height_px / 2), config)
        for b, aspect in aspects(cars, limits).items()
    }
    cuts: list[list[_Cuts]] = [[] for _ in cars]
    for b, window in windows.items():
        for views, of_frame in zip(cars, cuts, strict=True):
            away = limits.away_deg(views.azimuth_deg, b)
            of_frame.append(_Cuts.around(views, away <= limits.reach_deg, window, config.mining, rng))
            of_frame.append(_Cuts.around(views, away > limits.apart_deg, window, alone, rng))
    to_cut = (
        (frame, views.record, of_frame)
        for frame, (views, of_frame) in enumerate(zip(cars, cuts, strict=True))
    )
    found = [_Rows.joined(parts) for parts in zip(*map_frames(_cut, to_cut, None, jobs), strict=True)]
    pairs = zip(windows.items(), found[::2], found[1::2], strict=True)
    return {b: _BinExamples(b, window, shown, others) for (b, window), shown, others in pairs}


def _cut(of_frame: tuple[int, FrameRecord, Sequence[_Cuts]], _shared: None) -> list[_Rows]:
    frame, record, cuts = of_frame
    picture, found = read_gray(record), []
    with one_thread():
        for of_bin in cuts:
            crops = cut_like_a_scan(picture, of_bin.windows_px, of_bin.window)
            crops[of_bin.mirrored] = crops[of_bin.mirrored][:, :, ::-1]
            found.append(_Rows(_descriptors(crops, of_bin.window), np.full(len(crops), frame)))
    return found


def _descriptors(crops: UInt8Array, window: WindowGeometry) -> Float32Array:
    rows, columns = window.height_px // CELL_PX - 1, window.width_px // CELL_PX - 1
    out = np.empty((len(crops), rows, columns, LENGTH), np.float32)
    for i, crop in enumerate(crops):
        out[i] = block_features(crop, CELL_PX)
    return out


def _street(
    detector: HogViewsDetector, data: DataSet, rng: np.random.Generator, jobs: int, *, mined: bool
) -> dict[int, list[_Rows]]:
    """Windows of street for each bin that is learned: random ones, or those that look like cars to it."""
    limits, n = detector.config.mining, len(data.frames)
    per_bin = limits.hard_of_frame(n) if mined else limits.random_of_frame(n)
    work = partial(_street_of, detector=detector, mined=mined, per_bin=per_bin)
    found: dict[int, list[_Rows]] = {}
    for of_frame in over_frames(work, data, rng, jobs):
        for b, rows in of_frame:
            found.setdefault(b, []).append(rows)
    return found


def _street_of(
    frame: int,
    record: FrameRecord,
    truth: Truth,
    rng: np.random.Generator,
    *,
    detector: HogViewsDetector,
    mined: bool,
    per_bin: int,
) -> list[tuple[int, _Rows]]:
    config = detector.config
    with one_thread():
        heights = config.scan.car_sizes_px()
        # random windows need not be of all sizes in each frame
        some = heights if mined else np.sort(rng.choice(heights, min(4, len(heights)), replace=False))
        levels = pyramid(read_gray(record), config, some)
        places = detector.places(levels, MINING_FLOOR) if mined else _random_places(detector, levels, rng)
    found = []
    for k, view in enumerate(detector.filters):
        rows = np.flatnonzero(places.filter_index == k)
        boxes = Detections(places.xyxy_px[rows], places.score[rows])
        chosen = rows[hard_negatives(boxes, truth, config.mining, per_bin)]
        blocks = _blocks_at(places, chosen, levels, view, CELL_PX // config.stride_px)
        learned = min(view.view_bin, config.examples.mirrored(view.view_bin))
        blocks = blocks if learned == view.view_bin else mirrored_blocks(blocks)
        found.append((learned, _Rows(blocks, np.full(len(blocks), frame))))
    return found


def _random_places(detector: HogViewsDetector, levels: Sequence[Level], rng: np.random.Generator) -> Places:
    """Places of all filters with scores at random, all levels alike; more than training takes of a frame."""
    config, parts = detector.config, []
    step = CELL_PX // config.stride_px
    for k, view in enumerate(detector.filters):
        reach = (np.array(view.weight.shape[:2]) - 1) * step
        room = np.array([level.blocks.shape[:2] for level in levels]) - reach
        fits = np.flatnonzero((room > 0).all(axis=1))
        wanted = 4 * config.mining.random_per_frame if len(fits) else 0
        number = fits[rng.integers(len(fits), size=wanted)]
        at = rng.integers(room[number])
        zoom = np.array([level.zoom for level in levels])[number]
        boxes = view.window.boxes(
            (at[:, ::-1] * config.stride_px - config.padding_px) / zoom[:, None], 1 / zoom
        )
        parts.append(Places(np.full(len(at), k), number, at, boxes, rng.random(len(at))))
    return Places.joined(parts)


def _blocks_at(
    places: Places, rows: NDArray[np.intp], levels: Sequence[Level], view: ViewFilter, step: int
) -> Float32Array:
    """The blocks (n, rows, columns, 36) of the windows of some places of a filter."""
    out = np.empty((len(rows), *view.weight.shape), np.float32)
    height, width, _ = view.weight.shape
    for i, row in enumerate(rows):
        y, x = places.row_column[row]
        blocks = levels[places.level[row]].blocks
        out[i] = blocks[y : y + (height - 1) * step + 1 : step, x : x + (width - 1) * step + 1 : step]
    return out
