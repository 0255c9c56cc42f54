"""The class model is worth what its cues tell, no more, and the page says how sure that is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reports.studies.class_model_worth import worth_page, worth_sentence, write_worth_study
from rescore.data.splits import Splits
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.cues import CUES, cue_column
from rescore.experiment.config import run_preset
from rescore.results.candidate_file import ALONE
from rescore.results.run_config_file import write_run_config
from rescore.results.run_folder import RunFolder
from rescore.results.sweep_file import SweptInterval
from rescore.studies.ablation import AblationInput
from rescore.studies.class_model_worth import (
    WITH,
    WITHOUT,
    DetectorWorth,
    WorthResult,
    read_worth,
    worth_of,
)
from tests.rescore.spoiling import Run
from tests.rescore.studies.test_ablation import CAR, OTHER, data_set

CONFIG = run_preset("streets")


def worth(told_by: dict[str, float]) -> DetectorWorth:
    """Worth on candidates of one likelihood, of which the cues named tell cars from four other things."""
    rng, data = np.random.default_rng(0), data_set()
    splits = Splits.of(data)
    boxes = np.stack([CAR, *(OTHER + 3 * k for k in range(4))])

    def table(frames: list[int]) -> CandidateTable:
        tables = []
        for image_id in frames:
            likelihood = rng.uniform(0.2, 0.8, 5)
            cues = rng.normal(0, 1, (5, len(CUES)))
            cues[:, cue_column("resolved")] = 1
            for name, by in told_by.items():
                cues[0, cue_column(name)] += by
            found = Candidates(image_id, boxes, likelihood, likelihood)
            tables.append(replace(CandidateTable.of_candidates([found]), cues=cues))
        return CandidateTable.concatenate(tables)

    of = [[f.image_id for f in d.frames] for d in (splits.fitting_set.data, splits.validation, splits.test)]
    given = AblationInput(splits, *(table(frames) for frames in of))
    return worth_of(given, "modelled", CONFIG, 0)


@pytest.fixture(scope="module")
def needed() -> DetectorWorth:
    return worth({"overlap": 3.0, "foot": 1.0})


def test_what_it_alone_tells_is_its_worth(needed: DetectorWorth) -> None:
    assert needed.figures[ALONE].w == 1
    # nothing is missing in these candidates, and some fail a check of a hundredth
    assert [needed.figures[name].with_evidence > 0.9 for name in (ALONE, WITHOUT, WITH)] == [
        False,
        True,
        True,
    ]
    factor = needed.class_model.factor["0.7"]
    assert factor.low > 1
    before, after = (needed.figures[name].fppi["0.7"].value for name in (WITHOUT, WITH))
    assert factor.value == pytest.approx(before / after)
    gain = needed.figures[WITH].average_precision.value - needed.figures[WITHOUT].average_precision.value
    assert needed.class_model.average_precision.value == pytest.approx(gain)
    assert needed.depth[WITHOUT].factor["0.7"].low > 1
    assert "it earns its place" in worth_sentence(needed)


def test_what_other_cues_tell_is_not() -> None:
    idle = worth({"foot": 2.0})
    factor = idle.class_model.factor["0.7"]
    assert factor.low <= 1
    assert idle.figures[WITHOUT].average_precision.value > idle.figures[ALONE].average_precision.value + 0.1
    assert "it earns its place" not in worth_sentence(idle)


def test_a_recall_that_is_never_reached_is_said(needed: DetectorWorth) -> None:
    never = SweptInterval(value=np.nan, low=np.nan, high=np.nan, n_undefined=9, n_infinite=0)
    change = needed.class_model.model_copy(update={"factor": {**needed.class_model.factor, "0.7": never}})
    assert "70 % of the cars are not found" in worth_sentence(
        needed.model_copy(update={"class_model": change})
    )


def test_the_page_is_drawn_from_a_file_that_reads_back(needed: DetectorWorth, tmp_path: Path) -> None:
    result = WorthResult(
        command="do it", n_images=40, n_cars=40, cues=("overlap", "gap"), n_cues=9, detectors=(needed,)
    )
    page = write_worth_study(result, tmp_path / "worth")
    back = read_worth(page.with_name("class_model.json"))
    assert back.as_json() == result.as_json()
    assert page.read_text() == worth_page(back)
    assert "Made by `do it`" in page.read_text()
    assert worth_sentence(needed) in page.read_text()
    assert page.with_name("class_model.png").stat().st_size > 10_000


def test_a_run_without_the_mode_is_refused(tmp_path: Path, run: Run) -> None:
    config = run_preset("tiny")
    write_run_config(RunFolder(tmp_path).config, "reproduce", config.as_json(), 0, stereo=config.synth.sgbm)
    code, _, error = run("study-class-model", tmp_path, "--out", tmp_path / "out")
    assert code == 1
    assert "expected a run with mode instance, got paper, guarded, metric" in error
