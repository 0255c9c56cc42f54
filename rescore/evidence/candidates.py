"""Candidates of one frame, and tables of many frames' candidates with depth evidence and posterior."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray, IntArray, rows_by_value, rows_of, stacked
from recon.errors import Failure, RescoreError
from rescore.data.boxes3d import Boxes3D
from rescore.evidence.align_depth import DepthAlignment
from rescore.evidence.cues import CUES

OK = "ok"
"""Status of a candidate with depth evidence; else the status is a ``recon.errors.Reason``."""
NOT_RESCORED = ""
"""Status of a candidate that no rescoring has looked at."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """At most 15 detections of one image, best detector score first."""

    image_id: int
    xyxy_px: FloatArray
    """Boxes b_i, shape (n, 4), pixel edges."""
    score: FloatArray
    """Raw detector score, shape (n,); any range."""
    likelihood: FloatArray
    """l_i in [0, 1], shape (n,): the score after Platt scaling."""
    azimuth_deg: FloatArray | None = None
    """Azimuth from which the detector sees the object (see ``rescore.data.frames.Truth``), shape (n,), NaN
    where unknown; None where it never says."""
    boxes3d: Boxes3D | None = None
    """The 3D box of each, NaN rows where there is none; None where no detection has one."""

    def __post_init__(self) -> None:
        n = len(self.score)
        if self.xyxy_px.shape != (n, 4) or self.likelihood.shape != (n,) or self.score.shape != (n,):
            raise ValueError(
                f"candidates: {self.xyxy_px.shape} boxes, {self.score.shape} scores, "
                f"{self.likelihood.shape} likelihoods"
            )
        if self.azimuth_deg is not None and self.azimuth_deg.shape != (n,):
            raise ValueError(f"candidates: {n} boxes, {self.azimuth_deg.shape} azimuths")
        if self.boxes3d is not None and len(self.boxes3d) != n:
            raise ValueError(f"candidates: {n} boxes, {len(self.boxes3d)} 3D boxes")
        if not (np.isfinite(self.xyxy_px).all() and np.isfinite(self.score).all()):
            raise RescoreError(
                f"image {self.image_id}: boxes and scores must be finite, got NaN or infinity; "
                "mend the detections"
            )
        if n and not ((self.likelihood >= 0) & (self.likelihood <= 1)).all():
            raise RescoreError(
                f"image {self.image_id}: likelihoods must lie in [0, 1], got {self.likelihood.min()} to "
                f"{self.likelihood.max()}; calibrate the scores first"
            )

    def __len__(self) -> int:
        return len(self.score)

    @staticmethod
    def none(image_id: int) -> "Candidates":
        """An image without candidates."""
        return Candidates(image_id, np.zeros((0, 4)), np.zeros(0), np.zeros(0))


NUMBERS = ("depth_difference", "scale", "offset", "valid_share", "stereo_low", "stereo_span")
"""Fields of ``CandidateTable`` that are the numbers of eq. 6. Files of detections and tables of candidates
hold each under its name; a further one is added here, as a field, and to ``DepthAlignment``."""
_IN_ALIGNMENT = {"depth_difference": "difference"}
"""Names in ``DepthAlignment``, where they are others."""


@dataclass(frozen=True, eq=False)
class CandidateTable:
    """Candidates of many images, a row a candidate; images in order, best detector score first in each."""

    image_id: IntArray
    """Shape (n,)."""
    rank: IntArray
    """Place by detector score in its image, 0 is best, shape (n,)."""
    xyxy_px: FloatArray
    """Shape (n, 4), pixel edges."""
    score: FloatArray
    """Raw detector score, shape (n,)."""
    likelihood: FloatArray
    """l in [0, 1], shape (n,); NaN where the scores were never calibrated."""
    depth_difference: FloatArray
    """D of eq. 6 in [0, 1], shape (n,); this and the next five are NaN where ``status`` is not "ok"
    or "second_box"."""
    scale: FloatArray
    """a1 of eq. 6, shape (n,)."""
    offset: FloatArray
    """a2 of eq. 6, shape (n,)."""
    valid_share: FloatArray
    """Measured share of the predicted depth region, shape (n,)."""
    stereo_low: FloatArray
    """Measured depth that was normalised to 0, shape (n,)."""
    stereo_span: FloatArray
    """Measured depth that was normalised to 1, less ``stereo_low``, shape (n,)."""
    status: NDArray[np.object_]
    """"ok", a reason, or "" where nothing was rescored; strings, shape (n,)."""
    reason_detail: NDArray[np.object_]
    """What was expected and what came, "" where status is "ok"; strings, shape (n,)."""
    cues: FloatArray
    """Parts of the evidence of the learned modes, shape (n, k), columns ``CUES``; NaN where there is none."""
    azimuth_deg: FloatArray
    """Azimuth from which the detector sees the object (see ``rescore.data.frames.Truth``), shape (n,); NaN
    where it does not say."""
    ground: NDArray[np.object_]
    """Origin of the ground plane of the frame (``rescore.data.frames.GroundSource``), "" where nothing was
    rescored; strings, shape (n,)."""
    view_bin: NDArray[np.object_]
    """The side from which the fitted instance shows the object, a name of ``recon.view_bins.ViewBins``, ""
    where none was fitted; strings, shape (n,)."""
    view_probability: FloatArray
    """Probability of that view, shape (n,); NaN where no instance was fitted."""
    second_view: NDArray[np.object_]
    """The next likely view, as ``view_bin``; strings, shape (n,)."""
    boxes3d: Boxes3D | None = None
    """The 3D box of each, fitted or as the detector brought it, NaN rows where there is none; None where no
    candidate has one."""

    def __len__(self) -> int:
        return len(self.image_id)

    def take(self, rows: NDArray[Any]) -> "CandidateTable":
        """The rows of a mask or an index."""
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        taken: dict[str, Any] = {n: rows_of(c, rows) for n, c in columns.items() if isinstance(c, np.ndarray)}
        boxes3d = None if self.boxes3d is None else self.boxes3d[rows]
        return replace(self, **taken, boxes3d=boxes3d)

    def by_image(self, image_ids: Iterable[int]) -> dict[int, Candidates]:
        """The candidates of each image, empty where it has none."""
        rows, none = rows_by_value(self.image_id), np.zeros(0, np.int64)
        return {i: self.candidates(i, rows.get(i, none)) for i in image_ids}

    def candidates(self, image_id: int, rows: NDArray[Any] | Sequence[int]) -> Candidates:
        """What a detector found in an image, which are the rows of a mask or an index."""
        return Candidates(
            image_id,
            self.xyxy_px[rows],
            self.score[rows],
            self.likelihood[rows],
            self.azimuth_deg[rows],
            None if self.boxes3d is None else self.boxes3d[rows],
        )

    @staticmethod
    def of_candidates(frames: Iterable[Candidates]) -> "CandidateTable":
        """Candidates that nothing has rescored yet."""
        return CandidateTable.concatenate(
            [_rows(c, [NOT_RESCORED] * len(c), [None] * len(c)) for c in frames]
        )

    @staticmethod
    def concatenate(tables: Sequence["CandidateTable"]) -> "CandidateTable":
        """One table below the other."""
        empty = _rows(Candidates.none(0), [], [])
        parts = [empty, *tables]
        arrays = [f.name for f in fields(CandidateTable) if f.name != "boxes3d"]
        return CandidateTable(
            **{name: stacked([getattr(t, name) for t in parts]) for name in arrays},
            boxes3d=_joined_boxes3d(tables),
        )

    @staticmethod
    def of_alignments(
        candidates: Candidates,
        alignments: Sequence[DepthAlignment | Failure | None],
        cues: FloatArray | None = None,
        ground: str = "",
    ) -> "CandidateTable":
        """The candidates of one image with the outcome of eq. 6, the cues (n, k) of each, and its ground.

        The outcome is None where eq. 6 was not looked at.
        """
        rows = _rows(candidates, [_status(a) for a in alignments], alignments)
        table = replace(rows, ground=np.full(len(candidates), ground, object))
        return table if cues is None else replace(table, cues=cues)


def alignment_of(numbers: Mapping[str, float]) -> DepthAlignment:
    """The outcome of eq. 6 of one candidate, from its ``NUMBERS`` by name."""
    return DepthAlignment(**{_IN_ALIGNMENT.get(name, name): numbers[name] for name in NUMBERS})


def _status(outcome: DepthAlignment | Failure | None) -> str:
    if outcome is None:
        return NOT_RESCORED
    return outcome.reason.value if isinstance(outcome, Failure) else OK


def _rows(
    candidates: Candidates, status: list[str], outcome: Sequence[DepthAlignment | Failure | None]
) -> "CandidateTable":
    n = len(candidates)
    solved = {
        name: np.array([getattr(o, _IN_ALIGNMENT.get(name, name), np.nan) for o in outcome], dtype=float)
        for name in NUMBERS
    }
    return CandidateTable(
        image_id=np.full(n, candidates.image_id, np.int64),
        rank=np.arange(n, dtype=np.int64),
        xyxy_px=candidates.xyxy_px,
        score=candidates.score,
        likelihood=candidates.likelihood,
        status=np.array(status, dtype=object),
        reason_detail=np.array([o.detail if isinstance(o, Failure) else "" for o in outcome], dtype=object),
        cues=np.full((n, len(CUES)), np.nan),
        azimuth_deg=np.full(n, np.nan) if candidates.azimuth_deg is None else candidates.azimuth_deg,
        ground=np.full(n, "", object),
        view_bin=np.full(n, "", object),
        view_probability=np.full(n, np.nan),
        second_view=np.full(n, "", object),
        boxes3d=candidates.boxes3d,
        **solved,
    )


def _joined_boxes3d(tables: Sequence[CandidateTable]) -> Boxes3D | None:
    if all(t.boxes3d is None for t in tables):
        return None
    return Boxes3D.concatenate([Boxes3D.filled(t.boxes3d, len(t)) for t in tables])


@dataclass(frozen=True, eq=False)
class RescoredTable:
    """Candidates with D and their posterior likelihood."""

    candidates: CandidateTable
    """A row a candidate, with D and status of the mode."""
    posterior: FloatArray
    """Eq. 7, shape (n,), in [0, 1]; in mode "paper" the likelihood itself where there is no evidence."""

    @staticmethod
    def concatenate(tables: "Sequence[RescoredTable]") -> "RescoredTable":
        """One table below the other."""
        return RescoredTable(
            CandidateTable.concatenate([t.candidates for t in tables]),
            np.concatenate([np.zeros(0), *(t.posterior for t in tables)]),
        )
