"""The page on scaling: ``python -m reports.publishing.scaling.page RECORDED_JSON FOLDER COMMAND``.

Replays recorded times of frames through a model of 1 to 4,096 workers.
"""

import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reports.pages import write_figure, write_page
from reports.publishing.scaling.model import Cluster, Replayed, replay
from reports.publishing.scaling.recorded import EngineCost, Recorded, read_recorded
from reports.run.curve_pictures import STYLE
from reports.run.tables import Table
from rescore.engines.clusters import seconds_of_a_task
from rescore.formats.parts.candidates import FRAMES_A_PART

WORKERS = (1, 2, 4, 16, 64, 256, 1024, 4096)
FRAMES = 1_000_000
MOST_OF_A_WORKER = 20_000
"""Frames for each worker at most: more of them change nothing where workers are few."""
WANTED = 0.9
WANTED_AT = 256
SEED = 0
UNLIMITED = "a store without a limit"
LONG = f"Dask, in parts, {UNLIMITED}, ten times the frames"


@dataclass(frozen=True)
class Case:
    """One line of the figure."""

    name: str
    cluster: Cluster
    """With one worker."""
    colour: str
    frames_a_task: int | None = None
    """None for as many as ``map_frames`` puts into one for the number of workers."""
    times: int = 1
    """Times as many frames as in the others."""

    def replayed(self, recorded: Recorded) -> tuple[Replayed, ...]:
        """The run at each number of workers."""
        frame_s = np.array(recorded.frame_s)
        return tuple(
            replay(
                frame_s,
                recorded.read_bytes,
                self.times * min(FRAMES, MOST_OF_A_WORKER * n),
                replace(self.cluster, workers=n, task_s=self._task_s(n, float(frame_s.mean()))),
                SEED,
            )
            for n in WORKERS
        )

    def _task_s(self, workers: int, frame_s: float) -> float:
        return seconds_of_a_task(workers) if self.frames_a_task is None else self.frames_a_task * frame_s


def cases(recorded: Recorded) -> tuple[Case, ...]:
    """Engines with tasks as ``map_frames`` makes them, and what would be without that."""
    dask, ray = (_cluster(c) for c in recorded.engines)
    without = replace(dask, store_bytes_s=float("inf"))
    parts = _in_parts(without, recorded)
    return (
        Case("Dask", dask, "#1f5fa8"),
        Case("Ray", ray, "#b3541e"),
        Case("Dask, in parts", _in_parts(dask, recorded), "#2e7d32", FRAMES_A_PART),
        Case("Ray, in parts", _in_parts(ray, recorded), "#c9a227", FRAMES_A_PART),
        Case(f"Dask, {UNLIMITED}", without, "#5b9bd5"),
        Case(f"Dask, in parts, {UNLIMITED}", parts, "#81c784", FRAMES_A_PART),
        Case(LONG, parts, "#00695c", FRAMES_A_PART, times=10),
        Case("Dask, a task a frame", dask, "#777777", frames_a_task=1),
    )


def _cluster(cost: EngineCost) -> Cluster:
    return Cluster(1, 0.0, cost.caller_task_s, cost.caller_frame_s, cost.scheduler_task_s)


def _in_parts(cluster: Cluster, recorded: Recorded) -> Cluster:
    """The cluster of a run in parts, whose results stay with the workers: their order does not matter."""
    return replace(cluster, caller_frame_s=recorded.parts_frame_s, held=FRAMES)


def publish_scaling(file: Path, folder: Path, command: str) -> Path:
    """Write the page with its figure, and a copy of what was recorded; returns the page.

    Args:
        file: what ``python -m tests.bench.record_scaling`` wrote.
        folder: where to publish.
        command: what makes the page, for its text.

    Raises:
        RescoreError: no such file or another content.
    """
    recorded = read_recorded(file)
    folder.mkdir(parents=True, exist_ok=True)
    runs = {case: case.replayed(recorded) for case in cases(recorded)}
    write_figure(folder / "scaling.png", draw(runs, recorded))
    if file.resolve() != (folder / "recorded.json").resolve():
        shutil.copyfile(file, folder / "recorded.json")
    return write_page(folder, _page(runs, recorded, command))


