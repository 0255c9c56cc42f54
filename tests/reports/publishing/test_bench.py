"""The page on speed, and its file."""

from dataclasses import replace
from pathlib import Path

import pytest

from recon.errors import RescoreError
from reports.publishing.bench import Straight, growth_charts, publish_bench
from reports.publishing.bench_file import (
    Bench,
    Growth,
    Machine,
    Row,
    bench_of_this_machine,
    read_bench,
    write_bench,
)
from tests.bench.__main__ import Measured, measure

ROWS = (
    Row("render", 1.5, "ratio", 1.4, ours_ms=300.0, bare_ms=200.0),
    Row("loop", 12.0, "frames/s", 10.0, at_least=True, clock="wall"),
)
GROWTH = (
    Growth("evidence", "candidates", (1.0, 10.0, 100.0), (0.012, 0.03, 0.21), "a reason"),
    Growth("all views", "candidates", (1.0, 10.0), (0.1, 0.4)),
    Growth("apply", "frames", (12.0, 48.0), (2.0, 5.0)),
)


@pytest.fixture
def bench_file(tmp_path: Path) -> Path:
    path = tmp_path / "bench.json"
    write_bench(path, bench_of_this_machine("python -m tests.bench", ROWS, GROWTH, {}))
    return path


def test_what_is_written_is_read(bench_file: Path) -> None:
    bench = read_bench(bench_file)
    assert bench == Bench("python -m tests.bench", Machine.this(), bench.versions, ROWS, GROWTH)
    assert bench.versions["numpy"]


def test_a_figure_holds_on_its_side_of_the_limit() -> None:
    assert [row.holds for row in ROWS] == [False, True]
    assert replace(ROWS[0], value=1.4).holds
    assert not replace(ROWS[1], value=9.9).holds


def test_linear_growth_is_found_exactly() -> None:
    line = Straight.through(GROWTH[0])
    assert line.fixed_s == pytest.approx(0.010)
    assert line.each_s == pytest.approx(0.002)
    assert line.departure == pytest.approx(0, abs=1e-9)
    # three times that lie on 2, 1 and 4 of a line through none of them
    assert Straight.through(Growth("", "", (1, 2, 3), (2, 1, 4))).departure > 0.2


def test_growths_along_one_size_share_a_chart() -> None:
    candidates, frames = growth_charts(GROWTH)
    assert [line.name for line in candidates.lines] == ["evidence", "all views"]
    assert [line.name for line in frames.lines] == ["apply"]
    assert candidates.y.high > 400
    assert frames.y.high > 5000


def test_the_page_shows_figures_limits_and_growth(bench_file: Path, tmp_path: Path) -> None:
    page = publish_bench(bench_file, tmp_path / "published", "make published-bench")
    text = page.read_text()
    assert "| render | one core | 300 | 200 | 1.5 | ≤ 1.4 | no |" in text
    assert "| loop | wall |  |  | 12 frames/s | ≥ 10 frames/s | yes |" in text
    assert "1 of 2 figures are as wanted" in text
    assert "a reason" in text
    assert (page.parent / "growth.png").stat().st_size > 10_000
    assert read_bench(page.parent / "bench.json") == read_bench(bench_file)


def test_figures_alone_make_a_page(tmp_path: Path) -> None:
    write_bench(tmp_path / "bench.json", bench_of_this_machine("", ROWS, (), {}))
    page = publish_bench(tmp_path / "bench.json", tmp_path / "published", "")
    assert "How time grows" not in page.read_text()
    assert not (page.parent / "growth.png").exists()


def test_a_group_that_fails_is_named_and_loses_no_other(tmp_path: Path) -> None:
    def broken() -> Measured:
        raise ValueError("too few cars")

    groups = {"one": lambda: ([ROWS[0]], []), "two": broken, "three": lambda: ([ROWS[1]], list(GROWTH))}
    failed = measure(groups, tmp_path / "bench.json", "")
    assert failed == {"two": "ValueError: too few cars"}
    bench = read_bench(tmp_path / "bench.json")
    assert (bench.rows, bench.growth, bench.failed) == (ROWS, GROWTH, failed)
    page = publish_bench(tmp_path / "bench.json", tmp_path / "published", "").read_text()
    assert "Not measured: two (ValueError: too few cars)." in page
    assert "growth.png" in page


@pytest.mark.parametrize("text", ["{", '{"rows": 1}', "[]"])
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "bench.json").write_text(text)
    with pytest.raises(RescoreError, match=r"bench\.json: expected figures of `make bench`"):
        read_bench(tmp_path / "bench.json")
