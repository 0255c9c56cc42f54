"""What each part of the depth evidence is worth: the model fitted again without it.

Everything is done as in a run: the model on the splits "train" and "calibration", w on "validation", the
figures on "test".
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rescore.data.frames import DataSet
from rescore.data.splits import Splits
from rescore.evidence.candidates import OK, CandidateTable
from rescore.evidence.cues import CUES, cues_of
from rescore.evidence.fit_model import EvidenceConfig, fit_evidence, labelled_cues
from rescore.evidence.model import EvidenceModel
from rescore.evidence.registration import Registration
from rescore.experiment.config import run_config
from rescore.experiment.reproduce import FITTED_ON
from rescore.files import write_json
from rescore.formats.coco import read_detections
from rescore.formats.coco_dataset import read_dataset
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.tune import TuneConfig, match_at, tune_weight
from rescore.metrics.bootstrap import BootstrapConfig, bootstrap
from rescore.metrics.matching import MatchTable, TruthTable
from rescore.results.run_folder import RunFolder
from rescore.results.sweep_file import StudyPart, SweptInterval
from rescore.studies.sweep import RECALL


def groups(mode: Registration) -> dict[str, tuple[str, ...]]:
    """Cues of a mode that are left out together, by the name of their group; first none at all."""
    found: dict[str, tuple[str, ...]] = {"nothing": ()}
    for name in cues_of(mode):
        group = CUES[name].group
        found[group] = (*found.get(group, ()), name)
    return found


@dataclass(frozen=True, eq=False)
class AblationInput:
    """Candidates of one detector with their cues."""

    splits: Splits
    fitting: CandidateTable
    """Candidates of splits "train" and "calibration", which evidence models are fitted to."""
    validation: CandidateTable
    test: CandidateTable

    @staticmethod
    def of_run(root: Path, data: DataSet, detector: str) -> "AblationInput":
        """The candidates of a detector of a finished run, whose data set is given."""

        def table(split: str) -> CandidateTable:
            file = RunFolder(root).evidence_table(detector, split)
            return read_detections(file, data.split(split)).table

        fitting = CandidateTable.concatenate([table(split) for split in FITTED_ON])
        return AblationInput(Splits.of(data), fitting, table("validation"), table("test"))


class AblationRow(StudyPart):
    """The metric mode without some cues; a row of ablation.json."""

    without: str
    n_cues: int
    """Number of cues that are left out."""
    w: float
    fppi: SweptInterval
    """False positives an image at ``sweep.RECALL``."""
    auc: SweptInterval
    factor: SweptInterval | None
    """Paired: false positives without the cues over those with all of them; None for all of them."""


def ablate(
    given: AblationInput, mode: Registration, evidence: EvidenceConfig, tune: TuneConfig, seed: int
) -> tuple[AblationRow, ...]:
    """A row for the whole model, for each of ``groups`` and for each cue alone."""
    cues, is_car = labelled_cues(given.fitting, given.splits.fitting_set, tune.min_iou)
    truth = TruthTable.of(given.splits.test)
    left_out = list(_left_out(mode))
    matches, weights = {}, []
    for name, without in left_out:
        model = fit_evidence(cues, is_car, mode, evidence, without)
        found = judged(given, model, tune, truth, np.random.default_rng(seed))
        matches[name] = found.match
        weights.append(found.w)
    whole = left_out[0][0]
    pairs = [(name, whole) for name, _ in left_out[1:]]
    rng = np.random.default_rng(seed)
    intervals = bootstrap(matches, truth.cars_of_image, pairs, rng, BootstrapConfig(n_resamples=1000))
    return tuple(
        AblationRow(
            without=name,
            n_cues=len(without),
            w=w,
            fppi=SweptInterval.of(intervals.tables[name].fppi_at_recall[RECALL]),
            auc=SweptInterval.of(intervals.tables[name].auc),
            factor=None
            if name == whole
            else SweptInterval.of(intervals.comparisons[name, whole].reduction[RECALL]),
        )
        for (name, without), w in zip(left_out, weights, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Judged:
    """What an evidence model makes of the test split."""

    w: float
    """Weight that the validation split chooses."""
    match: MatchTable
    """Match table of the test split."""
    with_evidence: float
    """Share of its candidates with depth evidence."""


def judged(
    given: AblationInput,
    model: EvidenceModel,
    tune: TuneConfig,
    truth: TruthTable,
    rng: np.random.Generator,
) -> Judged:
    """What an evidence model makes of the test split, with w chosen on the validation split.

    Args:
        given: Candidates with their cues.
        model: What makes D of the cues.
        tune: How w is chosen.
        truth: Of the test split.
        rng: Draws the images that tell how well w is known.
    """
    rescoring = Rescoring(evidence_model=model)
    validation = rescoring.fuse(given.validation).candidates
    w = tune_weight(model.registration, validation, given.splits.validation_set, tune, rng).w
    test = rescoring.fuse(given.test).candidates
    return Judged(w, match_at(test, truth, w, tune.min_iou), float((test.status == OK).mean()))


def ablate_run(root: Path, out: Path, detector: str, seed: int) -> tuple[AblationRow, ...]:
    """The worth of each part of a finished run's evidence, in mode "instance" where it has it, else "metric".

    Writes ``ablation.json`` to the folder ``out``.

    Raises:
        RescoreError: the run is not finished, or has no such detector.
    """
    config = run_config(root)
    data = read_dataset(RunFolder(root).data, config.class_name)
    given = AblationInput.of_run(root, data, detector)
    with_instances = Registration.INSTANCE in config.registrations
    mode = Registration.INSTANCE if with_instances else Registration.METRIC
    rows = ablate(given, mode, config.evidence, config.tune, seed)
    write_ablation(out / "ablation.json", rows)
    return rows


def _left_out(mode: Registration) -> Iterator[tuple[str, Sequence[str]]]:
    yield from groups(mode).items()
    alone = {cues[0] for cues in groups(mode).values() if len(cues) == 1}
    yield from ((name, (name,)) for name in cues_of(mode) if name not in alone)


def write_ablation(path: Path, rows: Sequence[AblationRow]) -> None:
    """Write ablation.json."""
    write_json(path, [row.as_json() for row in rows])
