"""The page on class models: primitives that suffice, errors against truth, models from several sides."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.learning.primitives import plane_axes
from recon.view_bins import rotation
from reports.pages import write_figure, write_page
from reports.palette import BLUE, DARK_GREY, GREY, PALE_GREY, SOFT_GREY, part_colour
from reports.run.tables import Table
from rescore.studies.class_models import SHOWN_PRIMITIVES, AccuracyRow, ModelStudy, SelectionStudy
from rescore.studies.class_models_file import ModelsResult, write_models

_SEEN_FROM = ((30, 20), (90, 5), (150, 20), (270, 35))
"""Azimuth and elevation in degrees from which models are drawn."""


def write_study(study: ModelStudy, folder: Path, command: str) -> Path:
    """Write the page with its pictures and numbers; returns the page."""
    pictures = {
        "primitives_cost.png": draw_selection_cost(study.selection),
        "primitives_chosen.png": draw_chosen(study.selection),
        "models.png": draw_models(study.models),
    }
    for name, figure in pictures.items():
        write_figure(folder / name, figure)
    write_models(folder / "models.json", ModelsResult.of(study))
    return write_page(folder, _page(study, command))


def draw_selection_cost(study: SelectionStudy) -> Figure:
    """Root-mean-square distance of carried boundaries over the number of primitives."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    ax = figure.subplots()
    cost = np.sqrt(study.selection.cost)
    full = float(np.sqrt(study.selection.full_cost))
    ax.plot(np.arange(1, len(cost) + 1), cost, "o-", color=BLUE)
    ax.axhline(full, color=GREY, ls="--", lw=1)
    ax.annotate(
        f"all {len(study.normals)} primitives", (len(cost), full), ha="right", va="top", color=DARK_GREY,
        xytext=(0, -4), textcoords="offset points",
    )  # fmt: skip
    for i, value in enumerate(cost[:5]):
        ax.annotate(
            f"+{value / full - 1:.1%}", (i + 1, value), xytext=(6, 4), textcoords="offset points", fontsize=9
        )
    ax.set(
        xlabel="primitives, chosen greedily",
        ylabel="error of carried boundaries\n(share of the part's size)",
        title=f"{len(study.parts)} parts of chair, bicycle, airplane and car",
        ylim=(full - 0.3 * (cost[0] - full), cost[0] + 0.15 * (cost[0] - full)),
        xticks=np.arange(1, len(cost) + 1),
    )
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def draw_chosen(study: SelectionStudy) -> Figure:
    """The first chosen primitives, each over the parts that it costs least among them (figure 1 of the
    report)."""
    order = study.selection.order[:SHOWN_PRIMITIVES]
    of_part = study.best_of_first(SHOWN_PRIMITIVES)
    figure = Figure(figsize=(3 * len(order), 5.4), layout="constrained")
    axes = figure.subplots(2, len(order), height_ratios=(1, 1.25), squeeze=False)
    for column, primitive in enumerate(order):
        _draw_primitive(axes[0, column], study.normals[primitive])
        lines = []
        previous = ""
        for (class_name, part), chosen in zip(study.parts, of_part, strict=True):
            if chosen == column:
                if class_name != previous:
                    lines.append(class_name.removesuffix("_six_parts"))
                previous = class_name
                lines.append(f"   {part.replace('_', ' ')}")
        axes[1, column].text(0.1, 1.0, "\n".join(lines), va="top", fontsize=10, linespacing=1.35)
        axes[1, column].axis("off")
    return figure


def _draw_primitive(ax: Axes, normal: FloatArray) -> None:
    """A square of this orientation on the axes of the object frame."""
    view = rotation(np.deg2rad(35), np.deg2rad(25))
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ plane_axes(normal)
    for axis, name in zip(np.eye(3) * 1.7, ("x forward", "y left", "z up"), strict=True):
        end = view[:2] @ axis
        ax.plot([0, end[0]], [0, end[1]], color=PALE_GREY, lw=1, zorder=0)
        ax.annotate(name, 1.12 * end, fontsize=8, color=SOFT_GREY, ha="center", va="center")
    ax.add_patch(Polygon(square @ view[:2].T, fc=BLUE, ec="black", alpha=0.75))
    ax.set(xlim=(-2.1, 2.1), ylim=(1.9, -2.1), aspect="equal")
    ax.set_title(f"normal ({', '.join(f'{v + 0.0:.2f}' for v in normal)})", fontsize=10)
    ax.axis("off")


