"""Scores and match tables read back from the columns of candidates.parquet."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray
from recon.errors import RescoreError
from rescore.files import write_table
from rescore.metrics.matching import OUTCOMES, MatchTable, ranking_of

Columns = Mapping[str, NDArray[Any]]
"""A table as arrays of one length, by column name."""

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
    **dict.fromkeys(("depth_difference", "scale", "offset", "valid_share"), pa.float64()),
    **dict.fromkeys(("stereo_low", "stereo_span", "posterior_paper", "w"), pa.float64()),
    "outcome_detector": pa.string(),
    "outcome_paper": pa.string(),
    "annotation_id_detector": pa.int64(),
    "annotation_id_paper": pa.int64(),
    "kind": pa.string(),
}
"""Columns of candidates.parquet that are always there: a row a candidate."""


_ADDED_COLUMNS = {
    **dict.fromkeys(("cue", "difference", "posterior", "w"), pa.float64()),
    **dict.fromkeys(("status", "outcome"), pa.string()),
    "annotation_id": pa.int64(),
}
"""Kind of further columns by what their name begins with: ``cue_<name>`` of each part of the evidence;
``difference_<mode>`` (D), ``posterior_<mode>``, ``w_<mode>``, ``status_<mode>``, ``outcome_<mode>`` and
``annotation_id_<mode>`` of each mode but that of the paper."""


def write_candidates(path: Path, columns: Mapping[str, Any]) -> None:
    """Write candidates.parquet.

    Raises:
        ValueError: a column of ``CANDIDATE_COLUMNS`` is missing, or one is unknown.
    """
    kinds = dict(CANDIDATE_COLUMNS)
    for name in columns:
        for start, kind in _ADDED_COLUMNS.items():
            if name.startswith(f"{start}_"):
                kinds.setdefault(name, kind)
    if set(columns) != set(kinds):
        raise ValueError(f"candidates: columns differ: {sorted(set(columns) ^ set(kinds))}")
    write_table(path, {name: pa.array(columns[name], type=kind) for name, kind in kinds.items()})


def read_candidates(path: Path, needed: Iterable[str] = tuple(CANDIDATE_COLUMNS)) -> dict[str, NDArray[Any]]:
    """The columns of candidates.parquet as arrays of one length.

    Raises:
        RescoreError: no such file, not a table of candidates, or a column of ``needed`` is missing.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a table of candidates, found no file; run `rescore evaluate`")
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise RescoreError(f"{path}: expected a table of candidates, got {error}; write it again") from error
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise RescoreError(
            f"{path}: expected column {missing[0]!r}, found none; run `rescore evaluate` again"
        )
    return {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
