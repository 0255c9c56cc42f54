import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.core import TyperOption
from typer.testing import CliRunner

from rescore.cli import PANELS, app
from rescore.data.frames import DataSet
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.model import load_models
from rescore.evidence.registration import Registration
from rescore.formats.coco import read_detections
from rescore.formats.coco_dataset import read_dataset
from rescore.metrics.matching import FALSE_ALARM, HIT, TruthTable, greedy_match, ranking_of
from tests.rescore.spoiling import Run

Command = Callable[..., "Outcome"]
COMMANDS = tuple(name for panel in PANELS.values() for name in panel)


@dataclass(frozen=True)
class Outcome:
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def rescore(run: Run) -> Command:
    """The command in this process, which spares the imports; ends as it would end a process."""
    return lambda *arguments: Outcome(*run(*arguments))


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    heavy = ("cv2", "jinja2", "matplotlib", "open3d", "pyarrow", "rerun", "scipy", "sklearn", "trimesh")
    show = (
        f"from rescore.cli import app; import sys; print(*set(sys.modules) & set({heavy})); app(['--help'])"
    )
    done = subprocess.run([sys.executable, "-c", show], capture_output=True, text=True, check=True)
    imported, _, text = done.stdout.partition("\n")
    assert imported == ""
    for name in COMMANDS:
        assert f" {name} " in text


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_shows_an_example(name: str) -> None:
    shown = CliRunner().invoke(app, [name, "--help"]).output
    assert f"Example: rescore {name}" in " ".join(shown.split())


def test_version_says_what_is_installed() -> None:
    shown = CliRunner().invoke(app, ["--version"])
    assert (shown.exit_code, shown.output) == (0, f"rescore {metadata.version('rescore')}\n")


def test_a_shell_completes_commands_and_options() -> None:
    def completed(*words: str) -> list[str]:
        """What bash is offered for the last of the words."""
        asked = {
            "_RESCORE_COMPLETE": "complete_bash",
            "COMP_WORDS": " ".join(("rescore", *words)),
            "COMP_CWORD": str(len(words)),
        }
        main = "import sys; sys.argv = ['rescore']; from rescore.cli import main; main()"
        done = subprocess.run(
            [sys.executable, "-c", main], capture_output=True, text=True, env=os.environ | asked, check=True
        )
        return done.stdout.split()

    assert completed("stu") == [
        "study-evidence",
        "study-class-model",
        "study-relief",
        "study-places",
        "study-weight",
        "study-stereo",
        "study-models",
        "study-views",
    ]
    assert completed("apply", "--pred") == ["--predicted"]
    assert "--install-completion" in CliRunner().invoke(app, ["--help"], terminal_width=120).output


def test_apply_shows_few_options_first() -> None:
    context = typer.Context(typer.main.get_command(app))
    command = typer.main.get_command(app).get_command(context, "apply")  # type: ignore[attr-defined]
    options = [p for p in command.get_params(context) if isinstance(p, TyperOption)]
    panels = Counter(p.rich_help_panel for p in options)
    assert panels.pop(None) <= 12
    assert set(panels) == {
        "Modes with a learned D",
        "Camera and stereo matching",
        "Second boxes",
        "Names of classes",
        "Clusters (docs/scale.md)",
    }


def test_quiet_leaves_results_and_errors(rescore: Command, tiny_run: Path, tmp_path: Path) -> None:
    loud, quiet = rescore("doctor", tiny_run / "data"), rescore("--quiet", "doctor", tiny_run / "data")
    assert re.fullmatch(r"\d+ errors?, \d+ warnings?\n", loud.stderr)
    assert quiet.stderr == ""
    # what is measured in time differs; the findings are the same ones
    assert [line.split(":")[0] for line in quiet.stdout.splitlines()] == [
        line.split(":")[0] for line in loud.stdout.splitlines()
    ]
    assert "expected a run folder" in wrong(rescore("--quiet", "report", tmp_path))
    # the next command speaks again
    assert rescore("doctor", tiny_run / "data").stderr == loud.stderr


