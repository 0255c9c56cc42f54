"""Murphy, Torralba and Freeman: boosted image fragments (NIPS 2003), shared by all windows of a scan."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array
from rescore.data.frames import DataSet
from rescore.detectors.base import Detections, SuppressionConfig, best_candidates, ordered
from rescore.detectors.boosting import BoostConfig, Stumps, gentle_boost
from rescore.detectors.files import write_detector
from rescore.detectors.fragments import (
    Dictionary,
    FragmentConfig,
    cut_dictionary,
    features_of_crops,
    level_features,
)
from rescore.detectors.mining import CropStyle, MiningConfig, ScanRange, car_crops, hard_crops, street_crops
from rescore.detectors.windows import WindowGeometry, gray
from rescore.parallel import one_blas_thread

# the pyramid shrinks by area means, which do not alias
INTERPOLATION = cv2.INTER_AREA


@dataclass(frozen=True)
class BoostedConfig:
    """Fragments, boosting and scan of the Murphy-Torralba-Freeman detector."""

    window: WindowGeometry = field(default_factory=lambda: WindowGeometry(64, 24, 8, 8))
    """Object size and margin."""
    scan: ScanRange = field(default_factory=lambda: ScanRange(scale_step=1.15))
    stride: int = 2
    """Step of the window in grid steps of the fragments."""
    padding_px: tuple[int, int] = (24, 12)
    """Mirrored border of each level (x, y): cars cut by the picture's edge."""
    floor: float = -6.0
    """Windows that score less are not reported by the scan."""
    fragments: FragmentConfig = field(default_factory=FragmentConfig)
    boosting: BoostConfig = field(default_factory=BoostConfig)
    mining: MiningConfig = field(
        default_factory=lambda: MiningConfig(
            jitter_copies=9, random_per_frame=60, hard_per_frame=40, rounds=2
        )
    )
    suppression: SuppressionConfig = field(default_factory=SuppressionConfig)

    @property
    def cell_px(self) -> int:
        """Sides of the window are multiples of this."""
        return 1

    @property
    def crop_style(self) -> CropStyle:
        """How training crops are cut."""
        return CropStyle(self.window, INTERPOLATION, self.scan, self.mining)


