"""What the class model is worth: mode instance with and without the cues that come of it.

Everything is done as in the run, for each of its detectors: evidence fitted on the splits "train" and
"calibration", w chosen on "validation", figures on "test". With all cues the figures are those of the run.
"""

from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from recon.errors import RescoreError
from rescore.data.frames import DataSet
from rescore.evidence.fit_model import fit_evidence, labelled_cues
from rescore.evidence.registration import Registration
from rescore.experiment.config import RunConfig, run_config
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.tune import match_at
from rescore.metrics.bootstrap import Bootstrap, BootstrapConfig, Comparison, bootstrap
from rescore.metrics.matching import TruthTable
from rescore.metrics.resampled import Levels
from rescore.results.candidate_file import ALONE
from rescore.results.run_folder import RunFolder
from rescore.results.sweep_file import StudyPart, SweptInterval, swept_levels
from rescore.studies.ablation import AblationInput, Judged, groups, judged

MODE = Registration.INSTANCE
GROUP = "class model"
"""The group of cues that is left out."""
WITH, WITHOUT = "all cues", f"without {GROUP}"
RECALLS = (0.5, 0.6, 0.7, 0.8)
"""Shares of all cars at which false positives are compared."""


class WorthFigures(StudyPart):
    """One way of scoring the candidates of one detector."""

    w: float
    """1 is the detector alone."""
    with_evidence: float
    """Share of the candidates with depth evidence."""
    fppi: dict[str, SweptInterval]
    """False positives an image by recall, as "0.7"."""
    average_precision: SweptInterval


class Change(StudyPart):
    """What changes from one way of scoring to another, paired over images."""

    factor: dict[str, SweptInterval]
    """False positives before over those after, by recall: above 1 where the second makes fewer."""
    average_precision: SweptInterval
    """Average precision after less before."""

    @classmethod
    def of(cls, change: Comparison) -> "Change":
        """The change that a bootstrap found."""
        return cls(
            factor=swept_levels(change.reduction),
            average_precision=SweptInterval.of(change.difference.average_precision),
        )


class DetectorWorth(StudyPart):
    """One detector."""

    detector: str
    n_candidates: int
    figures: dict[str, WorthFigures]
    """By ``ALONE``, ``WITH`` and ``WITHOUT``."""
    class_model: Change
    """What the class model brings: from ``WITHOUT`` to ``WITH``."""
    depth: dict[str, Change]
    """What depth brings to the detector alone, by ``WITH`` and ``WITHOUT``."""


class WorthResult(StudyPart):
    """The content of class_model.json."""

    command: str
    """What made it."""
    n_images: int
    n_cars: int
    cues: tuple[str, ...]
    """The cues that are left out."""
    n_cues: int
    """Number of cues of the mode, these among them."""
    detectors: tuple[DetectorWorth, ...]


def class_model_worth(root: Path, command: str, seed: int) -> WorthResult:
    """The worth of the class model for each detector of a finished run.

    Args:
        root: The run, which has mode instance.
        command: What made it, for the file.
        seed: Of every random choice; that of the run gives the run's own w.

    Raises:
        RescoreError: the run is not finished, or has no mode instance.
    """
    config = run_config(root)
    if MODE not in config.registrations:
        modes = ", ".join(config.registrations)
        raise RescoreError(f"{root}: expected a run with mode {MODE}, got {modes}; use one of preset streets")
    data = read_dataset(RunFolder(root).data, config.class_name)
    truth = TruthTable.of(data.split("test"))
    left_out = groups(MODE)
    return WorthResult(
        command=command,
        n_images=truth.n_images,
        n_cars=truth.n_cars,
        cues=left_out[GROUP],
        n_cues=sum(map(len, left_out.values())),
        detectors=tuple(detector_worth(root, config, data, name, seed) for name in config.detectors),
    )


def detector_worth(root: Path, config: RunConfig, data: DataSet, detector: str, seed: int) -> DetectorWorth:
    """The worth of the class model for one detector of a run; arguments as for ``class_model_worth``."""
    given = AblationInput.of_run(root, data, detector)
    return worth_of(given, detector, config, seed)


def worth_of(given: AblationInput, detector: str, config: RunConfig, seed: int) -> DetectorWorth:
    """The worth of the class model for the candidates of one detector."""
    cues, is_car = labelled_cues(given.fitting, given.splits.fitting_set, config.tune.min_iou)
    truth = TruthTable.of(given.splits.test)
    alone = match_at(given.test, truth, 1.0, config.tune.min_iou)
    ways = {ALONE: Judged(1.0, alone, 0.0)}
    for name, without in ((WITH, ()), (WITHOUT, groups(MODE)[GROUP])):
        model = fit_evidence(cues, is_car, MODE, config.evidence, without)
        # the stream of the run's own choice of w
        drawn = np.random.default_rng([seed, 3])
        ways[name] = judged(given, model, config.tune, truth, drawn)
    pairs = [(WITHOUT, WITH), (ALONE, WITH), (ALONE, WITHOUT)]
    rng = np.random.default_rng(seed)
    matches = {name: way.match for name, way in ways.items()}
    levels = BootstrapConfig(levels=Levels(recalls=RECALLS))
    found = bootstrap(matches, truth.cars_of_image, pairs, rng, levels)
    return DetectorWorth(
        detector=detector,
        n_candidates=len(given.test),
        figures={name: _figures(found, name, way) for name, way in ways.items()},
        class_model=Change.of(found.comparisons[WITHOUT, WITH]),
        depth={name: Change.of(found.comparisons[ALONE, name]) for name in (WITH, WITHOUT)},
    )


def _figures(found: Bootstrap, name: str, way: Judged) -> WorthFigures:
    table = found.tables[name]
    return WorthFigures(
        w=way.w,
        with_evidence=way.with_evidence,
        fppi=swept_levels(table.fppi_at_recall),
        average_precision=SweptInterval.of(table.average_precision),
    )


def write_worth(path: Path, result: WorthResult) -> None:
    """Write class_model.json."""
    write_json(path, result.as_json())


def read_worth(path: Path) -> WorthResult:
    """The study in a file.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(WorthResult), "a study of what the class model is worth")
