"""Detections as COCO results files. Data sets: ``rescore.formats.coco_dataset``."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, FiniteFloat, TypeAdapter, create_model

from recon.arrays import FloatArray
from recon.boxes import xywh_from_xyxy, xyxy_from_xywh
from recon.errors import RescoreError
from recon.files import atomic_path
from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet
from rescore.evidence.candidates import NOT_RESCORED, NUMBERS, Candidates, CandidateTable, RescoredTable
from rescore.evidence.cues import CUES
from rescore.evidence.registration import Registration
from rescore.files import refuse_unsafe_name
from rescore.formats.checked_json import Box, Box3D, Box3DDeviations, Number, read_checked
from rescore.formats.labels import ClassMap, flat_note, has_size

MAX_CANDIDATES = 15
"""The report keeps the 15 highest-scoring candidates of an image."""

ROUNDING = 1e-6
"""What single precision may put a probability beyond 0 or 1."""


Text = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
"""A text without control characters, which could steer a terminal."""


class Detection(BaseModel):
    """One detection, as files have it; ``bbox`` is left, top, width, height in pixel edges."""

    image_id: Number
    bbox: Box
    score: FiniteFloat
    category_id: Number | None = None
    detector: str | None = None
    detector_score: FiniteFloat | None = None
    likelihood: FiniteFloat | None = None
    status: Text | None = None
    reason_detail: Text | None = None
    w: FiniteFloat | None = None
    registration: Registration | None = None
    cues: dict[str, FiniteFloat] = {}
    azimuth_deg: FiniteFloat | None = None
    ground: Text = ""
    view_bin: Text = ""
    view_probability: FiniteFloat | None = None
    second_view: Text = ""
    bbox3d: Box3D | None = None
    bbox3d_sd: Box3DDeviations | None = None


_NUMBERS: dict[str, Any] = dict.fromkeys(NUMBERS, (FiniteFloat | None, None))
_WithNumbers = create_model("_WithNumbers", __base__=Detection, **_NUMBERS)
"""A detection with the numbers of the depth evidence, as COCO files have it."""
_DETECTIONS = TypeAdapter[list[Detection]](list[_WithNumbers])  # type: ignore[valid-type]


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
                f"such, got scores from {low:g} to {high:g}; calibrate them (`rescore train` fits Platt "
                "scaling) or write a 'likelihood' for each"
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
    found = read_checked(path, _DETECTIONS, "detections as a list in COCO's results form")
    classes = classes or ClassMap(data.category, data.renamed, of_several=True)
    file = detection_file(path, found, data, max_candidates, classes)
    counts = Counter(dict.fromkeys(data.category_names.values(), 0))
    counts.update(_category_name(d.category_id, data) for d in found if d.category_id is not None)
    return replace(file, notes=(*file.notes, *classes.notes(path, counts)))


def detection_file(
    path: Path, found: list[Detection], data: DataSet, max_candidates: int | None, classes: ClassMap
) -> DetectionFile:
    """Detections of any form, checked and ordered as ``read_detections`` does; ``path`` names them.

    Raises:
        RescoreError: as there.
    """
    known = {f.image_id for f in data.frames}
    ours, sized = 0, []
    for number, d in enumerate(found):
        counts = _takes(d.category_id, data, classes)
        ours += counts
        if _check_detection(path, number, d, known, counts=counts):
            sized.append(d)
    if found and not ours:
        other = found[0].category_id
        name = _category_name(other, data)
        raise RescoreError(
            f"{path}: expected detections of category_id {data.category_id} ({data.category!r}), got only "
            f"{other}{'' if name.isdecimal() else f' ({name!r})'}; take it for the class with --map "
            f"{name}={data.category}, or give detections of the class"
        )
    kept = _best_of_each_image(sized, data, max_candidates)
    rescored = bool(kept) and all(d.status for d, _ in kept)
    weights = {d.w for d, _ in kept}
    detector = (kept[0][0].detector if kept else None) or path.stem
    refuse_unsafe_name(path, "the name of a detector", detector)
    return DetectionFile(
        detector=detector,
        table=_table(kept),
        posterior=np.array([d.score for d, _ in kept]) if rescored else None,
        w=weights.pop() if rescored and len(weights) == 1 else None,
        registration=(kept[0][0].registration if kept else None) or Registration.PAPER,
        n_beyond_max=len(sized) - len(kept),
        notes=flat_note(path, ours - len(sized)),
    )


def _takes(category_id: int | None, data: DataSet, classes: ClassMap) -> bool:
    """Whether a detection of a category counts as one of the class."""
    if category_id is None or category_id == data.category_id or category_id in data.class_ids:
        return True
    return classes.takes(_category_name(category_id, data))


def _category_name(category_id: int | None, data: DataSet) -> str:
    """The name of a category; its number where the data set does not name it."""
    if category_id is None or category_id == data.category_id:
        return data.category
    return data.category_names.get(category_id, str(category_id))


def _check_detection(path: Path, number: int, d: Detection, known: set[int], *, counts: bool) -> bool:
    """Whether a detection is a box of the class.

    Raises:
        RescoreError: it can be none of this data set.
    """
    if d.image_id not in known:
        raise RescoreError(
            f"{path}: detection {number}: expected an image of the data set, got image_id {d.image_id}; "
            "use the detections of this data set and split"
        )
    if d.bbox3d_sd is not None and d.bbox3d is None:
        raise RescoreError(
            f"{path}: detection {number}: expected bbox3d beside bbox3d_sd, got none; write both or neither"
        )
    if d.likelihood is not None and not -ROUNDING <= d.likelihood <= 1 + ROUNDING:
        raise RescoreError(
            f"{path}: detection {number}: expected a likelihood in [0, 1], got {d.likelihood}; "
            "calibrate the scores"
        )
    return has_size(f"{path}: detection {number}", d.bbox, counts=counts) and counts


def _raw_score(d: Detection) -> float:
    return d.score if d.detector_score is None else d.detector_score


def _best_of_each_image(
    found: list[Detection], data: DataSet, max_candidates: int | None
) -> list[tuple[Detection, int]]:
    """Detections with their rank, images in the order of the data set."""
    by_image: dict[int, list[Detection]] = {f.image_id: [] for f in data.frames}
    for d in found:
        by_image[d.image_id].append(d)
    return [
        (d, rank)
        for detections in by_image.values()
        for rank, d in enumerate(sorted(detections, key=lambda d: -_raw_score(d))[:max_candidates])
    ]


def _table(kept: list[tuple[Detection, int]]) -> CandidateTable:
    def column(name: str) -> FloatArray:
        values = [getattr(d, name, None) for d, _ in kept]
        return np.array([np.nan if v is None else v for v in values], dtype=float)

    score = np.array([_raw_score(d) for d, _ in kept], dtype=float)
    likelihood = np.clip(column("likelihood"), 0, 1)
    if np.isnan(likelihood).all() and ((score >= -ROUNDING) & (score <= 1 + ROUNDING)).all():
        likelihood = np.clip(score, 0, 1)
    return CandidateTable(
        image_id=np.array([d.image_id for d, _ in kept], dtype=np.int64),
        rank=np.array([rank for _, rank in kept], dtype=np.int64),
        xyxy_px=xyxy_from_xywh(np.array([d.bbox for d, _ in kept], dtype=float).reshape(-1, 4)),
        score=score,
        likelihood=likelihood,
        **{name: column(name) for name in NUMBERS},
        status=np.array([d.status or NOT_RESCORED for d, _ in kept], dtype=object),
        reason_detail=np.array([d.reason_detail or "" for d, _ in kept], dtype=object),
        cues=np.array([[d.cues.get(name, np.nan) for name in CUES] for d, _ in kept], dtype=float).reshape(
            -1, len(CUES)
        ),
        azimuth_deg=column("azimuth_deg"),
        ground=np.array([d.ground for d, _ in kept], dtype=object),
        view_bin=np.array([d.view_bin for d, _ in kept], dtype=object),
        view_probability=column("view_probability"),
        second_view=np.array([d.second_view for d, _ in kept], dtype=object),
        boxes3d=Boxes3D.of_rows([d.bbox3d for d, _ in kept], [d.bbox3d_sd for d, _ in kept]),
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
