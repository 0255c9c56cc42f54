from pathlib import Path

import pytest

from recon.errors import RescoreError
from reports.page.report import build_report
from reports.publishing.publish import CURVES, publish
from rescore.results.metrics_file import read_metrics
from rescore.results.run_folder import Run


def test_the_page_shows_the_numbers_and_figures_of_the_run(run: Run, tmp_path: Path):
    build_report(run.root)
    page = publish(run.root, tmp_path / "published", "make it").read_text(encoding="utf-8")
    assert "`make it`" in page
    for row in run.metrics.rows:
        assert f"{row.average_precision:.3f}" in page
    for name in CURVES:
        assert f"](curves/{name})" in page
        copied = tmp_path / "published" / "curves" / name
        assert copied.read_bytes() == (run.root / "curves" / name).read_bytes()
    assert read_metrics(tmp_path / "published" / "metrics.json") == run.metrics


def test_studies_beside_the_page_are_linked(run: Run, tmp_path: Path):
    build_report(run.root)
    assert "Studies of this run" not in publish(run.root, tmp_path, "make it").read_text(encoding="utf-8")
    (tmp_path / "relief").mkdir()
    (tmp_path / "relief" / "README.md").write_text("# What is there\n\nText.\n")
    page = publish(run.root, tmp_path, "make it").read_text(encoding="utf-8")
    assert "- [What is there](relief/README.md)" in page


def test_a_run_without_curves_is_refused(run: Run, tmp_path: Path):
    for name in ("candidates.parquet", "metrics.json", "config.json"):
        (tmp_path / name).write_bytes((run.root / name).read_bytes())
    with pytest.raises(RescoreError, match="expected curves, found none"):
        publish(tmp_path, tmp_path / "published", "make it")
    assert not (tmp_path / "published").exists()
