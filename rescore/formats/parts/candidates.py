"""Detections in parts, rescored or not: the rows of frames and candidates, and tables made of them again."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray, rows_by_value
from recon.errors import RescoreError
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet
from rescore.evidence.candidates import NUMBERS, CandidateTable
from rescore.evidence.cues import CUES
from rescore.evidence.registration import Registration
from rescore.formats.coco import OTHER_SPLIT, DetectionFile
from rescore.formats.parts.forms import BOXES3D, CANDIDATE_SCHEMA, CORNERS, DETECTIONS, DEVIATIONS, RESCORED
from rescore.formats.parts.table import Columns, Part, PartTable
from rescore.speech import counted

FRAMES_A_PART = 250
"""Frames of a part: at a tenth of a second each, half a minute's work, and some hundred kilobytes."""
OK = "ok"

_TEXTS = ("status", "reason_detail", "ground", "view_bin", "second_view")
_FLOATS = ("likelihood", *NUMBERS, "azimuth_deg", "view_probability")


@dataclass(frozen=True, eq=False)
class PartRows:
    """What a part of detections holds."""

    image_id: IntArray
    """Frames of the part, with candidates or not, shape (f,)."""
    failed: Mapping[int, str]
    """Why a frame failed, by image id."""
    table: CandidateTable
    posterior: FloatArray | None
    """Posterior of each candidate; None where nothing was rescored."""

    @property
    def groups(self) -> tuple[pa.Table, pa.Table]:
        """The rows of the frames, and those of the candidates."""
        ids = self.image_id.tolist()
        frames = {
            "image_id": pa.array(ids, pa.int64()),
            "status": pa.array(["frame_failed" if i in self.failed else OK for i in ids]),
            "reason_detail": pa.array([self.failed.get(i, "") for i in ids], pa.string()),
        }
        return _arrow(frames, len(ids)), _arrow(columns_of(self.table, self.posterior), len(self.table))


def columns_of(table: CandidateTable, posterior: FloatArray | None) -> dict[str, Any]:
    """The columns of candidates as parts have them; those that no candidate fills are left out."""
    columns: dict[str, Any] = {
        "image_id": table.image_id,
        "rank": table.rank,
        **dict(zip(CORNERS, table.xyxy_px.T, strict=True)),
        "detector_score": table.score,
        **{name: getattr(table, name) for name in (*_FLOATS, *_TEXTS)},
        **{f"cue_{name}": column for name, column in zip(CUES, table.cues.T, strict=True)},
    }
    if posterior is not None:
        columns["posterior"] = posterior
    if table.boxes3d is not None:
        columns |= dict(zip(BOXES3D, table.boxes3d.values.T, strict=True))
        if table.boxes3d.deviations is not None:
            columns |= dict(zip(DEVIATIONS, table.boxes3d.deviations.T, strict=True))
    return columns


def table_of(columns: Columns) -> CandidateTable:
    """The candidates of the columns of a part."""
    n = len(columns["image_id"])
    named = {f.name for f in fields(CandidateTable)}
    same = {name: columns[name] for name in (*_FLOATS, *_TEXTS, "rank", "image_id") if name in named}
    solid = np.stack([columns[name] for name in BOXES3D], axis=1)
    sure = np.stack([columns[name] for name in DEVIATIONS], axis=1)
    return CandidateTable(
        xyxy_px=np.stack([columns[name] for name in CORNERS], axis=1).reshape(n, 4),
        score=columns["detector_score"],
        cues=np.stack([columns[f"cue_{name}"] for name in CUES], axis=1).reshape(n, len(CUES)),
        boxes3d=None if np.isnan(solid).all() else Boxes3D.of_values(solid, sure),
        **same,
    )


def arrays_of_table(table: pa.Table) -> dict[str, NDArray[Any]]:
    """The columns of rows as arrays: what is empty is NaN, or "" of texts."""
    found = {}
    for name in table.column_names:
        column = table[name]
        if pa.types.is_string(column.type):
            found[name] = _texts(column)
        elif pa.types.is_null(column.type) or (
            pa.types.is_floating(column.type) and column.null_count == len(column)
        ):
            found[name] = np.full(len(column), np.nan)
        else:
            found[name] = column.to_numpy(zero_copy_only=False)
    return found


