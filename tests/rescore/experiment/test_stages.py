import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from recon import boxes
from rescore.experiment.stages import Stage, run_stage, run_stage_in_place
from rescore.files import read_json, write_json
from rescore.fusion import fuse


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    (tmp_path / "in.txt").write_text("1")
    return Stage("double", {"factor": 2}, (tmp_path / "in.txt",), (tmp_path / "out.txt",), (fuse,))


def writes(text: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(text) and None


def never(_path: Path) -> None:
    raise AssertionError("a finished stage must not run again")


def test_a_finished_stage_is_reused(tmp_path: Path, stage: Stage) -> None:
    first = run_stage(tmp_path, stage, writes("a"))
    again = run_stage(tmp_path, stage, never)
    assert (first.reused, again.reused) == (False, True)
    assert again.seconds == first.seconds
    assert stage.outputs[0].read_text() == "a"


@pytest.mark.parametrize("change", ["config", "input", "output", "code", "gone"])
def test_any_change_runs_it_again(tmp_path: Path, stage: Stage, change: str) -> None:
    run_stage(tmp_path, stage, writes("a"))
    if change == "config":
        stage = replace(stage, config={"factor": 3})
    elif change == "input":
        stage.inputs[0].write_text("22")
    elif change == "output":
        stage.outputs[0].write_text("edited by hand")
    elif change == "code":
        stage = replace(stage, code=(boxes,))
    else:
        stage.outputs[0].unlink()
    assert not run_stage(tmp_path, stage, writes("b")).reused
    assert stage.outputs[0].read_text() == "b"


def test_a_moved_run_folder_keeps_its_stages(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    old.mkdir()
    (old / "in.txt").write_text("1")

    def at(root: Path) -> Stage:
        return Stage("double", None, (root / "in.txt",), (root / "out.txt",), ())

    run_stage(old, at(old), writes("a"))
    old.rename(new)
    assert run_stage(new, at(new), never).reused


def test_a_failed_stage_leaves_the_old_result_and_runs_again(tmp_path: Path, stage: Stage) -> None:
    run_stage(tmp_path, stage, writes("a"))
    stage.inputs[0].write_text("22")

    def fails(path: Path) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_stage(tmp_path, stage, fails)
    assert stage.outputs[0].read_text() == "a"
    assert not run_stage(tmp_path, stage, writes("b")).reused
    assert sorted(p.name for p in tmp_path.iterdir()) == [".stages", "in.txt", "out.txt"]


@pytest.mark.parametrize("resumes", [True, False])
def test_a_killed_folder_stage_goes_on_where_it_can(tmp_path: Path, stage: Stage, resumes: bool) -> None:
    stage = replace(stage, outputs=(tmp_path / "data",), resumes=resumes)
    seen: list[bool] = []

    def work(path: Path) -> None:
        seen.append((path / "frame_0").exists())
        path.mkdir(exist_ok=True)
        (path / "frame_0").write_text("x")
        if len(seen) == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_stage(tmp_path, stage, work)
    assert not stage.outputs[0].exists()
    run_stage(tmp_path, stage, work)
    assert seen == [False, resumes]
    assert [p.name for p in stage.outputs[0].iterdir()] == ["frame_0"]


def test_in_place_watches_every_output(tmp_path: Path, stage: Stage) -> None:
    stage = replace(stage, outputs=(tmp_path / "a", tmp_path / "b"))

    def work() -> None:
        for path in stage.outputs:
            path.write_text("x")

    assert not run_stage_in_place(tmp_path, stage, work).reused
    assert run_stage_in_place(tmp_path, stage, work).reused
    stage.outputs[1].unlink()
    assert not run_stage_in_place(tmp_path, stage, work).reused


def test_what_a_killed_run_was_writing_in_place_is_removed(tmp_path: Path) -> None:
    out = tmp_path / "recording.rrd"
    code = (
        "import os, sys; from pathlib import Path; from recon.files import atomic_path\n"
        "with atomic_path(Path(sys.argv[1])) as beside:\n    beside.write_text('half'); os._exit(9)"
    )
    subprocess.run([sys.executable, "-c", code, str(out)], check=False)
    (left,) = tmp_path.iterdir()
    run_stage_in_place(
        tmp_path, Stage("log", None, (), (out,), ()), lambda: (out.write_text("whole"), None)[1]
    )
    assert not left.exists()
    assert out.read_text() == "whole"


@pytest.mark.parametrize(
    "record", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"[1]", b'{"key": 1}', b"9" * 5000]
)
def test_a_damaged_record_counts_as_none(tmp_path: Path, stage: Stage, record: bytes) -> None:
    run_stage(tmp_path, stage, writes("a"))
    (tmp_path / ".stages" / "double.json").write_bytes(record)
    assert not run_stage(tmp_path, stage, writes("b")).reused
    assert stage.outputs[0].read_text() == "b"
    assert run_stage(tmp_path, stage, never).reused


def test_a_record_without_its_time_counts_as_none(tmp_path: Path, stage: Stage) -> None:
    run_stage(tmp_path, stage, writes("a"))
    file = tmp_path / ".stages" / "double.json"
    value = read_json(file, "a record")
    for seconds in ("soon", None, [1]):
        write_json(file, value | {"seconds": seconds})
        assert not run_stage(tmp_path, stage, writes("a")).reused
