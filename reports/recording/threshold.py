"""The threshold's timeline of a recording: operating points on the curve, what is accepted in frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from recon.arrays import FloatArray, IntArray, UInt8Array
from reports.palette import NIGHT, mode_colour, mode_name, rgb
from reports.recording.boxes import LEGEND, LEGEND_TEXT, Shown, log_shown, shown
from reports.recording.entities import (
    OUTCOME_CLASSES,
    THRESHOLD_STEPS,
    THRESHOLD_TIME,
    boxes_path,
    outcome_class,
    outcome_context,
    padded,
    part,
    picture,
    text,
)
from reports.recording.plot import Marks, Plot
from reports.recording.story import Story
from reports.run.curves import scores
from reports.run.frame_view import FrameView
from reports.run.tables import SHORT_MODE, number, percent
from rescore.data.frames import Truth
from rescore.results.candidate_file import ALONE

MAX_STEPS = 60
MAX_TILES = 12
_TILE_WIDTH_PX = 320
_GAP_PX = 6


@dataclass(frozen=True, eq=False)
class SheetTile:
    """One frame of the sheet: a small picture, and its candidates by detector and mode."""

    picture: UInt8Array
    """Small left picture, shape (h, w, 3)."""
    zoom: float
    shown: dict[str, Shown]
    """Candidates of the frame by detector, in the mode that is explained."""
    truth: Truth

    @classmethod
    def of(cls, story: Story, view: FrameView, size_px: tuple[int, int]) -> "SheetTile":
        """The tile of a frame; room for a picture of width and height ``size_px``."""
        h, w = view.measured.shape
        room = _tile_px(size_px)
        zoom = min(room[0] / w, room[1] / h)
        whole = cv2.resize(view.rgb, (round(w * zoom), round(h * zoom)), interpolation=cv2.INTER_AREA)
        small = padded(whole, room, 0)
        some = {d: shown(story, view, d, story.mode_of(d)) for d in story.run.detectors}
        return cls(np.asarray(small, np.uint8), zoom, some, view.truth)


def sheet_path(detector: str) -> str:
    """Entity path of the sheet of frames of a detector."""
    return f"threshold/{part(detector)}/sheet"


def points_path(detector: str) -> str:
    """Entity path of the table of operating points of a detector."""
    return f"threshold/{part(detector)}/points"


def threshold_steps(story: Story) -> IntArray:
    """The times of the threshold's timeline, rising from 0: scores at which something changes.

    Thinned to so many that each step accepts about as many candidates less; most candidates have low scores.
    """
    every = [scores(story.run, d, m) for d in story.run.detectors for m in {ALONE, story.mode_of(d)}]
    steps = np.unique(np.ceil(np.clip(np.concatenate(every), 0, 1) * THRESHOLD_STEPS).astype(np.int64))
    if len(steps) >= MAX_STEPS:
        steps = steps[np.unique(np.linspace(0, len(steps) - 1, MAX_STEPS - 1).round().astype(int))]
    return np.unique(np.concatenate([[0], steps]))


def log_default_points(rec: rr.RecordingStream, story: Story, plots: Mapping[str, Plot]) -> None:
    """Log the operating points that all other timelines show."""
    for detector, plot in plots.items():
        log_points(rec, story, detector, plot, None)


def log_thresholds(
    rec: rr.RecordingStream,
    story: Story,
    plots: Mapping[str, Plot],
    first: FrameView,
    tiles: Sequence[SheetTile],
) -> None:
    """Log every step of the threshold: operating points, the first frame of the recording, the sheet.

    Args:
        rec: the recording.
        story: the run.
        plots: the plot with operating points, by detector.
        first: the first frame of the recording, which the frame views show on this timeline.
        tiles: the frames of the sheet.
    """
    for detector in story.run.detectors:
        _log_sheet_picture(rec, sheet_path(detector), tiles)
    for i, step in enumerate(threshold_steps(story).tolist()):
        rec.reset_time()
        rec.set_time(THRESHOLD_TIME, sequence=step)
        least = step / THRESHOLD_STEPS
        for detector, plot in plots.items():
            log_points(rec, story, detector, plot, least)
            log_sheet(rec, detector, tiles, least, whole=i == 0)
            for mode in dict.fromkeys((ALONE, story.mode_of(detector))):
                what = shown(story, first, detector, mode, least)
                log_shown(rec, boxes_path(detector, mode), what, first)


def log_points(
    rec: rr.RecordingStream, story: Story, detector: str, plot: Plot, least_score: float | None
) -> None:
    """Log the operating points of all modes of a detector, and their table; None: where they are compared."""
    modes = story.modes_of(detector)
    accepted = [
        story.accepted(detector, m) if least_score is None else scores(story.run, detector, m) >= least_score
        for m in modes
    ]
    rates = np.array([story.rates(detector, m, a) for m, a in zip(modes, accepted, strict=True)])
    main = story.mode_of(detector)
    labels = tuple(
        f"{SHORT_MODE.get(m, m)}: {fppi:.2f} FP/image" if m == main else ""
        for m, fppi in zip(modes, rates[:, 0], strict=True)
    )
    plot.log_marks(rec, Marks(rates[:, 0], rates[:, 1], tuple(mode_colour(m) for m in modes), labels))
    rec.log(points_path(detector), text(_points_table(story, detector, rates, least_score)))


def log_sheet(
    rec: rr.RecordingStream, detector: str, tiles: Sequence[SheetTile], least_score: float | None, whole: bool
) -> None:
    """Log the boxes of the sheet; without ``whole`` only their colours and widths, which is what changes."""
    corners = [_corner(i, tiles) for i in range(len(tiles))]
    boxes, classes, radii = [np.zeros((0, 4))], [], []
    for tile, corner in zip(tiles, corners, strict=True):
        what = tile.shown[detector]
        accepted = what.accepted
        if least_score is not None:
            accepted = np.array([c.posterior >= least_score for c in what.candidates], bool)
        some = list(zip(what.candidates, accepted.tolist(), strict=True))
        found = {c.annotation_id for c, a in some if a and c.outcome == "hit"}
        missed = [
            int(i) not in found and not g
            for i, g in zip(tile.truth.annotation_id, tile.truth.ignore, strict=True)
        ]
        offset = np.tile(corner, 2)
        boxes += [tile.truth.xyxy_px.reshape(-1, 4) * tile.zoom + offset]
        classes += [OUTCOME_CLASSES.index("missed" if m else "found") for m in missed]
        radii += [1.6 if m else 0.6 for m in missed]
        boxes += [np.array([c.xyxy_px for c, _ in some]).reshape(-1, 4) * tile.zoom + offset]
        classes += [outcome_class(c.outcome, a) for c, a in some]
        radii += [1.6 if a else 0.5 for _, a in some]
    width = rr.Radius.ui_points(radii)
    path = f"{sheet_path(detector)}/boxes"
    if whole:
        array = np.concatenate(boxes)
        rec.log(
            path,
            rr.Boxes2D(
                array=array,
                array_format=rr.Box2DFormat.XYXY,
                class_ids=classes,
                radii=width,
                show_labels=False,
            ),
        )
    else:
        rec.log(path, rr.Boxes2D.from_fields(class_ids=classes, radii=width))


def _tile_px(size_px: tuple[int, int]) -> tuple[int, int]:
    return _TILE_WIDTH_PX, round(size_px[1] * _TILE_WIDTH_PX / size_px[0])


def sheet_size_px(size_px: tuple[int, int], n_frames: int) -> tuple[int, int]:
    """Width and height of the sheet; the largest picture has the size ``size_px``."""
    tile = _tile_px(size_px)
    n = min(n_frames, MAX_TILES)
    columns = _columns(tile, n)
    rows = -(-n // columns)
    return columns * (tile[0] + _GAP_PX) - _GAP_PX, rows * (tile[1] + _GAP_PX) - _GAP_PX


def threshold_tab(detector: str, plot: Plot, sheet_px: tuple[int, int], title: str) -> rrb.Horizontal:
    """The blueprint's tab of the threshold; the sheet has the width and height ``sheet_px``."""
    numbers = rrb.TextDocumentView(origin=points_path(detector), name="operating points")
    w, h = sheet_px
    bounds = rrb.VisualBounds2D(x_range=[-6, w + 6], y_range=[-6, h + 0.045 * w])
    sheet = rrb.Spatial2DView(
        origin=sheet_path(detector),
        name="what is accepted, in the most telling frames",
        background=rgb(NIGHT),
        visual_bounds=bounds,
    )
    left = rrb.Vertical(plot.view(), numbers, row_shares=[4, 3])
    return rrb.Horizontal(left, sheet, column_shares=[2, 3], name=title)


