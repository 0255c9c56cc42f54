import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from recon.errors import RescoreError
from reports.page.paired_runs import Evaluated
from reports.page.report import build_report, render_report
from reports.run.curves import curve_sets
from reports.run.tables import result_table
from reports.run.tables3d import boxes3d_table, error_table, pose_table
from rescore.results.metrics_file import StereoStatistics
from rescore.results.run_config_file import RunConfigFile, RunSettings
from rescore.results.run_folder import Run, RunFolder, load_run
from rescore.results.sweep_file import (
    SweepFigures,
    SweepPoint,
    SweepResult,
    SweptDial,
    SweptInterval,
    write_sweep,
)
from tests.reports.html_reader import Page
from tests.reports.metric_run import make_metric_run
from tests.reports.solid_rows import boxes3d_level, boxes3d_row


def text_of(run: Run) -> str:
    return render_report([Evaluated("run", run)])


def charts_of(page: Page) -> dict:
    (text,) = [text for attributes, text in page.scripts if attributes.get("id") == "charts"]

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def report(run: Run) -> Path:
    return build_report(run.root)


@pytest.fixture(scope="module")
def page(report: Path) -> Page:
    return Page(report.read_text(encoding="utf-8"))


def test_nothing_is_loaded_from_anywhere(report: Path, page: Page):
    assert all(link.startswith(("data:", "#")) for link in page.links)
    # the name of a namespace is no address to load from
    text = report.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|@import|url\((?!data:|#)", text)


def test_the_file_is_small_and_its_names_are_unique(report: Path, page: Page):
    assert report.stat().st_size < 3e6
    assert len(page.ids) == len(set(page.ids))


def test_tables_equal_metrics_json(run: Run, page: Page):
    head, *rows = page.tables["r0-results"]
    assert tuple(head) == result_table(run.metrics).head
    for cells, row in zip(rows, run.metrics.rows, strict=True):
        assert float(cells[3]) == pytest.approx(row.auc, abs=5e-4)
        assert float(cells[4]) == pytest.approx(row.average_precision, abs=5e-4)
        for cell, level in zip(cells[5:9], ("0.5", "0.6", "0.7", "0.8"), strict=True):
            value = row.fppi_at_recall[level]
            assert (cell == "–") if value is None else (float(cell) == pytest.approx(value, abs=5e-3))
        assert float(cells[9]) == pytest.approx(row.recall_ceiling, abs=5e-4)


def test_interactive_curves_are_those_of_the_run(run: Run, page: Page):
    charts = charts_of(page)
    kinds = {f"r0-curves-{kind}-{detector}" for kind in range(3) for detector in range(2)}
    others = {f"r0-{name}-0-{detector}" for name in ("weight", "reliability") for detector in range(2)}
    assert set(charts) == kinds | others
    for d, detector in enumerate(run.detectors):
        own = [c for c in curve_sets(run) if c.detector == detector]
        for kind, of in enumerate((lambda c: c.cars, lambda c: c.candidate)):
            for c, line in zip(own, charts[f"r0-curves-{kind}-{d}"]["lines"], strict=True):
                np.testing.assert_allclose(line["x"], of(c).x, atol=1e-5)
                np.testing.assert_allclose(line["y"], of(c).y, atol=1e-5)
                assert line["tags"] == [c.mode]
                assert line["threshold"][0] is None
                np.testing.assert_allclose(line["threshold"][1:], of(c).threshold[1:], atol=1e-5)
        for c, line in zip(own, charts[f"r0-curves-2-{d}"]["lines"], strict=True):
            np.testing.assert_allclose(line["x"], c.precision.recall, atol=1e-5)
            np.testing.assert_allclose(line["y"], c.precision.precision, atol=1e-5)


def test_curves_have_bands_from_the_images(page: Page):
    for name, chart in charts_of(page).items():
        for line in chart["lines"] if "curves" in name else ():
            assert (np.array(line["band"]["low"]) <= np.array(line["band"]["high"])).all()
            assert len(line["band"]["x"]) > 20


def test_pictures_have_a_text_and_the_curves_lie_beside(run: Run, page: Page):
    assert page.missing_alt == 0
    assert sum(link.startswith("data:image/webp") for link in page.links) >= 8
    assert len(list((run.root / "curves").glob("*.png"))) == 5


def test_cards_say_what_filters_ask_for(run: Run, page: Page):
    assert len(page.cards) >= 4
    assert {c["data-move"] for c in page.cards} == {"gain", "loss"}
    assert {c["data-detector"] for c in page.cards} == set(run.detectors)
    assert [c["data-place"] for c in page.cards] == [str(i + 1) for i in range(len(page.cards))]


def test_what_was_run_names_versions_seed_and_frames(run: Run, page: Page):
    for value in ("rescore 0.1.0", "fake", str(run.config.seed)):
        assert value in page.text
    ((split, images, _, n_images, n_cars),) = page.tables["r0-ids"][1:]
    assert (split, int(n_images), int(n_cars)) == ("test", run.metrics.n_images, run.metrics.n_cars)
    assert re.fullmatch("[0-9a-f]{16}", images)


def test_few_images_are_told_to_prove_little(page: Page):
    assert "5 images prove little" in page.text


def test_text_from_outside_cannot_break_the_page(run: Run):
    evil = "</script><script>alert(1)</script>"
    text = text_of(replace(run, config=RunConfigFile(command=evil, config=RunSettings(preset=evil))))
    assert evil not in text
    assert evil in Page(text).text


def test_a_run_with_the_detector_alone_has_no_gallery(run: Run):
    rows = tuple(row for row in run.metrics.rows if row.mode == "detector")
    fewer = {"rows": rows, "tuning": {}, "stereo": StereoStatistics()}
    alone = replace(run, metrics=run.metrics.model_copy(update=fewer))
    page = Page(text_of(alone))
    assert not page.cards
    assert "No candidate was rescored in this run" in page.text
    assert "No choice of w came with this run" in page.text
    assert "r0-stereo" not in page.tables


def test_3d_boxes_have_their_tables(run: Run, page: Page):
    row = boxes3d_row("hog", "metric", boxes3d_level("all", 0.25))
    with_boxes = replace(run, metrics=run.metrics.model_copy(update={"boxes3d": (row,)}))
    tables = Page(text_of(with_boxes)).tables
    for name, table in (("boxes3d", boxes3d_table), ("errors3d", error_table), ("poses", pose_table)):
        shown = table(with_boxes.metrics)
        assert shown is not None
        assert tables[f"r0-{name}"] == [list(shown.head), *(list(r) for r in shown.rows)]
        assert f"r0-{name}" not in page.tables


def test_a_run_without_its_data_set_has_curves_and_says_what_lacks(run: Run):
    lost = replace(run, config=run.config.model_copy(update={"data": str(run.root / "gone")}))
    page = Page(text_of(lost))
    assert len(charts_of(page)) == 10
    assert "No pictures of candidates:" in page.text
    assert "No bands around the curves:" in page.text
    assert "r0-ids" not in page.tables


def test_reconstructions_that_were_not_kept_are_told_once(run_dir: Path, tmp_path: Path):
    shutil.copytree(run_dir, tmp_path / "run")
    shutil.rmtree(tmp_path / "run" / "evidence")
    page = Page(text_of(load_run(tmp_path / "run")))
    assert page.cards
    assert page.text.count("No predicted depth is shown") == 1


def test_a_sweep_in_the_run_folder_is_drawn_else_its_command_is_named(run_dir: Path, tmp_path: Path):
    run = load_run(run_dir)
    assert "rescore sweep RUN --out RUN/sweep" in Page(text_of(run)).text
    # detections of one's own have nothing to spoil
    settings = run.config.config.model_copy(update={"preset": None})
    own = replace(run, config=run.config.model_copy(update={"config": settings}))
    assert "rescore sweep" not in Page(text_of(own)).text
    shutil.copytree(run_dir, tmp_path / "run")
    figure = SweptInterval(value=2.0, low=1.0, high=math.inf, n_undefined=0, n_infinite=1)
    figures = {
        mode: SweepFigures(
            fppi=figure, auc=figure, reduction=reduction, with_evidence=1.0, significant_loss=False
        )
        for mode, reduction in (("detector", None), ("paper", figure))
    }
    points = tuple(SweepPoint(level=level, figures=figures) for level in (0.0, 1.0))
    dials = {"blur": SweptDial(what="blur, pixels", points=points)}
    sweep = SweepResult(detector="hog", n_images=5, dials=dials)
    write_sweep(RunFolder(tmp_path / "run").sweep, sweep)
    charts = charts_of(Page(text_of(load_run(tmp_path / "run"))))
    (factor,) = charts["r0-sweep-0-0"]["lines"]
    assert factor["band"]["high"] == [30.0, 30.0]
    assert factor["text"] == ["2.00 [1.00, inf]"] * 2
    assert [line["tags"] for line in charts["r0-sweep-1-0"]["lines"]] == [["detector"], ["paper"]]


@pytest.mark.parametrize("name", ["config.json", "metrics.json", "candidates.parquet"])
def test_a_missing_file_is_named(run_dir: Path, tmp_path: Path, name: str):
    for other in {"config.json", "metrics.json", "candidates.parquet"} - {name}:
        shutil.copy(run_dir / other, tmp_path)
    with pytest.raises(RescoreError, match=f"expected a run folder with {name}, found none; run"):
        build_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_results_of_another_shape_are_refused(run_dir: Path, tmp_path: Path):
    for name in ("config.json", "metrics.json", "candidates.parquet"):
        shutil.copy(run_dir / name, tmp_path)
    (tmp_path / "metrics.json").write_text("[]")
    with pytest.raises(RescoreError, match="expected a JSON object, got list"):
        load_run(tmp_path)


def test_curves_of_a_detector_without_hits_are_json_that_a_browser_reads(run_dir: Path, tmp_path: Path):
    # no hit: the rate of hits is 0 / 0, and one NaN in the data would leave every chart of the page blank
    shutil.copytree(run_dir, tmp_path / "run")
    table = pq.read_table(tmp_path / "run" / "candidates.parquet")
    for name in ("outcome_detector", "outcome_paper"):
        column = [
            "false_alarm" if d == "hog" and o in ("hit", "duplicate") else o
            for d, o in zip(table["detector"].to_pylist(), table[name].to_pylist(), strict=True)
        ]
        table = table.set_column(table.column_names.index(name), name, pa.array(column, table[name].type))
    pq.write_table(table, tmp_path / "run" / "candidates.parquet")
    charts = charts_of(Page(text_of(load_run(tmp_path / "run"))))
    hog = charts["r0-curves-1-0"]["lines"][0]
    assert set(hog["y"]) == {None}
    assert hog["band"] is None


def test_damaged_results_are_one_error(run: Run, tmp_path: Path):
    for name in ("config.json", "metrics.json", "candidates.parquet"):
        (tmp_path / name).write_bytes((run.root / name).read_bytes())
    (tmp_path / "metrics.json").write_text("{}")
    with pytest.raises(RescoreError, match="expected key 'n_images', found none"):
        load_run(tmp_path)
    (tmp_path / "candidates.parquet").write_bytes(b"x" * 50)
    with pytest.raises(RescoreError, match="expected a table of candidates"):
        load_run(tmp_path)


def test_several_runs_come_side_by_side(run: Run, tmp_path: Path):
    shutil.copytree(run.root, tmp_path / "other")
    out = build_report([run.root, tmp_path / "other"], tmp_path / "both.html")
    page = Page(out.read_text(encoding="utf-8"))
    assert len(page.ids) == len(set(page.ids))
    charts = charts_of(page)
    assert len(charts) == 6 + 2 * 10
    assert len(charts["all-curves-0-0"]["lines"]) == 4
    assert len(page.tables["all-runs"]) == 1 + 2 * len(run.metrics.rows)
    assert "on all 5 images" in page.text
    assert "All settings, seeds and versions are the same" in page.text
    # a run against itself differs by nothing, in every resample
    for row in page.tables["paired-1"][1:]:
        assert row[4:] == ["+0.000 (+0.000, +0.000)"] * 2


def test_a_run_named_twice_is_refused(run: Run):
    with pytest.raises(RescoreError, match=r"expected different run folders, got .* twice"):
        build_report([run.root, run.root / "."])


def test_a_run_without_annotated_cars_claims_nothing(run: Run):
    nothing = {"auc": None, "average_precision": None, "recall_ceiling": None, "intervals": None}
    fppi = dict.fromkeys(("0.5", "0.6", "0.7", "0.8"))
    rows = tuple(row.model_copy(update=nothing | {"fppi_at_recall": fppi}) for row in run.metrics.rows)
    unknown = {"comparisons": (), "reliability": (), "tuning": {}, "n_cars": 0, "rows": rows}
    columns = {
        name: np.full(len(c), "ignored", object) if name.startswith("outcome_") else c
        for name, c in run.candidates.items()
    }
    page = Page(text_of(replace(run, metrics=run.metrics.model_copy(update=unknown), candidates=columns)))
    assert "No car is annotated in these images" in page.text
    for word in ("nterval", "no likelihoods", "false alarm", "duplicate is", "Gain", "FP/image"):
        assert word not in page.text, word
    assert {c["data-move"] for c in page.cards} == {"rise", "fall"}
    assert "r0-fusion" not in page.tables


def test_another_evidence_model_takes_the_reasons_and_not_the_pictures(run_dir: Path, tmp_path: Path):
    other = load_run(make_metric_run(run_dir, tmp_path / "other"))
    page = Page(text_of(other))
    assert "epth speaks" in page.text
    table = other.candidates | {"difference_metric": other.candidates["difference_metric"] * 0.5}
    doubted = Page(text_of(replace(other, candidates=table)))
    assert "No reasons are told: depth evidence (metric): expected the model" in doubted.text
    assert "epth speaks" not in doubted.text
    assert len(doubted.cards) == len(page.cards) > 0
