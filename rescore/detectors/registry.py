"""The detectors by name: what trains each, and what loads it. A new detector is a module and an entry here."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.detectors.base import Detector
from rescore.detectors.boosted import BoostedConfig, train_boosted
from rescore.detectors.crop_training import Crops, CrossValidation, SceneConfig, cross_validate
from rescore.detectors.crop_training import train_on_crops as train_in_scenes
from rescore.detectors.files import _one_line, read_detector_file
from rescore.detectors.hog_svm import HogConfig, train_hog


def load_detector(path: Path) -> Detector:
    """The detector of a file written by its ``save``.

    Raises:
        RescoreError: no such file, not a detector, an unknown kind, or damaged content.
    """
    # imported here: each detector module imports this one to write itself
    from rescore.detectors.boosted import BoostedDetector  # noqa: PLC0415
    from rescore.detectors.hog_svm import HogDetector  # noqa: PLC0415

    header, arrays = read_detector_file(path)
    kinds: dict[str, Callable[..., Detector]] = {
        HogDetector.kind: HogDetector.from_parts,
        BoostedDetector.kind: BoostedDetector.from_parts,
    }
    if header.get("kind") not in kinds:
        raise RescoreError(
            f"{path}: expected a detector of kind {' or '.join(sorted(kinds))}, got {header.get('kind')!r}; "
            "train the detector again (rescore train)"
        )
    try:
        return kinds[header["kind"]](header["name"], header["config"], arrays)
    except (KeyError, TypeError, ValueError) as error:
        raise RescoreError(
            f"{path}: expected a whole {header['kind']} detector, got damaged content ({_one_line(error)}); "
            "train the detector again (rescore train)"
        ) from error


class DetectorKind(StrEnum):
    """Detectors that can be trained."""

    HOG = "hog"
    BOOSTED = "boosted"


def train_detector(data: DataSet, config: HogConfig | BoostedConfig, seed: int, jobs: int) -> Detector:
    """A detector trained on the split "train" of a data set."""
    training = data.split("train")
    if not training.frames:
        raise RescoreError(f"{data.root}: expected frames of split 'train', got none; add some")
    if isinstance(config, HogConfig):
        return train_hog(training, config, np.random.default_rng([seed, 1]), jobs)
    return train_boosted(training, config, np.random.default_rng([seed, 2]), jobs)


def train_detector_on_crops(
    crops: Crops, config: HogConfig | BoostedConfig, seed: int, jobs: int
) -> tuple[Detector, CrossValidation]:
    """A detector trained on all crops, and what cross-validation tells of it, with its Platt scaling.

    The scaling comes from detectors trained on fewer crops, each on scenes of the crops it has not seen.
    """
    number = 1 if isinstance(config, HogConfig) else 2
    validation = cross_validate(crops, config, SceneConfig(), np.random.default_rng([seed, number, 1]), jobs)
    detector = train_in_scenes(crops, config, SceneConfig(), np.random.default_rng([seed, number]), jobs)
    return detector, validation
