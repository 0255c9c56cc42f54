"""Detections as COCO results files. Data sets: ``rescore.formats.coco_dataset``."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, compress
from pathlib import Path
from typing import Annotated, Any, Required, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat, TypeAdapter
from typing_extensions import TypedDict

from recon.arrays import FloatArray, IntArray, constant, rows_of, stacked
from recon.boxes import xywh_from_xyxy, xyxy_from_xywh
from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet
from rescore.evidence.candidates import NOT_RESCORED, NUMBERS, Candidates, CandidateTable, RescoredTable
from rescore.evidence.cues import CUES
from rescore.evidence.registration import Registration
from rescore.files import refuse_unsafe_name
from rescore.formats.checked_json import Box, Box3D, Box3DDeviations, Number, Rows
from rescore.formats.json_lists import read_pieces
from rescore.formats.labels import ClassMap, flat_note, has_size, refuse_other_form

MAX_CANDIDATES = 15
"""The report keeps the 15 highest-scoring candidates of an image."""

ROUNDING = 1e-6
"""What single precision may put a probability beyond 0 or 1."""


Text = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
"""A text without control characters, which could steer a terminal."""


class Detection(TypedDict, total=False):
    """One detection, as files have it; ``bbox`` is left, top, width, height in pixel edges."""

    image_id: Required[Number]
    bbox: Required[Box]
    score: Required[FiniteFloat]
    category_id: Number | None
    detector: str | None
    detector_score: FiniteFloat | None
    likelihood: FiniteFloat | None
    status: Text | None
    reason_detail: Text | None
    w: FiniteFloat | None
    registration: Registration | None
    cues: dict[str, FiniteFloat]
    azimuth_deg: FiniteFloat | None
    ground: Text
    view_bin: Text
    view_probability: FiniteFloat | None
    second_view: Text
    bbox3d: Box3D | None
    bbox3d_sd: Box3DDeviations | None


_WithNumbers = TypedDict(  # type: ignore[misc]
    "_WithNumbers",
    get_type_hints(Detection, include_extras=True) | dict.fromkeys(NUMBERS, FiniteFloat | None),
    total=False,
)
"""A detection with the numbers of the depth evidence, as COCO files have it."""
_DETECTIONS: TypeAdapter[list[Detection]] = TypeAdapter[Any](Rows[_WithNumbers])


def checked_detections(rows: list[Detection]) -> list[Detection]:
    """Detections that another reader made, checked as those of files are.

    Raises:
        ValidationError: a number out of range.
    """
    return _DETECTIONS.validate_python(rows)


@dataclass(frozen=True, eq=False)
class DetectionFile:
    """The detections of one detector on the images of a data set, rescored or not."""

    detector: str
    """Name for tables: the key ``detector`` of the file, or its file name."""
    table: CandidateTable
    posterior: FloatArray | None
    """The file's ``score`` where it was rescored, shape (n,); None where it was not."""
    w: float | None
    """Weight of eq. 7 that made the posterior."""
    registration: Registration
    """Mode that made the posterior; ``PAPER`` where the file does not say."""
    n_beyond_max: int
    """Detections left out because their image has ``max_candidates`` better ones."""
    notes: tuple[str, ...] = ()
    """What the reader left out or mapped otherwise, a line each, for the user to see."""

    def candidates(self, data: DataSet) -> dict[int, Candidates]:
        """Candidates of every image, empty where none was found.

        Raises:
            RescoreError: likelihoods are unknown.
        """
        if np.isnan(self.table.likelihood).any():
            low, high = self.table.score.min(), self.table.score.max()
            raise RescoreError(
                f"detections of {self.detector}: expected likelihoods, or scores in [0, 1] to be taken as "
                f"such, got scores from {low:g} to {high:g}; map them to likelihoods, "
                "as by Platt scaling on labelled frames, or write a 'likelihood' for each"
            )
        rows: dict[int, list[int]] = {f.image_id: [] for f in data.frames}
        for row, image_id in enumerate(self.table.image_id.tolist()):
            rows[image_id].append(row)
        return {i: self.table.candidates(i, r) for i, r in rows.items()}


