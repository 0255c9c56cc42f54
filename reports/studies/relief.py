"""The page on the relief of cars: true shape, fitted instance and class model against the best plane."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from recon.arrays import FloatArray
from reports.pages import write_figure, write_page
from reports.palette import BLUE, DARK_GREY, GREEN, GREY, ORANGE, PURPLE, VERMILION
from reports.run.tables import Table, number
from rescore.studies.relief.relief_file import (
    DISTANCES_M,
    MAIN_SURFACES,
    SURFACES,
    TARGET_BELOW_M,
    MatcherErrors,
    Middle,
    ReliefCar,
    ReliefCell,
    ReliefResult,
    View,
    write_relief,
)

NAMES = {
    "true": "true shape",
    "framed": "fitted, framed",
    "seen": "fitted, seen",
    "space": "class model, true pose",
    "true_ideal": "true shape, ideal matcher",
}
_STYLE = {
    "true": (DARK_GREY, "s"),
    "framed": (GREEN, "D"),
    "seen": (BLUE, "^"),
    "space": (ORANGE, "o"),
    "true_ideal": (PURPLE, "*"),
}
_LINEAR_NATS = 10.0
"""Up to here the axis of nats is linear, beyond it logarithmic."""
SHARE_WANTED = 0.6
"""Share of the true shape's ratio that the fitted instance should reach."""


def write_relief_study(result: ReliefResult, folder: Path) -> Path:
    """Write the page with its figure and numbers; returns the page."""
    write_figure(folder / "relief.png", draw_relief(result))
    write_relief(folder / "relief.json", result)
    return write_page(folder, relief_page(result))


def cells_table(result: ReliefResult) -> Table:
    """A row a view and group of distances: cars, and the median ratio of each main surface."""
    rows = [
        (
            cell.views[0].value,
            _between(cell),
            str(cell.n_cars),
            str(cell.n_fitted),
            str(cell.n_images),
            *(middle_text(cell.median[name]) for name in NAMES),
        )
        for cell in result.cells
    ]
    head = ("view", "distance", "cars", "fitted", "images", *NAMES.values())
    return Table("Nats over the best plane", head, tuple(rows), text_columns=2)


def causes_table(result: ReliefResult) -> Table:
    """A row a surface: its median ratio on the cars of the target, how often it beats the plane, and its
    median by stereo head."""
    cell = result.target
    rows = [
        (
            what,
            middle_text(cell.median[name]),
            _percent(cell.above_plane[name]),
            *(_signed(rig.median[name].value) for rig in result.rigs.values()),
        )
        for name, what in SURFACES.items()
    ]
    head = ("surface", "median nats", "beats the plane", *(f"head {rig}" for rig in result.rigs))
    return Table("What stands in the way", head, tuple(rows))


def rigs_table(result: ReliefResult) -> Table:
    """A row a stereo head: the cars of the target, and the fitted instance against the true shape."""
    names = ("true_ideal", "true", "framed")
    rows = [
        (
            rig,
            str(cell.n_cars),
            str(cell.n_fitted),
            *(middle_text(cell.median[name]) for name in names),
            _share_text(cell.share_of_true),
            *(middle_text(cell.median[name]) for name in ("true_tilted", "framed_tilted")),
            _share_text(cell.share_of_relief),
        )
        for rig, cell in {**result.rigs, "all": result.target}.items()
    ]
    relief = ("true + plane", "framed + plane", "share")
    head = ("stereo head", "cars", "fitted", *(NAMES[name] for name in names), "share", *relief)
    return Table("By stereo head", head, tuple(rows))


def matcher_table(cars: Sequence[ReliefCar]) -> Table:
    """Two rows: the matcher's errors on textured and on blank pixels of all cars."""
    rows = (
        _matcher_row("textured", [car.textured for car in cars], cars),
        _matcher_row("blank", [car.blank for car in cars], cars),
    )
    head = ("pixels of cars", "share", "measured", "median error (px)", "2 px too low", "2 px too high")
    return Table("The matcher on cars", head, rows)


