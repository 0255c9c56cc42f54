"""SQL on the tables of a run, by DuckDB: nothing is written, and no more is read than what is asked for."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as pads
import pyarrow.parquet as pq

from recon.errors import RescoreError
from recon.stores import located, remote
from rescore.data.frames import DataSet
from rescore.formats.open import read_dataset
from rescore.formats.parts.forms import DETECTIONS, FRAMES, RESCORED
from rescore.formats.parts.frames import frame_rows
from rescore.formats.parts.manifest import is_parts
from rescore.formats.parts.table import PartTable
from rescore.metrics.curves import RECALL_LEVELS
from rescore.results.candidate_file import ALONE, score_column
from rescore.results.changes import DEFAULT_RECALL
from rescore.results.metrics_file import Metrics, read_metrics
from rescore.results.run_config_file import read_run_config
from rescore.results.run_folder import RunFolder

Source = Any
"""A table of Arrow, or its data set."""
ROWS_AT_A_TIME = 10_000


@dataclass(frozen=True, eq=False)
class Answer:
    """The rows that a query gives."""

    columns: tuple[str, ...]
    _cursor: Any

    def rows(self) -> Iterator[tuple[Any, ...]]:
        """The rows one after another."""
        with _told():
            while rows := self._cursor.fetchmany(ROWS_AT_A_TIME):
                yield from rows


def query(run: Path, sql: str) -> Answer:
    """The rows of one SELECT on the tables of a run, or of a table in parts.

    Tables of a run: ``candidates``, as candidates.parquet has them; ``frames`` and ``cars`` of the data set;
    ``results``, the rows of metrics.json; ``operating``, the score from which each mode finds 70 % of the
    cars, or the largest level that all reach; ``found``, a row for each car that a mode finds at all, and
    whether it is found at that score. Numbers that there are none of are NULL.

    Raises:
        RescoreError: no such run, no DuckDB, or SQL that is not one SELECT on these tables.
    """
    try:
        import duckdb  # noqa: PLC0415 (an extra, for queries alone)
    except ImportError:
        raise RescoreError(
            "query: expected the package's extra 'query', which is not installed; "
            'pip install "rescore[query]"'
        ) from None
    sources, views = _tables(run)
    connection = duckdb.connect(":memory:")
    # one SELECT on what is registered here: no other file is read, none is written
    connection.execute("SET enable_external_access = false")
    connection.execute("SET python_enable_replacements = false")
    with _told((*sources, *views)):
        for name, source in sources.items():
            connection.register(name, source)
        for name, view in views.items():
            connection.execute(f"CREATE VIEW {name} AS {view}")
        connection.execute("SET lock_configuration = true")
        statements = connection.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise RescoreError(
                "query: expected one SELECT, got another statement or several; ask one question"
            )
        cursor = connection.execute(statements[0])
        return Answer(tuple(d[0] for d in cursor.description), cursor)


@contextmanager
def _told(names: Sequence[str] = ()) -> Iterator[None]:
    """Inside, an error of DuckDB becomes one line; ``names`` are those of the tables."""
    try:
        yield
    except Exception as error:
        if not type(error).__module__.startswith(("duckdb", "_duckdb")):
            raise
        # what follows the place repeats the query and points into it
        text = " ".join(str(error).partition("LINE")[0].split())
        known = ", ".join(n for n in names if not n.startswith("_"))
        told = f"; the tables are {known}" if known else ""
        raise RescoreError(f"query: expected SQL that DuckDB runs, got {text[:300]}{told}") from error


def _tables(run: Path) -> tuple[dict[str, Source], dict[str, str]]:
    """The tables by name, and the SQL of views on them."""
    if is_parts(run):
        return _of_parts(PartTable.read(run))
    folder = RunFolder(run)
    if not folder.metrics.is_file():
        raise RescoreError(
            f"{run}: expected a run folder with metrics.json, or a table in parts, found neither; run "
            "`rescore evaluate` first"
        )
    metrics, config = read_metrics(folder.metrics), read_run_config(folder.config)
    data_dir = folder.data if config.data is None else located(config.data)
    parts = run / "candidates"
    if is_parts(parts):
        candidates: Source = PartTable.read(parts).dataset()
    elif remote(folder.candidates) is not None:
        with folder.candidates.open("rb") as file:
            candidates = pq.read_table(file)
    else:
        candidates = pads.dataset(folder.candidates)
    frames, views = _frames(data_dir, config.config.class_name, config.config.split)
    columns = [_known(field) for field in candidates.schema]
    views = {
        "candidates": f"SELECT {', '.join(columns)} FROM _candidates",
        **views,
        "operating": _operating(metrics),
        "found": _found(metrics),
    }
    return {"_candidates": candidates, **frames, "results": _results(metrics)}, views


def _of_parts(table: PartTable) -> tuple[dict[str, Source], dict[str, str]]:
    dataset = table.dataset()
    if table.kind == FRAMES:
        return {"frames": dataset}, {"cars": _CARS}
    if table.kind in (DETECTIONS, RESCORED):
        views = {
            "candidates": "SELECT * FROM _rows WHERE rank IS NOT NULL",
            "frames": "SELECT image_id, status, reason_detail FROM _rows WHERE rank IS NULL",
        }
        return {"_rows": dataset}, views
    return {"candidates": dataset}, {}


_CARS = "SELECT image_id, unnest(objects, recursive := true) FROM frames"


def _frames(data_dir: Path, class_name: str, split: str) -> tuple[dict[str, Source], dict[str, str]]:
    """The frames of the split that was evaluated."""
    if is_parts(data_dir):
        source: Source = PartTable.read(data_dir).dataset()
    else:
        data: DataSet = read_dataset(data_dir, class_name)
        source = frame_rows(data.root, data.frames, data)
    chosen = "" if split == "all" else f" WHERE split = '{split}'"
    return {"_frames": source}, {"frames": f"SELECT * FROM _frames{chosen}", "cars": _CARS}


def _known(field: pa.Field) -> str:
    """A column of candidates, NaN as NULL."""
    if pa.types.is_floating(field.type):
        return f'nullif("{field.name}", \'NaN\'::DOUBLE) AS "{field.name}"'
    return f'"{field.name}"'


def _results(metrics: Metrics) -> pa.Table:
    names = ("detector", "mode", "w", "auc", "average_precision", "recall_ceiling")
    columns = {name: [getattr(row, name) for row in metrics.rows] for name in names}
    for level in RECALL_LEVELS:
        column = [row.fppi_at_recall.get(f"{level:g}") for row in metrics.rows]
        columns[f"fppi_at_{100 * level:.0f}"] = pa.array(column, pa.float64())
    return pa.table(columns)


def _score(mode: str) -> str:
    return "detector_score" if mode == ALONE else score_column(mode)


def _level(metrics: Metrics, detector: str) -> float | None:
    """The share of the cars at which the modes of a detector are compared; None where they reach none."""
    ceilings = [row.recall_ceiling or 0.0 for row in metrics.rows if row.detector == detector]
    levels = [level for level in RECALL_LEVELS if level <= min(DEFAULT_RECALL, *ceilings) + 1e-9]
    return max(levels, default=None)


def _operating(metrics: Metrics) -> str:
    """SQL of the score from which each mode finds the level of its detector."""
    rows = []
    for row in metrics.rows:
        level, score = _level(metrics, row.detector), _score(row.mode)
        needed = 0 if level is None else int(np.ceil(level * metrics.n_cars - 1e-9))
        threshold = (
            "NULL"
            if level is None
            else f"(SELECT {score} FROM candidates WHERE detector = {_quoted(row.detector)} AND "
            f"outcome_{row.mode} = 'hit' ORDER BY {score} DESC LIMIT 1 OFFSET {needed - 1})"
        )
        rows.append(
            f"SELECT {_quoted(row.detector)} AS detector, '{row.mode}' AS mode, "
            f"{'NULL' if level is None else level}::DOUBLE AS recall, {threshold}::DOUBLE AS threshold"
        )
    return " UNION ALL ".join(rows)


def _found(metrics: Metrics) -> str:
    """SQL of the cars that each mode finds."""
    rows = [
        f"SELECT detector, '{mode}' AS mode, image_id, annotation_id_{mode} AS annotation_id, "
        f"{_score(mode)} AS score FROM candidates WHERE outcome_{mode} = 'hit'"
        for mode in metrics.modes
    ]
    return (
        f"SELECT f.*, f.score >= o.threshold AS accepted FROM ({' UNION ALL '.join(rows)}) f "
        "JOIN operating o USING (detector, mode)"
    )


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