def read_detections(
    path: Path,
    data: DataSet,
    max_candidates: int | None = MAX_CANDIDATES,
    classes: ClassMap | None = None,
) -> DetectionFile:
    """The detections of a COCO results file, best raw score first in each image (ties in the file's order).

    The raw score is ``detector_score`` where there is one (a rescored file), else ``score``. Where no
    likelihood is given, scores that all lie in [0, 1] are taken as likelihoods; other scores leave them NaN.

    Detections without a category, of a category of the truth, and of one that ``classes`` maps to the class
    are read; others, and boxes of no size, are left out, and ``notes`` of the result counts them.

    Raises:
        RescoreError: the file is missing, has another shape, names an unknown image, or holds no usable
        number.
    """
    classes = classes or ClassMap(data.category, data.renamed, of_several=True)
    pieces = read_pieces(path, _DETECTIONS, "detections as a list in COCO's results form")
    names = Counter(dict.fromkeys(data.category_names.values(), 0))
    file = detection_file(path, _counted(pieces, data, names), data, max_candidates, classes)
    return replace(file, notes=(*file.notes, *classes.notes(path, names)))


def _counted(
    pieces: Iterable[list[Detection]], data: DataSet, names: Counter[str]
) -> Iterator[list[Detection]]:
    """The pieces as they are; as they pass, ``names`` counts the detections of each class."""
    for piece in pieces:
        ids = Counter([d.get("category_id") for d in piece])
        names.update({_category_name(i, data): n for i, n in ids.items() if i is not None})
        yield piece


def detection_file(
    path: Path,
    pieces: Iterable[Sequence[Detection]],
    data: DataSet,
    max_candidates: int | None,
    classes: ClassMap,
) -> DetectionFile:
    """Detections of any form, checked and ordered as ``read_detections`` does; ``path`` names them.

    Raises:
        RescoreError: as there.
    """
    images, parts, n = np.array([f.image_id for f in data.frames], dtype=np.int64), [], 0
    first: int | None = None
    for piece in pieces:
        first = piece[0].get("category_id") if not n and piece else first
        part = _part(path, n, piece, images, data, classes)
        # the best of all are among the best of each piece
        parts.append(part.take(np.sort(_best_rows(part.table, images, max_candidates)[0])))
        n += len(piece)
    n_ours, n_flat = sum(p.n_ours for p in parts), sum(p.n_flat for p in parts)
    if n and not n_ours:
        raise _another_class(path, first, data)
    joined = _Part.joined(parts)
    # as large as what is joined
    parts.clear()
    _refuse_other_form(path, joined.table, data)
    rows, rank = _best_rows(joined.table, images, max_candidates)
    kept = joined.take(rows)
    del joined
    rescored = len(rows) > 0 and bool((kept.table.status != NOT_RESCORED).all())
    weights = np.unique(kept.w)
    detector = kept.detector or path.stem
    refuse_unsafe_name(path, "the name of a detector", detector)
    return DetectionFile(
        detector=detector,
        table=replace(kept.table, rank=rank, likelihood=_likelihood(kept.table)),
        posterior=kept.shown if rescored else None,
        w=float(weights[0]) if rescored and len(weights) == 1 and np.isfinite(weights[0]) else None,
        registration=kept.registration or Registration.PAPER,
        n_beyond_max=n_ours - n_flat - len(rows),
        notes=flat_note(path, n_flat),
    )


def _refuse_other_form(path: Path, table: CandidateTable, data: DataSet) -> None:
    size_px = {f.image_id: (f.width_px, f.height_px) for f in data.frames}
    sizes_px = np.array([size_px[i] for i in table.image_id.tolist()], float).reshape(-1, 2)
    refuse_other_form(path, table.xyxy_px, sizes_px)


