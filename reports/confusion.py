"""Pictures of confusion tables: ``python -m reports.confusion TABLES.json OUT.png``."""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rescore.confusion import Confusion, load_confusions
from rescore.store import atomic_path

TITLES = {"level_set": "outline by level set", "true_outline": "true outline"}


def write_confusion(tables_path: Path, out: Path) -> None:
    """Draw every table of a file that ``datasets_synth.view_confusion`` wrote, side by side, as a PNG.

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
    shown = [f"{name.replace('_', ' ')} {share:.0%}" for name, share in table.shares().items()]
    failed = sum(table.failures.values())
    return f"{', '.join(shown[:2])} of {table.photos}, {failed} without a bin\n{', '.join(shown[2:])}"


if __name__ == "__main__":
    write_confusion(Path(sys.argv[1]), Path(sys.argv[2]))
