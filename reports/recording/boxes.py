"""The candidates of a frame as boxes over the picture, before and after rescoring, and as a table."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from recon.arrays import BoolArray, FloatArray
from reports.palette import OUTCOME_NAME
from reports.recording.entities import IMAGE, OUTCOME_CLASSES, boxes_path, outcome_class, part, text, values
from reports.recording.story import Story
from reports.run.changes_text import GROUP_TEXT
from reports.run.frame_view import CandidateView, FrameView
from rescore.data.frames import Truth
from rescore.results.candidate_file import ALONE
from rescore.results.words import status_text

LEGEND = ("hit", "false_alarm", "duplicate", "missed")
LEGEND_TEXT = {"hit": "hit", "false_alarm": "false alarm", "duplicate": "duplicate", "missed": "missed car"}
_MAX_TABLE = 15
_MAX_LABELS = 3
_LABEL_HEIGHT, _LETTER_WIDTH, _LABEL_EDGE = 0.042, 0.015, 0.02
"""Sizes of labels as shares of the width of the largest picture, in a view of some 500 points."""


@dataclass(frozen=True, eq=False)
class Shown:
    """The candidates of one detector and mode in one frame, with what is accepted of them."""

    candidates: tuple[CandidateView, ...]
    accepted: BoolArray
    """Shape (n,)."""
    labelled: BoolArray
    """Whether each candidate's label is shown, shape (n,); else it appears where the pointer is."""
    alone: bool
    """Whether this is the detector alone."""


def log_boxes(rec: rr.RecordingStream, story: Story, view: FrameView, width_px: int) -> None:
    """Log the candidates of all detectors and modes, and the tables, at the time that is set.

    ``width_px`` is that of the largest picture of the recording, for which the views are made.
    """
    for detector in story.run.detectors:
        for mode in story.modes_of(detector):
            what = shown(story, view, detector, mode)
            log_shown(rec, boxes_path(detector, mode), what, view)
            _log_labels(rec, f"{boxes_path(detector, mode)}/labels", what, view, width_px)
        rec.log(f"tables/{part(detector)}", text(frame_table(story, view, detector)))
        _log_legend(rec, f"{IMAGE}/{part(detector)}/legend", view)


def candidates_of(story: Story, view: FrameView, detector: str, mode: str) -> tuple[CandidateView, ...]:
    """The candidates of a frame in any mode, best detector score first."""
    if mode == story.mode:
        return view.candidates[detector]
    return view.other_modes[detector, mode]


def shown(story: Story, view: FrameView, detector: str, mode: str, least_score: float | None = None) -> Shown:
    """What is shown of a detector and mode: accepted at its operating point, or from a score on."""
    some = candidates_of(story, view, detector, mode)
    rows = [c.row for c in some]
    if least_score is None:
        accepted = story.accepted(detector, mode)[rows]
    else:
        accepted = np.array([c.posterior >= least_score for c in some], bool)
    return Shown(some, accepted, labelled(story, view, detector), mode == ALONE)


def labelled(story: Story, view: FrameView, detector: str) -> BoolArray:
    """Whether each candidate of a frame has its label shown, the same before and after: the foremost have."""
    before = story.accepted(detector, ALONE)
    after = story.accepted(detector, story.mode_of(detector))
    some = view.candidates[detector]
    wanted = [c for c in some if before[c.row] or after[c.row] or c.outcome == "hit"] or some[:1]
    best = sorted(wanted, key=lambda c: min(c.rank, c.new_rank))[:_MAX_LABELS]
    return np.array([any(c is b for b in best) for c in some], bool)


def log_shown(rec: rr.RecordingStream, path: str, what: Shown, view: FrameView) -> None:
    """Log boxes and annotated cars at an entity path."""
    _log_rectangles(rec, f"{path}/accepted", what, what.accepted)
    _log_rectangles(rec, f"{path}/rejected", what, ~what.accepted)
    _log_cars(rec, f"{path}/cars", what, view.truth)


