"""Dalal and Triggs: histograms of oriented gradients and a linear SVM (CVPR 2005).

OpenCV computes the descriptors and scans; scikit-learn trains. OpenCV's grouping of hits is off, since
it drops lone hits and their scores; suppression happens in ``recon.boxes``.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, UInt8Array
from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.detectors.base import (
    MOST_WINDOWS,
    Detections,
    SuppressionConfig,
    best_candidates,
    best_rows,
    ordered,
)
from rescore.detectors.files import write_detector
from rescore.detectors.mining import (
    CropStyle,
    MiningConfig,
    ScanRange,
    car_crops,
    hard_crops,
    street_crops,
)
from rescore.detectors.windows import WindowGeometry, gray
from rescore.parallel import one_thread

CELL_PX = 8
BLOCK_PX = 16
BINS = 9
# detectMultiScale shrinks its pictures so, without a blur before
INTERPOLATION = cv2.INTER_LINEAR


@dataclass(frozen=True)
class HogConfig:
    """Descriptor, training and scan of the Dalal-Triggs detector (cells of 8 px, blocks of 2 x 2, 9 bins)."""

    window: WindowGeometry = field(default_factory=WindowGeometry)
    """Whole window: a multiple of the cell size."""
    scan: ScanRange = field(default_factory=ScanRange)
    stride_px: int = 4
    """Step of the window on a level of the pyramid; half a cell places boxes better than a whole one."""
    padding_px: tuple[int, int] = (32, 16)
    """Mirrored border of the scanned picture (x, y), in window pixels: for cars cut by the edge."""
    svm_c: float = 0.01
    """Soft margin of the SVM, as in the paper of Dalal and Triggs."""
    floor: float = -1.6
    """Windows that score less are not reported by the scan."""
    mining: MiningConfig = field(default_factory=lambda: MiningConfig(rounds=1))
    """Settings of mining: one round, as in the paper of Dalal and Triggs."""
    suppression: SuppressionConfig = field(default_factory=SuppressionConfig)

    def __post_init__(self) -> None:
        if self.window.width_px % CELL_PX or self.window.height_px % CELL_PX:
            raise RescoreError(
                f"hog: expected a window of whole cells of {CELL_PX} px, got {self.window.width_px} x "
                f"{self.window.height_px}; change the object size or the margin"
            )

    @property
    def cell_px(self) -> int:
        """Sides of the window are multiples of this."""
        return CELL_PX

    @property
    def crop_style(self) -> CropStyle:
        """How training crops are cut."""
        return CropStyle(self.window, INTERPOLATION, self.scan, self.mining)


@dataclass(frozen=True, eq=False)
class HogDetector:
    """A trained Dalal-Triggs detector: score of a window = weight . descriptor + bias."""

    kind: ClassVar[str] = "hog_svm"
    weight: Float32Array
    """Shape (descriptor length,)."""
    bias: float
    config: HogConfig
    name: str = "hog"

    def __post_init__(self) -> None:
        if self.weight.shape != (descriptor_length(self.config),):
            raise ValueError(
                f"hog: {self.weight.shape} weights, window needs {descriptor_length(self.config)}"
            )

    def detect(self, rgb: UInt8Array) -> Detections:
        """The candidates of an (h, w, 3) uint8 picture after suppression; may be none."""
        return best_candidates(self.scan(rgb), self.config.suppression, rgb.shape[1], rgb.shape[0])

    def scan(self, rgb: UInt8Array) -> Detections:
        """All windows above the floor, before suppression and clipping."""
        window = self.config.window
        picture, zoom = self.zoomed(rgb)
        if picture.shape[0] < window.height_px or picture.shape[1] < window.width_px:
            return Detections(np.empty((0, 4)), np.empty(0))
        # OpenCV's threads lock windows and scores one after the other, and so now and then swap the scores of
        # two levels; in one thread the pairs are right, and frames run in parallel anyway
        with one_thread():
            found, found_score = self.descriptor().detectMultiScale(picture, **self.scan_arguments())
        if not len(found):
            return Detections(np.empty((0, 4)), np.empty(0))
        score = np.asarray(found_score, dtype=float).ravel()
        # boxes are made of those alone that ``ordered`` keeps
        kept = best_rows(score, MOST_WINDOWS)
        corner_size, score = np.asarray(found)[kept].astype(float), score[kept]
        # OpenCV rounds sizes to pixels and cuts windows at the picture's edge: the level tells the size
        step = np.log(self.config.scan.scale_step)
        rough = (corner_size[:, 2:] / [window.width_px, window.height_px]).max(axis=1)
        scale = np.exp(step * np.round(np.log(rough) / step))
        boxes = window.boxes((corner_size[:, :2] - self.config.padding_px) / zoom, scale / zoom)
        return ordered(boxes, score)

    def zoomed(self, rgb: UInt8Array) -> tuple[UInt8Array, float]:
        """The zoomed grey picture that is scanned, with its border, and its size over that of ``rgb``."""
        zoom = self.config.window.object_width_px / self.config.scan.smallest_car_px
        picture = gray(rgb)
        size = round(picture.shape[1] * zoom), round(picture.shape[0] * zoom)
        zoomed = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
        # not left to detectMultiScale: it cuts windows in its own border, so that their place is lost
        x, y = self.config.padding_px
        return np.asarray(cv2.copyMakeBorder(zoomed, y, y, x, x, cv2.BORDER_REFLECT_101), np.uint8), zoom

    def scan_arguments(self) -> dict[str, Any]:
        """Keyword arguments of the detectMultiScale call."""
        return {
            "hitThreshold": self.config.floor,
            "winStride": (self.config.stride_px, self.config.stride_px),
            "padding": (0, 0),
            "scale": self.config.scan.scale_step,
            "groupThreshold": 0,
        }

    def descriptor(self) -> cv2.HOGDescriptor:
        """OpenCV's descriptor with the weights set and as many levels as the car sizes need."""
        hog = hog_descriptor(self.config)
        hog.setSVMDetector(np.append(self.weight, np.float32(self.bias)))
        return hog

    def with_scan(self, scan: ScanRange) -> "HogDetector":
        """The detector, looking for other sizes of cars."""
        return replace(self, config=replace(self.config, scan=scan))

    def save(self, path: Path) -> None:
        """Write the detector to one file."""
        arrays = {"weight": self.weight, "bias": np.array(self.bias)}
        write_detector(path, self.kind, self.name, asdict(self.config), arrays)

    @staticmethod
    def from_parts(name: str, config: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> "HogDetector":
        """A detector from the header and the arrays of its file."""
        nested = dict(config)
        nested["window"] = WindowGeometry(**nested["window"])
        nested["scan"] = ScanRange(**nested["scan"])
        nested["mining"] = MiningConfig(**nested["mining"])
        nested["suppression"] = SuppressionConfig(**nested["suppression"])
        nested["padding_px"] = tuple(nested["padding_px"])
        weight = np.asarray(arrays["weight"], np.float32)
        return HogDetector(weight, float(arrays["bias"]), HogConfig(**nested), name)


def hog_descriptor(config: HogConfig) -> cv2.HOGDescriptor:
    """OpenCV's descriptor of the window, without weights."""
    return cv2.HOGDescriptor(
        _winSize=(config.window.width_px, config.window.height_px),
        _blockSize=(BLOCK_PX, BLOCK_PX),
        _blockStride=(CELL_PX, CELL_PX),
        _cellSize=(CELL_PX, CELL_PX),
        _nbins=BINS,
        _nlevels=len(config.scan.car_sizes_px()),
    )


def descriptor_length(config: HogConfig) -> int:
    """Numbers in the descriptor of one window."""
    return int(hog_descriptor(config).getDescriptorSize())


def descriptors(crops: UInt8Array, config: HogConfig) -> Float32Array:
    """Descriptors (n, length) of canonical crops (n, height, width)."""
    hog = hog_descriptor(config)
    out = np.empty((len(crops), descriptor_length(config)), np.float32)
    for i, crop in enumerate(crops):
        out[i] = np.ravel(hog.compute(np.ascontiguousarray(crop)))
    return out


def train_hog(data: DataSet, config: HogConfig, rng: np.random.Generator, jobs: int = 1) -> HogDetector:
    """A detector trained on all frames of ``data``, with rounds of hard-negative mining.

    Raises:
        RescoreError: no car in the frames is seen well enough.
    """
    style = config.crop_style
    cars = descriptors(car_crops(data, style, rng, jobs), config)
    street = descriptors(street_crops(data, style, rng, jobs), config)
    detector = train_hog_on_descriptors(cars, street, config, rng)
    for _ in range(config.mining.rounds):
        hard = hard_crops(detector, data, style, rng, jobs=jobs)
        street = np.concatenate([street, descriptors(hard, config)])
        detector = train_hog_on_descriptors(cars, street, config, rng)
    return detector


def train_hog_on_descriptors(
    cars: Float32Array, street: Float32Array, config: HogConfig, rng: np.random.Generator
) -> HogDetector:
    """The linear SVM between descriptors (n, length) of cars and of street."""
    if not len(cars) or not len(street):
        raise RescoreError(
            f"training: expected crops of cars and of street, got {len(cars)} and {len(street)}; "
            "add training frames"
        )
    from sklearn.svm import LinearSVC  # noqa: PLC0415 (takes a second; fitting alone needs it)

    svm = LinearSVC(C=config.svm_c, dual="auto", max_iter=5000, random_state=int(rng.integers(2**31)))
    svm.fit(np.concatenate([cars, street]), np.repeat([1, 0], [len(cars), len(street)]))
    return HogDetector(svm.coef_[0].astype(np.float32), float(svm.intercept_[0]), config)


@dataclass(frozen=True)
class HogLearner:
    """Training on features that are kept from round to round."""

    config: HogConfig

    def features(self, crops: UInt8Array) -> Float32Array:
        """Descriptors (n, length) of canonical crops (n, height, width)."""
        return descriptors(crops, self.config)

    def fit(self, cars: Float32Array, street: Float32Array, rng: np.random.Generator) -> HogDetector:
        """A detector that parts the descriptors (n, length) of cars and of street."""
        return train_hog_on_descriptors(cars, street, self.config, rng)