def test_json_in_place_of_tables(rescore: Command, tiny_run: Path, tmp_path: Path) -> None:
    run, data = tmp_path / "run", tiny_run / "data"
    done = rescore(
        *("evaluate", data, tiny_run / "rescored" / "hog_test.json", "--out", run, "--no-report", "--json")
    )
    assert done.returncode == 0, done.stderr
    metrics = json.loads((run / "metrics.json").read_text())
    assert json.loads(done.stdout) == metrics | {"files": {"figures": str(run / "metrics.json")}}

    plain = rescore("inspect", run, "--only", "all", "--top", 7).stdout.splitlines()
    found = json.loads(rescore("inspect", run, "--only", "all", "--top", 7, "--json").stdout)
    assert plain[0] == f"# {found['summary']}"
    assert (found["detector"], found["mode"], len(found["candidates"])) == ("hog", "paper", 7)
    names = plain[1].split("\t")
    for line, row in zip(plain[2:], found["candidates"], strict=True):
        assert list(row) == names
        told = dict(zip(names, line.split("\t"), strict=True))
        assert {n: told[n] for n in ("image_id", "place_after", "reason")} == {
            n: str(row[n]) for n in ("image_id", "place_after", "reason")
        }
        assert float(told["score_after"]) == pytest.approx(row["score_after"], rel=1e-5)

    findings = json.loads(rescore("doctor", data, "--json").stdout)
    lines = rescore("doctor", data).stdout.splitlines()
    assert [f"{f['level']:<8}{f['where']}" for f in findings] == [line.split(":")[0] for line in lines]


def wrong(done: Outcome) -> str:
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr


def test_errors_are_one_line(rescore: Command, tiny_run: Path, tmp_path: Path) -> None:
    data, out = tiny_run / "data", tmp_path / "out.json"
    detections, model = tiny_run / "detections" / "hog_test.json", tiny_run / "models" / "class_model.json"
    assert "preset: expected one of" in wrong(
        rescore("reproduce", "--preset", "huge", "--out", tmp_path / "run")
    )
    assert "expected a data set" in wrong(
        rescore("apply", tmp_path, detections, "--model", model, "--w", 1, "--out", out)
    )
    both = rescore("apply", data, detections, "--model", model, "--out", out)
    assert "expected either --tuned or --w" in wrong(both)
    nan = json.loads(detections.read_text())
    nan[3]["score"] = float("nan")
    (tmp_path / "nan.json").write_text(json.dumps(nan))
    assert "[3].score" in wrong(
        rescore("apply", data, tmp_path / "nan.json", "--model", model, "--w", 1, "--out", out)
    )
    stranger = rescore(
        "apply", data, detections, "--model", model, "--w", 1, "--out", out, "--split", "validation"
    )
    assert "expected an image of the data set" in wrong(stranger)
    assert "expected a run folder" in wrong(rescore("log", tmp_path))
    assert "expected a run folder" in wrong(rescore("report", tmp_path))
    rescore("evaluate", data, detections, "--out", tmp_path / "judged", "--no-report")
    assert "--detector: expected a value, got an empty text" in wrong(
        rescore("inspect", tiny_run, "--detector", "")
    )
    assert "expected a table in parts, found nothing" in wrong(
        rescore("inspect", tmp_path / "no", "--failed")
    )
    assert "expected a run of tables in parts, got one of JSON" in wrong(
        rescore("inspect", tmp_path / "judged", "--failed")
    )
    assert "expected another place than what is read" in wrong(
        rescore("evaluate", data, detections, "--out", data)
    )
    assert "--up, --nose: expected --meshes too" in wrong(
        rescore("localize", "--out", tmp_path / "cars", "--up", "z")
    )
    assert sorted(p.name for p in tmp_path.iterdir()) == ["judged", "nan.json"]