@dataclass(frozen=True, eq=False)
class _Part:
    """Some detections of the class, in the order of the file."""

    table: CandidateTable
    shown: FloatArray
    """The scores of the file, the posteriors where it was rescored, shape (n,)."""
    w: FloatArray
    """Shape (n,), NaN where unknown."""
    detector: str | None
    registration: Registration | None
    n_ours: int
    """Detections of the class, those of no size too."""
    n_flat: int
    """Detections of the class that have no size and are left out."""

    def take(self, rows: IntArray) -> "_Part":
        """The rows of an index, with all else as it is."""
        return replace(self, table=self.table.take(rows), shown=self.shown[rows], w=rows_of(self.w, rows))

    @staticmethod
    def joined(parts: "Sequence[_Part]") -> "_Part":
        return _Part(
            CandidateTable.concatenate([p.table for p in parts]),
            np.concatenate([np.zeros(0), *(p.shown for p in parts)]),
            stacked([np.zeros(0), *(p.w for p in parts)]),
            next((p.detector for p in parts if p.detector), None),
            next((p.registration for p in parts if p.registration), None),
            sum(p.n_ours for p in parts),
            sum(p.n_flat for p in parts),
        )


def _part(
    path: Path,
    n_before: int,
    found: Sequence[Detection],
    images: IntArray,
    data: DataSet,
    classes: ClassMap,
) -> _Part:
    """The detections of the class among those of a file that come after ``n_before`` others.

    Raises:
        RescoreError: one can be none of this data set.
    """
    keys: set[str] = set().union(*found)
    category = [d.get("category_id") for d in found]
    takes = {i: _takes(i, data, classes) for i in set(category)}
    ours = np.fromiter(map(takes.__getitem__, category), bool, len(found))
    xywh_px = np.fromiter(chain.from_iterable([d["bbox"] for d in found]), float, 4 * len(found))
    xywh_px = xywh_px.reshape(-1, 4)
    image_id = np.array([d["image_id"] for d in found], dtype=np.int64)
    known = np.isin(image_id, images)
    for i in range(len(found)) if keys & _CHECKED else np.flatnonzero(~known).tolist():
        _check_detection(path, n_before + i, found[i], known=bool(known[i]))
    sized = ours.copy()
    for i in np.flatnonzero(ours & (xywh_px[:, 2:] < 1e-6).any(axis=1)).tolist():
        sized[i] = has_size(path, f"detection {n_before + i}", xywh_px[i].tolist())
    kept = list(compress(found, sized.tolist()))
    shown = np.array([d["score"] for d in kept], dtype=float)
    return _Part(
        table=_table(kept, keys, image_id[sized], xywh_px[sized], shown),
        shown=shown,
        w=_column("w", kept, keys),
        detector=_first(kept, "detector", keys),
        registration=_first(kept, "registration", keys),
        n_ours=int(ours.sum()),
        n_flat=int(ours.sum()) - len(kept),
    )


def _first(rows: Sequence[Detection], name: str, keys: set[str]) -> Any:
    """The first value of a key that is not empty; None where there is none."""
    return next((value for d in rows if (value := d.get(name))), None) if name in keys else None


def _takes(category_id: int | None, data: DataSet, classes: ClassMap) -> bool:
    """Whether a detection of a category counts as one of the class."""
    if category_id is None:
        return True
    name = _category_name(category_id, data)
    if name.casefold() in classes.renamed:
        return classes.takes(name)
    return category_id == data.category_id or category_id in data.class_ids or classes.takes(name)


def _category_name(category_id: int | None, data: DataSet) -> str:
    """The name of a category; its number where the data set does not name it."""
    if category_id is None or category_id == data.category_id:
        return data.category
    return data.category_names.get(category_id, str(category_id))


def _another_class(path: Path, category_id: int | None, data: DataSet) -> RescoreError:
    name = _category_name(category_id, data)
    told = "" if name.isdecimal() else f" ({name!r})"
    return RescoreError(
        f"{path}: expected detections of category_id {data.category_id} ({data.category!r}), got only "
        f"{category_id}{told}; take it for the class with --map {name}={data.category}, or give detections "
        "of the class"
    )