def short_label(c: CandidateView, alone: bool) -> str:
    """What stands on a box: its place and l, or both places and D."""
    if alone:
        return f"#{c.rank + 1}  {c.likelihood:.2f}"
    d = f"  D {c.depth_difference:.2f}" if np.isfinite(c.depth_difference) else ""
    return (f"#{c.rank + 1}" if c.rank == c.new_rank else f"#{c.rank + 1} → #{c.new_rank + 1}") + d


def candidate_label(c: CandidateView, alone: bool) -> str:
    """The label where the pointer is: rank and l; after rescoring also both places, D and the score."""
    if alone:
        return f"#{c.rank + 1}   l {c.likelihood:.2f}"
    d = f"D {c.depth_difference:.2f}" if np.isfinite(c.depth_difference) else "no D"
    moved = f"#{c.rank + 1}" if c.rank == c.new_rank else f"#{c.rank + 1} → #{c.new_rank + 1}"
    return f"{moved}   l {c.likelihood:.2f} → {c.posterior:.2f}   {d}"


def frame_table(story: Story, view: FrameView, detector: str) -> str:
    """The candidates of a frame as Markdown, best after rescoring first."""
    after = story.accepted(detector, story.mode_of(detector))
    some = sorted(view.candidates[detector], key=lambda c: c.new_rank)
    found = {c.annotation_id for c in some if c.outcome == "hit" and after[c.row]}
    cars = [int(i) for i in view.truth.annotation_id[~view.truth.ignore]]
    lines = [
        f"**{view.file}** (image {view.image_id}): {len(cars)} annotated "
        f"{'car' if len(cars) == 1 else 'cars'}, {sum(i in found for i in cars)} found after rescoring.\n\n",
        "| place | l | D | score | is | became |\n",
        "| :--- | :--- | :--- | :--- | :--- | :--- |\n",
    ]
    for c in some[:_MAX_TABLE]:
        d = f"{c.depth_difference:.3f}" if np.isfinite(c.depth_difference) else "–"
        kind = f" ({c.kind.replace('_', ' ')})" if c.kind and c.outcome == "false_alarm" else ""
        became = GROUP_TEXT[story.group(detector, c)]
        if c.status != "ok":
            became += f"; no evidence: {status_text(c.status)}"
        lines.append(
            f"| {c.rank + 1} → {c.new_rank + 1} | {c.likelihood:.3f} | {d} | {c.posterior:.3f} | "
            f"{OUTCOME_NAME[c.outcome]}{kind} | {became} |\n"
        )
    if len(some) > _MAX_TABLE:
        lines.append(f"\nand {len(some) - _MAX_TABLE} more candidates\n")
    return "".join(lines)


def label_spots(
    xyxy_px: FloatArray, picture_px: tuple[int, int], widths_px: FloatArray, height_px: float
) -> FloatArray:
    """Where labels (n, 2) hang, the middle of their upper edges: in their boxes where they fit.

    Else above or below the box; where another label is there, lower.

    Args:
        xyxy_px: the boxes (n, 4).
        picture_px: width and height of the picture.
        widths_px: widths of the labels in pixels of the picture, shape (n,).
        height_px: height of a label in pixels of the picture.
    """
    (width, height), h = picture_px, height_px
    taken: list[tuple[float, float, float]] = []
    for (x0, y0, x1, y1), w in zip(xyxy_px, widths_px, strict=True):
        inside = [y0, y1 - h] if x1 - x0 >= w and y1 - y0 >= h else []
        x = float(np.clip((x0 + x1) / 2, w / 2, width - w / 2))
        ys = [float(y) for y in (*inside, y0 - h, y1) if 0 <= y <= height - h]
        ys += np.arange(float(np.clip(y0, 0, height - h)), 2 * height, h / 4).tolist()
        free = (y for y in ys if all(abs(x - ox) >= (w + ow) / 2 or abs(y - oy) >= h for ox, oy, ow in taken))
        taken.append((x, next(free), float(w)))
    return np.array([spot[:2] for spot in taken]).reshape(-1, 2)


