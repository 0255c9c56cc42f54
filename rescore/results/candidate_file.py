"""The table of candidates: the columns of candidates.parquet, how they are filled, and how they are read.

A column that an evaluation adds is named here alone. The numbers of the depth evidence are those of
``rescore.evidence.candidates.NUMBERS``.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray, constant, is_constant, stacked
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import reading
from recon.stores import remote
from rescore.data.boxes3d import BOX_NAMES
from rescore.evidence.candidates import NOT_RESCORED, NUMBERS
from rescore.evidence.cues import CUES
from rescore.evidence.registration import Registration
from rescore.formats.coco import DetectionFile
from rescore.formats.parts.candidates import columns_of
from rescore.formats.parts.forms import CORNERS
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


class Outcomes(Protocol):
    """What became of candidates: match tables, and what has no more of them."""

    @property
    def outcome(self) -> NDArray[np.int8]:
        """Index into ``OUTCOMES``, shape (n,)."""

    @property
    def annotation_id(self) -> IntArray:
        """As in match tables, shape (n,)."""


@dataclass(frozen=True, eq=False)
class Given:
    """The candidates of one detector in one mode as they come to an evaluation."""

    detector: str
    mode: Registration | None
    """None where nothing was rescored."""
    w: float | None
    rows: Mapping[str, Any]
    """Columns named as in parts of detections: arrays, or columns of Arrow."""

    @staticmethod
    def of(file: DetectionFile) -> "Given":
        """The candidates of a file."""
        mode = None if file.posterior is None else file.registration
        return Given(file.detector, mode, file.w, columns_of(file.table, file.posterior))


def detector_columns(
    own: Sequence[Given],
    alone: Outcomes,
    matched: Mapping[Registration, Outcomes],
    kind: NDArray[np.object_],
) -> dict[str, Any]:
    """The columns of one detector with all its modes, a row a candidate.

    Args:
        own: its candidates as they come, those of eq. 6 first; the same ones in each mode.
        alone: what became of them by the raw scores.
        matched: what became of them in each mode.
        kind: what fills most of the box of each candidate, shape (n,).
    """
    rows, n = own[0].rows, len(kind)
    # what was not rescored has no D, so it may stand for eq. 6
    file = next((g for g in own if g.mode in {Registration.PAPER, None}), None)
    paper = matched.get(Registration.PAPER, alone)
    columns = {
        "detector": constant(own[0].detector, (n,), object),
        **{name: rows[name] for name in _GIVEN},
        **{name: rows[name] for name in NUMBERS},
        "posterior_paper": (file or own[0]).rows[_posterior(file)],
        "w": _weights(file, n),
        f"outcome_{ALONE}": _names(alone),
        "outcome_paper": _names(paper),
        f"annotation_id_{ALONE}": alone.annotation_id,
        "annotation_id_paper": paper.annotation_id,
        **{f"cue_{name}": rows[f"cue_{name}"] for name in CUES},
    }
    if file is None:
        # D of another mode is in a column of its own
        columns["depth_difference"] = constant(np.nan, (n,))
    for other in own:
        if other.mode is not None and other.mode is not Registration.PAPER:
            columns |= _mode_columns(other, matched[other.mode])
    return columns | _of_first(own, _BOX_COLUMNS) | _of_first(own, tuple(_VIEW_COLUMNS)) | {"kind": kind}


_GIVEN = ("image_id", "rank", *CORNERS, "detector_score", "likelihood", "status", "reason_detail")
_BOX_COLUMNS = tuple(f"box3d_{kind}{name}" for kind in ("", "sd_") for name in BOX_NAMES)


def _posterior(given: Given | None) -> str:
    return "likelihood" if given is None or given.mode is None else "posterior"


def _weights(given: Given | None, n: int) -> FloatArray:
    return constant(np.nan if given is None or given.w is None else given.w, (n,))


def _of_first(own: Sequence[Given], names: Sequence[str]) -> dict[str, Any]:
    """Columns of the first mode in which a candidate fills the first of them; none where it is nowhere."""
    rows = next((g.rows for g in own if _filled(g.rows.get(names[0]))), {})
    return {name: rows[name] for name in names if name in rows}


def _filled(column: Any) -> bool:
    """Whether a candidate fills a column: with a number, or a text that is not empty."""
    if column is None:
        return False
    if isinstance(column, np.ndarray):
        return bool((column != "").any() if column.dtype.kind in "OU" else not np.isnan(column).all())
    if pa.types.is_string(column.type):
        return bool(pc.any(pc.not_equal(column, "")).as_py())
    return bool(column.null_count < len(column))


def _mode_columns(given: Given, match: Outcomes) -> dict[str, Any]:
    assert given.mode is not None
    mode = given.mode.value
    return {
        f"difference_{mode}": given.rows["depth_difference"],
        f"status_{mode}": given.rows["status"],
        score_column(mode): given.rows["posterior"],
        f"w_{mode}": _weights(given, len(match.outcome)),
        f"outcome_{mode}": _names(match),
        f"annotation_id_{mode}": match.annotation_id,
    }


def _names(match: Outcomes) -> NDArray[np.object_]:
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


def arrow_rows(columns: Mapping[str, Any], schema: pa.Schema) -> pa.Table:
    """The candidates of a detector as a table; numbers that there are none of are null."""
    n = len(columns["image_id"])
    modes = {f.name for f in schema if f.name.rpartition("_")[0] in _STAND_INS}
    filled = [
        _arrow(_column(columns, f.name), f.type)
        if f.name in columns or f.name in modes
        else pa.nulls(n, f.type)
        for f in schema
    ]
    return pa.table(filled, schema=schema)


def _arrow(column: Any, kind: pa.DataType) -> Any:
    if not isinstance(column, np.ndarray):
        return column
    if is_constant(column):
        return pa.repeat(pa.scalar(column[0], kind, from_pandas=True), len(column))
    return pa.array(column, kind, from_pandas=True)


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
