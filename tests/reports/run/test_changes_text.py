import sys
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from recon.errors import RescoreError
from reports.recording.viewer import open_recording
from reports.run.changes_text import GROUP_TEXT, PLAIN_COLUMNS, inspect_run, note, summary, terminal_table
from reports.run.curves import match_table
from rescore.cli import main
from rescore.metrics.curves import fppi_at_recall, recall_curve
from rescore.results.changes import Group, OperatingPoint
from rescore.results.metrics_file import read_metrics, write_metrics
from rescore.results.ranked_changes import Only, Sort
from rescore.results.run_folder import Run, load_run

Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["rescore", "inspect", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        shown = capsys.readouterr()
        return int(ended.value.code or 0), shown.out, shown.err

    return run


def test_the_tally_is_that_of_the_curves_in_every_detector_and_mode(run: Run) -> None:
    for detector in run.detectors:
        inspection = inspect_run(run, detector, "paper", OperatingPoint(recall=0.5))
        tally, n_images = inspection.changes.tally, run.metrics.n_images
        for mode, false in (("detector", tally.false_before), ("paper", tally.false_after)):
            wanted = fppi_at_recall(recall_curve(match_table(run, detector, mode)), 0.5)
            assert false / n_images == pytest.approx(wanted)
            assert wanted == pytest.approx(run.row(detector, mode).fppi_at_recall["0.5"])
        assert f"{tally.newly_rejected} of {tally.false_before} false alarms gone" in summary(inspection)


def test_lists_hold_their_groups_in_their_order(run: Run) -> None:
    inspection = inspect_run(run, "hog", point=OperatingPoint(false_positives=1.0))
    everything = inspection.listed(Only.ALL)
    assert sorted(everything) == list(range(len(inspection.rows["rank"])))
    assert (np.diff(np.abs(inspection.changes.delta[everything])) <= 0).all()
    assert (np.diff(inspection.changes.loss[inspection.listed(Only.ALL, Sort.LOSS)]) <= 0).all()
    d = inspection.rows["depth_difference"][inspection.listed(Only.ALL, Sort.DEPTH_DIFFERENCE)]
    known = d[np.isfinite(d)]
    assert (np.diff(known) <= 0).all()
    assert np.isnan(d[len(known) :]).all()
    only = [set(inspection.changes.group[inspection.listed(o)]) <= set(o.groups) for o in Only]
    assert all(only)
    assert set(inspection.rows["image_id"][inspection.listed(Only.ALL, image_id=2)]) == {2}
    assert set(GROUP_TEXT) == set(Group)


@pytest.mark.parametrize("width", [80, 160])
def test_the_table_has_a_row_a_candidate_and_fits_the_terminal(run: Run, width: int) -> None:
    from rich.console import Console  # noqa: PLC0415

    inspection = inspect_run(run, "hog")
    rows = inspection.listed(Only.ALL)[:5]
    console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(terminal_table(inspection, rows, width))
    shown = console.export_text()
    assert max(map(len, shown.splitlines())) <= width
    for i in rows:
        assert f"{inspection.changes.place_before[i]} → {inspection.changes.place_after[i]}" in shown


def test_in_a_pipe_every_line_has_the_same_columns(command: Command, run_dir: Path) -> None:
    code, out, err = command(run_dir, "--only", "all", "--detector", "boosted")
    assert (code, err) == (0, "")
    first, head, *lines = out.splitlines()
    assert first.startswith("# boosted, paper, at 70 % of all cars: ")
    assert tuple(head.split("\t")) == PLAIN_COLUMNS
    assert {len(line.split("\t")) for line in lines} == {len(PLAIN_COLUMNS)}
    assert len(lines) == (load_run(run_dir).candidates["detector"] == "boosted").sum()


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_export_holds_what_is_listed(command: Command, run_dir: Path, tmp_path: Path, form: str) -> None:
    copytree(run_dir, tmp_path / "run")
    code, out, err = command(tmp_path / "run", "--frame", 2, "--export", form)
    path = tmp_path / "run" / f"changes_hog_paper.{form}"
    table = pa.csv.read_csv(path) if form == "csv" else pq.read_table(path)
    assert code == 0
    assert str(path) in err
    assert set(table["image_id"].to_pylist()) == {2}
    assert table.num_rows == len(out.splitlines()) - 2
    assert set(PLAIN_COLUMNS) <= set(table.column_names)


def test_what_is_not_there_is_one_line(command: Command, run_dir: Path, tmp_path: Path) -> None:
    wrong = {
        ("--detector", "yolo"): "--detector: expected hog or boosted, got 'yolo'",
        ("--mode", "metric"): "--mode: expected paper, got 'metric'",
        ("--only", "cars"): "--only: expected changed, all, ",
        ("--sort", "size"): "--sort: expected delta, loss, depth_difference, got 'size'",
        ("--frame", "99"): "--frame: expected the id of an image with candidates of hog, of 1 to 5, got 99",
        ("--recall", "0.5", "--false-positives", "1"): "got both",
        ("--export", "xls"): "--export: expected csv, parquet, got 'xls'",
        ("--open", "--frame", "1"): "recording.rrd: expected a recording, found none; run `rescore log`",
    }
    for arguments, message in wrong.items():
        code, _, err = command(run_dir, *arguments)
        assert (code, err.count("\n")) == (1, 1), arguments
        assert message in err
    code, _, err = command(tmp_path)
    assert (code, err.count("\n")) == (1, 1)
    assert "expected a run folder with config.json" in err


def test_a_damaged_or_foreign_table_is_refused(command: Command, run_dir: Path, tmp_path: Path) -> None:
    root = copytree(run_dir, tmp_path / "run")
    table = pq.read_table(root / "candidates.parquet")
    pq.write_table(table.slice(3), root / "candidates.parquet")
    code, _, err = command(root)
    assert code == 1
    assert "the two are of different runs" in err
    # damage in a page, which only reading it finds
    whole = bytearray((run_dir / "candidates.parquet").read_bytes())
    whole[200:1200] = bytes(1000)
    for damaged in (bytes(whole), whole[:1000]):
        (root / "candidates.parquet").write_bytes(damaged)
        code, _, err = command(root)
        assert (code, err.count("\n")) == (1, 1)
        assert "expected a table of candidates, could not read it" in err


def test_a_run_of_the_detector_alone_has_nothing_to_compare(run_dir: Path, tmp_path: Path) -> None:
    root = copytree(run_dir, tmp_path / "run")
    metrics = read_metrics(root / "metrics.json")
    alone = tuple(r for r in metrics.rows if r.mode == "detector")
    write_metrics(root / "metrics.json", metrics.model_copy(update={"rows": alone}))
    with pytest.raises(RescoreError, match="expected hog to be rescored, got the detector alone"):
        inspect_run(load_run(root))


def test_a_learned_mode_without_its_model_says_what_is_missing(run_dir: Path, tmp_path: Path) -> None:
    root = copytree(run_dir, tmp_path / "run")
    table = pq.read_table(root / "candidates.parquet")
    table = table.append_column("posterior_metric", table["posterior_paper"])
    pq.write_table(table, root / "candidates.parquet")
    metrics = read_metrics(root / "metrics.json")
    more = tuple(r.model_copy(update={"mode": "metric"}) for r in metrics.rows if r.mode == "paper")
    write_metrics(root / "metrics.json", metrics.model_copy(update={"rows": metrics.rows + more}))
    inspection = inspect_run(load_run(root))
    assert inspection.mode == "metric"
    assert "--evidence-model" in str(note(inspection))
    assert note(inspect_run(load_run(root), mode="paper")) is None


def test_the_viewer_opens_at_the_frame(
    run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rerun.experimental import ViewerClient  # noqa: PLC0415

    from reports.recording.log import write_recording  # noqa: PLC0415

    recording = write_recording(run_dir, tmp_path / "a.rrd", max_frames=2, show=False)
    with pytest.raises(RescoreError, match="expected frame 3 among the 2 recorded"):
        open_recording(recording, 3, "hog")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RescoreError, match="expected a display"):
        open_recording(recording, 5, "hog")
    if not list(Path("/usr/share/vulkan/icd.d").glob("*.json")):
        pytest.skip("the viewer needs a Vulkan driver: apt-get install mesa-vulkan-drivers")
    viewer = open_recording(recording, 5, "boosted", headless=True)
    try:
        port = viewer.args[viewer.args.index("--port") + 1]
        (shown,) = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy").get_state().recordings
        assert (shown.current_timeline, shown.current_time) == ("image_id", 5)
    finally:
        viewer.terminate()
        viewer.wait(10)
    (tmp_path / "b.rrd").write_bytes(recording.read_bytes()[:500])
    with pytest.raises(RescoreError, match=r"b\.rrd: expected a recording"):
        open_recording(tmp_path / "b.rrd", 5, "hog")
