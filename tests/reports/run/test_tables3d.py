"""The tables of 3D boxes: what they say, and that they fit."""

from io import StringIO

import pytest
from rich.console import Console

from reports.run.tables3d import (
    TERMINAL_CAPTION_3D,
    boxes3d_table,
    error_table,
    pose_table,
    terminal_boxes3d,
)
from rescore.results.metrics_file import Boxes3DRow, Metrics
from tests.reports.solid_rows import boxes3d_level, boxes3d_row


def metrics(*rows: Boxes3DRow) -> Metrics:
    return Metrics(n_images=5, n_cars=60, n_candidates=80, rows=(), boxes3d=rows)


def test_figures_of_every_level_and_mode() -> None:
    first = boxes3d_row("hog", "detector", boxes3d_level("moderate", 0.25), boxes3d_level("all", None))
    some = metrics(first, boxes3d_row("net", "paper", boxes3d_level("all", 0.5)))
    table = boxes3d_table(some)
    assert table is not None
    assert [r[2:] for r in table.rows] == [
        ("moderate", "60", "0.250", "0.250", "0.250", "0.500", "0.250", "0.500"),
        ("all", "60", "–", "–", "–", "–", "–", "–"),
        ("all", "60", "0.500", "0.500", "0.500", "1.000", "0.500", "1.000"),
    ]
    assert all(len(r) == len(table.head) for r in table.rows)


def test_errors_and_poses() -> None:
    some = metrics(
        boxes3d_row("net", "detector", boxes3d_level("all", 0.5)),
        boxes3d_row("net", "metric", boxes3d_level("all", 0.5)),
    )
    errors, poses = error_table(some), pose_table(some)
    assert errors is not None
    assert poses is not None
    # 0.1 rad are 5.7 degrees
    assert errors.rows[0] == (
        *("net", "detector alone", "44 of 60"),
        *("0.50 / 0.30", "0.12 / 0.10", "– / 5.7"),
    )
    # a row a distance, in the last mode alone
    assert poses.rows == (
        ("net", "all", "50", "40", "50.0%", "0.25", "2.0"),
        ("net", "whole, 0 to 25 m", "50", "40", "87.5%", "0.25", "2.0"),
    )


def test_without_3d_boxes_there_is_no_table() -> None:
    none = metrics()
    assert [t(none) for t in (boxes3d_table, error_table, pose_table, terminal_boxes3d)] == [None] * 4


@pytest.mark.parametrize("levels", [("moderate", "all"), ("all",)])
def test_the_terminal_shows_kittis_middle_level_in_80_columns(levels: tuple[str, ...]) -> None:
    some = metrics(
        boxes3d_row("hog", "guarded", *(boxes3d_level(name, 0.1 + 0.1 * i) for i, name in enumerate(levels)))
    )
    table = terminal_boxes3d(some)
    assert table is not None
    assert table.title == f"3D boxes, 60 cars ({levels[0]})"
    assert table.rows == (
        *(("HOG + SVM, guarded", "0.100", "0.100", "0.200", "0.100", "0.200", "0.30", "5.7", "88%"),),
    )
    out = StringIO()
    Console(file=out, width=80).print(table.rich(TERMINAL_CAPTION_3D))
    shown = out.getvalue()
    assert "HOG + SVM, guarded" in shown
    assert "…" not in shown