def draw(runs: dict[Case, tuple[Replayed, ...]], recorded: Recorded) -> Figure:
    """Efficiency over workers, with the points that were measured with two."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(12, 4.8), layout="constrained")
        ax: Axes = figure.subplots()
        for case, found in runs.items():
            # the two engines lie on each other where the store is what stops both
            style = ".--" if case.name.startswith("Ray") else ".-"
            ax.plot(WORKERS, [r.efficiency for r in found], style, color=case.colour, label=case.name)
        for cost, marker, colour in zip(recorded.engines, "os", ("#1f5fa8", "#b3541e"), strict=True):
            label = f"{cost.engine.capitalize()}, measured, frames of 100 ms"
            ax.plot([2], [cost.efficiency], marker, color=colour, mfc="white", ms=8, label=label)
        ax.axhline(WANTED, color="#999999", lw=0.8, ls=":")
        ax.set_xscale("log", base=2)
        ax.set_xticks(WORKERS, [f"{n:,}" for n in WORKERS])
        ax.set_ylim(0, 1.05)
        ax.set_xlabel("workers")
        ax.set_ylabel("time in frames / time of all workers")
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return figure


def _table(runs: dict[Case, tuple[Replayed, ...]]) -> Table:
    head = ("", *(f"{n:,}" for n in WORKERS))
    rows = [(case.name, *(f"{100 * r.efficiency:.0f} %" for r in found)) for case, found in runs.items()]
    return Table("Efficiency", head, tuple(rows), text_columns=1)


def _limits(runs: dict[Case, tuple[Replayed, ...]]) -> Table:
    """What is busy at three sizes: a part that is busy all the time is what stops it."""
    head = ("", "workers", "gives tasks out, busy", "scheduler, busy", "store, busy", "deaths")
    rows = []
    for case, found in runs.items():
        for n, r in zip(WORKERS, found, strict=True):
            if n in {256, 1024, 4096}:
                busy = (f"{100 * min(b, 1):.0f} %" for b in (r.caller_busy, r.scheduler_busy, r.store_busy))
                rows.append((case.name, f"{n:,}", *busy, str(r.deaths)))
    return Table("What is busy", head, tuple(rows), text_columns=1)


def _of_scheduler(cost: EngineCost) -> str:
    taken = cost.scheduler_task_s
    return f", its scheduler, a process of its own, {1e3 * taken:.2f} ms a task" if taken else ""


def _page(runs: dict[Case, tuple[Replayed, ...]], recorded: Recorded, command: str) -> str:
    c = next(iter(runs)).cluster
    frame_s = np.array(recorded.frame_s)
    given_hz = c.store_bytes_s / recorded.read_bytes
    held = {case.name: found[WORKERS.index(WANTED_AT)].efficiency for case, found in runs.items()}
    first = "; ".join(f"{name}: {100 * e:.0f} %" for name, e in held.items())
    costs = ", ".join(
        f"{cost.engine.capitalize()} {1e3 * cost.caller_task_s:.2f} ms a task and "
        f"{1e3 * cost.caller_frame_s:.2f} ms a frame in it{_of_scheduler(cost)}"
        for cost in recorded.engines
    )
    parts = [
        "# How a run grows with its workers",
        f"Made by `{command}` from `recorded.json`. A simulation on recorded times, not a measurement: two "
        "cores were there to measure on. The points at two workers are measured: time in frames over that "
        "of all processes, which at two workers counts the one that gives tasks out on the same cores.",
        "![Efficiency over workers](scaling.png)",
        f"Efficiency at {WANTED_AT} workers, where {100 * WANTED:.0f} % is wanted: {first}.",
        _table(runs).markdown().rstrip(),
        "## What stops it",
        "A part that is busy all the time is the limit: the process that gives tasks out does one at a time, "
        "so does the scheduler, and the store gives all workers together so many bytes a second. "
        f"{c.store_bytes_s / 1e9:g} GB/s are {given_hz:,.0f} frames a second, which keep "
        f"{given_hz * frame_s.mean():.0f} workers busy: with {WANTED_AT}, the store is what stops the run. "
        "The lines with a store without a limit say what would stop it then.",
        f"In parts, as `rescore apply` and `detect` write folders, a task is {FRAMES_A_PART} frames, and its "
        "worker writes the file: no more than its name comes back. The process that gives parts out reads "
        "the frames' records and candidates and sends them. Where the store does not stop it, the end of the "
        f"run does: {WANTED_AT} workers need {FRAMES * frame_s.mean() / WANTED_AT / 60:.0f} minutes for all, "
        f"{FRAMES / FRAMES_A_PART / WANTED_AT:.0f} parts for each, the last of which, and slow ones, are "
        f"waited for. With ten times the frames it is {100 * held[LONG]:.0f} %.",
        _limits(runs).markdown().rstrip(),
        "## What was recorded",
        f"{len(frame_s)} frames took {frame_s.mean():.3f} s of a processor each in the mean "
        f"({frame_s.min():.3f} to {frame_s.max():.3f} s), mode `paper`, by `{recorded.command}`. "
        f"A frame reads {recorded.read_bytes / 1e3:.0f} kB of pictures; its record and its result are "
        f"{recorded.sent_bytes / 1e3:.1f} kB on their way. The process that gives tasks out spends: {costs}; "
        f"in parts, with their reading, {1e3 * recorded.parts_frame_s:.2f} ms a frame.",
        "## What was assumed",
        f"The run has {FRAMES:,} frames, or {MOST_OF_A_WORKER:,} for each worker where that is less. A "
        f"message takes {1e3 * c.latency_s:g} ms. The store gives {c.store_bytes_s / 1e9:g} GB/s to all. "
        f"Speeds of workers differ by {100 * c.spread:g} %. {100 * c.slow_share:g} % of the tasks take "
        f"{c.slow_times:g} times as long. A worker dies {c.deaths_per_hour:g} times an hour; that is noticed "
        f"after {c.noticed_s:g} s, and it is back after {c.renewal_s:g} s. Workers are there when the run "
        f"begins. Results are taken in the order of the frames, {c.held} times as "
        "many tasks ahead as are out; parts in any order.",
    ]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    print(publish_scaling(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
