"""Train a detector from crops alone, laid out in scenes so that false alarms are mined as in whole pictures.

A crop of a car shows the car in its place and nothing beside it. A scan also looks at half a car, at the
ground between two cars and across the edges of things. Crops of street are therefore laid out as tiles, a
crop of a car is put among them, and the detector's false alarms in such scenes are mined as in frames.
Scenes of held-out crops tell, by cross-validation, what a detector finds, and fit its Platt scaling.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np

from recon.arrays import Float32Array, UInt8Array
from recon.errors import RescoreError
from rescore.data.frames import Truth
from rescore.data.pictures import PICTURES, decode_picture
from rescore.detectors.base import Detector, SuppressionConfig, best_candidates
from rescore.detectors.mining import CropStyle, MiningConfig, ScanRange, hard_negatives, jittered
from rescore.detectors.platt import PlattScaling, fit_platt, label_candidates
from rescore.detectors.uiuc_rule import RecallPrecision, hits, lone, recall_precision
from rescore.detectors.windows import WindowGeometry, crop_windows
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread


class WindowConfig(Protocol):
    """Settings of a detector that slides a window over a pyramid of the picture."""

    @property
    def window(self) -> WindowGeometry:
        """Size of the window."""

    @property
    def scan(self) -> ScanRange:
        """Sizes of cars that are looked for."""

    @property
    def mining(self) -> MiningConfig:
        """How false alarms are mined."""

    @property
    def suppression(self) -> SuppressionConfig:
        """Limits on the windows that become candidates."""

    @property
    def crop_style(self) -> CropStyle:
        """How training crops are cut."""

    @property
    def cell_px(self) -> int:
        """Sides of the window are multiples of this."""


@runtime_checkable
class WindowDetector(Detector, Protocol):
    """A detector that slides a window over a pyramid of the picture."""

    @property
    def config(self) -> WindowConfig:
        """Settings of the detector: scan, window, mining, suppression."""

    def with_scan(self, scan: ScanRange) -> "WindowDetector":
        """The detector, looking for other sizes of cars."""


class Learner(Protocol):
    """Training on features that are kept from round to round."""

    def features(self, crops: UInt8Array) -> Float32Array:
        """Features (n, length) of canonical crops (n, height, width)."""

    def fit(self, cars: Float32Array, street: Float32Array, rng: np.random.Generator) -> WindowDetector:
        """A detector that parts the features (n, length) of cars and of street."""


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
    picture = decode_picture(file, cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise RescoreError(f"{file}: expected a picture, could not read it; mend or remove it")
    return np.asarray(picture, np.uint8)


def config_for_crops(config: Any, width_px: int, height_px: int) -> Any:
    """The settings with a window that is the whole crop, and with sizes of cars from the crop's on.

    The window keeps its height and takes the crops' ratio of sides, for HOG in whole cells. What is found is
    then the crop, with whatever margin it has, and not the car's own box.

    Args:
        config: settings of a detector, a dataclass and a ``WindowConfig``; what comes back is of its type.
        width_px: width of the crops.
        height_px: height of the crops.
    """
    cell = config.cell_px
    height = config.window.height_px
    width = max(cell, cell * round(height * width_px / height_px / cell))
    scan = ScanRange(width_px, max(width_px, config.scan.largest_car_px), config.scan.scale_step)
    return replace(config, window=WindowGeometry(width, height, 0, 0), scan=scan)


LearnerOf = Callable[[Callable[[], UInt8Array], Any, np.random.Generator, int], Learner]
"""Makes a learner from crops of cars (n, height, width), made when called, settings, random numbers and
jobs."""


@dataclass(frozen=True)
class SceneConfig:
    """How scenes are made of crops, and how they are used."""

    rows: int = 3
    """Tiles of street above one another."""
    columns: int = 3
    """Tiles of street beside one another."""
    folds: int = 3
    """Parts of the crops, each held out once."""
    mirror: bool = True
    """Learn from mirrored copies of all crops as well: cars face both ways."""


@dataclass(frozen=True, eq=False)
class CropScene:
    """A picture made of crops."""

    picture: UInt8Array
    """Grey picture, shape (h, w)."""
    truth: Truth


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """What detectors find in scenes of crops that have not trained them."""

    scaling: PlattScaling
    """Platt scaling fitted to the candidates of all held-out scenes."""
    curve: RecallPrecision
    """Recall and precision on the held-out scenes, by the rule of the UIUC car set."""


def train_on_crops(
    crops: Crops,
    config: WindowConfig,
    learner_of: LearnerOf,
    scenes: SceneConfig,
    rng: np.random.Generator,
    jobs: int,
) -> WindowDetector:
    """A detector trained on all crops, with rounds of mining in scenes made of the crops.

    ``config`` is one of ``config_for_crops``. The detector scans for all its sizes of cars; mining looks for
    the crops' own size alone, since scenes hold no other.
    """
    learner = learner_of(lambda: _cut(crops.cars, config, scenes, 0, rng), config, rng, jobs)
    cars = learner.features(_cut(crops.cars, config, scenes, config.mining.jitter_copies, rng))
    street = learner.features(_cut(crops.street, config, scenes, 0, rng))
    detector = learner.fit(cars, street, rng)
    for _ in range(config.mining.rounds):
        mined = _mine(at_one_size(detector), list(scenes_of(crops, scenes, rng)), jobs)
        street = np.concatenate([street, learner.features(mined)])
        detector = learner.fit(cars, street, rng)
    return detector


def cross_validate(
    crops: Crops,
    config: WindowConfig,
    learner_of: LearnerOf,
    scenes: SceneConfig,
    rng: np.random.Generator,
    jobs: int,
) -> CrossValidation:
    """Train on all parts of the crops but one, and detect in scenes of that one; for each part.

    Raises:
        RescoreError: fewer crops than parts.
    """
    scores, is_car, curve = [], [], []
    for training, held_out in _folds(crops, scenes.folds, rng):
        detector = at_one_size(train_on_crops(training, config, learner_of, scenes, rng, jobs))
        for scene in scenes_of(held_out, scenes, rng):
            with one_thread():
                found = detector.scan(scene.picture)
            height_px, width_px = scene.picture.shape
            candidates = best_candidates(found, config.suppression, width_px, height_px)
            car, counts = label_candidates(candidates, scene.truth)
            scores.append(candidates.score[counts])
            is_car.append(car[counts])
            apart, places = lone(found), scene.truth.xyxy_px[:, :2]
            hit = hits(apart.xyxy_px[:, :2], apart.score, places, crops.width_px, crops.height_px)
            curve.append((apart.score, hit, len(places)))
    return CrossValidation(fit_platt(np.concatenate(scores), np.concatenate(is_car)), recall_precision(curve))


def at_one_size(detector: WindowDetector) -> WindowDetector:
    """The detector, looking for cars of the smallest size that it knows and no other."""
    scan = detector.config.scan
    one = replace(scan, largest_car_px=scan.smallest_car_px)
    return detector.with_scan(one)


def scenes_of(crops: Crops, config: SceneConfig, rng: np.random.Generator) -> Iterator[CropScene]:
    """Scenes, one for each car: tiles of street in random order, the car at a random place among them."""
    n_tiles = config.rows * config.columns
    height, width = crops.height_px, crops.width_px
    for car in crops.cars:
        tiles = [_turned(crops.street[i], config, rng) for i in rng.integers(len(crops.street), size=n_tiles)]
        rows = [np.hstack(tiles[i : i + config.columns]) for i in range(0, n_tiles, config.columns)]
        picture = np.vstack(rows)
        y, x = (int(rng.integers(free + 1)) for free in np.subtract(picture.shape, (height, width)))
        picture[y : y + height, x : x + width] = _turned(car, config, rng)
        box = np.array([[x, y, x + width, y + height]], dtype=float)
        truth = Truth(np.zeros(1, np.int64), box, np.zeros(1, bool), np.ones(1), ("",))
        yield CropScene(picture, truth)


def _turned(crop: UInt8Array, config: SceneConfig, rng: np.random.Generator) -> UInt8Array:
    return crop[:, ::-1] if config.mirror and rng.integers(2) else crop


def _cut(
    crops: UInt8Array, config: WindowConfig, scenes: SceneConfig, copies: int, rng: np.random.Generator
) -> UInt8Array:
    """Each crop on the canonical window with ``copies`` jittered ones; with mirroring, as many again
    mirrored."""
    window, interpolation = config.window, config.crop_style.interpolation
    mining = replace(config.mining, jitter_copies=copies)
    whole = np.array([[0.0, 0.0, crops.shape[2], crops.shape[1]]])
    both = np.concatenate([crops, crops[:, :, ::-1]]) if scenes.mirror else crops
    cut = [
        crop_windows(np.ascontiguousarray(crop), jittered(whole, mining, rng), window, interpolation)
        for crop in both
    ]
    return np.concatenate(cut)


def _mine(detector: WindowDetector, scenes: list[CropScene], jobs: int) -> UInt8Array:
    window, mining = detector.config.window, detector.config.mining
    limit = max(1, mining.max_negatives // (2 * mining.rounds * len(scenes)))
    per_scene = min(mining.hard_per_frame, limit)
    none = np.empty((0, window.height_px, window.width_px), np.uint8)
    return np.concatenate([none, *map_frames(_mined_of, scenes, (detector, per_scene), jobs)])


def _mined_of(scene: CropScene, shared: tuple[WindowDetector, int]) -> UInt8Array:
    detector, max_count = shared
    style = detector.config.crop_style
    with one_thread():
        found = detector.scan(scene.picture)
    hard = found.xyxy_px[hard_negatives(found, scene.truth, style.mining, max_count)]
    return crop_windows(scene.picture, style.window.windows(hard), style.window, style.interpolation)


def _folds(crops: Crops, n: int, rng: np.random.Generator) -> Iterator[tuple[Crops, Crops]]:
    """``n`` splits of the crops into (rest, part); parts are drawn at random, as equal as can be."""
    if min(len(crops.cars), len(crops.street)) < n or n < 2:
        raise RescoreError(
            f"crops: expected at least {max(n, 2)} of cars and of street to hold some out, got "
            f"{len(crops.cars)} and {len(crops.street)}; add crops"
        )
    car_part = rng.permutation(len(crops.cars)) % n
    street_part = rng.permutation(len(crops.street)) % n
    for part in range(n):
        car, street = car_part == part, street_part == part
        yield Crops(crops.cars[~car], crops.street[~street]), Crops(crops.cars[car], crops.street[street])
