import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from recon.errors import RescoreError
from reports.curves import curve_sets
from reports.html import build_report, headline, render_report
from reports.run_folder import Run, load_run
from reports.tables import result_table

CHROMIUM = shutil.which("chromium")
LOADING = {"src", "href", "srcset", "data", "action", "poster"}


class Page(HTMLParser):
    """Attributes, table cells, scripts and plain text of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.links: list[str] = []
        self.missing_alt = 0
        self.tables: dict[str, list[list[str]]] = {}
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.text = ""
        self._table, self._tag = "", ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.links += [v or "" for k, v in attrs if k in LOADING]
        self.missing_alt += tag == "img" and not attributes.get("alt")
        self._tag = tag
        if tag == "table":
            self._table = attributes["id"] or ""
            self.tables[self._table] = []
        if tag == "tr":
            self.tables[self._table].append([])
        if tag == "script":
            self.scripts.append((attributes, ""))

    def handle_endtag(self, tag):
        self._tag = ""

    def handle_data(self, data):
        if self._tag in ("td", "th"):
            self.tables[self._table][-1].append(data)
        elif self._tag == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        elif self._tag != "style":
            self.text += data


@pytest.fixture(scope="module")
def report(run: Run) -> Path:
    return build_report(run.root)


@pytest.fixture(scope="module")
def page(report: Path) -> Page:
    return Page(report.read_text(encoding="utf-8"))


def test_nothing_is_loaded_from_anywhere(report: Path, page: Page):
    assert all(link.startswith(("data:", "#")) for link in page.links)
    # plotly.js names addresses of map tiles that it would load for maps alone; our own part names none
    own = re.sub(r"<script>/\*\*.*?</script>", "", report.read_text(encoding="utf-8"), flags=re.S)
    assert len(own) < 3_000_000
    assert not re.search(r"https?://|@import|url\((?!data:)", own)


def test_plotly_is_inlined_once_and_the_file_is_small_enough(report: Path, page: Page):
    assert sum("plotly.js v" in text for _, text in page.scripts) == 1
    assert report.stat().st_size < 15e6


def test_tables_equal_metrics_json(run: Run, page: Page):
    head, *rows = page.tables["results"]
    assert tuple(head) == result_table(run.metrics).head
    for cells, row in zip(rows, run.metrics["rows"], strict=True):
        assert float(cells[3]) == pytest.approx(row["auc"], abs=5e-4)
        assert float(cells[4]) == pytest.approx(row["average_precision"], abs=5e-4)
        for cell, level in zip(cells[5:9], ("0.5", "0.6", "0.7", "0.8"), strict=True):
            value = row["fppi_at_recall"][level]
            assert (cell == "–") if value is None else (float(cell) == pytest.approx(value, abs=5e-3))
        assert float(cells[9]) == pytest.approx(row["recall_ceiling"], abs=5e-4)


def test_interactive_curves_are_those_of_the_run(run: Run, page: Page):
    (text,) = [text for attributes, text in page.scripts if attributes.get("id") == "figures"]
    figures = {f["id"]: f for f in json.loads(text)}
    assert set(figures) == {"candidate-roc", "car-roc", "precision-recall", "weight", "reliability"}
    for c, trace in zip(curve_sets(run), figures["candidate-roc"]["traces"], strict=False):
        np.testing.assert_array_equal(trace["x"], c.candidate.x)
        np.testing.assert_array_equal(trace["y"], c.candidate.y)
        assert trace["text"][0] == "above all scores"
        np.testing.assert_allclose(
            [float(t) for t in trace["text"][1:]], c.candidate.threshold[1:], atol=5e-5
        )
    for c, trace in zip(curve_sets(run), figures["car-roc"]["traces"], strict=True):
        np.testing.assert_array_equal(trace["customdata"], c.cars.x)
        np.testing.assert_array_equal(trace["y"], c.cars.y)
    assert all(
        "share" in f["layout"]["xaxis"]["title"]["text"] for i, f in figures.items() if i == "candidate-roc"
    )


def test_pictures_have_a_text_and_the_curves_lie_beside(run: Run, page: Page):
    assert page.missing_alt == 0
    assert sum(link.startswith("data:image/jpeg") for link in page.links) >= 8
    assert len(list((run.root / "curves").glob("*.png"))) == 5


def test_the_headline_states_both_values(run: Run):
    sentences = headline(run.metrics)
    before, after = run.row("hog", "detector"), run.row("hog", "paper")
    assert f"from {before['average_precision']:.3f} to {after['average_precision']:.3f}" in sentences[0]
    assert f"go from {before['fppi_at_recall']['0.7']:.2f} to" in sentences[0]


def test_the_headline_says_so_where_a_rate_is_never_reached():
    row = {
        "detector": "a",
        "mode": "detector",
        "w": 1.0,
        "average_precision": 0.25,
        "fppi_at_recall": {"0.7": None},
    }
    (alone,) = headline({"rows": [row]})
    assert alone == "a: average precision 0.250, and 70% of all cars are never found."
    later = row | {"mode": "paper", "w": 0.5, "fppi_at_recall": {"0.7": 2.0}}
    (both,) = headline({"rows": [row, later]})
    assert both.endswith("where 70% of all cars are found go from never reached to 2.00.")


def test_text_from_outside_cannot_break_the_page(run: Run):
    evil = "</script><script>alert(1)</script>"
    text = render_report(replace(run, config={"seed": evil, "config": {"preset": evil}}))
    assert evil not in text
    assert evil in Page(text).text


def test_a_run_with_the_detector_alone_has_no_gallery(run: Run):
    rows = [row for row in run.metrics["rows"] if row["mode"] == "detector"]
    alone = replace(run, metrics={**run.metrics, "rows": rows, "tuning": {}, "stereo": {}})
    page = Page(render_report(alone))
    assert "moved most" not in page.text
    assert "stereo" not in page.tables


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


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_a_browser_draws_every_curve(report: Path, tmp_path: Path):
    options = (
        "--headless --no-sandbox --disable-gpu --disable-background-networking --disable-component-update"
    )
    options += " --disable-sync --no-first-run --virtual-time-budget=10000 --dump-dom"
    command = [str(CHROMIUM), *options.split(), f"--user-data-dir={tmp_path}", report.as_uri()]
    page = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    body = page[page.rindex("</style>") - 10 :] if "main-svg" not in page else page
    drawn = list(_plots(body))
    assert len(drawn) == 5
    assert all(plot.count('class="trace scatter') >= 2 for plot in drawn)


def _plots(page: str) -> Iterator[str]:
    for match in re.finditer(r'<div class="plot[^>]*>(.*?)</figure>', page, flags=re.S):
        yield match.group(1)


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
    page = Page(render_report(load_run(tmp_path / "run")))
    (text,) = [text for attributes, text in page.scripts if attributes.get("id") == "figures"]

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    figures = {f["id"]: f for f in json.loads(text, parse_constant=refuse)}
    hog = figures["candidate-roc"]["traces"][0]
    assert set(hog["y"]) == {None}


def test_damaged_results_are_one_error(run: Run, tmp_path: Path):
    for name in ("config.json", "metrics.json", "candidates.parquet"):
        (tmp_path / name).write_bytes((run.root / name).read_bytes())
    (tmp_path / "metrics.json").write_text("{}")
    with pytest.raises(RescoreError, match="expected key 'n_images', found none"):
        load_run(tmp_path)
    (tmp_path / "candidates.parquet").write_bytes(b"x" * 50)
    with pytest.raises(RescoreError, match="expected a table of candidates"):
        load_run(tmp_path)
