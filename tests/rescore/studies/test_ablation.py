"""What is left out is missed exactly where it told cars from other things."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rescore.data.frames import SPLITS, DataSet, FrameRecord, Truth
from rescore.data.splits import Splits
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.cues import CUES, cue_column, cues_of
from rescore.evidence.fit_model import EvidenceConfig
from rescore.evidence.registration import Registration
from rescore.fusion.tune import TuneConfig
from rescore.studies.ablation import AblationInput, AblationRow, ablate, groups

CAR, OTHER = np.array([10.0, 10, 60, 30]), np.array([100.0, 50, 150, 70])
PER_SPLIT = 40


def data_set() -> DataSet:
    """A car in every picture."""
    frames, truth = [], {}
    for i in range(PER_SPLIT * len(SPLITS)):
        split = SPLITS[i // PER_SPLIT]
        frames.append(FrameRecord(i, Path(f"{i}.png"), None, None, split, 200, 100, None, None))
        truth[i] = Truth(np.array([i]), CAR[None], np.array([False]), np.array([1.0]), (f"{split} {i}",))
    return DataSet(Path(), 1, "car", tuple(frames), truth)


def table_of(data: DataSet, rng: np.random.Generator) -> CandidateTable:
    """A candidate on the car and four others of one likelihood; width alone tells them apart."""
    boxes = np.stack([CAR, *(OTHER + 3 * k for k in range(4))])
    tables = []
    for frame in data.frames:
        likelihood = rng.uniform(0.2, 0.8, 5)
        cues = rng.normal(0, 1, (5, len(CUES)))
        cues[0, cue_column("width")] += 4
        found = Candidates(frame.image_id, boxes, likelihood, likelihood)
        tables.append(replace(CandidateTable.of_candidates([found]), cues=cues))
    return CandidateTable.concatenate(tables)


@pytest.fixture(scope="module")
def rows() -> dict[str, AblationRow]:
    rng, data = np.random.default_rng(0), data_set()
    splits = Splits.of(data)
    given = AblationInput(
        splits,
        table_of(splits.fitting_set.data, rng),
        table_of(splits.validation, rng),
        table_of(splits.test, rng),
    )
    return {
        r.without: r
        for r in ablate(
            given, Registration.METRIC, EvidenceConfig(), TuneConfig(n_grid=21, n_resamples=100), 0
        )
    }


def test_every_cue_is_in_one_group_and_has_a_row(rows: dict[str, AblationRow]) -> None:
    grouped = [name for cues in groups(Registration.METRIC).values() for name in cues]
    assert sorted(grouped) == sorted(cues_of(Registration.METRIC))
    alone = {cues[0] for cues in groups(Registration.METRIC).values() if len(cues) == 1}
    assert set(rows) == set(groups(Registration.METRIC)) | (set(grouped) - alone)
    assert not set(groups(Registration.METRIC)) & set(CUES)


def test_what_tells_cars_is_missed(rows: dict[str, AblationRow]) -> None:
    whole = rows["nothing"]
    assert whole.factor is None
    for name in ("width", "all of size"):
        factor = rows[name].factor
        assert factor is not None
        assert factor.low > 1
        assert rows[name].auc.value < whole.auc.value - 0.05


def test_what_is_chance_is_not(rows: dict[str, AblationRow]) -> None:
    for name in ("edges beside", "foot", "measured share"):
        assert abs(rows[name].auc.value - rows["nothing"].auc.value) < 0.03