OTHER_SPLIT = "give those of this split, or name theirs by --split where the command has it"
"""What helps where detections have images that the data set, cut to a split, lacks."""
_CHECKED = {"bbox3d_sd", "likelihood"}
"""Keys whose values ``_check_detection`` looks at."""


def _check_detection(path: Path, number: int, d: Detection, *, known: bool) -> None:
    """Raises RescoreError where a detection can be none of this data set; ``known``: is its image one?"""
    if not known:
        raise RescoreError(
            f"{path}: detection {number}: expected an image of the data set, got image_id {d['image_id']}; "
            f"{OTHER_SPLIT}; `rescore import DATA --out NEW` writes the id of each picture to "
            "NEW/annotations.json"
        )
    if d.get("bbox3d_sd") is not None and d.get("bbox3d") is None:
        raise RescoreError(
            f"{path}: detection {number}: expected bbox3d beside bbox3d_sd, got none; write both or neither"
        )
    likelihood = d.get("likelihood")
    if likelihood is not None and not -ROUNDING <= likelihood <= 1 + ROUNDING:
        raise RescoreError(
            f"{path}: detection {number}: expected a likelihood in [0, 1], got {likelihood}; "
            "calibrate the scores"
        )


def _best_rows(table: CandidateTable, images: IntArray, most: int | None) -> tuple[IntArray, IntArray]:
    """Rows of the best raw scores of each image, images in their order, and the rank of each in its image."""
    by_id = np.argsort(images, kind="stable")
    image = by_id[np.searchsorted(images, table.image_id, sorter=by_id)] if len(table) else table.image_id
    order = np.lexsort((np.arange(len(table)), -table.score, image))
    rank = np.arange(len(order)) - np.searchsorted(image[order], image[order], side="left")
    kept = rank < (len(order) if most is None else most)
    return order[kept], rank[kept]


def _likelihood(table: CandidateTable) -> FloatArray:
    """Likelihoods (n,) of a table: the scores themselves where it has none and they could be some."""
    score = table.score
    if np.isnan(table.likelihood).all() and ((score >= -ROUNDING) & (score <= 1 + ROUNDING)).all():
        return np.clip(score, 0, 1)
    return table.likelihood


def _column(name: str, rows: Sequence[Detection], keys: set[str]) -> FloatArray:
    """Numbers of the rows (n,), NaN where one has none; ``keys`` are those that some row has."""
    if name not in keys:
        return constant(np.nan, (len(rows),))
    return np.array([np.nan if (v := d.get(name)) is None else v for d in rows], dtype=float)


def _texts(name: str, rows: Sequence[Detection], keys: set[str]) -> NDArray[np.object_]:
    """Texts of the rows (n,), empty where one has none."""
    if name not in keys:
        return constant("", (len(rows),), object)
    return np.array([d.get(name) or "" for d in rows], dtype=object)


def _table(
    rows: Sequence[Detection], keys: set[str], image_id: IntArray, xywh_px: FloatArray, shown: FloatArray
) -> CandidateTable:
    """The rows in their order, of rank 0 all; columns that are made already come beside them."""
    n = len(rows)
    raw = _column("detector_score", rows, keys)
    cues = constant(np.nan, (n, len(CUES)))
    if "cues" in keys:
        told = [[d.get("cues", {}).get(name, np.nan) for name in CUES] for d in rows]
        cues = np.array(told, dtype=float).reshape(-1, len(CUES))
    return CandidateTable(
        image_id=image_id,
        rank=constant(0, (n,), np.int64),
        xyxy_px=xyxy_from_xywh(xywh_px),
        score=np.where(np.isnan(raw), shown, raw),
        likelihood=np.clip(_column("likelihood", rows, keys), 0, 1),
        **{name: _column(name, rows, keys) for name in NUMBERS},
        status=_texts("status", rows, keys),
        reason_detail=_texts("reason_detail", rows, keys),
        cues=cues,
        azimuth_deg=_column("azimuth_deg", rows, keys),
        ground=_texts("ground", rows, keys),
        view_bin=_texts("view_bin", rows, keys),
        view_probability=_column("view_probability", rows, keys),
        second_view=_texts("second_view", rows, keys),
        boxes3d=Boxes3D.of_rows([d.get("bbox3d") for d in rows], [d.get("bbox3d_sd") for d in rows])
        if "bbox3d" in keys
        else None,
    )


