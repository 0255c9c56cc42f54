import io
from dataclasses import replace

import numpy as np
from rich.console import Console

from reports.page.paired_runs import Evaluated
from reports.page.report import render_report
from reports.run.tables import (
    difficulty_table,
    kind_table,
    reason_table,
    result_table,
    short_table,
    stereo_table,
    terminal_table,
    tie_notes,
)
from rescore.results.metrics_file import DetectorDifficulty, Metrics, Row, StereoStatistics, TiedScores
from rescore.results.run_folder import Run


def test_the_result_table_shows_metrics_json(run: Run):
    table = result_table(run.metrics)
    assert len(table.rows) == len(run.metrics.rows) == 4
    for cells, row in zip(table.rows, run.metrics.rows, strict=True):
        shown = dict(zip(table.head, cells, strict=True))
        assert float(shown["area (ROC)"]) == round(row.auc, 3)
        assert float(shown["average precision"]) == round(row.average_precision, 3)
        assert float(shown["recall ceiling"]) == round(row.recall_ceiling, 3)
        assert shown["w"] == f"{row.w:.2f}"
        assert shown["FP/image at 70%"] == f"{row.fppi_at_recall['0.7']:.2f}"


def test_what_is_undefined_or_never_reached_is_a_dash():
    row = Row(
        detector="mine",
        mode="detector",
        auc=None,
        average_precision=float("nan"),
        recall_ceiling=0.25,
        fppi_at_recall=dict.fromkeys(("0.5", "0.6", "0.7", "0.8")),
    )
    cells = result_table(Metrics(n_images=1, n_cars=1, n_candidates=0, rows=(row,))).rows[0]
    assert cells == ("mine", "detector alone", *["–"] * 7, "0.250")


def test_the_terminal_table_fits_80_columns(run: Run):
    out = io.StringIO()
    Console(file=out, width=80).print(terminal_table(run.metrics, "all"))
    text = out.getvalue()
    assert "Results on all splits" in text
    assert "…" not in text
    assert max(len(line) for line in text.splitlines()) <= 80
    for row in run.metrics.rows:
        assert f"{row.auc:.3f}" in text


def test_markdown_has_one_cell_a_column(run: Run):
    lines = short_table(run.metrics, levels=("0.7",)).markdown().splitlines()
    assert {line.count("|") for line in lines} == {7}
    assert lines[1].startswith("| --- | ---: |")


def test_reasons_count_every_candidate_once():
    columns = {
        "detector": np.array(["a", "a", "a", "b"], object),
        "status": np.array(["no_outline", "ok", "ok", "ok"], object),
    }
    table = reason_table(columns, ["a", "b"])
    assert table.rows == (
        ("depth compared", "2 (67%)", "1 (100%)"),
        ("no outline found", "1 (33%)", "0 (0%)"),
    )


def test_kinds_count_false_alarms_alone():
    columns = {
        "detector": np.array(["a", "a", "a", "b"], object),
        "outcome_detector": np.array(["false_alarm", "hit", "false_alarm", "duplicate"], object),
        "kind": np.array(["low_wall", "car", "hedge", "car"], object),
    }
    table = kind_table(columns, ["a", "b"])
    assert table is not None
    assert table.rows == (("hedge", "1", "0"), ("low wall", "1", "0"))
    short = kind_table(columns | {"outcome_detector": np.array(["false_alarm"] * 4, object)}, ["a", "b"], 1)
    assert short is not None
    # two cars, one of each detector; a hedge and a wall remain
    assert short.rows == (("car", "1", "1"), ("2 other kinds", "2", "0"))
    assert kind_table(columns | {"kind": np.array([""] * 4, object)}, ["a", "b"]) is None


def test_stereo_errors_are_listed_by_split_and_region(run: Run):
    table = stereo_table(run.metrics.stereo)
    assert table is not None
    assert table.rows[0] == ("test", "cars", "93.0%", "1.25", "18.0%", "–")
    assert stereo_table(StereoStatistics()) is None


def test_the_difficulty_table_names_the_commonest_kinds():
    hard = DetectorDifficulty(
        n_cars=10, recall_ceiling=0.9, fppi_at_70=None, share_by_kind={"bus_picture": 0.6, "": 0.4}
    )
    table = difficulty_table({"hog": hard})
    assert table is not None
    assert table.rows[0][1:] == ("10", "90.0%", "–", "bus picture 60.0%, unknown 40.0%")
    assert difficulty_table({"hog": hard.model_copy(update={"share_by_kind": {}})}) is None


def test_equal_scores_are_told_with_what_their_order_decides(run: Run) -> None:
    assert tie_notes(run.metrics) == ()
    tied = TiedScores(n_candidates=7, average_precision=(0.25, 0.5))
    first, *rest = run.metrics.rows
    metrics = run.metrics.model_copy(update={"rows": (first.model_copy(update={"ties": tied}), *rest)})
    assert tie_notes(metrics) == (
        "HOG + SVM, alone: 7 candidates share their score, hits with false positives. Their order in the "
        "file decides where average precision lies between 0.250 and 0.500, as in COCO's tool",
    )
    page = render_report([Evaluated("run", replace(run, metrics=metrics))])
    assert "7 candidates share their score" in page


def test_figures_are_whole_beside_long_names(run: Run) -> None:
    wide = dict.fromkeys(("0.5", "0.6", "0.7", "0.8"), 12.34)
    rows = tuple(
        row.model_copy(update={"detector": "hog_views", "mode": "instance", "fppi_at_recall": wide})
        for row in run.metrics.rows
    )
    out = io.StringIO()
    Console(file=out, width=80).print(terminal_table(run.metrics.model_copy(update={"rows": rows})))
    assert "…" not in out.getvalue()
    assert out.getvalue().count("12.34") == 4 * len(rows)