def test_answers_of_sql_as_json(rescore: Command, tiny_run: Path) -> None:
    pytest.importorskip("duckdb", reason="no duckdb; pip install rescore[query]")
    told = rescore("query", tiny_run, "SELECT 1.5 AS x, DATE '2009-05-01' AS day, NULL AS none", "--json")
    assert json.loads(told.stdout) == [{"x": 1.5, "day": "2009-05-01", "none": None}]
    assert "expected columns of different names, got 'a' twice" in wrong(
        rescore("query", tiny_run, "SELECT 1 AS a, 2 AS a", "--json")
    )


def check_made_with(config: Path, weights: dict[str, float]) -> None:
    """The settings of an evaluation tell what rescored the detections, without the numbers of the model."""
    made_with = json.loads(config.read_text())["config"]["rescored"]["hog"]
    assert list(made_with) == ["paper", "metric"]
    for mode, told in made_with.items():
        assert (told["registration"], told["w"]) == (mode, weights[mode])
        assert "view_bin" in told["rescore"]
        assert "evidence_model" not in told


def test_commands_one_by_one_equal_the_whole_run(rescore: Command, tiny_run: Path, tmp_path: Path) -> None:
    data = tiny_run / "data"

    def run(*arguments: object) -> None:
        done = rescore(*arguments)
        assert done.returncode == 0, done.stderr

    jobs = ("--jobs", 1)
    run("learn", data, "--out", tmp_path / "car.json", "--preset", "tiny")
    run("train", data, "--detector", "hog", "--out", tmp_path, "--preset", "tiny", *jobs)
    detector = ("--detector", tmp_path / "hog.npz")
    for split in ("train", "calibration", "validation", "test"):
        run("detect", data, *detector, "--split", split, "--out", tmp_path / f"{split}.json", *jobs)
    model = ("--model", tmp_path / "car.json", "--preset", "tiny", *jobs)
    fitted_on = (tmp_path / "train.json", tmp_path / "calibration.json")
    evidence = tmp_path / "evidence.json"
    run("fit-evidence", data, *fitted_on, "--out", evidence, *model)
    for mode, suffix in (("paper", ""), ("metric", "_metric")):
        how = ("--registration", mode, *(("--evidence-model", evidence) if suffix else ()))
        w, out = tmp_path / f"w{suffix}.json", tmp_path / f"rescored{suffix}.json"
        run("tune", data, tmp_path / "validation.json", "--out", w, *how, *model)
        run("apply", data, tmp_path / "test.json", "--tuned", w, "--out", out, *how, *model)
    same = {
        "car.json": "models/class_model.json",
        "evidence.json": "models/hog.evidence.json",
        "validation.json": "detections/hog_validation.json",
        "test.json": "detections/hog_test.json",
        "w.json": "tuned/hog.json",
        "w_metric.json": "tuned/hog_metric.json",
        "rescored.json": "rescored/hog_test.json",
        "rescored_metric.json": "rescored/hog_test_metric.json",
    }
    for mine, theirs in same.items():
        assert (tmp_path / mine).read_bytes() == (tiny_run / theirs).read_bytes(), mine
    provenance = json.loads((tmp_path / "rescored.json.config.json").read_text())
    assert provenance["versions"]["numpy"] == np.__version__
    files = (tmp_path / "rescored.json", tmp_path / "rescored_metric.json")
    run("evaluate", data, *files, "--out", tmp_path / "run", "--no-report")
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    whole = json.loads((tiny_run / "metrics.json").read_text())
    check_made_with(tmp_path / "run" / "config.json", {row["mode"]: row["w"] for row in metrics["rows"]})
    modes = {"detector", "paper", "metric"}
    assert metrics["rows"] == [r for r in whole["rows"] if r["detector"] == "hog" and r["mode"] in modes]
    # a weight of one mode does not serve another
    once_more = ("apply", data, tmp_path / "test.json", "--out", tmp_path / "x.json", *model)
    metric = ("--registration", "metric", "--evidence-model", evidence)
    wrong = rescore(*once_more, "--tuned", tmp_path / "w.json", *metric)
    assert wrong.returncode == 1
    assert "expected a weight tuned for registration metric, got one for paper" in wrong.stderr
    bare = rescore(*once_more, "--w", 0.5, "--registration", "guarded")
    assert bare.returncode == 1
    assert "rescore fit-evidence" in bare.stderr
    # for the detections' own share of cars
    adapted = rescore(*once_more, "--w", 0.5, *metric, "--adapt-share")
    assert adapted.returncode == 0, adapted.stderr
    assert "log odds moved by" in adapted.stderr
    table = read_detections(tmp_path / "x.json", read_dataset(data)).table
    has = table.status == "ok"
    car_given_depth = 1 - table.depth_difference[has]
    np.testing.assert_allclose(car_given_depth.mean(), table.likelihood[has].mean(), atol=1e-6)
    of_formula = rescore(*once_more, "--w", 0.5, "--adapt-share")
    assert of_formula.returncode == 1
    assert "whose D is no probability" in of_formula.stderr
    without_annotations(rescore, data, tmp_path / "x.json", evidence, len(table))


