"""The command ``inspect``: which candidates of a run rose or fell, and why."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer
from decimal import Decimal
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from recon.errors import RescoreError
from rescore.commands.base import AsJson, app, print_json
from rescore.commands.parts.evaluating import run_to_show
from rescore.speech import counted, say, shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from recon.arrays import IntArray
    from rescore.large.query import Answer
    from rescore.results.changes import OperatingPoint
    from rescore.results.ranked_changes import Inspection

_Choice = TypeVar("_Choice", bound=StrEnum)

SHOWN = 20
"""Candidates shown in a terminal unless told otherwise."""


@app.command()
def inspect(
    run: Annotated[Path, typer.Argument(help="Run folder of `rescore reproduce` or `rescore evaluate`.")],
    detector: Annotated[str | None, typer.Option(show_default="the first")] = None,
    mode: Annotated[
        str | None,
        typer.Option(
            help="Way of rescoring: paper, guarded, metric or instance.", show_default="the last of the run"
        ),
    ] = None,
    only: Annotated[
        str,
        typer.Option(
            help="changed, all, newly-rejected-false-alarms, newly-accepted-false-alarms, lost-cars, "
            "gained-cars or flips (found by another box).",
            show_default="changed; all with --frame",
        ),
    ] = "",
    sort: Annotated[
        str,
        typer.Option(
            help="delta (most places moved), loss (most places the wrong way) or depth_difference (D)."
        ),
    ] = "delta",
    frame: Annotated[int | None, typer.Option(help="Candidates of this image alone, by its id.")] = None,
    recall: Annotated[
        float | None,
        typer.Option(
            help="Compare where both find this share of all cars.",
            show_default="0.7, or the next tenth below that both reach",
        ),
    ] = None,
    false_positives: Annotated[
        float | None, typer.Option(help="Compare where both make up to so many false positives an image.")
    ] = None,
    top: Annotated[
        int | None,
        typer.Option(min=1, help="So many candidates.", show_default=f"{SHOWN} in a terminal, else all"),
    ] = None,
    evidence_model: Annotated[
        Path | None,
        typer.Option(help="What D was made with, to name its parts.", show_default="that of the run folder"),
    ] = None,
    export: Annotated[
        str | None,
        typer.Option(
            help="csv or parquet: also write all that is listed, with every column, to RUN/changes_*."
        ),
    ] = None,
    as_json: AsJson = False,
    failed: Annotated[
        bool,
        typer.Option(
            "--failed",
            help="Of detections in parts: list the frames that failed, and why.",
            show_default=False,
        ),
    ] = False,
    open_viewer: Annotated[
        bool, typer.Option("--open", help="Open the recording at --frame, or at the first frame listed.")
    ] = False,
) -> None:
    """List the candidates that rescoring moved, with the reason for each.

    The lists add up: cars gained less cars lost, and false alarms accepted less those rejected, are the
    differences of the two curves. In a pipe the table is plain: columns separated by tabs.

    Example: [bold]rescore inspect runs/demo --only lost-cars --sort loss[/bold]
    """
    from reports.run.changes_text import inspect_run
    from rescore.files import TableFormat
    from rescore.results.ranked_changes import Only, Sort
    from rescore.results.run_folder import load_run

    if failed:
        _show_failed(run, as_json)
        return
    form = None if export is None else _choice("--export", export, TableFormat)
    run = run_to_show(run)
    loaded = load_run(run)
    inspection = inspect_run(loaded, detector, mode, _point(recall, false_positives), evidence_model)
    chosen = _choice("--only", only, Only) if only else Only.CHANGED if frame is None else Only.ALL
    rows = inspection.listed(chosen, _choice("--sort", sort, Sort), frame)
    if as_json:
        _print_json(inspection, rows[:top])
    else:
        _show(inspection, rows, top)
    if form is not None:
        _export(inspection, rows, run / f"changes_{inspection.detector}_{inspection.mode}.{form}")
    if open_viewer:
        _open(inspection, rows, run, frame)


def _show_failed(table: Path, as_json: bool) -> None:
    """List the frames of a table in parts that failed."""
    from rescore.formats.parts.candidates import refuse_kind
    from rescore.formats.parts.forms import DETECTIONS, RESCORED
    from rescore.formats.parts.table import PartTable

    if not table.exists():
        raise RescoreError(f"{table}: expected a table in parts, found nothing; check the path")
    _refuse_run(table)
    parts = PartTable.read(table)
    refuse_kind(parts, (DETECTIONS, RESCORED))
    found = list(parts.failed_frames())
    if as_json:
        print_json([{"image_id": i, "reason": reason} for i, reason in found])
        return
    for image_id, reason in found:
        print(image_id, shown(reason), sep="\t")
    say(f"{counted(len(found), 'frame')} failed")


def _refuse_run(folder: Path) -> None:
    """Raises RescoreError where a folder is that of a run, which knows of no failed frames."""
    from rescore.results.run_config_file import read_run_config
    from rescore.results.run_folder import RunFolder

    run = RunFolder(folder)
    if run.metrics.is_file():
        made_of = read_run_config(run.config).as_json()["config"].get("detections", ())
        parts = [name for name in made_of if not name.endswith(".json")]
        if made_of and not parts:
            raise RescoreError(
                f"{folder}: expected a run of tables in parts, got one of JSON files, which hold no frame "
                "that failed; rescore into a folder (--out without .json) to count them"
            )
        which = f", one of {', '.join(parts)}" if parts else ""
        raise RescoreError(
            f"{folder}: expected a table in parts, got a run folder; name the folder that `rescore apply` or "
            f"`rescore detect` wrote{which}"
        )


@app.command()
def query(
    run: Annotated[Path, typer.Argument(help="Run folder, or a folder with a table in parts.")],
    sql: Annotated[
        str, typer.Argument(help="One SELECT on candidates, frames, cars, results, operating, found.")
    ],
    as_json: AsJson = False,
) -> None:
    """Ask the tables of a run by SQL (docs/scale.md has the tables and examples).

    In a pipe the answer is plain: columns separated by tabs. Needs the package's extra "query".

    Example: [bold]rescore query runs/demo "SELECT status, count(*) FROM candidates GROUP BY ALL"[/bold]
    """
    import sys

    from rescore.large.query import query as ask

    answer = ask(run, sql)
    if as_json:
        _refuse_equal_names(answer.columns)
        print_json([dict(zip(answer.columns, map(_as_json, row), strict=True)) for row in answer.rows()])
    elif sys.stdout.isatty():
        _show_answer(answer)
    else:
        print(*answer.columns, sep="\t")
        for row in answer.rows():
            print(*(shown("" if v is None else str(v)) for v in row), sep="\t")


def _as_json(value: Any) -> Any:
    """A value of SQL as JSON has it: decimals as numbers, dates and whatever else it lacks as text."""
    if isinstance(value, dict):
        return {str(k): _as_json(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(v) for v in value]
    if isinstance(value, Decimal):
        return float(value)
    return value if value is None or isinstance(value, str | int | float) else str(value)


def _refuse_equal_names(columns: "Sequence[str]") -> None:
    """Raises RescoreError where an object of JSON would lose a column."""
    for name in columns:
        if columns.count(name) > 1:
            raise RescoreError(
                f"--json: expected columns of different names, got {name!r} twice; name one by AS"
            )


def _show_answer(answer: "Answer") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(*answer.columns, box=None)
    for row in answer.rows():
        table.add_row(*(_value(v) for v in row))
    Console().print(table)


def _value(value: object) -> str:
    if value is None:
        return ""
    return shown(f"{value:.4g}" if isinstance(value, float) else str(value))


def _point(recall: float | None, false_positives: float | None) -> "OperatingPoint | None":
    from rescore.results.changes import OperatingPoint

    if recall is not None and false_positives is not None:
        raise RescoreError("inspect: expected --recall or --false-positives, got both; give one of them")
    if recall is None and false_positives is None:
        return None
    return OperatingPoint(recall, false_positives)


def _choice(option: str, value: str, of: type[_Choice]) -> _Choice:
    if value not in list(of):
        raise RescoreError(f"{option}: expected {', '.join(of)}, got {value!r}; choose one of these")
    return of(value)


def _show(inspection: "Inspection", rows: "IntArray", top: int | None) -> None:
    """Print the summary and the candidates: a table in a terminal, plain lines elsewhere."""
    import sys

    from rich.console import Console

    from reports.run.changes_text import note, plain_lines, summary, terminal_table

    about = note(inspection)
    if about:
        say(f"note: {about}")
    if not sys.stdout.isatty():
        print(f"# {summary(inspection)}")
        print(*plain_lines(inspection, rows[:top]), sep="\n")
        return
    console = Console()
    console.print(summary(inspection), highlight=False, markup=False)
    shown = rows[: top or SHOWN]
    if len(rows):
        console.print(terminal_table(inspection, shown, console.width))
    if len(shown) < len(rows):
        console.print(f"{len(shown)} of {len(rows)} shown; --top {len(rows)} shows all", highlight=False)
    if not len(rows):
        console.print("none of these")


def _print_json(inspection: "Inspection", rows: "IntArray") -> None:
    """Print the summary, and of each candidate the columns of the plain table."""
    from reports.run.changes_text import PLAIN_COLUMNS, summary

    columns = {name: inspection.columns()[name][rows].tolist() for name in PLAIN_COLUMNS}
    listed = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    about = {"detector": inspection.detector, "mode": inspection.mode, "summary": summary(inspection)}
    print_json(about | {"candidates": listed})


def _export(inspection: "Inspection", rows: "IntArray", path: Path) -> None:
    from rescore.files import write_table

    write_table(path, {name: column[rows] for name, column in inspection.columns().items()})
    say(f"{counted(len(rows), 'candidate')}: {path}")


def _open(inspection: "Inspection", rows: "IntArray", run: Path, frame: int | None) -> None:
    from reports.recording.viewer import open_recording
    from rescore.results.run_folder import RunFolder

    if frame is None and not len(rows):
        raise RescoreError("--open: expected a frame to open, got an empty list; give --frame")
    image_id = int(inspection.rows["image_id"][rows[0]]) if frame is None else frame
    recording = RunFolder(run).recording
    open_recording(recording, image_id, inspection.detector)
    say(f"{recording} at frame {image_id}")
