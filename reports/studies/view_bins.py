"""Pictures of confusion tables, and the page on the choice of view bins."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from recon.files import atomic_path
from reports.pages import write_page
from rescore.studies.view_bins import Confusion, load_confusions

TITLES = {"level_set": "outline by level set", "true_outline": "true outline"}


def write_confusion(tables_path: Path, out: Path) -> None:
    """Draw every table of a file that ``rescore study-views`` wrote, side by side, as a PNG.

    Raises:
        RescoreError: no such file, or something else.
    """
    tables, title = load_confusions(tables_path)
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(5.2 * len(tables), 6.2), layout="constrained")
        figure.suptitle(f"View bins of {title}")
        axes = figure.subplots(1, len(tables), squeeze=False)[0]
        for ax, (name, table) in zip(axes, tables.items(), strict=True):
            draw_confusion(ax, table, TITLES.get(name, name))
        with atomic_path(out) as beside:
            figure.savefig(beside, format="png", dpi=110)


def draw_confusion(ax: Axes, table: Confusion, title: str) -> None:
    """A heat map with numbers: true bins as rows, chosen bins as columns, shares in the title."""
    counts = table.counts
    row_share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    ax.imshow(row_share, cmap="Blues", vmin=0, vmax=1)
    for row, column in zip(*np.nonzero(counts), strict=True):
        colour = "w" if row_share[row, column] > 0.6 else "k"
        ax.text(column, row, str(counts[row, column]), ha="center", va="center", color=colour)
    ticks = range(len(counts))
    ax.set(xticks=ticks, yticks=ticks, xlabel="chosen bin", ylabel="true bin")
    ax.set_title(f"{title}\n{_shares_text(table)}")


def _shares_text(table: Confusion) -> str:
    shown = [f"{name.replace('_', ' ')} {share:.0%}" for name, share in table.shares()]
    failed = sum(table.failures.values())
    return f"{', '.join(shown[:2])} of {table.photos}, {failed} without a bin\n{', '.join(shown[2:])}"


def write_view_study(folder: Path, names: Sequence[str], learned_shapes: int, command: str) -> Path:
    """Draw the tables ``NAME.json`` of a folder and write the page that shows them; returns the page.

    Args:
        folder: where the tables are, and the pictures and the page go.
        names: of the tables, in the order of the page.
        learned_shapes: training shapes of each class model.
        command: what made the tables, for the page.

    Raises:
        RescoreError: a table is missing, or something else.
    """
    studies = {name: load_confusions(folder / f"{name}.json") for name in names}
    for name in names:
        write_confusion(folder / f"{name}.json", folder / f"{name}.png")
    return write_page(folder, _page(studies, learned_shapes, command))


def _page(studies: Mapping[str, tuple[dict[str, Confusion], str]], learned_shapes: int, command: str) -> str:
    table = next(iter(next(iter(studies.values()))[0].values()))
    bins, photos = len(table.counts), table.photos
    parts = [
        "# View bins chosen by the class model",
        f"Made by `{command}`.",
        f"{photos} rendered photographs of test shapes a row, azimuths spread over all {bins} bins, true\n"
        f"boxes; class models of {learned_shapes} training shapes. The true outline, that of the true mask,\n"
        f"takes the place of the level set's. Chance is {1 / bins:.0%} for the right bin and {3 / bins:.0%}\n"
        "for a bin within one of it. The right bin has its standard error.",
        _shares_table([(title, tables) for tables, title in studies.values()]),
        "Mistakes by more than one bin, the most frequent first:",
        "\n".join(
            f"- {title}, {TITLES.get(name, name)}: {_mistakes(one)}"
            for tables, title in studies.values()
            for name, one in tables.items()
        ),
        *(f"![Confusion of view bins, {title}]({name}.png)" for name, (_, title) in studies.items()),
    ]
    return "\n\n".join(parts) + "\n"


def _shares_table(rows: Sequence[tuple[str, Mapping[str, Confusion]]]) -> str:
    """A row a table; the right bin with its standard error."""
    lines = [
        "| | right bin | within one | mirrored | ends exchanged | opposite side |",
        "|---|" + "---:|" * 5,
    ]
    for title, tables in rows:
        for name, table in tables.items():
            s = table.shares()
            spread = np.sqrt(s.exact * (1 - s.exact) / max(table.photos, 1))
            cells = [f"{title}, {TITLES.get(name, name)}", f"{100 * s.exact:.0f} ± {100 * spread:.0f} %"]
            others = (s.within_one, s.mirrored, s.ends_exchanged, s.opposite)
            cells += [f"{100 * share:.0f} %" for share in others]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _mistakes(table: Confusion, most: int = 3) -> str:
    """The most frequent confusions of bins that do not adjoin, in words."""
    k = len(table.counts)
    true, chosen = np.mgrid[:k, :k]
    far = np.where(np.isin((chosen - true) % k, [0, 1, k - 1]), 0, table.counts)
    order = np.argsort(-far, axis=None, kind="stable")[:most]
    shown = [
        f"{chosen.flat[i]} for {true.flat[i]} ({far.flat[i]} of {table.counts[true.flat[i]].sum()})"
        for i in order
        if far.flat[i]
    ]
    return "; ".join(shown) or "none"
