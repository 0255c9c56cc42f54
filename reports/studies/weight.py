"""The page on the width of w: what tuning on 20, 100 or 500 validation images chooses."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.pages import write_figure, write_page
from reports.palette import detector_name, mode_colour, mode_name
from reports.run.tables import Table, number
from rescore.studies.weight import WeightRecord, WeightStudy, write_weights


def write_weight_study(studies: Sequence[WeightStudy], folder: Path, command: str) -> Path:
    """Write the page with its figure and numbers; returns the page."""
    write_figure(folder / "weight.png", draw_widths(studies), dpi=120)
    write_weights(folder / "weight.json", [WeightRecord.of(s) for s in studies])
    return write_page(folder, _page(studies, command))


def width_table(studies: Sequence[WeightStudy], short: bool = False) -> Table:
    """A row a detector, mode and number of images; short names fit a terminal of 80 columns."""
    rows = []
    for s in studies:
        name = (detector_name(s.detector), mode_name(s.registration))
        if short:
            name = (detector_name(s.detector, short=True), s.registration.value)
        for width in s.widths:
            interval = f"{width.low:.2f} to {width.high:.2f}"
            half = f"{width.lower_quartile:.2f} to {width.upper_quartile:.2f}"
            rows.append(
                (*name, str(width.n_images), f"{width.median:.2f}", interval, half, number(width.loss))
            )
    head = ("detector", "scores", "images", "median w", "95 % of w", "middle half", "loss")
    return Table("The weight w by validation images", head, tuple(rows), text_columns=2)


def draw_widths(studies: Sequence[WeightStudy]) -> Figure:
    """Above, w over the number of images, a panel a detector; below, the objective over w on all images."""
    detectors = list(dict.fromkeys(s.detector for s in studies))
    figure = Figure(figsize=(5.2 * len(detectors), 7.4), layout="constrained")
    axes = figure.subplots(2, len(detectors), squeeze=False, sharey="row")
    for column, detector in enumerate(detectors):
        own = [s for s in studies if s.detector == detector]
        _draw_intervals(axes[0][column], own)
        _draw_objective(axes[1][column], own)
        axes[0][column].set_title(detector_name(detector), loc="left", fontweight="bold")
    axes[0][0].set_ylabel("chosen w (line 95 %, bar middle half)")
    axes[1][0].set_ylabel(f"{studies[0].objective.replace('_', ' ')}, {studies[0].n_images} images")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def _draw_intervals(ax: Axes, studies: Sequence[WeightStudy]) -> None:
    sizes = [width.n_images for width in studies[0].widths]
    for i, s in enumerate(studies):
        x = np.arange(len(sizes)) + 0.18 * (i - (len(studies) - 1) / 2)
        low, lower, median, upper, high = (
            [getattr(width, name) for width in s.widths]
            for name in ("low", "lower_quartile", "median", "upper_quartile", "high")
        )
        colour = mode_colour(s.registration)
        ax.vlines(x, low, high, color=colour, lw=1.5)
        ax.vlines(x, lower, upper, color=colour, lw=7, alpha=0.5)
        ax.plot(x, median, "o", color=colour, label=mode_name(s.registration))
    ax.set_xticks(range(len(sizes)), [str(n) for n in sizes])
    ax.set(xlabel="validation images", ylim=(-0.03, 1.03))
    ax.spines[["top", "right"]].set_visible(False)


def _draw_objective(ax: Axes, studies: Sequence[WeightStudy]) -> None:
    for s in studies:
        colour = mode_colour(s.registration)
        ax.plot(s.grid, s.value, color=colour)
        ax.plot([s.w], [s.value[int(np.argmin(np.abs(s.grid - s.w)))]], "o", color=colour)
    ax.set(xlabel="w: 0 trusts the depth alone, 1 the detector alone", xlim=(-0.02, 1.02))
    ax.spines[["top", "right"]].set_visible(False)


def _sentences(studies: Sequence[WeightStudy]) -> str:
    """How the width shrinks from the smallest to the largest size, an item a detector and mode."""
    lines = []
    for s in studies:
        few, many = s.widths[0], s.widths[-1]
        lines.append(
            f"- {detector_name(s.detector, short=True)}, {s.registration}: 95 % of the choices lie within "
            f"{few.high - few.low:.2f} of each other on {few.n_images} images, within "
            f"{many.high - many.low:.2f} on {many.n_images}; on all images w = {s.w:.2f}."
        )
    return "\n".join(lines)


def _page(studies: Sequence[WeightStudy], command: str) -> str:
    first = studies[0]
    objective = first.objective.replace("_", " ")
    parts = [
        "# How well validation images determine w",
        f"Made by `{command}`: w of eq. 7 tuned by {objective} on {first.n_draws} subsets of "
        f"{first.n_images} rendered validation images with {first.n_cars} annotated cars, drawn with "
        "replacement. No test image takes part. Loss: what the choices lose on all these images against the "
        f"best w there, on average, in {objective}. Subsets of as many images as there are differ only by "
        "what is drawn twice, as in a bootstrap.",
        _sentences(studies),
        width_table(studies).markdown().rstrip(),
        "![Chosen w by validation images, and the objective over w](weight.png)",
    ]
    return "\n\n".join(parts) + "\n"