def _matcher_row(what: str, errors: Sequence[MatcherErrors], cars: Sequence[ReliefCar]) -> tuple[str, ...]:
    """Shares over the pixels of all cars, and the median over cars of the median error."""
    count = np.array([e.n_pixels for e in errors], float)
    measured = count * [e.measured_share for e in errors]
    bias = [e.bias_px for e in errors if np.isfinite(e.bias_px)]
    low, high = (
        float(measured @ np.nan_to_num([getattr(e, side) for e in errors])) / max(1.0, measured.sum())
        for side in ("low_share", "high_share")
    )
    return (
        what,
        f"{count.sum() / max(1, sum(car.n_pixels for car in cars)):.0%}",
        f"{measured.sum() / max(1.0, count.sum()):.0%}",
        number(float(np.median(bias)) if bias else None, 2).replace("-", "−"),
        f"{low:.0%}",
        f"{high:.0%}",
    )


def middle_text(middle: Middle, digits: int = 1) -> str:
    """A median with its interval where there is one; a dash where it is undefined."""
    value, low, high = (number(v, digits).replace("-", "−") for v in (middle.value, middle.low, middle.high))
    return f"{value} [{low}, {high}]" if np.isfinite(middle.low) else value


def target_sentence(cell: ReliefCell) -> str:
    """Whether the fitted instance reaches what was asked of it."""
    true, framed = cell.median["true"], cell.median["framed"]
    said = (
        f"Three-quarter views and ends below {TARGET_BELOW_M:g} m ({cell.n_cars} cars): the true shape has a "
        f"median of {middle_text(true)} nats over the best plane, the framed instance {middle_text(framed)} "
        f"(of {cell.n_fitted} cars). "
    )
    if not np.isfinite(cell.share_of_true.value):
        said += (
            "The true shape itself does not beat the plane in the median, so that a share of it says nothing."
        )
    else:
        said += (
            f"It reaches {_share_text(cell.share_of_true)} of the true shape's ratio; "
            f"{SHARE_WANTED:.0%} are wanted. {_verdict(cell.share_of_true)}"
        )
    return (
        f"{said} With a free plane added to both, so that relief alone counts and the freedom is that of the "
        f"plane, it has {middle_text(cell.median['framed_tilted'])} of "
        f"{middle_text(cell.median['true_tilted'])} nats: {_share_text(cell.share_of_relief)}."
    )


def _share_text(share: Middle) -> str:
    """A share with its interval; a dash where the true shape does not beat the plane."""
    if not np.isfinite(share.value):
        return "–"
    ends = (f"{v:.0%}" if np.isfinite(v) else "any" for v in (share.low, share.high))
    return f"{share.value:.0%} [{', '.join(ends)}]".replace("-", "−")


def _verdict(share: Middle) -> str:
    if share.low >= SHARE_WANTED:
        return "It is reached, beyond the interval."
    reached = "It is reached" if share.value >= SHARE_WANTED else "It is missed"
    return f"{reached}, but not beyond the interval." if share.high >= SHARE_WANTED else f"{reached}."


