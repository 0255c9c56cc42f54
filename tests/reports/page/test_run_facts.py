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
