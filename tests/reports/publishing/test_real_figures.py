from pathlib import Path

import pytest

from recon.errors import RescoreError
from reports.publishing.real_figures import TITLES, figures_table, publish_figures, read_figures
from rescore.results.candidate_file import ALONE
from rescore.results.metrics_file import Metrics, read_metrics
from rescore.results.run_folder import Run
from tests.conftest import ROOT

PUBLISHED = ROOT / "reports" / "published" / "streets" / "real.json"


@pytest.fixture
def named(run: Run, tmp_path: Path) -> Path:
    """A run under the name of one on real streets."""
    folder = tmp_path / "kitti_road"
    folder.mkdir()
    (folder / "metrics.json").write_bytes((run.root / "metrics.json").read_bytes())
    return folder


def test_the_readme_says_what_the_published_figures_are() -> None:
    figures = read_figures(PUBLISHED)
    assert list(figures) == list(TITLES)
    text = (ROOT / "README.md").read_text()
    assert figures_table(figures).markdown().strip() in text
    road, strong = figures["kitti_road"], figures["kitti"]
    for told in (
        f"{road.n_images} frames, {road.n_candidates} boxes",
        f"{road.n_cars} cars have a good box",
        f"{strong.n_images} frames, {strong.n_cars} cars",
    ):
        assert told in text.replace("\n", " ")


def test_figures_and_table_are_those_of_the_run(named: Path, tmp_path: Path) -> None:
    file = tmp_path / "real.json"
    table = publish_figures(file, "make it", [named])
    metrics = read_metrics(named / "metrics.json")
    assert read_figures(file) == {"kitti_road": metrics}
    for row, told in zip(metrics.rows, table.rows, strict=True):
        assert told[0] == f"KITTI road, {'detector alone' if row.mode == ALONE else 'rescored'}"
        assert told[2] == f"{row.average_precision:.3f}"
        assert told[5] == f"{row.fppi_at_recall['0.7']:.2f}"
        assert bool(told[-1]) is (row.mode != ALONE)


def test_publishing_twice_changes_nothing(named: Path, tmp_path: Path) -> None:
    file = tmp_path / "real.json"
    publish_figures(file, "make it", [named])
    once = file.read_bytes()
    publish_figures(file, "make it", [named])
    assert file.read_bytes() == once


def test_a_run_of_another_name_and_one_without_cars_are_refused(named: Path) -> None:
    metrics = read_metrics(named / "metrics.json")
    with pytest.raises(RescoreError, match="demo: expected a run of kitti_road, kitti"):
        figures_table({"demo": metrics})
    bare = Metrics(n_images=1, n_cars=0, n_candidates=0, rows=())
    with pytest.raises(RescoreError, match="with annotated cars, got another"):
        figures_table({"kitti": bare})


def test_a_file_of_another_format_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "real.json"
    file.write_text("{}\n")
    with pytest.raises(RescoreError, match="expected format 'real streets 1', got None"):
        read_figures(file)