def draw_models(models: Sequence[tuple[str, ClassModel]]) -> Figure:
    """Each model's parts from several sides (figures 2 and 3 of the report)."""
    figure = Figure(figsize=(3.1 * len(_SEEN_FROM), 2.5 * len(models)), layout="constrained")
    axes = figure.subplots(len(models), len(_SEEN_FROM), squeeze=False)
    for row, (words, model) in zip(axes, models, strict=True):
        for ax, (azimuth, elevation) in zip(row, _SEEN_FROM, strict=True):
            draw_model(ax, model, rotation(np.deg2rad(azimuth), np.deg2rad(elevation)))
            ax.set_title(f"azimuth {azimuth}, elevation {elevation}", fontsize=8, color=SOFT_GREY, y=-0.12)
        row[0].set_title(f"{model.class_name}, from {words}", fontsize=10, loc="left")
    return figure


def draw_model(ax: Axes, model: ClassModel, view_from_object: FloatArray) -> None:
    """Part outlines under orthographic projection, far ones first."""
    seen = [(p, p.outline @ view_from_object.T) for p in model.parts if p.view_count > 1]
    for part, outline in sorted(seen, key=lambda item: -float(item[1][:, 2].mean())):
        ax.add_patch(Polygon(outline[:, :2], fc=part_colour(part.label), ec="black", lw=0.6, alpha=0.85))
    points = np.concatenate([outline[:, :2] for _, outline in seen])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * (high - low).max()
    ax.set(xlim=(low[0] - margin, high[0] + margin), ylim=(high[1] + margin, low[1] - margin), aspect="equal")
    ax.axis("off")


def _page(study: ModelStudy, command: str) -> str:
    selection = study.selection
    error = np.sqrt(selection.selection.cost / selection.selection.full_cost)
    rises = ", ".join(f"{value - 1:.1%} with {i}" for i, value in enumerate(error[:5], start=1))
    few = (
        f"The library holds {len(selection.normals)} orientations. The {len(selection.parts)} parts of "
        "chair, bicycle, airplane and car (in six parts, as the report has them) are carried between views, "
        "each by the best of the chosen primitives. Over the whole library the error rises by "
        f"{rises} primitives. Boundaries that no primitive explains, since a part is seen edge-on or half "
        "hidden, count the same for all, which makes the rise look smaller than it is."
    )
    truth = (
        "Test shapes, each learned from neighbouring labelled views of its own, knowing the view bins alone. "
        "Parts that at least two views show; rods (legs, handlebars, fuselages) have no normal. Centroids in "
        "lengths of the object's longest side, after the best scale and shift. More views sharpen "
        "planes; centroids may suffer, since parts that turn away, or hide, have the middle of what is seen "
        "elsewhere. "
        "They count for little, but without them nothing says how wide an object is."
    )
    parts = [
        "# Class models",
        f"Made by `{command}`. `models.json` holds the numbers.",
        f"## A few primitives serve all parts\n\n{few}",
        "![Error over the number of primitives](primitives_cost.png)",
        "The first four, and the parts that each represents (as in figure 1 of the report):",
        "![The four primitives and their parts](primitives_chosen.png)",
        f"## Planes and skeletons against the truth\n\n{truth}",
        accuracy_table(study.accuracy).markdown().rstrip(),
        "## Models of two views\n\nOnly parts that both views show are drawn.",
        "![Learned models from several sides](models.png)",
    ]
    return "\n\n".join(parts) + "\n"


def accuracy_table(rows: Sequence[AccuracyRow]) -> Table:
    """Errors by class, view space and number of views."""
    head = (
        "class", "elevation", "views", "models", "parts", "normal, median", "normal, 90 %",
        "centroid, median", "centroid, 90 %",
    )  # fmt: skip
    cells = [
        (
            row.class_name,
            f"{row.elevation_deg:g} deg",
            str(row.n_views),
            str(row.n_models),
            str(row.n_parts),
            f"{row.normal_deg:.1f} deg",
            f"{row.normal_deg_90:.1f} deg",
            f"{row.centroid:.1%}",
            f"{row.centroid_90:.1%}",
        )
        for row in rows
    ]
    return Table("Errors of learned models", head, tuple(cells))
