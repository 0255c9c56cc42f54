import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

from reports.page.run_facts import differing_settings, id_lists, made_from
from reports.run.frame_view import run_dataset
from rescore.results.run_config_file import RunSettings
from rescore.results.run_folder import Run, load_run


def test_the_hash_is_that_of_ids_and_names(run: Run):
    (one,) = id_lists(run_dataset(run))
    lines = "".join(f"{i + 1}\tleft/{i}.png\n" for i in range(5))
    assert one.images == hashlib.sha256(lines.encode()).hexdigest()
    assert (one.split, one.n_images, one.n_cars, one.shapes) == ("test", 5, run.metrics.n_cars, "")


def test_splits_and_shapes_have_hashes_of_their_own(run: Run, tmp_path: Path):
    shutil.copytree(run.root, tmp_path / "run")
    file = tmp_path / "run" / "data" / "annotations.json"
    value = json.loads(file.read_text())
    value["images"][0]["split"] = "train"
    for annotation in value["annotations"]:
        annotation["shape_id"] = f"shape{annotation['image_id']}"
    file.write_text(json.dumps(value))
    train, test = id_lists(run_dataset(load_run(tmp_path / "run")))
    assert (train.split, train.n_images) == ("train", 1)
    assert train.images == hashlib.sha256(b"1\tleft/0.png\n").hexdigest()
    assert train.shapes == hashlib.sha256(b"shape1\n").hexdigest()
    assert test.shapes == hashlib.sha256(b"shape2\nshape3\nshape4\n").hexdigest()


def test_facts_leave_out_what_is_not_known(run: Run):
    facts = dict(made_from(run))
    assert facts["preset"] == "fake"
    assert facts["versions"] == "rescore 0.1.0"
    assert "command" not in facts


def test_only_settings_that_differ_are_listed(run: Run):
    more = RunSettings.model_validate({"preset": "fake", "more": 1})
    other = replace(run, config=run.config.model_copy(update={"seed": 4, "config": more}))
    table = differing_settings({"a": run, "b": other})
    assert table is not None
    assert table.rows == (("seed", "3", "4"),)
    assert differing_settings({"a": run, "b": run}) is None


def rescored(run: Run, mode: str, w: float, shift: float, view_bin: int | str) -> Run:
    """The run as `rescore evaluate` would tell of it, its detectors rescored in one mode."""
    rows = tuple(
        row if row.mode == "detector" else row.model_copy(update={"mode": mode, "w": w})
        for row in run.metrics.rows
    )
    made_with = {
        "w": w,
        "registration": mode,
        "log_odds_shift": shift,
        "rescore": {"view_bin": view_bin, "align": {"min_valid_px": 30}},
    }
    settings = {
        "detections": [f"{mode}.json"],
        "split": "test",
        "rescored": {detector: {mode: made_with} for detector in run.detectors},
    }
    config = run.config.model_copy(update={"config": RunSettings.model_validate(settings)})
    return replace(run, metrics=run.metrics.model_copy(update={"rows": rows}), config=config)


def test_mode_weight_share_and_view_are_told_and_file_names_are_not(run: Run):
    one, other = rescored(run, "paper", 0.6, 0.0, 3), rescored(run, "instance", 0.33, -0.4, "fit")
    table = differing_settings({"a": one, "b": other})
    assert table is not None
    assert table.rows == (
        ("HOG + SVM, boosted: scores", "paper", "instance"),
        ("HOG + SVM, boosted: w", "0.60", "0.33"),
        ("HOG + SVM, boosted: share of cars: log odds moved by", "+0.00", "-0.40"),
        ("HOG + SVM, boosted: view_bin", "3", "fit"),
    )
    assert differing_settings({"a": one, "b": one}) is None


def test_runs_of_one_detector_each_are_compared_by_whatever_name(run: Run):
    def of(name: str, w: float) -> Run:
        rows = tuple(
            row.model_copy(update={"detector": name})
            for row in run.metrics.rows
            if row.detector == run.detectors[0]
        )
        one = replace(run, metrics=run.metrics.model_copy(update={"rows": rows}))
        return rescored(one, "paper", w, 0.0, 3)

    table = differing_settings({"a": of("mine", 0.5), "b": of("yours", 0.9)})
    assert table is not None
    assert table.rows == (("w", "0.50", "0.90"), ("detectors", "mine", "yours"))


def test_a_run_of_reproduce_is_compared_with_one_of_evaluate(run: Run):
    made = RunSettings.model_validate({"preset": "demo", "rescore": {"view_bin": 3}})
    whole = replace(run, config=run.config.model_copy(update={"config": made}))
    table = differing_settings({"a": whole, "b": rescored(run, "paper", 0.6, 0.0, "fit")})
    assert table is not None
    assert ("HOG + SVM, boosted: view_bin", "3", "fit") in table.rows
