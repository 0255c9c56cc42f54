"""The table of candidates: the columns of candidates.parquet, how they are filled, and how they are read.

A column that an evaluation adds is named here alone. The numbers of the depth evidence are those of
``rescore.evidence.candidates.NUMBERS``.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray, stacked
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import reading
from recon.stores import remote
from rescore.data.boxes3d import BOX_NAMES
from rescore.evidence.candidates import NOT_RESCORED, NUMBERS
from rescore.evidence.cues import CUES
from rescore.evidence.registration import Registration
from rescore.formats.coco import DetectionFile
from rescore.metrics.matching import OUTCOMES, MatchTable, ranking_of

Columns = Mapping[str, NDArray[Any]]
"""A table as arrays of one length, by column name."""

ROWS_AT_A_TIME = 2**15
"""Rows that are written at a time."""

ALONE = "detector"
"""The mode that ranks by the raw score of the detector alone."""


def score_column(mode: str) -> str:
    """Name of the column of scores in [0, 1] of a mode: that of l, or of the posterior."""
    return "likelihood" if mode == ALONE else f"posterior_{mode}"


def of_mode(rows: Columns, name: str, mode: str) -> NDArray[Any]:
    """Column ``<name>_<mode>``, or the detector's own column where the table has none of this mode."""
    own = f"{name}_{mode}"
    return rows[own if own in rows else f"{name}_{ALONE}"]


def difference(rows: Columns, mode: str) -> FloatArray:
    """D of every candidate (n,) in a mode, or D of eq. 6 where the table has no other; NaN where there is
    none."""
    own = f"difference_{mode}"
    return np.asarray(rows[own if own in rows else "depth_difference"], float)


def status(rows: Columns, mode: str) -> NDArray[Any]:
    """Status of every candidate (n,) in a mode, or the status of eq. 6 where the table has no other."""
    own = f"status_{mode}"
    return rows[own if own in rows else "status"]


def match_table(rows: Columns, mode: str, n_images: int, n_cars: int) -> MatchTable:
    """The match table of the candidates of one detector in one mode.

    Images without candidates are not in the table: they come last here.

    Args:
        rows: the candidates of one detector.
        mode: "detector" for the detector alone, or one whose posteriors the table has.
        n_images: images of the test set, with candidates or not.
        n_cars: annotated cars of the test set.

    Raises:
        RescoreError: the table has no scores of this mode, or an outcome that is none.
    """
    if score_column(mode) not in rows:
        raise RescoreError(
            f"candidates.parquet: expected column {score_column(mode)!r}, found none; "
            "run `rescore evaluate` again"
        )
    code = {str(name): i for i, name in enumerate(OUTCOMES)}
    names = [str(o) for o in of_mode(rows, "outcome", mode)]
    unknown = sorted(set(names) - set(code))
    if unknown:
        raise RescoreError(
            f"candidates.parquet: expected outcomes {', '.join(code)}, got {unknown[0]!r}; "
            "run `rescore evaluate` again"
        )
    raw = np.asarray(rows["detector_score"], float)
    score = raw if mode == ALONE else np.asarray(rows[score_column(mode)], float)
    return MatchTable(
        n_images=n_images,
        n_cars=n_cars,
        image=np.unique(rows["image_id"], return_inverse=True)[1],
        ranking=ranking_of(score, raw),
        outcome=np.array([code[o] for o in names], dtype=np.int8),
        annotation_id=of_mode(rows, "annotation_id", mode).astype(np.int64),
    )


def places(ranking: FloatArray) -> IntArray:
    """Place of each candidate (n,), 1 is best; candidates of equal ranking in the order given."""
    place = np.empty(len(ranking), np.int64)
    place[np.argsort(-ranking, kind="stable")] = np.arange(1, len(ranking) + 1)
    return place


CANDIDATE_COLUMNS = {
    "detector": pa.string(),
    "image_id": pa.int64(),
    "rank": pa.int64(),
    **dict.fromkeys(("x0", "y0", "x1", "y1", "detector_score", "likelihood"), pa.float64()),
    "status": pa.string(),
    "reason_detail": pa.string(),
    **dict.fromkeys((*NUMBERS, "posterior_paper", "w"), pa.float64()),
    f"outcome_{ALONE}": pa.string(),
    "outcome_paper": pa.string(),
    f"annotation_id_{ALONE}": pa.int64(),
    "annotation_id_paper": pa.int64(),
    "kind": pa.string(),
}
"""Columns of candidates.parquet that are always there: a row a candidate."""

