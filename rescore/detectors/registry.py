"""The detectors by name: what trains each, and what loads it.

A new detector is a module that offers what ``DetectorEntry`` names, and an entry of ``DETECTORS``.
"""

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from recon.arrays import UInt8Array
from recon.errors import RescoreError
from recon.reading import reading
from rescore.data.frames import DataSet
from rescore.detectors.base import Detector
from rescore.detectors.boosted import BoostedConfig, BoostedDetector, BoostedLearner, train_boosted
from rescore.detectors.crop_training import (
    Crops,
    CrossValidation,
    Learner,
    SceneConfig,
    cross_validate,
    train_on_crops,
)
from rescore.detectors.files import read_detector_file
from rescore.detectors.hog_svm import HogConfig, HogDetector, HogLearner, train_hog
from rescore.detectors.modelled import ModelledConfig, ModelledDetector, make_modelled
from rescore.detectors.views.boosted import BoostedViewsConfig, BoostedViewsDetector, train_boosted_views
from rescore.detectors.views.hog import HogViewsConfig, HogViewsDetector, train_hog_views


@dataclass(frozen=True)
class DetectorEntry:
    """What the suite needs to know of a kind of detector."""

    title: str
    """Name of the detector in tables and pictures."""
    kind: str
    """Name of the kind of detector in detector files."""
    stream: int
    """Number of the stream of random numbers that trains the detector; no two detectors share one."""
    config: type[Any]
    """Settings, a frozen dataclass whose defaults train the detector of the experiment."""
    train: Callable[[DataSet, Any, np.random.Generator, int], Detector]
    """Trains a detector from frames, settings, random numbers and a number of jobs."""
    load: Callable[[str, Mapping[str, Any], Mapping[str, Any]], Detector]
    """Builds a detector from the name, the settings and the arrays of a detector file."""
    learner: Callable[[Callable[[], UInt8Array], Any, np.random.Generator, int], Learner] | None = None
    """Makes a learner from crops of cars (n, height, width), made when called, settings, random numbers and
    jobs; None where the detector cannot be trained on crops."""
    authors: str = ""
    """Who published it, for headings."""
    on_request: bool = False
    """Whether it runs only where it is named, not as one of all detectors: it needs truth that side views of
    cars do not have, such as azimuths."""

    @property
    def module(self) -> ModuleType:
        """The module that does the work, for the code version of cached stages."""
        return sys.modules[self.train.__module__]


DETECTORS: dict[str, DetectorEntry] = {
    "hog": DetectorEntry(
        title="HOG + SVM",
        kind=HogDetector.kind,
        stream=1,
        config=HogConfig,
        train=train_hog,
        load=HogDetector.from_parts,
        learner=lambda _cars, config, _rng, _jobs: HogLearner(config),
        authors="Dalal-Triggs",
    ),
    "boosted": DetectorEntry(
        title="boosted",
        kind=BoostedDetector.kind,
        stream=2,
        config=BoostedConfig,
        train=train_boosted,
        load=BoostedDetector.from_parts,
        learner=lambda cars, config, rng, jobs: BoostedLearner.of(cars(), config, rng, jobs),
        authors="Murphy-Torralba-Freeman",
    ),
    "modelled": DetectorEntry(
        title="modelled boxes",
        kind=ModelledDetector.kind,
        stream=3,
        config=ModelledConfig,
        train=make_modelled,
        load=ModelledDetector.from_parts,
        on_request=True,
    ),
    "hog_views": DetectorEntry(
        title="HOG + SVM, all views",
        kind=HogViewsDetector.kind,
        stream=4,
        config=HogViewsConfig,
        train=train_hog_views,
        load=HogViewsDetector.from_parts,
        authors="Dalal-Triggs",
        on_request=True,
    ),
    "boosted_views": DetectorEntry(
        title="boosted, all views",
        kind=BoostedViewsDetector.kind,
        stream=5,
        config=BoostedViewsConfig,
        train=train_boosted_views,
        load=BoostedViewsDetector.from_parts,
        authors="Torralba-Murphy-Freeman",
        on_request=True,
    ),
}
"""The detectors, by the name that commands, files and tables use."""


def learned_detectors() -> tuple[str, ...]:
    """Names of the detectors that are meant where none is named: those of the report, of one view."""
    return tuple(name for name, entry in DETECTORS.items() if not entry.on_request)


def detector_entry(name: str) -> DetectorEntry:
    """The entry of a name.

    Raises:
        RescoreError: no detector has it.
    """
    if name not in DETECTORS:
        raise RescoreError(f"detector: expected {' or '.join(DETECTORS)}, got {name!r}; choose one of these")
    return DETECTORS[name]


def train_detector(name: str, data: DataSet, config: Any, seed: int, jobs: int) -> Detector:
    """A detector trained on the split "train" of a data set.

    Raises:
        RescoreError: no such detector, no frames in the split, or too few cars in them.
    """
    training = data.split("train")
    if not training.frames:
        raise RescoreError(f"{data.root}: expected frames of split 'train', got none; add some")
    entry = detector_entry(name)
    return entry.train(training, config, np.random.default_rng([seed, entry.stream]), jobs)


def train_detector_on_crops(
    name: str, crops: Crops, config: Any, seed: int, jobs: int
) -> tuple[Detector, CrossValidation]:
    """A detector trained on all crops, and its cross-validation, which holds the Platt scaling.

    The scaling comes from detectors trained on fewer crops, each on scenes of the crops it has not seen.

    Raises:
        RescoreError: no such detector, it cannot be trained on crops, or the crops are too few.
    """
    entry = detector_entry(name)
    if entry.learner is None:
        raise RescoreError(
            f"{name}: expected a detector that learns from crops, got another; train it on frames"
        )
    scenes, stream = SceneConfig(), (seed, entry.stream)
    validation = cross_validate(
        crops, config, entry.learner, scenes, np.random.default_rng([*stream, 1]), jobs
    )
    detector = train_on_crops(crops, config, entry.learner, scenes, np.random.default_rng(stream), jobs)
    return detector, validation


def load_detector(path: Path) -> Detector:
    """The detector of a file written by its ``save``.

    Raises:
        RescoreError: no such file, not a detector, an unknown kind, or damaged content.
    """
    header, arrays = read_detector_file(path)
    kinds = {entry.kind: entry.load for entry in DETECTORS.values()}
    if header.get("kind") not in kinds:
        raise RescoreError(
            f"{path}: expected a detector of kind {' or '.join(sorted(kinds))}, got {header.get('kind')!r}; "
            "train the detector again (rescore train)"
        )
    with reading(path, f"a whole {header['kind']} detector", "train the detector again (rescore train)"):
        return kinds[header["kind"]](header["name"], header["config"], arrays)