def causes_text(result: ReliefResult) -> str:
    """What stands between the fitted instance and the bound, an item a cause with its number."""
    cell, near = result.target, _near(result.cars)
    nats = {name: cell.median[name].value for name in SURFACES}

    def against(name: str, other: str) -> str:
        return f"{_signed(nats[name])} against {_signed(nats[other])} nats"

    items = [
        f"The ground: {cell.n_cars - cell.n_fitted} of the {cell.n_cars} cars have no fit: in their frame no "
        "ground is stated, and the one of stereo is not trusted.",
        f"The relief itself, had the matcher no errors but the noise: {_signed(nats['true_ideal'])} nats.",
        f"The matcher: with its measurements the true shape has {_signed(nats['true'])} nats. A plane "
        "follows what it gets wrong on blank panels, the true shape does not. On textured pixels alone the "
        f"true shape has {_signed(nats['true_textured'])}, with a free plane added "
        f"{_signed(nats['true_tilted'])}.",
        "The shape space: the nearest shape in the true pose against the true shape, "
        f"{against('space', 'true')}.",
        f"The shapes that the fit tries: the nearest one, {against('fit_shapes', 'space')}.",
        "Search and what is searched for: the framed instance moved to where this likelihood is greatest, "
        f"{against('framed_climbed', 'framed')}; bent too, {_signed(nats['framed_shaped'])}.",
        "The pose: median error of the framed instance "
        f"{number(_median(near, lambda c: c.place_error_m), 2)} m and "
        f"{number(_median(near, lambda c: c.heading_error_deg), 1)} degrees.",
        "The silhouette: it covers "
        f"{_percent(_median(near, lambda c: c.covered_share))} of the pixels in the median; those beside it "
        f"counted as wrong measurements, {against('framed_strict', 'framed')}.",
        f"The edge: the true shape with the pixels at the car's edge, {against('true_edges', 'true')}.",
    ]
    return "\n".join(f"- {item}" for item in items)


def _near(cars: Sequence[ReliefCar]) -> list[ReliefCar]:
    return [c for c in cars if c.view is not View.SIDE and c.distance_m < TARGET_BELOW_M]


def _median(cars: Sequence[ReliefCar], of: Callable[[ReliefCar], float]) -> float:
    known = [value for car in cars if np.isfinite(value := of(car))]
    return float(np.median(known)) if known else float("nan")


def _percent(share: float) -> str:
    return f"{share:.0%}" if np.isfinite(share) else "–"


def _signed(value: float) -> str:
    return "–" if not np.isfinite(value) else f"{value:.1f}".replace("-", "−")


def _cars(count: int) -> str:
    return f"{count} car{'s' * (count != 1)}"


def _between(cell: ReliefCell) -> str:
    return f"{cell.from_m:g} to {cell.to_m:g} m"


def draw_relief(result: ReliefResult) -> Figure:
    """Above, a panel a view: medians over distance; below, all surfaces on the cars of the target."""
    figure = Figure(figsize=(12.0, 9.6), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.0, 1.05], squeeze=False)[:, 0]
    axes = above.subplots(1, len(View), sharey=True)
    for ax, view in zip(axes, View, strict=True):
        _draw_view(ax, [cell for cell in result.cells if cell.views == (view,)], view)
    axes[0].set_ylabel("nats over the best plane, median")
    handles, labels = axes[-1].get_legend_handles_labels()
    above.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    _draw_causes(below.subplots(), result.target)
    return figure


def _draw_view(ax: Axes, cells: Sequence[ReliefCell], view: View) -> None:
    groups = list(pairwise(DISTANCES_M))
    ax.axhline(0, color=GREY, lw=1)
    for k, name in enumerate(NAMES):
        colour, marker = _STYLE[name]
        x = np.array([groups.index((cell.from_m, cell.to_m)) for cell in cells], float)
        x = x + 0.15 * (k - (len(NAMES) - 1) / 2)
        value, low, high = _ends([cell.median[name] for cell in cells])
        ax.vlines(x, low, high, color=colour, lw=1.8, alpha=0.55)
        ax.plot(x, value, marker, color=colour, label=NAMES[name])
    count = {(cell.from_m, cell.to_m): cell.n_cars for cell in cells}
    labels = [f"{low:g}–{high:g} m\n{_cars(count.get((low, high), 0))}" for low, high in groups]
    ax.set_xticks(range(len(groups)), labels)
    ax.set_yscale("symlog", linthresh=_LINEAR_NATS)
    ax.yaxis.set_major_formatter(ScalarFormatter())
    ax.set(xlim=(-0.6, len(groups) - 0.4))
    ax.set_title(view.value, loc="left", fontweight="bold")
    ax.spines[["top", "right"]].set_visible(False)


