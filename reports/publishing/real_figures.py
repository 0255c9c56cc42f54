"""The figures of real streets: ``python -m reports.publishing.real_figures FILE COMMAND RUN [RUN ...]``.

Writes the metrics of finished runs into one JSON file; `reports/publishing/prose.py` writes their table into
the README.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from recon.errors import RescoreError
from reports.run.reductions import reduction_cell
from reports.run.tables import LEVEL, RECALLS, Table, number
from rescore.files import read_json_object, write_json
from rescore.results.candidate_file import ALONE
from rescore.results.metrics_file import Metrics, read_metrics

TITLES: Mapping[str, str] = {
    "kitti_road": "KITTI road",
    "kitti": "KITTI object",
}
"""What each run is, by the name of its folder."""
_FORMAT = "real streets 1"


def publish_figures(file: Path, command: str, runs: Sequence[Path]) -> Table:
    """Write the metrics of runs to a file; returns their table.

    Args:
        file: the JSON file.
        command: what made them.
        runs: run folders, named as in ``TITLES``.

    Raises:
        RescoreError: a run of another name, or one without annotated cars.
    """
    found = {run.name: read_metrics(run / "metrics.json") for run in runs}
    table = figures_table(found)
    metrics = {name: m.as_json() for name, m in found.items()}
    write_json(file, {"format": _FORMAT, "made_with": command, "runs": metrics})
    return table


def read_figures(file: Path) -> dict[str, Metrics]:
    """The metrics by run of a file that ``publish_figures`` wrote.

    Raises:
        RescoreError: no such file, or another content.
    """
    value = read_json_object(file, "figures of real streets")
    if value.get("format") != _FORMAT:
        raise RescoreError(
            f"{file}: expected format {_FORMAT!r}, got {value.get('format')!r}; write it again"
        )
    return {name: Metrics.model_validate(part) for name, part in value["runs"].items()}


def figures_table(runs: Mapping[str, Metrics]) -> Table:
    """A row a run and way of scoring, with intervals of what rescoring gains.

    Raises:
        RescoreError: a run that is not in ``TITLES``, or one without annotated cars.
    """
    for name, metrics in runs.items():
        if name not in TITLES or not metrics.n_cars:
            raise RescoreError(
                f"{name}: expected a run of {', '.join(TITLES)} with annotated cars, got another"
            )
    first, *others = (f"{100 * float(r):.0f} %" for r in RECALLS)
    level = f"{100 * float(LEVEL):.0f} %"
    head = (
        *("frames, scores", "area (ROC)", "average precision"),
        *(f"FP/image at {first}", *others[:-1], f"{others[-1]} of all cars"),
        f"fewer FP at {level}, times (95 %)",
    )
    rows = tuple(row for name, metrics in runs.items() for row in _rows(TITLES[name], metrics))
    return Table("Real streets", head, rows)


def _rows(title: str, metrics: Metrics) -> list[tuple[str, ...]]:
    gains = {(c.detector, c.mode): reduction_cell(c.reduction.get(LEVEL)) for c in metrics.comparisons}
    return [
        (
            f"{title}, detector alone" if row.mode == ALONE else f"{title}, rescored",
            number(row.auc),
            number(row.average_precision),
            *(number(row.fppi_at_recall.get(r), 2) for r in RECALLS),
            gains.get((row.detector, row.mode), ""),
        )
        for row in metrics.rows
    ]


if __name__ == "__main__":
    target, command, *runs = sys.argv[1:]
    print(publish_figures(Path(target), command, [Path(run) for run in runs]).markdown())
