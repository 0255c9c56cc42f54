"""Pictures and table of the bank of distractors: D by kind and mode, and one example of each kind."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.files import atomic_path
from reports.palette import GREEN, GREY, VERMILION, mode_name, rgb
from reports.run.curve_pictures import STYLE
from reports.run.tables import Table
from rescore.studies.distractors import BankResult, Judged

_TILE = (250, 120)
"""Width and height in pixels of the picture and of the disparity of an example."""
_CAPTION_PX = 20
_MARGIN = 0.45
"""What is shown around a box, as a share of its width."""


@dataclass(frozen=True, eq=False)
class Example:
    """One thing of the bank to look at."""

    title: str
    caption: str
    left_rgb: UInt8Array
    """Left picture, shape (h, w, 3)."""
    disparity_px: Float32Array
    """Measured disparity, shape (h, w); NaN where there is none."""
    xyxy_px: FloatArray
    """Box of the thing, pixel edges, shape (4,)."""


def draw_bank(folder: Path, bank: BankResult, first: Sequence[Judged]) -> None:
    """Draw ``distractors.png`` and ``examples.png`` of what ``judge_bank_of_run`` found."""
    draw_boxes(folder / "distractors.png", bank)
    draw_examples(folder / "examples.png", [example for one in first for example in _examples(one)])


def _examples(judged: Judged) -> list[Example]:
    """The thing to look at; none where its pictures are kept no longer."""
    if judged.item is None:
        return []
    caption = ", ".join(f"{mode} {d:.2f}" for mode, d in judged.difference.items())
    frame = judged.item.frame
    title = judged.title
    return [Example(title, caption, frame.left_rgb, frame.disparity_px, judged.item.xyxy_px)]


def distractor_text(bank: BankResult) -> str:
    """Table and text of the bank in Markdown, without pictures."""
    modes = list(bank.cut)
    cuts = "\n".join(
        f"- {mode}: posters {_times(cut.posters)}, all distractors {_times(cut.all)}; posters where "
        f"half of the cars are dark {_times(cut.posters_dark)}"
        for mode, cut in bank.cut.items()
    )
    lower = {m: [k.title for k in bank.kinds if m in k.below_cars] for m in modes}
    failing = "\n".join(f"- {mode}: {', '.join(kinds) or 'none'}" for mode, kinds in lower.items())
    return "\n\n".join(
        [
            distractor_table(bank).markdown().rstrip(),
            f"How many times fewer distractors than cars pass the threshold on D that {bank.recall:.0%} "
            "of the cars pass (without depth as many pass). Posters are boards, murals and prints on "
            "vehicles.",
            cuts,
            "Kinds whose median D is below that of ordinary cars, so that depth takes them for cars:",
            failing,
        ]
    )


def distractor_table(bank: BankResult) -> Table:
    """A row a kind: number of things, median and quartiles of D in each mode."""
    modes = list(bank.cut)
    rows = []
    for kind in bank.kinds:
        row = [kind.title, str(kind.count)]
        for mode in modes:
            d = kind.d[mode]
            row += ["-" if d.median is None else f"{d.median:.2f} [{d.low:.2f}, {d.high:.2f}]"]
            row += [str(d.without)]
        rows.append(tuple(row))
    head = ["kind", "things"]
    for mode in modes:
        head += [f"D {mode}", "no evidence"]
    return Table("", tuple(head), tuple(rows))


def draw_boxes(path: Path, bank: BankResult) -> None:
    """Box plots of D by kind, a panel a mode; true cars are green."""
    modes, kinds = list(bank.cut), bank.kinds
    with mpl.rc_context(STYLE | {"font.size": 10}):
        figure = Figure(figsize=(4.0 * len(modes) + 1.5, 0.36 * len(kinds) + 1.2), layout="constrained")
        axes = figure.subplots(1, len(modes), sharey=True, squeeze=False)[0]
        for ax, mode in zip(axes, modes, strict=True):
            values = [[v for v in k.values[mode] if v is not None] for k in kinds]
            drawn = ax.boxplot(
                values,
                orientation="horizontal",
                patch_artist=True,
                widths=0.62,
                medianprops={"color": "black"},
                flierprops={"markersize": 2.5},
            )
            for box, kind in zip(drawn["boxes"], kinds, strict=True):
                box.set_facecolor(GREEN if kind.is_car else GREY)
                box.set_alpha(0.75)
            ax.set_yticks(range(1, len(kinds) + 1), [k.title for k in kinds])
            ax.invert_yaxis()
            ax.set_title(mode_name(mode))
            ax.set_xlabel("D")
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as beside:
            figure.savefig(beside, dpi=110)


def draw_examples(path: Path, examples: Sequence[Example], columns: int = 3) -> None:
    """A sheet of examples: the picture around the box, and the measured disparity beside it."""
    tiles = [_tile(e) for e in examples]
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % columns)
    sheet = np.vstack([np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)])
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(".png", sheet[..., ::-1])
    if not done:
        raise ValueError(f"{path}: OpenCV could not write a PNG")
    with atomic_path(path) as beside:
        beside.write_bytes(data.tobytes())


def _tile(example: Example) -> UInt8Array:
    height, width = example.disparity_px.shape
    x0, y0, x1, y1 = example.xyxy_px
    half_w = (0.5 + _MARGIN) * (x1 - x0)
    half_h = half_w * _TILE[1] / _TILE[0]
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    # the crop keeps its shape, so it may be moved but not cut at the rim of the picture
    scale = min(1.0, width / (2 * half_w), height / (2 * half_h))
    half_w, half_h = half_w * scale, half_h * scale
    left = float(np.clip(middle[0] - half_w, 0, width - 2 * half_w))
    top = float(np.clip(middle[1] - half_h, 0, height - 2 * half_h))
    crop = np.s_[int(top) : int(top + 2 * half_h), int(left) : int(left + 2 * half_w)]
    picture = example.left_rgb.copy()
    corners = [int(v) for v in example.xyxy_px]
    line = max(1, int((x1 - x0) / 120))
    cv2.rectangle(picture, (corners[0], corners[1]), (corners[2], corners[3]), rgb(VERMILION), line)
    # dark frames are brightened to be looked at
    shown = picture[crop].astype(np.float32)
    shown *= min(3.0, 200 / max(float(np.quantile(shown, 0.98)), 1.0))
    both = [np.clip(shown, 0, 255).astype(np.uint8), _coloured(example.disparity_px[crop])]
    images = np.hstack([cv2.resize(b, _TILE, interpolation=cv2.INTER_AREA) for b in both])
    tile = np.full((_TILE[1] + _CAPTION_PX + 6, 2 * _TILE[0] + 8, 3), 255, np.uint8)
    tile[_CAPTION_PX : _CAPTION_PX + _TILE[1], : 2 * _TILE[0]] = images
    text = f"{example.title}: {example.caption}"
    cv2.putText(tile, text, (2, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return tile


def _coloured(disparity_px: Float32Array) -> UInt8Array:
    """Disparity as colours between its quantiles; holes are dark grey."""
    known = np.isfinite(disparity_px)
    if not known.any():
        return np.full((*disparity_px.shape, 3), 40, np.uint8)
    low, high = np.quantile(disparity_px[known], [0.02, 0.98])
    share = np.clip((np.nan_to_num(disparity_px) - low) / max(float(high - low), 1.0), 0, 1)
    colour = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    return np.where(known[..., None], colour, 40).astype(np.uint8)


def _times(value: float) -> str:
    return "no distractor passes" if np.isinf(value) else f"{value:.1f} times"