def _draw_causes(ax: Axes, cell: ReliefCell) -> None:
    value, low, high = _ends([cell.median[name] for name in SURFACES])
    y = np.arange(len(SURFACES))[::-1]
    colour = [VERMILION if name in MAIN_SURFACES else DARK_GREY for name in SURFACES]
    ax.axvline(0, color=GREY, lw=1)
    ax.hlines(y, low, high, color=colour, lw=2.4, alpha=0.5)
    ax.scatter(value, y, c=colour, s=30, zorder=3)
    ax.set_yticks(y, list(SURFACES.values()))
    ax.set_xlabel("nats over the best plane, median and 95 % interval")
    ax.set_title(
        f"three-quarter views and ends below {TARGET_BELOW_M:g} m, {cell.n_cars} cars",
        loc="left",
        fontweight="bold",
    )
    ax.spines[["top", "right"]].set_visible(False)


def _ends(middles: Sequence[Middle]) -> tuple[FloatArray, FloatArray, FloatArray]:
    value, low, high = np.array([(m.value, m.low, m.high) for m in middles], float).reshape(-1, 3).T
    return value, low, high


def relief_page(result: ReliefResult) -> str:
    """The page in Markdown; its picture lies beside it."""
    noise = result.noise
    parts = [
        "# What a car's disparity says beyond a plane",
        f"Made by `{result.command}`: {len(result.cars)} annotated cars of {result.n_images} rendered images "
        f"(split {result.split}) that are whole and in sight, nearer than {DISTANCES_M[-1]:g} m.",
        "A figure is the logarithm of how much likelier the measured disparity is under a surface than under "
        "the best slanted plane, in nats: above 0 the surface explains it better. The plane is fitted to the "
        "same pixels by the same likelihood, all of its three numbers free, from 200 starts of which the "
        "best ten are climbed from; the true shape has nothing free. Noise, the same for all: "
        f"{noise.sd_px:g} px, {noise.outliers:.0%} of the measurements anywhere from 0 to "
        f"{noise.largest_px:g} px, one independent measurement in {noise.independent_px:g} pixels. Pixels "
        "within two of the car's edge are left out. Where a silhouette does not reach, the surface goes on "
        "at its nearest value. A car is seen from an end or a side if it is within 15 degrees of it. Medians "
        "over cars with intervals of 95 % from a bootstrap over images.",
        target_sentence(result.target),
        "![Nats over the best plane by view and distance, and by surface](relief.png)",
        "## By view and distance",
        cells_table(result).markdown().rstrip(),
        "An ideal matcher is one whose errors are those of the noise: that is what the relief of cars is "
        "worth. What the other columns have less is lost in the matcher, the shape and the pose.",
        "## By stereo head",
        f"Three-quarter views and ends below {TARGET_BELOW_M:g} m. A share is the median of the fitted "
        "instance over that of the true shape, both over the fitted cars; there is none where the true shape "
        "does not beat the plane, and no end of its interval (any) where that is so in many resamples. "
        "The last columns have a free plane of disparity added to both: the freedom that the plane has, so "
        "that a matcher that is wrong as a plane is wrong is forgiven, and relief alone counts.",
        rigs_table(result).markdown().rstrip(),
        "## What stands in the way",
        f"Three-quarter views and ends below {TARGET_BELOW_M:g} m:",
        causes_text(result),
        causes_table(result).markdown().rstrip(),
        "## The matcher on cars",
        "Measured less true disparity. A pixel is textured where the picture changes along its row by two "
        "grey levels a pixel or more, around it on average. On blank pixels the errors are one-sided, "
        "towards what is farther away, as what surrounds a car is.",
        matcher_table(result.cars).markdown().rstrip(),
    ]
    return "\n\n".join(parts) + "\n"