REQUIRED_COLUMNS = (
    *("detector", "image_id", "rank", "x0", "y0", "x1", "y1", "detector_score", "likelihood", "status"),
    *("depth_difference", "scale", "offset", f"outcome_{ALONE}"),
)
"""Columns without which a table cannot be read; the others are not in the files of older versions."""

_ADDED_COLUMNS = {
    **dict.fromkeys(("cue", "difference", "posterior", "w", "box3d"), pa.float64()),
    **dict.fromkeys(("status", "outcome"), pa.string()),
    "annotation_id": pa.int64(),
}
"""Kind of further columns by what their name begins with: ``cue_<name>`` of each part of the evidence;
``box3d_<name>`` and ``box3d_sd_<name>`` of the 3D box and its deviations, where a candidate has one;
``difference_<mode>`` (D), ``posterior_<mode>``, ``w_<mode>``, ``status_<mode>``, ``outcome_<mode>`` and
``annotation_id_<mode>`` of each mode but that of the paper."""

_VIEW_COLUMNS = {"view_bin": pa.string(), "view_probability": pa.float64(), "second_view": pa.string()}
"""Columns of what the fitted instance says of the view, where a candidate has one."""

_STAND_INS = {
    "posterior": score_column(ALONE),
    "outcome": f"outcome_{ALONE}",
    "annotation_id": f"annotation_id_{ALONE}",
}
"""What a column of a mode holds for a detector that was not rescored in it, by what its name begins with;
else NaN, or no status."""


def detector_columns(
    own: Sequence[DetectionFile],
    alone: MatchTable,
    matched: Mapping[Registration, MatchTable],
    kind: NDArray[np.object_],
) -> dict[str, NDArray[Any]]:
    """The columns of one detector with all its modes, a row a candidate.

    Args:
        own: its files, that of eq. 6 first; all hold the same candidates.
        alone: the match table of the raw scores.
        matched: the match table of each mode.
        kind: what fills most of the box of each candidate, shape (n,).
    """
    t = own[0].table
    # a file that was not rescored has no D, so it may stand for that of eq. 6
    file = next((f for f in own if f.registration is Registration.PAPER), None)
    posterior = file.posterior if file is not None and file.posterior is not None else t.likelihood
    w = np.nan if file is None or file.w is None else file.w
    paper = matched.get(Registration.PAPER, alone)
    numbers = {name: getattr(t, name) for name in NUMBERS}
    if file is None:
        # D of another mode is in a column of its own
        numbers["depth_difference"] = np.full(len(t), np.nan)
    columns = {
        "detector": np.full(len(t), own[0].detector, dtype=object),
        "image_id": t.image_id,
        "rank": t.rank,
        **dict(zip(("x0", "y0", "x1", "y1"), t.xyxy_px.T, strict=True)),
        "detector_score": t.score,
        "likelihood": t.likelihood,
        "status": t.status,
        "reason_detail": t.reason_detail,
        **numbers,
        "posterior_paper": posterior,
        "w": np.full(len(t), w),
        f"outcome_{ALONE}": _names(alone),
        "outcome_paper": _names(paper),
        f"annotation_id_{ALONE}": alone.annotation_id,
        "annotation_id_paper": paper.annotation_id,
        **{f"cue_{name}": column for name, column in zip(CUES, t.cues.T, strict=True)},
    }
    for other in own:
        if other.registration in matched and other.registration is not Registration.PAPER:
            columns |= _mode_columns(other, matched[other.registration])
    return columns | _box3d_columns(own) | _view_columns(own) | {"kind": kind}


def _view_columns(own: Sequence[DetectionFile]) -> dict[str, NDArray[Any]]:
    """The views of the first file that tells some; no column where none does."""
    table = next((f.table for f in own if f.table.view_bin.any()), None)
    return {} if table is None else {name: getattr(table, name) for name in _VIEW_COLUMNS}


def _box3d_columns(own: Sequence[DetectionFile]) -> dict[str, NDArray[Any]]:
    """The 3D boxes of the first file that has some; no column where none has."""
    boxes3d = next((f.table.boxes3d for f in own if f.table.boxes3d is not None), None)
    if boxes3d is None:
        return {}
    columns = dict(zip((f"box3d_{name}" for name in BOX_NAMES), boxes3d.values.T, strict=True))
    if boxes3d.deviations is None:
        return columns
    return columns | dict(zip((f"box3d_sd_{name}" for name in BOX_NAMES), boxes3d.deviations.T, strict=True))


