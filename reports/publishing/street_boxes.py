"""The boxes of one frame with what became of them, ready for a picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.errors import RescoreError
from reports.palette import PALE_GREY, SKY, VERMILION, on_dark
from reports.run.changes_text import inspect_run, model_of
from reports.run.frame_view import CandidateView, FrameReader, FrameView, run_data
from rescore.evidence.candidates import OK
from rescore.files import read_json
from rescore.results.explain import Explanation
from rescore.results.run_folder import Run

FOR, AGAINST, SILENT = SKY, on_dark(VERMILION), PALE_GREY
"""Colours of boxes that depth speaks for, against, or says nothing of."""
_REASONS = 2
"""Cues that are told of a box."""


@dataclass(frozen=True, eq=False)
class StreetBox:
    """One box of a picture with what became of it."""

    view: CandidateView
    number: int
    """Number in the picture, from 1 on."""
    shows: str
    """What a person sees in the box."""
    places: tuple[int, int]
    """Place before and after among all boxes of the data set, 1 is best."""
    n_places: int
    neutral: float
    """D where depth says nothing."""
    reasons: tuple[str, ...]
    """What speaks most for the side that depth takes, in words."""

    @property
    def has_evidence(self) -> bool:
        """Whether depth says anything of it."""
        return self.view.status == OK

    @property
    def speaks_for(self) -> bool:
        """Whether depth speaks for a car, more than where it says nothing."""
        return self.has_evidence and self.view.depth_difference < self.neutral

    @property
    def colour(self) -> str:
        """The colour of what depth says of it."""
        if not self.has_evidence:
            return SILENT
        return FOR if self.speaks_for else AGAINST

    @property
    def label(self) -> str:
        """Number and places, for a label in the picture; the number alone where depth says nothing."""
        return f"{self.number}   place {_ends(self.places)}" if self.has_evidence else str(self.number)

    @property
    def title(self) -> str:
        """What it shows, with the likelihood, what depth makes of it, and both together by eq. 7."""
        c = self.view
        return (
            f"{self.shows}: detector {c.likelihood:.2f}, depth {1 - c.depth_difference:.2f}, "
            f"together {c.posterior:.2f}"
        )


def _ends(places: tuple[int, int]) -> str:
    before, after = places
    return f"{before} → {after}"


@dataclass(frozen=True, eq=False)
class StreetFrame:
    """One frame of a data set with its boxes, best detector score first."""

    view: FrameView
    boxes: tuple[StreetBox, ...]


def street_frames(run: Run) -> tuple[StreetFrame, ...]:
    """The frames of a run with the boxes of its first detector in its last mode.

    Raises:
        RescoreError: not rescored in a learned mode, or the data set does not say what each box shows.
    """
    inspection = inspect_run(run)
    detector, mode = inspection.detector, inspection.mode
    model = model_of(run, detector, mode)
    if model is None:
        raise RescoreError(f"{run.root}: expected the model that made D, found none; evaluate it again")
    shows = _shown(run.data_dir / "detections.json")
    changes = inspection.changes
    reader = FrameReader(run, run_data(run), mode)

    def box(number: int, image_id: int, c: CandidateView) -> StreetBox:
        places = int(changes.place_before[c.row]), int(changes.place_after[c.row])
        told = _reasons(inspection.explanations[c.row], c, model.neutral)
        seen = shows[_key(image_id, c.xyxy_px.tolist())]
        return StreetBox(c, number, seen, places, len(changes.delta), model.neutral, told)

    views = [reader.read(image_id) for image_id in reader.records]
    return tuple(
        StreetFrame(v, tuple(box(i, v.image_id, c) for i, c in enumerate(v.candidates[detector], 1)))
        for v in views
    )


def _reasons(explanation: Explanation, c: CandidateView, neutral: float) -> tuple[str, ...]:
    """What speaks most for the side that depth takes; nothing where it takes none."""
    if c.status != OK:
        return ()
    for_it = c.depth_difference < neutral
    return tuple(p.text for p in explanation.parts if (p.log_odds > 0) is for_it)[:_REASONS]


def _shown(file: Path) -> Mapping[tuple[int, ...], str]:
    """What a person sees in each box of a file of detections."""
    try:
        rows = read_json(file, "detections")
        return {_key(r["image_id"], _edges(r["bbox"])): str(r["shows"]) for r in rows}
    except (KeyError, TypeError, ValueError) as error:
        raise RescoreError(f"{file}: expected detections with key 'shows', got {error!r}; add it") from error


def _edges(xywh: list[float]) -> list[float]:
    left, top, width, height = xywh
    return [left, top, left + width, top + height]


def _key(image_id: int, xyxy_px: list[float]) -> tuple[int, ...]:
    return (image_id, *np.round(xyxy_px).astype(int).tolist())
