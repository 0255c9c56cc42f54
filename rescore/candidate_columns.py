"""Scores and match tables read back from the columns of candidates.parquet."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray
from recon.errors import RescoreError
from rescore.matching import OUTCOMES, MatchTable, ranking_of

Columns = Mapping[str, NDArray[Any]]
"""A table as arrays of one length, by column name."""

ALONE = "detector"
"""The mode that ranks by the raw score of the detector alone."""


def score_column(mode: str) -> str:
    """Name of the column of scores in [0, 1] of a mode: that of l, or of the posterior."""
    return "likelihood" if mode == ALONE else f"posterior_{mode}"


def of_mode(rows: Columns, name: str, mode: str) -> NDArray[Any]:
    """Column ``<name>_<mode>``, or that of the detector alone where the table has none of this mode."""
    own = f"{name}_{mode}"
    return rows[own if own in rows else f"{name}_{ALONE}"]


def difference(rows: Columns, mode: str) -> FloatArray:
    """D of every candidate (n,) in a mode; that of eq. 6 where the table has no other. NaN where none."""
    own = f"difference_{mode}"
    return np.asarray(rows[own if own in rows else "depth_difference"], float)


def status(rows: Columns, mode: str) -> NDArray[Any]:
    """Status of every candidate (n,) in a mode; that of eq. 6 where the table has no other."""
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