def unlabelled(data: Path, out: Path) -> None:
    """A data set without its annotations."""
    out.mkdir()
    for part in data.iterdir():
        (out / part.name).symlink_to(part)
    value = json.loads((data / "annotations.json").read_text()) | {"annotations": []}
    (out / "annotations.json").unlink()
    (out / "annotations.json").write_text(json.dumps(value))


def without_annotations(rescore: Command, data: Path, detections: Path, evidence: Path, n: int) -> None:
    """Evaluate, inspect and log n rescored detections where no car is annotated."""
    folder = detections.with_name("unlabelled")
    unlabelled(data, folder)
    bare_run = detections.with_name("bare_run")
    done = rescore("evaluate", folder, detections, "--out", bare_run)
    assert done.returncode == 0, done.stderr
    assert "no car is annotated" in done.stderr
    # the model that made D comes along, moved to the other share
    kept = load_models(bare_run / "models" / "hog.evidence.json")[Registration.METRIC]
    assert kept.bias != load_models(evidence)[Registration.METRIC].bias
    assert "nothing can be said" in (bare_run / "report.html").read_text()
    listed = rescore("inspect", bare_run).stdout.splitlines()
    assert "nothing is right or wrong" in listed[0]
    assert len(listed) == 2 + n
    assert rescore("log", bare_run, "--max-frames", 1).returncode == 0


def cars_above_false_alarms(table: CandidateTable, score: np.ndarray, data: DataSet) -> set[int]:
    """The annotated cars found by a candidate that scores more than every false alarm of the data set."""
    ranking = ranking_of(score, table.score)
    match = greedy_match(table.image_id, table.xyxy_px, ranking, TruthTable.of(data))
    worst = score[match.outcome == FALSE_ALARM].max()
    return set(match.annotation_id[(match.outcome == HIT) & (score > worst)].tolist())


def test_real_frames_go_through_as_they_are(
    rescore: Command, tiny_run: Path, kitti: Path, tmp_path: Path
) -> None:
    model = tiny_run / "models" / "class_model.json"
    out, run = tmp_path / "rescored.json", tmp_path / "run"
    done = rescore(
        *("apply", kitti, kitti / "detections.json", "--model", model, "--w", 0.6, "--out", out),
        *("--evidence", run / "evidence"),
    )
    assert done.returncode == 0, done.stderr
    assert "21 candidates" in done.stderr
    assert "ground plane of 5 frames with candidates: 5 stated, 0 from stereo, 0 the" in done.stderr
    data = read_dataset(kitti)
    file = read_detections(out, data)
    failed = file.table.status != "ok"
    assert all(file.table.reason_detail[failed])
    np.testing.assert_array_equal(file.posterior[failed], file.table.likelihood[failed])
    before, after = (
        cars_above_false_alarms(file.table, s, data) for s in (file.table.likelihood, file.posterior)
    )
    assert len(before) == 13
    assert before <= after
    assert rescore("evaluate", kitti, out, "--out", run, "--no-report").returncode == 0
    metrics = json.loads((run / "metrics.json").read_text())
    assert (metrics["n_images"], metrics["n_cars"], metrics["n_candidates"]) == (6, 15, 21)
    logged = rescore("log", run, "--max-frames", 2)
    assert logged.returncode == 0, logged.stderr
    assert (run / "recording.rrd").stat().st_size > 10_000


