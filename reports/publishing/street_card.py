"""One frame as a picture for a visitor: boxes, 3D boxes, the view from above, measured disparity, reasons.

It is drawn on a dark card of its own, so that it reads alike on light and dark pages.
"""

import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath

from recon.arrays import FloatArray
from recon.boxes import paired_overlap
from recon.camera import StereoCamera
from recon.files import atomic_path
from reports.palette import NIGHT, NIGHT_AXIS, NIGHT_INK
from reports.publishing.birds_eye import draw_birds_eye
from reports.publishing.street_boxes import AGAINST, FOR, SILENT, StreetBox, StreetFrame
from reports.run.candidate_panels import DEPTH_COLOURS, colourise
from reports.run.fitted_cars import solid_corners
from reports.run.frame_view import FrameView
from rescore.results.words import status_text

WIDTH_PX = 1600
_FONT = "DejaVu Sans"
"""The font that comes with matplotlib, so that pictures are the same everywhere."""
_DPI = 100
_EDGE_PX, _GAP_PX, _SIDE_PX = 24, 18, 500
_HEAD_PX, _TEXT_PX, _LINE_PX, _BLOCK_PX = 40, 23, 32, 14
_QUALITY = 86
_KEY = (
    (FOR, "depth speaks for a car: its 3D box"),
    (AGAINST, "against; dashed: where a car would be"),
    (SILENT, "depth says nothing"),
)
_SIDES = [(i, (i + 1) % 4) for i in range(4)]
_EDGES = (*_SIDES, *((i + 4, j + 4) for i, j in _SIDES), *((i, i + 4) for i in range(4)))
_FRONT_CROSS = ((0, 5), (1, 4))
_NEAREST_M = 0.5
"""A 3D box that comes nearer to the camera is not drawn in the picture."""


def draw_street(path: Path, frame: StreetFrame, crop_px: FloatArray) -> None:
    """Draw one frame into a WebP file.

    Args:
        path: the file.
        frame: the frame with its boxes.
        crop_px: the part of the left picture that is shown, pixel edges (4,).
    """
    wide = WIDTH_PX - 2 * _EDGE_PX - _GAP_PX - _SIDE_PX
    shape = (crop_px[3] - crop_px[1]) / (crop_px[2] - crop_px[0])
    tall, small = round(wide * shape), round(_SIDE_PX * shape)
    blocks = _blocks(frame.boxes, wide - _LINE_PX)
    words = sum(len(b.lines) for b in blocks) * _LINE_PX + (len(blocks) - 1) * _BLOCK_PX
    key = [(colour, text) for colour, text in _KEY if colour in {b.colour for b in frame.boxes}]
    beside = small + (2 + len(key)) * _LINE_PX
    height = 2 * (_EDGE_PX + _HEAD_PX) + tall + _GAP_PX + max(beside, words)
    right, top = _EDGE_PX + wide + _GAP_PX, _EDGE_PX + _HEAD_PX
    second = top + tall + _GAP_PX + _HEAD_PX
    with mpl.rc_context({"font.family": _FONT}):
        figure = Figure(figsize=(WIDTH_PX / _DPI, height / _DPI), dpi=_DPI, facecolor=NIGHT)
        card = _Card(figure, height)
        _draw_picture(card.panel(_title(frame.boxes), _EDGE_PX, top, wide, tall), frame, crop_px)
        above = card.panel("Seen from above", right, top, _SIDE_PX, tall)
        draw_birds_eye(above, frame.view, frame.boxes, _TEXT_PX)
        _draw_disparity(card, frame, crop_px, (right, second, _SIDE_PX, small))
        card.words(blocks, _EDGE_PX, second)
        card.key(key, right, second + small + 1.7 * _LINE_PX)
        with atomic_path(path) as file:
            options = {"quality": _QUALITY, "method": 6}
            figure.savefig(file, format="webp", facecolor=NIGHT, pil_kwargs=options)


def _title(boxes: Sequence[StreetBox]) -> str:
    """What the labels in the picture say."""
    told = [f", place among {b.n_places} before → after depth" for b in boxes if b.has_evidence]
    return f"Boxes of a detector{told[0] if told else ''}"


class _Block:
    """What is said of one box, or of all that depth says nothing of: a number, a title, lines."""

    def __init__(self, number: str, title: str, reasons: Sequence[str], colour: str, width_px: float) -> None:
        self.number, self.colour = number, colour
        self.lines = [(line, True) for line in _wrapped(title, width_px, bold=True)]
        self.lines += [(line, False) for r in reasons for line in _wrapped(r, width_px)]