def _mode_columns(file: DetectionFile, match: MatchTable) -> dict[str, NDArray[Any]]:
    mode = file.registration.value
    assert file.posterior is not None
    return {
        f"difference_{mode}": file.table.depth_difference,
        f"status_{mode}": file.table.status,
        score_column(mode): file.posterior,
        f"w_{mode}": np.full(len(file.table), np.nan if file.w is None else file.w),
        f"outcome_{mode}": _names(match),
        f"annotation_id_{mode}": match.annotation_id,
    }


def _names(match: MatchTable) -> NDArray[np.object_]:
    return np.array([o.value for o in OUTCOMES], dtype=object)[match.outcome]


def joined(parts: Sequence[Columns]) -> dict[str, NDArray[Any]]:
    """The columns of several detectors below each other; where only others have a mode, its stand-ins."""
    names = dict.fromkeys(name for p in parts for name in p)
    return {name: stacked([_column(p, name) for p in parts]) for name in names}


def _column(part: Columns, name: str) -> NDArray[Any]:
    """A column of one detector; where only others have the mode, what it would be without rescoring."""
    if name in part:
        return part[name]
    start = name.rpartition("_")[0]
    if start in _STAND_INS:
        return part[_STAND_INS[start]]
    n = len(part["image_id"])
    text = start == "status" or _VIEW_COLUMNS.get(name) == pa.string()
    return np.full(n, NOT_RESCORED, dtype=object) if text else np.full(n, np.nan)


def parts_schema(modes: Iterable[str]) -> pa.Schema:
    """Columns of candidates in parts, of a run with some modes: all that candidates.parquet may have."""
    own = [m for m in modes if m not in {ALONE, Registration.PAPER}]
    solid = (f"box3d_{kind}{name}" for kind in ("", "sd_") for name in BOX_NAMES)
    starts = ("difference", "posterior", "w", "status", "outcome", "annotation_id")
    return pa.schema(
        CANDIDATE_COLUMNS
        | {f"cue_{name}": pa.float64() for name in CUES}
        | {f"{start}_{mode}": _ADDED_COLUMNS[start] for mode in own for start in starts}
        | dict.fromkeys(solid, pa.float64())
        | _VIEW_COLUMNS
    )


def arrow_rows(columns: Columns, schema: pa.Schema) -> pa.Table:
    """The candidates of a detector as a table; numbers that there are none of are null."""
    n = len(columns["image_id"])
    modes = {f.name for f in schema if f.name.rpartition("_")[0] in _STAND_INS}
    filled = [
        pa.array(_column(columns, f.name), f.type, from_pandas=True)
        if f.name in columns or f.name in modes
        else pa.nulls(n, f.type)
        for f in schema
    ]
    return pa.table(filled, schema=schema)


def write_candidates(path: Path, columns: Mapping[str, Any]) -> None:
    """Write candidates.parquet.

    Raises:
        ValueError: a column of ``CANDIDATE_COLUMNS`` is missing, or one is unknown.
    """
    kinds = CANDIDATE_COLUMNS | {name: kind for name, kind in _VIEW_COLUMNS.items() if name in columns}
    for name in columns:
        for start, kind in _ADDED_COLUMNS.items():
            if name.startswith(f"{start}_"):
                kinds.setdefault(name, kind)
    if set(columns) != set(kinds):
        raise ValueError(f"candidates: columns differ: {sorted(set(columns) ^ set(kinds))}")
    schema = pa.schema(list(kinds.items()))
    n = len(columns["image_id"])
    with atomic_path(path) as beside, pq.ParquetWriter(beside, schema, compression="zstd") as writer:
        # some rows at a time: columns that no candidate fills take no memory before
        for i in range(0, max(n, 1), ROWS_AT_A_TIME):
            part = {k: pa.array(columns[k][i : i + ROWS_AT_A_TIME], type=kind) for k, kind in kinds.items()}
            writer.write_table(pa.table(part, schema=schema))


def read_candidates(path: Path, needed: Iterable[str] = tuple(CANDIDATE_COLUMNS)) -> dict[str, NDArray[Any]]:
    """The columns of candidates.parquet as arrays of one length.

    Raises:
        RescoreError: no such file, not a table of candidates, or a column of ``needed`` is missing.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a table of candidates, found no file; run `rescore evaluate`")
    with reading(path, "a table of candidates", "run `rescore evaluate` again"):
        table = pq.read_table(path if remote(path) is None else io.BytesIO(path.read_bytes()))
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise RescoreError(
            f"{path}: expected column {missing[0]!r}, found none; run `rescore evaluate` again"
        )
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