def _points_table(story: Story, detector: str, rates: FloatArray, least_score: float | None) -> str:
    modes = story.modes_of(detector)
    if least_score is None:
        point = story.points[detector].text
        head = f"**Where {point} are reached.** Choose the timeline *threshold* to move it.\n\n"
    else:
        step = round(least_score * THRESHOLD_STEPS)
        head = f"**Accepted: score at least {least_score:.3f}** (step {step})\n\n"
    lines = [
        head,
        "| score of | from | cars found | FP/image | precision |\n",
        "| :--- | :--- | :--- | :--- | :--- |\n",
    ]
    for mode, (fppi, recall, precision) in zip(modes, rates.tolist(), strict=True):
        least = story.threshold(detector, mode) if least_score is None else least_score
        figures = (f"{least:.3f}", _percent(recall), number(fppi, 2), _percent(precision))
        lines.append(f"| {mode_name(mode)} | {' | '.join(figures)} |\n")
    return "".join(lines)


def _percent(share: float) -> str:
    return percent(share if np.isfinite(share) else None)


def _columns(tile_px: tuple[int, int], n: int) -> int:
    most = 3 if tile_px[1] > 0.5 * tile_px[0] else 2
    return min(most, n)


def _corner(i: int, tiles: Sequence[SheetTile]) -> FloatArray:
    """Left and top of a tile in the sheet."""
    height = tiles[0].picture.shape[0]
    row, column = divmod(i, _columns((_TILE_WIDTH_PX, height), len(tiles)))
    return np.array([column * (_TILE_WIDTH_PX + _GAP_PX), row * (height + _GAP_PX)], float)