def _blocks(boxes: Sequence[StreetBox], width_px: float) -> list[_Block]:
    """What is said of each box that depth says something of, and of the others together."""
    found = [_Block(str(b.number), b.title, b.reasons, b.colour, width_px) for b in boxes if b.has_evidence]
    silent = [b for b in boxes if not b.has_evidence]
    for status in dict.fromkeys(b.view.status for b in silent):
        some = [b for b in silent if b.view.status == status]
        numbers = f"{some[0].number}" if len(some) == 1 else f"{some[0].number} to {some[-1].number}"
        title = f"{numbers}: {status_text(status)}, so depth says nothing"
        found.append(_Block("", title, ("Their order among each other stays.",), SILENT, width_px))
    return found


class _Card:
    """A figure whose parts are placed in pixels from its upper left corner."""

    def __init__(self, figure: Figure, height_px: int) -> None:
        self.figure, self.height = figure, height_px

    def panel(self, title: str, x: float, y: float, width: float, height: float) -> Axes:
        """Axes without frame, with a title above."""
        if title:
            self.text(title, x, y - _HEAD_PX + 4, NIGHT_AXIS)
        at = (x / WIDTH_PX, 1 - (y + height) / self.height, width / WIDTH_PX, height / self.height)
        ax = self.figure.add_axes(at)
        ax.set(xticks=[], yticks=[])
        for spine in ax.spines.values():
            spine.set_visible(False)
        return ax

    def text(self, words: str, x: float, y: float, colour: str, **how: Any) -> None:
        """Words with their upper left corner at a place."""
        at = (x / WIDTH_PX, 1 - y / self.height)
        self.figure.text(*at, words, color=colour, fontsize=_points(_TEXT_PX), va="top", **how)

    def words(self, blocks: Sequence[_Block], x: float, y: float) -> None:
        """What became of each box, and why."""
        self.text("What depth says", x, y - _HEAD_PX + 4, NIGHT_AXIS)
        for block in blocks:
            self.text(block.number, x, y, block.colour, weight="bold")
            for i, (line, bold) in enumerate(block.lines):
                colour, weight = (block.colour, "bold") if bold else (NIGHT_INK, "normal")
                indent = _LINE_PX if block.number else 0
                self.text(line, x + indent, y + i * _LINE_PX, colour, weight=weight)
            y += len(block.lines) * _LINE_PX + _BLOCK_PX

    def key(self, entries: Sequence[tuple[str, str]], x: float, y: float) -> None:
        """What the colours of boxes mean."""
        for i, (colour, text) in enumerate(entries):
            top = y + i * _LINE_PX
            at = (x / WIDTH_PX, 1 - (top + 0.85 * _TEXT_PX) / self.height)
            size = (_TEXT_PX / WIDTH_PX, 0.7 * _TEXT_PX / self.height)
            self.figure.add_artist(Rectangle(at, *size, facecolor=colour, edgecolor="none"))
            self.text(text, x + 1.5 * _TEXT_PX, top - 3, NIGHT_INK)


def _points(px: float) -> float:
    return px * 72 / _DPI


def _wrapped(text: str, width_px: float, bold: bool = False) -> list[str]:
    """The text in lines that are no wider than so many pixels, broken between words."""
    lines: list[str] = []
    # what stands in brackets stays together
    for word in re.findall(r"\([^)]*\)|\S+", text):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and _width_px(longer, bold) <= width_px:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _width_px(text: str, bold: bool = False) -> float:
    font = FontProperties(family=_FONT, weight="bold" if bold else "normal")
    return float(TextPath((0, 0), text, size=_TEXT_PX, prop=font).get_extents().width)


def _draw_picture(ax: Axes, frame: StreetFrame, crop_px: FloatArray) -> None:
    """The left picture with boxes, the 3D boxes of what depth speaks for, and labels."""
    _show(ax, frame.view.rgb, crop_px)
    for b in frame.boxes:
        if b.speaks_for:
            _draw_solid(ax, b, frame.view)
        _draw_box(ax, b, 2.6)
    scale = ax.bbox.width / (crop_px[2] - crop_px[0])
    widths = [_width_px(b.label, bold=True) + 0.6 * _TEXT_PX for b in frame.boxes]
    sizes = np.array([[width, 1.5 * _TEXT_PX] for width in widths]).reshape(-1, 2) / scale
    xyxy_px = np.array([b.view.xyxy_px for b in frame.boxes]).reshape(-1, 4)
    chip = {"edgecolor": "none", "boxstyle": "square,pad=0.25"}
    how: dict[str, Any] = {"ha": "center", "va": "center_baseline", "zorder": 6, "weight": "bold"}
    for b, at in zip(frame.boxes, place_labels(xyxy_px, sizes, crop_px), strict=True):
        x, y = (at[:2] + at[2:]) / 2
        look = chip | {"facecolor": b.colour}
        ax.text(x, y, b.label, color=NIGHT, fontsize=_points(_TEXT_PX), bbox=look, **how)