def _log_rectangles(rec: rr.RecordingStream, path: str, what: Shown, use: BoolArray) -> None:
    some = [c for c, u in zip(what.candidates, use, strict=True) if u]
    bright = path.endswith("accepted")
    rec.log(
        path,
        rr.Boxes2D(
            array=np.array([c.xyxy_px for c in some]).reshape(-1, 4),
            array_format=rr.Box2DFormat.XYXY,
            class_ids=[outcome_class(c.outcome, bright) for c in some],
            labels=[candidate_label(c, what.alone) for c in some],
            show_labels=False,
            radii=rr.Radius.ui_points(2.0 if bright else 0.8),
            draw_order=20 if bright else 12,
        ),
        *values(
            rank=np.array([c.rank for c in some], np.int64),
            new_rank=np.array([c.new_rank for c in some], np.int64),
            likelihood=np.array([c.likelihood for c in some], np.float64),
            score=np.array([c.posterior for c in some], np.float64),
            depth_difference=np.array([c.depth_difference for c in some], np.float64),
            annotation_id=np.array([c.annotation_id for c in some], np.int64),
        ),
    )


def _log_labels(rec: rr.RecordingStream, path: str, what: Shown, view: FrameView, width_px: int) -> None:
    """Labels apart from the boxes, for the viewer would break them into lines as wide as the box."""
    h, w = view.measured.shape
    some = [c for c, named in zip(what.candidates, what.labelled, strict=True) if named]
    # the foremost chooses its place first
    some.sort(key=lambda c: min(c.rank, c.new_rank))
    boxes = np.array([c.xyxy_px for c in some]).reshape(-1, 4)
    labels = [short_label(c, what.alone) for c in some]
    widths = width_px * (_LABEL_EDGE + _LETTER_WIDTH * np.array([len(label) for label in labels], float))
    rec.log(
        path,
        rr.Points2D(
            label_spots(boxes, (w, h), widths, _LABEL_HEIGHT * width_px),
            class_ids=[outcome_class(c.outcome, accepted=True) for c in some],
            labels=labels,
            show_labels=True,
            radii=rr.Radius.ui_points(0),
            draw_order=30,
        ),
    )


def _log_cars(rec: rr.RecordingStream, path: str, what: Shown, truth: Truth) -> None:
    pairs = zip(what.candidates, what.accepted, strict=True)
    found = {c.annotation_id for c, accepted in pairs if accepted and c.outcome == "hit"}
    names = [
        "ignored_car" if ignore else "found" if int(i) in found else "missed"
        for i, ignore in zip(truth.annotation_id, truth.ignore, strict=True)
    ]
    rec.log(
        path,
        rr.Boxes2D(
            array=truth.xyxy_px,
            array_format=rr.Box2DFormat.XYXY,
            class_ids=[OUTCOME_CLASSES.index(n) for n in names],
            labels=[{"missed": "missed car", "found": "found car"}.get(n, "") for n in names],
            show_labels=False,
            radii=rr.Radius.ui_points(1.3),
            draw_order=14,
        ),
        *values(annotation_id=truth.annotation_id),
    )


def _log_legend(rec: rr.RecordingStream, path: str, view: FrameView) -> None:
    """The colours, in a row below the picture."""
    h, w = view.measured.shape
    at = (np.arange(len(LEGEND)) + 0.5) / len(LEGEND) * w
    rec.log(
        path,
        rr.Points2D(
            np.stack([at, np.full(len(at), 1.02 * h)], axis=1),
            class_ids=[OUTCOME_CLASSES.index(n) for n in LEGEND],
            labels=[f"■ {LEGEND_TEXT[n]}" for n in LEGEND],
            show_labels=True,
            radii=rr.Radius.ui_points(0),
        ),
    )
