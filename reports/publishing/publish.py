"""Results kept in the repository: ``python -m reports.publishing.publish RUN FOLDER COMMAND``.

Copies the figures and numbers of a finished run and writes a page that shows them, so that what the README
says can be made again with the command that the page names. Pages of studies in folders of it are linked.
"""

import shutil
import sys
from pathlib import Path

from recon.errors import RescoreError
from reports.pages import write_page
from reports.run.tables import (
    Table,
    comparison_table,
    difficulty_table,
    fusion_table,
    kind_table,
    reason_table,
    reliability_table,
    result_table,
    stereo_table,
    weight_table,
)
from rescore.results.metrics_file import Metrics
from rescore.results.run_folder import Run, load_run

CURVES = {
    "car_roc.png": "True-positive rate over all annotated cars against false positives per image",
    "candidate_roc.png": "ROC over the candidates",
    "precision_recall.png": "Precision and recall",
    "weight.png": "The objective on the validation set over w, with intervals of w",
    "reliability.png": "Share of hits over score",
}
"""The figures with what a person reads in their place."""


TITLES = {"streets": "Streets: cars in all views"}
"""Title of the page by preset; else it is that of the report's experiment."""


def publish(run_dir: Path, folder: Path, command: str) -> Path:
    """Copy the figures and numbers of a run to a folder, with a page that shows them; returns the page.

    Args:
        run_dir: a finished run.
        folder: where to publish; made where it is missing.
        command: what made the run, for the page.

    Raises:
        RescoreError: the run has no curves yet.
    """
    run = load_run(run_dir)
    if not run.folder.curves.is_dir():
        raise RescoreError(f"{run_dir}: expected curves, found none; call `rescore evaluate` first")
    (folder / "curves").mkdir(parents=True, exist_ok=True)
    drawn = [name for name in CURVES if (run.folder.curves / name).is_file()]
    for name in drawn:
        shutil.copyfile(run.folder.curves / name, folder / "curves" / name)
    for file in (run.folder.metrics, run.folder.config):
        shutil.copyfile(file, folder / file.name)
    return write_page(folder, _page(run, command, drawn, _studies(folder)))


def _studies(folder: Path) -> list[str]:
    """Links to the pages of studies that lie in folders of the page, an item a page."""
    pages = sorted(folder.glob("*/README.md"))
    titles = [page.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ") for page in pages]
    return [f"- [{title}]({p.parent.name}/README.md)" for title, p in zip(titles, pages, strict=True)]


def _page(run: Run, command: str, drawn: list[str], studies: list[str]) -> str:
    metrics = run.metrics
    parts = [
        f"# {TITLES.get(run.config.config.preset or '', 'The ROC experiment')}",
        f"Made by `{command}`, seed {run.config.seed}: {metrics.n_cars} annotated cars in "
        f"{metrics.n_images} test images, {metrics.n_candidates} candidates. `config.json` holds the "
        "settings and versions, `metrics.json` the numbers.",
        *(["Studies of this run:", "\n".join(studies)] if studies else []),
        *(_section(table) for table in _tables(run, metrics) if table is not None),
        *(f"![{CURVES[name]}](curves/{name})" for name in drawn),
    ]
    return "\n\n".join(parts) + "\n"


def _tables(run: Run, metrics: Metrics) -> tuple[Table | None, ...]:
    return (
        result_table(metrics),
        comparison_table(metrics),
        fusion_table(metrics),
        weight_table(metrics),
        reliability_table(metrics),
        difficulty_table(metrics.difficulty),
        reason_table(run.candidates, run.detectors),
        kind_table(run.candidates, run.detectors),
        stereo_table(metrics.stereo),
    )


def _section(table: Table) -> str:
    return f"## {table.title}\n\n{table.markdown()}".rstrip()


if __name__ == "__main__":
    print(publish(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