def place_labels(xyxy_px: FloatArray, sizes_px: FloatArray, crop_px: FloatArray) -> FloatArray:
    """Where the label of each box covers the labels before it and the boxes least, pixel edges (n, 4).

    Args:
        xyxy_px: The boxes, shape (n, 4), pixel edges.
        sizes_px: Width and height of their labels, shape (n, 2).
        crop_px: What is shown, shape (4,): no label leaves it.
    """
    places = np.zeros_like(xyxy_px)
    for i, (box, size) in enumerate(zip(xyxy_px, sizes_px, strict=True)):
        gap = 0.25 * size[1]
        lefts = (
            box[0],
            box[2] - size[0],
            (box[0] + box[2] - size[0]) / 2,
            box[2] + gap,
            box[0] - size[0] - gap,
        )
        tops = (box[1] - size[1] - gap, box[3] + gap, box[1] + gap, box[3] - size[1] - gap)
        low = np.array([(x, y) for y, x in product(tops, lefts)])
        low = np.clip(low, crop_px[:2] + gap, crop_px[2:] - size - gap)
        choices = np.concatenate([low, low + size], axis=1)
        weights = np.where(np.arange(len(xyxy_px)) == i, 0.3, 1.0)
        cost = (weights * _covered(choices, xyxy_px)).sum(axis=1)
        cost += 10 * _covered(choices, places[:i]).sum(axis=1)
        places[i] = choices[np.argmin(cost.round(6))]
    return places


def _covered(labels: FloatArray, others: FloatArray) -> FloatArray:
    """Share of each label (n, 4) that each of other boxes (m, 4) covers, shape (n, m)."""
    return paired_overlap(labels[:, None], others[None])[1]


def _draw_disparity(
    card: _Card, frame: StreetFrame, crop_px: FloatArray, at: tuple[float, float, float, float]
) -> None:
    """Measured disparity with the boxes, and what its colours mean."""
    ax = card.panel("Measured disparity (grey: none)", *at)
    stereo = StereoCamera(frame.view.seen_from.camera, frame.view.baseline)
    disparity = stereo.disparity_px(frame.view.measured)
    x0, y0, x1, y1 = np.round(crop_px).astype(int)
    part = disparity[y0:y1, x0:x1]
    low, high = np.nanpercentile(part, [1, 99]) if np.isfinite(part).any() else (0.0, 1.0)
    _show(ax, colourise(disparity, float(low), float(high)), crop_px)
    for b in frame.boxes:
        _draw_box(ax, b, 1.6)
    x, y, wide, tall = at
    bar = card.panel("", x + 0.38 * wide, y + tall + 0.45 * _LINE_PX, 0.24 * wide, 0.5 * _LINE_PX)
    bar.imshow(np.linspace(0, 1, 256)[None], cmap=DEPTH_COLOURS, aspect="auto")
    ends = [f"{v:.0f} px, {stereo.focal_baseline / v:.0f} m" for v in (low, high)]
    below = y + tall + 0.25 * _LINE_PX
    card.text(ends[0], x, below, NIGHT_INK)
    card.text(ends[1], x + wide, below, NIGHT_INK, ha="right")


def _show(ax: Axes, picture: Any, crop_px: FloatArray) -> None:
    """Show the part of a picture."""
    height, width = picture.shape[:2]
    ax.imshow(picture, extent=(0, width, height, 0), interpolation="antialiased", aspect="auto")
    ax.set(xlim=(crop_px[0], crop_px[2]), ylim=(crop_px[3], crop_px[1]))


def _draw_box(ax: Axes, b: StreetBox, width: float) -> None:
    """The 2D box, with its sides at the edge of the picture drawn inside of it."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    x0, x1 = np.clip(b.view.xyxy_px[[0, 2]], left + width, right - width)
    y0, y1 = np.clip(b.view.xyxy_px[[1, 3]], top + width, bottom - width)
    dark = [withStroke(linewidth=width + 2, foreground=NIGHT)]
    ring = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]).T
    ax.plot(*ring, color=b.colour, lw=width, zorder=4, solid_joinstyle="miter", path_effects=dark)


def _draw_solid(ax: Axes, b: StreetBox, view: FrameView) -> None:
    """The 3D box, its front crossed."""
    if b.view.box3d is None:
        return
    corners = solid_corners(b.view.box3d, view.seen_from.ground)[0]
    if corners[:, 2].min() < _NEAREST_M:
        return
    uv = view.seen_from.camera.project(corners) + 0.5
    for width, ends in ((2.0, _EDGES), (1.0, _FRONT_CROSS)):
        dark = [withStroke(linewidth=width + 2, foreground=(0, 0, 0, 0.55))]
        for i, j in ends:
            ax.plot(*uv[[i, j]].T, color="white", lw=width, zorder=3, path_effects=dark)
