"""Measures, prints tables and writes bench.json: ``python -m tests.bench [GROUP...] [--out FILE]``.

What a group measured is written before the next begins, and one that fails leaves the others alone.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from reports.publishing.bench_file import Growth, Row, bench_of_this_machine, write_bench
from tests.bench import rows_evidence, rows_memory, rows_render, rows_results
from tests.bench.growth import growing
from tests.bench.rows_demo import demo_and_detectors
from tests.bench.rows_engines import engines
from tests.bench.rows_grasp import grasping
from tests.bench.rows_learning import generic, learning
from tests.bench.rows_start import starting

Measured = tuple[list[Row], list[Growth]]


def _rows(*parts: Callable[[], list[Row]]) -> Callable[[], Measured]:
    return lambda: ([row for part in parts for row in part()], [])


GROUPS: dict[str, Callable[[], Measured]] = {
    "start": _rows(starting),
    "known": _rows(rows_evidence.known_view),
    "known_kitti": _rows(rows_evidence.known_view_kitti),
    "views_kitti": _rows(rows_evidence.chosen_view_kitti),
    "live": _rows(rows_evidence.live_loop),
    "modes": _rows(rows_evidence.all_modes),
    "reconstruction": _rows(rows_evidence.reconstruction),
    "rendering": _rows(rows_render.rendering),
    "demo": _rows(demo_and_detectors),
    "evaluation": _rows(rows_results.evaluation),
    "bootstrap": _rows(rows_results.resampling),
    "grasping": _rows(grasping),
    "learning": _rows(learning),
    "generic": _rows(generic),
    "memory": rows_memory.memory,
    "engines": _rows(engines),
    "growth": lambda: ([], growing()),
}
"""What is measured, in the order of the tables."""


def main() -> None:
    """Print the tables and write the file."""
    options = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    options.add_argument("groups", nargs="*", metavar="GROUP", help=f"among {', '.join(GROUPS)}; all if none")
    options.add_argument("--out", type=Path, default=Path("runs/bench/bench.json"))
    chosen = options.parse_args()
    unknown = [name for name in chosen.groups if name not in GROUPS]
    if unknown:
        options.error(f"expected groups among {', '.join(GROUPS)}, got {', '.join(unknown)}")
    command = " ".join(["python -m tests.bench", *chosen.groups])
    failed = measure({name: GROUPS[name] for name in chosen.groups or GROUPS}, chosen.out, command)
    if failed:
        sys.exit(f"bench: {', '.join(failed)} failed")


def measure(groups: Mapping[str, Callable[[], Measured]], out: Path, command: str) -> dict[str, str]:
    """The errors of groups that failed, by name; what all others measured is printed and written."""
    console = Console()
    rows, growth, failed = list[Row](), list[Growth](), dict[str, str]()
    for name, group in groups.items():
        start = time.perf_counter()
        try:
            more_rows, more_growth = group()
        except Exception as error:  # whatever it is, the other groups are measured
            console.print_exception()
            failed[name] = f"{type(error).__name__}: {error}"
        else:
            rows, growth = rows + more_rows, growth + more_growth
        write_bench(out, bench_of_this_machine(command, tuple(rows), tuple(growth), failed))
        console.print(f"[dim]{name}: {time.perf_counter() - start:.0f} s[/dim]")
    console.print(row_table(rows))
    for one in growth:
        console.print(growth_table(one))
    console.print(f"bench: {out}")
    return failed


def row_table(rows: Sequence[Row]) -> Table:
    """A line a figure."""
    table = Table(title="Speed and memory")
    for name in ("what", "ours, ms", "bare, ms", "value", "unit", "wanted"):
        table.add_column(name, justify="left" if name in {"what", "unit"} else "right")
    for row in rows:
        times = ("" if ms is None else f"{ms:.0f}" for ms in (row.ours_ms, row.bare_ms))
        wanted = f"{'>=' if row.at_least else '<='} {row.wanted:g}"
        table.add_row(row.what, *times, f"{row.value:.3g}", row.unit, wanted)
    return table


def growth_table(growth: Growth) -> Table:
    """A line a size."""
    table = Table(title=growth.name)
    table.add_column(growth.along, justify="right")
    table.add_column("seconds", justify="right")
    for size, seconds in zip(growth.size, growth.seconds, strict=True):
        table.add_row(f"{size:.3g}", f"{seconds:.3f}")
    return table


if __name__ == "__main__":
    main()
