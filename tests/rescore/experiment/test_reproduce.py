"""The whole run of preset "tiny": what it leaves, that it is reused, and that nothing leaks."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.evidence.cues import CUES
from rescore.experiment.config import run_preset, with_changes
from rescore.experiment.reproduce import Experiment
from rescore.experiment.source_digest import imported_modules, source_files
from rescore.experiment.stages import Done, Stage
from rescore.results.candidate_file import read_candidates
from rescore.results.run_folder import RunFolder

ROW = {"detector", "mode", "w", "auc", "average_precision", "recall_ceiling", "fppi_at_recall", "intervals"}


def again(folder: Path) -> tuple[Experiment, list[Done]]:
    done: list[Done] = []
    return Experiment(RunFolder(folder), run_preset("tiny"), 0, 1, done.append), done


def test_metrics_keep_the_contract(tiny_run: Path) -> None:
    metrics = json.loads((tiny_run / "metrics.json").read_text())
    assert {"n_images", "n_cars", "n_candidates", "rows", "stereo", "reasons"} <= set(metrics)
    assert [(r["detector"], r["mode"]) for r in metrics["rows"]] == [
        (d, m) for d in ("hog", "boosted") for m in ("detector", "paper", "guarded", "metric")
    ]
    for row in metrics["rows"]:
        assert set(row) == ROW
        assert list(row["fppi_at_recall"]) == ["0.5", "0.6", "0.7", "0.8"]
    assert metrics["stereo"]["splits"]["test"]["car"]["wrong_share"] > 0
    for name, hard in metrics["difficulty"].items():
        alone = next(r for r in metrics["rows"] if (r["detector"], r["mode"]) == (name, "detector"))
        # fewer cars count than annotated ones, and none counts that the candidates do not hold
        assert 0 < hard["n_cars"] <= metrics["n_cars"]
        found = round(alone["recall_ceiling"] * metrics["n_cars"])
        assert round(hard["recall_ceiling"] * hard["n_cars"]) <= found
    modes = [(d, m) for d in ("hog", "boosted") for m in ("paper", "guarded", "metric")]
    assert [(c["detector"], c["mode"]) for c in metrics["comparisons"]] == modes
    rows = {(r["detector"], r["mode"]): r for r in metrics["rows"]}
    for c in metrics["comparisons"]:
        before, after = rows[c["detector"], "detector"], rows[c["detector"], c["mode"]]
        gain = after["average_precision"] - before["average_precision"]
        assert c["average_precision_difference"]["value"] == pytest.approx(gain)
    rules = ("detector", "depth", "product", "maximum", "eq7", "learned")
    assert [(f["detector"], f["mode"], f["rule"]) for f in metrics["fusion"]] == [
        (*mode, rule) for mode in modes for rule in rules
    ]
    for f in metrics["fusion"]:
        if f["rule"] in ("detector", "eq7"):
            same = rows[f["detector"], "detector" if f["rule"] == "detector" else f["mode"]]
            assert {k: same[k] for k in ("auc", "average_precision", "fppi_at_recall")} == {
                k: f[k] for k in ("auc", "average_precision", "fppi_at_recall")
            }
    assert {(r["detector"], r["mode"]) for r in metrics["reliability"]} == set(rows)
    for counts in metrics["reasons"].values():
        assert sum(counts.values()) <= 15 * metrics["n_images"]


def test_the_table_has_a_row_a_candidate(tiny_run: Path) -> None:
    metrics = json.loads((tiny_run / "metrics.json").read_text())
    table = read_candidates(tiny_run / "candidates.parquet")
    assert len(table["image_id"]) == metrics["n_candidates"]
    ok = table["status"] == "ok"
    assert ok.any()
    assert np.isfinite(table["depth_difference"][ok]).all()
    assert np.isnan(table["depth_difference"][~ok]).all()
    w, d, lik = table["w"][ok], table["depth_difference"][ok], table["likelihood"][ok]
    np.testing.assert_allclose(table["posterior_paper"][ok], lik**w * (1 - d) ** (1 - w))
    assert {"car"} < set(table["kind"].tolist())
    for mode in ("guarded", "metric"):
        w, d = table[f"w_{mode}"], table[f"difference_{mode}"]
        assert ((d > 0) & (d < 1)).all()
        posterior = table["likelihood"] ** w * (1 - d) ** (1 - w)
        np.testing.assert_allclose(table[f"posterior_{mode}"], posterior, atol=1e-12)
    for name in CUES:
        assert f"cue_{name}" in table
    for outcome in ("outcome_detector", "outcome_paper"):
        assert set(table[outcome].tolist()) <= {"hit", "false_alarm", "duplicate", "ignored"}


def test_a_second_run_reuses_every_stage(tiny_run: Path) -> None:
    run, done = again(tiny_run)
    run.all()
    assert len(done) > 15
    assert [d.name for d in done if not d.reused] == []


def test_report_and_recording_are_made_again_where_what_draws_them_changed(
    tiny_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stages: list[Stage] = []

    def note(root: Path, stage: Stage, work: object) -> Done:
        stages.append(stage)
        return Done(stage.name, reused=True, seconds=0)

    monkeypatch.setattr("rescore.experiment.reproduce.run_stage_in_place", note)
    again(tiny_run)[0].write_report()
    page, recording = stages
    keys = [s.key(tiny_run) for s in stages]
    for stage, drawing in ((page, "reports.page.gallery"), (recording, "reports.recording.frame")):
        files = source_files()
        assert drawing in imported_modules(files[stage.code[0].__name__], files)
    # words of the templates
    monkeypatch.setattr("rescore.experiment.reproduce.digest_of", lambda _path: "another")
    stages.clear()
    again(tiny_run)[0].write_report()
    assert [s.key(tiny_run) == key for s, key in zip(stages, keys, strict=True)] == [False, False]


def test_other_test_images_cannot_change_w(tiny_run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(tiny_run, copy)
    tuned = [RunFolder(copy).tuned("hog", mode) for mode in run_preset("tiny").registrations]
    before = [file.read_bytes() for file in tuned]
    assert all(json.loads(text)["learned"] for text in before)
    data = json.loads((copy / "data" / "annotations.json").read_text())
    rng = np.random.default_rng(0)
    for image in data["images"]:
        if image["split"] == "test":
            noise = rng.integers(0, 255, (image["height"], image["width"], 3), dtype=np.uint8)
            cv2.imwrite(str(copy / "data" / image["file_name"]), noise)
    run, done = again(copy)
    run.learn()
    run.train("hog")
    for split in ("train", "calibration", "validation"):
        if split != "calibration":
            run.detect("hog", split)
        run.find_evidence("hog", split)
    run.fit_evidence("hog")
    for mode in run_preset("tiny").registrations:
        run.tune("hog", mode)
    ran = {d.name for d in done if not d.reused}
    # the data set is another, so all that reads it was done anew; to the same end
    assert {"train_hog", "calibrate_hog", "evidence_hog_validation"} <= ran
    assert [file.read_bytes() for file in tuned] == before


def test_settings_of_a_file_replace_those_of_the_preset(tmp_path: Path) -> None:
    file = tmp_path / "changes.json"
    file.write_text('{"rescore": {"align": {"normalisation": "image_range"}}, "detectors": ["hog"]}')
    config = with_changes(run_preset("demo"), file)
    assert config.rescore.align.normalisation == "image_range"
    assert config.detectors == ("hog",)
    assert config.synth == run_preset("demo").synth


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"rescore": {"algin": {}}}', "rescore: unknown setting 'algin', known are align"),
        ('{"colour": 1}', "colour: extra inputs are not permitted"),
        ('{"rescore": {"camera": "mine"}}', "rescore.camera: input should be 'calibrated' or 'default'"),
        ('{"tune": {"n_grid": "many"}}', r"tune.n_grid: input should be a valid integer"),
        ("[1]", "expected a JSON object of settings, got list"),
    ],
)
def test_wrong_settings_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "changes.json"
    file.write_text(text)
    with pytest.raises(RescoreError, match=message) as caught:
        with_changes(run_preset("tiny"), file)
    assert "\n" not in str(caught.value)


def test_unknown_preset() -> None:
    known = "demo, paper, streets, tiny, weight-study"
    with pytest.raises(RescoreError, match=f"preset: expected one of {known}, got 'x'"):
        run_preset("x")
