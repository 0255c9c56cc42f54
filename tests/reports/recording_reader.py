"""Reads recordings back for tests, with Rerun's own reader."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import pyarrow as pa
from rerun.chunk import RrdReader

ROW_ID = "rerun.controls.RowId"


def read(path: Path, entity: str, timeline: str = "frame") -> dict[int, dict[str, Any]]:
    """Component lists of an entity by time of a timeline, static ones at -1.

    Of several rows at one time the last logged one counts, as in the viewer.
    """
    rows: dict[int, dict[str, Any]] = defaultdict(dict)
    found: list[tuple[bytes, int, str, Any]] = []
    for chunk in RrdReader(str(path)).stream().filter(content=entity):
        table = pa.Table.from_batches([chunk.to_record_batch()])
        static = not any(name in table.column_names for name in ("frame", "threshold"))
        if not static and timeline not in table.column_names:
            continue
        times = [-1] * table.num_rows if static else table[timeline].to_pylist()
        row_ids = table[ROW_ID].to_pylist()
        for name in table.column_names:
            if name.startswith("rerun.controls"):
                continue
            for row_id, time, value in zip(row_ids, times, table[name].to_pylist(), strict=True):
                if value is not None and time is not None:
                    found.append((row_id, time, name, value))
    for _, time, name, value in sorted(found, key=lambda f: f[0]):
        rows[time][name] = value
    return rows


def colours_of(path: Path, entity: str) -> list[int]:
    """Class ids of all rows of an entity."""
    return [c for row in read(path, entity).values() for c in row.get("Boxes2D:class_ids", [])]


def every_row(path: Path, blueprint: bool = False) -> list[tuple[str, dict[str, Any]]]:
    """Entity path and columns of every row in the order of logging, without ids and times of the clock.

    Of ``blueprint``, the rows of the layout, whose containers and views have random ids too.
    """
    reader = RrdReader(str(path))
    store = reader.blueprints()[0] if blueprint else None
    found: list[tuple[bytes, str, dict[str, Any]]] = []
    for chunk in reader.stream(store=store):
        table = pa.Table.from_batches([chunk.to_record_batch()])
        ids = table[ROW_ID].to_pylist()
        clock = [field.name for field in table.schema if pa.types.is_timestamp(field.type)]
        rows = table.drop_columns([ROW_ID, *clock]).to_pylist()
        found += [(i, chunk.entity_path, row) for i, row in zip(ids, rows, strict=True)]
    return [(entity, row) for _, entity, row in sorted(found, key=lambda f: f[0])]