def _texts(column: pa.ChunkedArray) -> NDArray[np.object_]:
    """A column of texts; equal ones are one object, since most are the same few."""
    coded = pa.chunked_array(column.fill_null("").dictionary_encode()).combine_chunks()
    if isinstance(coded, pa.ChunkedArray):
        return np.zeros(0, object)
    words: NDArray[np.object_] = np.array(coded.dictionary.to_pylist(), object)
    return np.asarray(words[coded.indices.to_numpy()])


def read_rows(table: PartTable, part: Part) -> tuple[CandidateTable, FloatArray | None]:
    """The candidates of a part, and their posteriors where they were rescored."""
    columns = arrays_of_table(table.columns(part, CANDIDATE_SCHEMA.names))
    return table_of(columns), columns["posterior"] if table.kind == RESCORED else None


def read_part_detections(root: Path, data: DataSet, most: int | None) -> DetectionFile:
    """Detections in parts as those of a file, on the images of a data set, in their order.

    Raises:
        RescoreError: no such table, or it names an unknown image.
    """
    table = PartTable.read(root)
    refuse_kind(table, (DETECTIONS, RESCORED))
    found = [read_rows(table, part) for part in table.parts]
    whole = CandidateTable.concatenate([t for t, _ in found])
    rows = rows_in_order(root, whole.image_id, data)
    rows = rows if most is None else rows[whole.rank[rows] < most]
    rescored = table.kind == RESCORED
    posterior = np.concatenate([np.zeros(0), *(p for _, p in found if p is not None)])
    failed = table.n_failed
    note = f"{root}: {counted(failed, 'frame')} failed; `rescore inspect --failed` lists them"
    return DetectionFile(
        detector=str(table.said("detector")),
        table=whole.take(rows),
        posterior=posterior[rows] if rescored else None,
        w=table.about.get("w") if rescored else None,
        registration=mode_of(table),
        n_beyond_max=len(whole) - len(rows),
        notes=(note,) if failed else (),
    )


def rows_in_order(where: Path, image_id: IntArray, data: DataSet) -> IntArray:
    """The rows (n,) of candidates in the order of the frames of a data set.

    Raises:
        RescoreError: a candidate is of another image.
    """
    own = rows_by_value(image_id)
    strangers = own.keys() - {f.image_id for f in data.frames}
    if strangers:
        raise RescoreError(
            f"{where}: expected images of the data set, got image_id {min(strangers)}; {OTHER_SPLIT}, "
            "or use detections of this data set"
        )
    none = np.zeros(0, np.int64)
    return np.concatenate([none, *(own.get(f.image_id, none) for f in data.frames)])


def mode_of(table: PartTable) -> Registration:
    """The mode that a table was rescored in.

    Raises:
        RescoreError: there is no such mode.
    """
    named = table.about.get("registration", Registration.PAPER)
    if named not in list(Registration):
        raise RescoreError(
            f"{table.root}: expected candidates rescored by {', '.join(Registration)}, got {named!r}; "
            "rescore them again"
        )
    return Registration(named)


def refuse_kind(table: PartTable, kinds: Iterable[str]) -> None:
    """Raises RescoreError where a table holds other rows than one of some kinds."""
    if table.kind not in kinds:
        raise RescoreError(
            f"{table.root}: expected {' or '.join(kinds)} in parts, got {table.kind}; name another folder"
        )


def _arrow(columns: Mapping[str, Sequence[Any] | NDArray[Any]], n: int) -> pa.Table:
    # NaN is no number: queries then leave it out of their means
    filled = [
        pa.array(columns[f.name], f.type, from_pandas=True) if f.name in columns else pa.nulls(n, f.type)
        for f in CANDIDATE_SCHEMA
    ]
    return pa.table(filled, schema=CANDIDATE_SCHEMA)