def test_kitti_folders_are_rescored_as_our_own(
    rescore: Command, tiny_run: Path, kitti: Path, tmp_path: Path
) -> None:
    value = json.loads((kitti / "annotations.json").read_text())
    for image in value["images"]:
        image["camera"].pop("height_m")  # which KITTI's files do not tell
    found = {}
    for layout in ("ours", "kitti"):
        data = tmp_path / layout
        data.mkdir()
        for name in ("image_2", "image_3", "calib"):
            (data / name).symlink_to(kitti / name)
        if layout == "ours":
            (data / "annotations.json").write_text(json.dumps(value))
        detections = kitti / "detections.json"
        if layout == "kitti":
            detections = tmp_path / "text"
            done = rescore("convert", data, kitti / "detections.json", "--out", detections)
            assert done.returncode == 0, done.stderr
        model = ("--model", tiny_run / "models" / "class_model.json", "--w", 0.5, "--jobs", 1)
        done = rescore("apply", data, detections, *model, "--out", tmp_path / f"{layout}.json")
        assert done.returncode == 0, done.stderr
        told = (
            "ground plane of 5 frames with candidates: 0 stated, 5 from stereo, 0 the default (1.5 m, level)"
        )
        assert told in done.stderr
        rows = json.loads((tmp_path / f"{layout}.json").read_text())
        assert {r["ground"] for r in rows} == {"stereo"}
        found[layout] = {
            (r["image_id"], *np.round(r["bbox"], 6)): r | {"bbox": 0, "detector": 0} for r in rows
        }
    assert len(found["ours"]) == 21
    assert found["kitti"] == found["ours"]
    assert any(r["depth_difference"] is not None for r in found["kitti"].values())


def test_what_fails_leaves_a_run_folder_as_it_was(rescore: Command, tiny_run: Path, tmp_path: Path) -> None:
    data, detections = tiny_run / "data", tiny_run / "detections" / "hog_test.json"
    run = tmp_path / "run"
    assert "expected one file a detector" in wrong(
        rescore("evaluate", data, detections, detections, "--out", run)
    )
    (tmp_path / "file").write_text("x")
    assert "choose another place" in wrong(
        rescore("reproduce", "--preset", "tiny", "--out", tmp_path / "file" / "run")
    )
    (tmp_path / "changes.json").write_text('{"detectors": []}')
    assert "detectors: tuple should have at least 1 item" in wrong(
        rescore("reproduce", "--preset", "tiny", "--config", tmp_path / "changes.json", "--out", run)
    )
    assert not run.exists()


def test_learning_says_what_is_missing(rescore: Command, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "model.json")
    assert "expected views or --class, got neither" in wrong(rescore("learn", *out))
    assert "expected one of car, car_six_parts, chair" in wrong(rescore("learn", "--class", "horse", *out))
    assert "numbers from 0 to 11" in wrong(rescore("learn", "--class", "chair", "--view-bins", "1,x", *out))
    one = ("--class", "chair", "--view-bins", "3", "--instances", "2")
    assert "at least two views of one instance" in wrong(rescore("learn", *one, *out))
    assert "found no file; learn one first" in wrong(
        rescore("learn", "--class", "chair", "--primitives", tmp_path / "none.npz", *out)
    )
    assert not list(tmp_path.iterdir())