def _log_sheet_picture(rec: rr.RecordingStream, path: str, tiles: Sequence[SheetTile]) -> None:
    rec.log(path, outcome_context(), static=True)
    corners = np.array([_corner(i, tiles) for i in range(len(tiles))]).astype(int)
    tile_px = np.array([_TILE_WIDTH_PX, tiles[0].picture.shape[0]])
    whole = corners.max(axis=0) + tile_px
    sheet = np.full((whole[1], whole[0], 3), rgb(NIGHT), np.uint8)
    for tile, (x, y) in zip(tiles, corners, strict=True):
        sheet[y : y + tile.picture.shape[0], x : x + tile.picture.shape[1]] = tile.picture
    rec.log(f"{path}/picture", picture(sheet), static=True)
    at = (np.arange(len(LEGEND)) + 0.5) / len(LEGEND) * whole[0]
    rec.log(
        f"{path}/legend",
        rr.Points2D(
            np.stack([at, np.full(len(at), whole[1] + 6.0)], axis=1),
            class_ids=[OUTCOME_CLASSES.index(n) for n in LEGEND],
            labels=[f"■ {LEGEND_TEXT[n]}" for n in LEGEND],
            show_labels=True,
            radii=rr.Radius.ui_points(0),
        ),
        static=True,
    )
