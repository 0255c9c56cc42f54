import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from datasets_synth.presets import synth_preset
from recon.errors import RescoreError
from reports.studies.weight import width_table, write_weight_study
from rescore.cli import app
from rescore.data.frames import DataSet
from rescore.data.splits import Splits
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import Registration
from rescore.fusion.tune import TuneConfig
from rescore.studies.weight import WeightStudy, study_weight
from tests.rescore.fusion.test_tune import data_set, table

CONFIG = TuneConfig(n_grid=51)


def noisy(data: DataSet) -> CandidateTable:
    rng = np.random.default_rng(1)
    t = table(data, (0.5, 0.5), (0.5, 0.5))
    t.likelihood[:], t.depth_difference[:] = rng.uniform(size=(2, len(t)))
    t.likelihood[::2] **= 0.5
    t.depth_difference[::2] *= 0.7
    return t


def studied(
    sizes: list[int], mode: Registration = Registration.PAPER, config: TuneConfig = CONFIG
) -> WeightStudy:
    validation = Splits.of(data_set(80)).validation_set
    t = noisy(validation.data)
    return study_weight("hog", mode, t, validation, sizes, 60, CONFIG, np.random.default_rng(0))


def test_more_images_choose_more_alike_and_lose_less() -> None:
    few, many = studied([5, 80]).widths
    assert few.high - few.low > 1.5 * (many.high - many.low)
    assert few.loss > 2 * many.loss > 0
    for width in (few, many):
        assert width.low <= width.lower_quartile <= width.median <= width.upper_quartile <= width.high


def test_all_quantiles_are_weights_of_the_grid() -> None:
    study = studied([10])
    for name in ("low", "lower_quartile", "median", "upper_quartile", "high"):
        assert np.abs(study.grid - getattr(study.widths[0], name)).min() < 1e-12
    assert study.w in study.grid
    assert study.value[int(np.argmin(np.abs(study.grid - study.w)))] == study.value.max()


@pytest.mark.parametrize("sizes", [[], [0], [20, 81]])
def test_sizes_that_the_set_cannot_serve_are_refused(sizes: list[int]) -> None:
    with pytest.raises(RescoreError, match="weight study: expected sizes from 1 to the 80 validation images"):
        studied(sizes)


def test_test_images_cannot_be_studied() -> None:
    data = data_set(10)
    with pytest.raises(ValueError, match="not among the images"):
        study_weight(
            "hog",
            Registration.PAPER,
            noisy(data.split("test")),
            Splits.of(data).validation_set,
            [5],
            20,
            CONFIG,
            np.random.default_rng(0),
        )


def test_the_preset_has_validation_frames_alone() -> None:
    splits = synth_preset("weight-study").splits
    assert set(splits) == {"validation"}
    assert splits["validation"].n_images >= 500


def test_the_page_shows_every_width(tmp_path: Path) -> None:
    studies = [studied([5, 20], mode) for mode in Registration]
    page = write_weight_study(studies, tmp_path / "weight", "make it").read_text(encoding="utf-8")
    assert "`make it`" in page
    numbers = json.loads((tmp_path / "weight" / "weight.json").read_text())
    assert [n["registration"] for n in numbers] == list(Registration)
    for study in studies:
        for width in study.widths:
            assert f"| {width.n_images} | {width.median:.2f} | {width.low:.2f} to {width.high:.2f} |" in page
    assert (tmp_path / "weight" / "weight.png").stat().st_size > 10_000
    assert len(width_table(studies, short=True).rows) == 2 * len(Registration)


def test_the_command_studies_a_run_and_keeps_candidates(tiny_run: Path, tmp_path: Path) -> None:
    def run(*arguments: object) -> str:
        common = ["study-weight", tiny_run, "--draws", 20, "--sizes", "2,500", "--jobs", 1]
        result = CliRunner().invoke(app, [str(a) for a in [*common, *arguments]], catch_exceptions=False)
        assert result.exit_code == 0
        return result.stdout if "--json" in arguments else result.output

    printed = run("--out", tmp_path / "own", "--json")
    assert json.loads(printed) == json.loads((tmp_path / "own" / "weight.json").read_text())
    # the same frames as another data set: detected and rescored anew, to the same end
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in (tiny_run / "data").iterdir():
        (copy / file.name).symlink_to(file)
    again = ("--dataset", copy, "--keep", tmp_path / "kept")
    assert "left out 500: there are 2 validation images" in run(*again, "--out", tmp_path / "first")
    assert "hog: candidates of" in run(*again, "--out", tmp_path / "second")
    pages = [(tmp_path / name / "weight.json").read_bytes() for name in ("own", "first", "second")]
    assert pages[0] == pages[1] == pages[2]