def write_detections(path: Path, detector: str, table: CandidateTable, data: DataSet) -> None:
    """Write raw detections: ``score`` is the raw one, with ``likelihood`` beside it where it is known."""
    rows = [
        {**base, "score": float(s), "detector": detector}
        | ({} if np.isnan(lik) else {"likelihood": float(lik)})
        for base, s, lik in zip(_boxes(table, data), table.score, table.likelihood, strict=True)
    ]
    _write_rows(path, rows)


def write_rescored(
    path: Path, detector: str, rescored: RescoredTable, data: DataSet, *, w: float, registration: Registration
) -> None:
    """Write rescored detections: ``score`` is the posterior, and what led to it lies beside it.

    Numbers of a candidate without depth evidence are null; its ``status`` says why. ``cues`` holds the parts
    of the evidence that it has, ``ground`` says where the ground plane of its frame came from, and
    ``view_bin``, ``view_probability`` and ``second_view`` what the fitted instance says of the view.
    """
    table, posterior = rescored.candidates, rescored.posterior
    columns: Mapping[str, FloatArray] = {name: getattr(table, name) for name in ("likelihood", *NUMBERS)}
    rows = []
    for i, base in enumerate(_boxes(table, data)):
        values = {name: float(column[i]) for name, column in columns.items()}
        rows.append(
            base
            | {"score": float(posterior[i]), "detector": detector, "detector_score": float(table.score[i])}
            | {name: None if np.isnan(v) else v for name, v in values.items()}
            | {"status": table.status[i], "reason_detail": table.reason_detail[i], "w": w}
            | {"registration": registration.value, "cues": _known_cues(table.cues[i])}
            | {"ground": table.ground[i]}
            | _view(table, i)
        )
    _write_rows(path, rows)


def _known_cues(cues: FloatArray) -> dict[str, float]:
    return {name: float(v) for name, v in zip(CUES, cues, strict=True) if np.isfinite(v)}


def _view(table: CandidateTable, i: int) -> dict[str, object]:
    """What a row says of the side from which the object is seen; nothing where no instance was fitted."""
    if not table.view_bin[i]:
        return {}
    told = {"view_bin": table.view_bin[i], "second_view": table.second_view[i]}
    return told | {"view_probability": float(table.view_probability[i])}


def _boxes(table: CandidateTable, data: DataSet) -> list[dict[str, object]]:
    boxes = xywh_from_xyxy(table.xyxy_px).tolist()
    boxes3d = Boxes3D.filled(table.boxes3d, len(table))
    return [
        {"image_id": int(i), "category_id": data.category_id, "bbox": box}
        | ({} if np.isnan(azimuth) else {"azimuth_deg": float(azimuth)})
        | ({} if np.isnan(box3d).any() else {"bbox3d": box3d.tolist()})
        | ({} if np.isnan(deviations).any() else {"bbox3d_sd": deviations.tolist()})
        for i, box, azimuth, box3d, deviations in zip(
            table.image_id, boxes, table.azimuth_deg, boxes3d.values, boxes3d.deviations_or_nan, strict=True
        )
    ]


def _write_rows(path: Path, rows: list[dict[str, object]]) -> None:
    """One detection a line, so that files can be read and compared by eye."""
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    with atomic_path(path) as beside:
        beside.write_text(f"[\n{lines}\n]\n" if rows else "[]\n", encoding="utf-8")
