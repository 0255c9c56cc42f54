"""The page on speed: ``python -m reports.publishing.bench BENCH_JSON FOLDER COMMAND``.

Shows what ``make bench`` measured: each figure beside what it is wanted to be, and how times grow.
"""

import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from reports.charts import Axis, Chart, Line, Look
from reports.pages import write_figure, write_page
from reports.publishing.bench_file import Bench, Growth, Row, read_bench
from reports.run.curve_pictures import STYLE, draw_chart
from reports.run.tables import Table

_LOOKS = tuple(Look.of_mode(mode) for mode in ("metric", "paper"))
"""Looks of the lines of one chart, first to last."""
_ROOM = 1.08
_ROOM_ABOVE = 1.25
"""Height of the legend, which stands above the lines."""
CLOCKS = {"processor": "one core", "wall": "wall", "memory": "memory"}


def publish_bench(file: Path, folder: Path, command: str) -> Path:
    """Write the page with its figure, and a copy of the numbers; returns the page.

    Args:
        file: what ``make bench`` wrote.
        folder: where to publish.
        command: what makes the page, for its text.

    Raises:
        RescoreError: no such file or another content.
    """
    bench = read_bench(file)
    folder.mkdir(parents=True, exist_ok=True)
    if bench.growth:
        write_figure(folder / "growth.png", draw_growth(bench.growth))
    shutil.copyfile(file, folder / "bench.json")
    return write_page(folder, _page(bench, command))


@dataclass(frozen=True)
class Straight:
    """The straight line nearest to times over a size, relative to each time."""

    fixed_s: float
    each_s: float
    departure: float
    """Largest distance of a time from the line, as a share of the time."""

    @staticmethod
    def through(growth: Growth) -> "Straight":
        """The line of least squared relative distances."""
        size, seconds = np.array(growth.size), np.array(growth.seconds)
        terms = np.stack([np.ones_like(size), size], axis=1) / seconds[:, None]
        (fixed, each), *_ = np.linalg.lstsq(terms, np.ones_like(size))
        departure = np.abs((fixed + each * size) / seconds - 1).max()
        return Straight(float(fixed), float(each), float(departure))


def row_table(rows: Sequence[Row]) -> Table:
    """A row a figure, with what it is wanted to be and whether it is."""
    head = ("what", "clock", "ours, ms", "bare, ms", "value", "wanted", "holds")
    cells = []
    for row in rows:
        times = ("" if ms is None else f"{ms:.0f}" for ms in (row.ours_ms, row.bare_ms))
        sign, unit = "≥" if row.at_least else "≤", "" if row.unit == "ratio" else f" {row.unit}"
        value, wanted = f"{row.value:.3g}{unit}", f"{sign} {row.wanted:g}{unit}"
        cells.append((row.what, CLOCKS[row.clock], *times, value, wanted, "yes" if row.holds else "no"))
    return Table("Figures", head, tuple(cells), text_columns=2)


def growth_table(growth: Sequence[Growth]) -> Table:
    """A row a kind of work: its time at both ends, and the nearest straight line."""
    head = ("what", "over", "from", "to", "fixed, ms", "each, ms", "off the line, %", "why")
    cells = []
    for one in growth:
        line = Straight.through(one)
        ends = (f"{one.size[i]:.3g}: {1e3 * one.seconds[i]:.0f} ms" for i in (0, -1))
        parts = (1e3 * line.fixed_s, 1e3 * line.each_s, 100 * line.departure)
        cells.append((one.name, one.along, *ends, *(f"{p:.3g}" for p in parts), one.note))
    return Table("How time grows", head, tuple(cells), text_columns=2)


def growth_charts(growth: Sequence[Growth]) -> list[Chart]:
    """A chart a size that grows, with a line a kind of work; both axes linear, so that linear is straight."""
    charts = []
    for along in dict.fromkeys(one.along for one in growth):
        own = [one for one in growth if one.along == along]
        lines = tuple(
            Line(
                one.name,
                f"{1e3 * one.seconds[-1]:.0f} ms at {one.size[-1]:.3g}",
                look,
                one.size,
                1e3 * np.array(one.seconds),
                (),
            )
            for one, look in zip(own, _LOOKS, strict=False)
        )
        x = Axis(along, 0, _ROOM * max(max(one.size) for one in own))
        y = Axis("time, ms", 0, _ROOM_ABOVE * 1e3 * max(max(one.seconds) for one in own))
        charts.append(Chart(f"Time over {along}", f"Time over {along}", x, y, lines))
    return charts


def draw_growth(growth: Sequence[Growth]) -> Figure:
    """The charts in one picture, two side by side."""
    charts = growth_charts(growth)
    with mpl.rc_context(STYLE):
        rows = -(-len(charts) // 2)
        figure = Figure(figsize=(13, 4.8 * rows), layout="constrained")
        axes = figure.subplots(rows, 2, squeeze=False).ravel()
        for ax, chart in zip(axes, charts, strict=False):
            draw_chart(ax, chart, "upper left")
            for line in chart.lines:
                ax.plot(line.x, line.y, "o", color=line.look.light, ms=4)
        for ax in axes[len(charts) :]:
            ax.remove()
    return figure


def _page(bench: Bench, command: str) -> str:
    m = bench.machine
    versions = ", ".join(f"{name} {number}" for name, number in bench.versions.items())
    n_held = sum(row.holds for row in bench.rows)
    failures = (f"Not measured: {name} ({error})." for name, error in bench.failed.items())
    parts = [
        "# Speed and memory",
        f"Made by `{command}` from what `{bench.command}` measured on {m.n_cores} cores of {m.processor} "
        f"with {m.memory_gb:g} GB, {m.system}: `bench.json`. {n_held} of {len(bench.rows)} figures are as "
        "wanted. Ratios are medians of paired runs in one process with one thread, each side timed in turn, "
        "so that they say the same on a slower machine; wall times hold for this one.",
        "\n\n".join((row_table(bench.rows).markdown().rstrip(), *failures)),
        "## How time grows",
        "The nearest straight line, fixed part and part of each, and how far the times depart from it.",
        growth_table(bench.growth).markdown().rstrip(),
        "![Time over candidates, picture size, views and frames](growth.png)",
        f"Versions: {versions}.",
    ]
    return "\n\n".join(parts if bench.growth else [*parts[:3], parts[-1]]) + "\n"


if __name__ == "__main__":
    print(publish_bench(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