@dataclass(frozen=True, eq=False)
class BoostedDetector:
    """A trained Murphy-Torralba-Freeman detector: score of a window = sum of stumps on fragment features."""

    kind: ClassVar[str] = "boosted_fragments"
    dictionary: Dictionary
    """Fragments of the dictionary that some stump reads."""
    stumps: Stumps
    config: BoostedConfig
    name: str = "boosted"

    def __post_init__(self) -> None:
        if len(self.stumps) and self.stumps.feature.max() >= len(self.dictionary):
            raise ValueError(
                f"boosted: stump of feature {self.stumps.feature.max()} of {len(self.dictionary)}"
            )

    def detect(self, rgb: UInt8Array) -> Detections:
        """The candidates of an (h, w, 3) uint8 picture after suppression; may be none."""
        return best_candidates(self.scan(rgb), self.config.suppression, rgb.shape[1], rgb.shape[0])

    def scan(self, rgb: UInt8Array) -> Detections:
        """All windows above the floor, before suppression and clipping."""
        picture = gray(rgb)
        widths = self.config.scan.car_sizes_px()
        # threads over levels, largest first; BLAS alone would idle between its small products
        with one_blas_thread(), ThreadPoolExecutor(cv2.getNumThreads()) as pool:
            levels = list(pool.map(lambda width: self._scan_level(picture, width), widths))
        return ordered(np.concatenate([b for b, _ in levels]), np.concatenate([s for _, s in levels]))

    def _scan_level(self, picture: UInt8Array, car_width_px: float) -> tuple[FloatArray, FloatArray]:
        config, window = self.config, self.config.window
        scale = car_width_px / window.object_width_px
        size = max(1, round(picture.shape[1] / scale)), max(1, round(picture.shape[0] / scale))
        level = cv2.resize(picture, size, interpolation=INTERPOLATION if scale > 1 else cv2.INTER_LINEAR)
        px, py = config.padding_px
        padded = np.asarray(cv2.copyMakeBorder(level, py, py, px, px, cv2.BORDER_REFLECT_101), np.uint8)
        features = level_features(padded, self.dictionary, window, config.stride)
        score = self.stumps.score(features)
        row, column = np.nonzero(score > config.floor)
        step = config.stride * config.fragments.grid_px
        corner = np.stack([column * step - px, row * step - py], axis=1).astype(float) * scale
        return window.boxes(corner, scale), score[row, column].astype(float)

    def with_scan(self, scan: ScanRange) -> "BoostedDetector":
        """The detector, looking for other sizes of cars."""
        return replace(self, config=replace(self.config, scan=scan))

    def save(self, path: Path) -> None:
        """Write the detector to one file."""
        arrays: dict[str, NDArray[Any]] = {
            f"stump_{key}": getattr(self.stumps, key) for key in ("feature", "threshold", "below", "above")
        }
        arrays |= self.dictionary.as_arrays()
        write_detector(path, self.kind, self.name, asdict(self.config), arrays)

    @staticmethod
    def from_parts(
        name: str, config: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> "BoostedDetector":
        """A detector from the header and the arrays of its file."""
        nested = dict(config)
        fragments = dict(nested["fragments"])
        fragments["sizes_px"] = tuple(fragments["sizes_px"])
        nested["fragments"] = FragmentConfig(**fragments)
        nested["window"] = WindowGeometry(**nested["window"])
        nested["scan"] = ScanRange(**nested["scan"])
        nested["boosting"] = BoostConfig(**nested["boosting"])
        nested["mining"] = MiningConfig(**nested["mining"])
        nested["suppression"] = SuppressionConfig(**nested["suppression"])
        nested["padding_px"] = tuple(nested["padding_px"])
        whole = BoostedConfig(**nested)
        dictionary = Dictionary.of_arrays(arrays, whole.fragments)
        stumps = Stumps(*(arrays[f"stump_{key}"] for key in ("feature", "threshold", "below", "above")))
        return BoostedDetector(dictionary, stumps, whole, name)


def train_boosted(
    data: DataSet, config: BoostedConfig, rng: np.random.Generator, jobs: int = 1
) -> BoostedDetector:
    """A detector trained on all frames of ``data``, with rounds of hard-negative mining.

    Raises:
        RescoreError: no car in the frames is seen well enough.
    """
    style = config.crop_style
    cars = car_crops(data, style, rng, jobs)
    dictionary = cut_dictionary(cars, config.window, config.fragments, rng)
    car_features = features_of_crops(cars, dictionary, jobs)
    street_features = features_of_crops(street_crops(data, style, rng, jobs), dictionary, jobs)
    detector = _fit(dictionary, car_features, street_features, config, rng)
    for _ in range(config.mining.rounds):
        hard = hard_crops(detector, data, style, rng, jobs=jobs)
        street_features = np.concatenate([street_features, features_of_crops(hard, dictionary, jobs)], axis=1)
        detector = _fit(dictionary, car_features, street_features, config, rng)
    return detector


@dataclass(frozen=True, eq=False)
class BoostedLearner:
    """Training on features of one dictionary that are kept from round to round."""

    dictionary: Dictionary
    config: BoostedConfig
    jobs: int

    @staticmethod
    def of(cars: UInt8Array, config: BoostedConfig, rng: np.random.Generator, jobs: int) -> "BoostedLearner":
        """A learner whose fragments are cut from canonical crops (n, height, width) of cars."""
        return BoostedLearner(cut_dictionary(cars, config.window, config.fragments, rng), config, jobs)

    def features(self, crops: UInt8Array) -> Float32Array:
        """Features (n, f) of canonical crops (n, height, width)."""
        return features_of_crops(crops, self.dictionary, self.jobs).T

    def fit(self, cars: Float32Array, street: Float32Array, rng: np.random.Generator) -> BoostedDetector:
        """A detector that parts the features (n, f) of cars and of street."""
        return _fit(self.dictionary, cars.T, street.T, self.config, rng)


def _fit(
    dictionary: Dictionary,
    cars: Float32Array,
    street: Float32Array,
    config: BoostedConfig,
    rng: np.random.Generator,
) -> BoostedDetector:
    is_car = np.repeat([True, False], [cars.shape[1], street.shape[1]])
    stumps = gentle_boost(np.concatenate([cars, street], axis=1), is_car, config.boosting, rng)
    used = stumps.used()
    return BoostedDetector(dictionary.chosen(used), stumps.renumbered(used), config)
