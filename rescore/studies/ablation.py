"""What each part of the depth evidence is worth: the model fitted again without it.

Everything is done as in a run: the model on the splits "train" and "calibration", w on "validation", the
figures on "test".
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rescore.data.splits import Splits
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.fit_model import EvidenceConfig, fit_evidence, labelled_cues
from rescore.evidence.registration import Registration
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.tune import TuneConfig, match_at, tune_weight
from rescore.metrics.bootstrap import BootstrapConfig, Interval, bootstrap
from rescore.metrics.matching import TruthTable
from rescore.studies.sweep import RECALL

GROUPS: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "all relief": ("relief_scale", "relief_residual", "relief_gain", "roughness", "relief"),
    "all of size": ("width", "height", "support"),
    "foot and ground": ("foot", "ground_below"),
    "edges beside": ("left", "right"),
    "edges above": ("above", "behind_above"),
    "fill": ("compact", "lower", "fill_left", "fill_right", "fill_top", "near"),
    "depth ratio": ("depth_ratio",),
    "measured share": ("measured",),
}
"""Cues by the name of the group in which they are left out together."""


@dataclass(frozen=True, eq=False)
class AblationInput:
    """Candidates of one detector with their cues."""

    splits: Splits
    fitting: CandidateTable
    """Candidates of splits "train" and "calibration", which evidence models are fitted to."""
    validation: CandidateTable
    test: CandidateTable


@dataclass(frozen=True)
class AblationRow:
    """The metric mode without some cues."""

    without: str
    n_cues: int
    """Number of cues that are left out."""
    w: float
    fppi: Interval
    """False positives an image at ``sweep.RECALL``."""
    auc: Interval
    factor: Interval | None
    """Paired: false positives without the cues over those with all of them; None for all of them."""


def ablate(
    given: AblationInput, evidence: EvidenceConfig, tune: TuneConfig, seed: int
) -> tuple[AblationRow, ...]:
    """A row for the whole model, for each of ``GROUPS`` and for each cue alone."""
    cues, is_car = labelled_cues(given.fitting, given.splits.fitting_set, tune.min_iou)
    truth = TruthTable.of(given.splits.test)
    left_out = list(_left_out())
    matches, weights = {}, []
    for name, without in left_out:
        model = fit_evidence(cues, is_car, Registration.METRIC, evidence, without)
        validation = Rescoring(evidence_model=model).fuse(given.validation).candidates
        drawn = np.random.default_rng(seed)
        w = tune_weight(name, validation, given.splits.validation_set, tune, drawn).w
        test = Rescoring(evidence_model=model).fuse(given.test).candidates
        matches[name] = match_at(test, truth, w, tune.min_iou)
        weights.append(w)
    whole = left_out[0][0]
    pairs = [(name, whole) for name, _ in left_out[1:]]
    rng = np.random.default_rng(seed)
    intervals = bootstrap(matches, truth.cars_of_image, pairs, rng, BootstrapConfig(n_resamples=1000))
    return tuple(
        AblationRow(
            name,
            len(without),
            w,
            intervals.tables[name].fppi_at_recall[RECALL],
            intervals.tables[name].auc,
            intervals.comparisons[name, whole].reduction[RECALL] if name != whole else None,
        )
        for (name, without), w in zip(left_out, weights, strict=True)
    )


def _left_out() -> Iterator[tuple[str, Sequence[str]]]:
    yield from GROUPS.items()
    alone = {cues[0] for cues in GROUPS.values() if len(cues) == 1}
    yield from ((name, (name,)) for name in Registration.METRIC.cues if name not in alone)
