"""Records what the model of a cluster replays: ``python -m tests.bench.record_scaling RUN DETECTOR OUT``.

Times of frames of a finished run, one thread, and what Dask and Ray spend on a task with two workers.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pyarrow as pa

from reports.publishing.scaling.recorded import EngineCost, Recorded, write_recorded
from rescore.data.frames import FrameRecord, load_frame
from rescore.engines.engine import Engine
from rescore.engines.executor import Executor
from rescore.engines.on_dask import OnDask
from rescore.engines.on_ray import OnRay
from rescore.engines.shared import pickled
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.formats.parts.forms import CORNERS, DETECTIONS
from rescore.formats.parts.table import PartTable, write_part
from rescore.fusion.rescore_frame import Rescoring, rescore_frame
from rescore.large.rescored import PartsByImage, rescore_tasks
from rescore.large.run import RunParts
from rescore.parallel import one_thread
from rescore.studies.finished_run import finished_run
from tests.bench.rows_engines import FRAME_S, rounds_of, spent_s
from tests.faults.clusters import dask_scheduler, free_port
from tests.rescore.large_tables import write_tables

FRAMES = 40
TASKS = 250
FRAMES_OF_PARTS = 4000
SIZES = (1, 16)
"""Frames in a task; the difference is what a frame costs, the rest what a task does."""
Given = tuple[FrameRecord, Candidates]


def main(root: Path, detector: str, out: Path) -> None:
    """Write the file."""
    run = finished_run(root, detector, None)
    given = [(f, run.candidates[f.image_id]) for f in run.data.frames if len(run.candidates[f.image_id])][
        :FRAMES
    ]
    rescoring, seconds, tables = Rescoring(run.config, w=0.5), [], []
    with one_thread():
        rescore_frame(load_frame(given[0][0], run.sgbm), given[0][1], run.class_model, rescoring)
        for record, candidates in given:
            start_s = time.process_time()
            frame = load_frame(record, run.sgbm)
            tables.append(rescore_frame(frame, candidates, run.class_model, rescoring).table)
            seconds.append(time.process_time() - start_s)
    sent = [len(pickled(g)) + len(pickled(t)) for g, t in zip(given, tables, strict=True)]
    write_recorded(
        out,
        Recorded(
            command="python -m tests.bench.record_scaling",
            frame_s=tuple(seconds),
            read_bytes=statistics.mean(_read_bytes(record) for record, _ in given),
            sent_bytes=statistics.mean(sent),
            engines=tuple(_cost(name, given, tables) for name in ("dask", "ray")),
            parts_frame_s=parts_frame_s(),
        ),
    )


def parts_frame_s() -> float:
    """Processor seconds of the process that gives parts out, a frame; what the engine adds is left out."""
    with tempfile.TemporaryDirectory() as folder:
        frames, rescored = write_tables(Path(folder), FRAMES_OF_PARTS, 0)
        found = PartsByImage(as_detections(rescored, Path(folder) / "found"))
        run = RunParts(Path(folder) / "out", _Nothing(), "", frames.root, 1)
        start_s = time.process_time()
        for part in run.todo(rescore_tasks(frames, "all", found, {}), {}):
            pickled((part,))
        return (time.process_time() - start_s) / FRAMES_OF_PARTS


def as_detections(rescored: PartTable, root: Path) -> PartTable:
    """The candidates of a table as they were before they were rescored."""
    kept = ("image_id", "rank", *CORNERS, "detector_score", "likelihood", "status", "reason_detail")
    parts = []
    for part in rescored.parts:
        groups = [rescored.columns(part, group=k) for k in (0, 1)]
        bare = [
            pa.table([g[f.name] if f.name in kept else pa.nulls(len(g), f.type) for f in g.schema], g.schema)
            for g in groups
        ]
        parts.append(part.model_copy(update={"bytes": write_part(root, part.name, bare)}))
    return PartTable(root, DETECTIONS, {"detector": "hog"}, tuple(parts))


class _Nothing:
    """Work that is not done."""

    def frame(self, task: object) -> object:
        raise NotImplementedError

    def failed(self, task: object, reason: str) -> object:
        raise NotImplementedError

    def rows(self, results: object) -> tuple[CandidateTable, None]:
        raise NotImplementedError


def _read_bytes(record: FrameRecord) -> int:
    files = (record.left_path, record.right_path, record.disparity_path)
    return sum(file.stat().st_size for file in files if file is not None)


def looked_up(given: Given, tables: dict[int, RescoredTable]) -> RescoredTable:
    """The result without the work."""
    return tables[given[0].image_id]


def _cost(name: str, given: list[Given], tables: list[RescoredTable]) -> EngineCost:
    shared = {record.image_id: table for (record, _), table in zip(given, tables, strict=True)}
    with _cluster(name) as (executor, scheduler):
        engine: Engine = (OnDask if name == "dask" else OnRay)(looked_up, shared, executor)
        spent = {size: [_task_s(engine, given, size, scheduler) for _ in range(3)] for size in SIZES}
        engine.close()
        one, many = (statistics.median(own for own, _ in spent[size]) for size in SIZES)
        frame_s = max(0.0, (many - one) / (SIZES[1] - SIZES[0]))
        rounds = rounds_of(FRAME_S)
        spent_s(rounds, executor)
        all_s, frames_s = spent_s(rounds, executor)
    passing_s = statistics.median(its for size in SIZES for _, its in spent[size])
    return EngineCost(name, one - frame_s, frame_s, passing_s, frames_s / all_s)


@contextmanager
def _cluster(name: str) -> Iterator[tuple[Executor, psutil.Process | None]]:
    """Two workers, and the scheduler of Dask in a process of its own, as on a cluster."""
    if name == "ray":
        yield Executor.of(name, 2, None), None
        return
    port = free_port()
    with (
        tempfile.TemporaryDirectory() as folder,
        dask_scheduler(port, Path(folder) / "log") as scheduler,
    ):
        yield Executor.of(name, 2, f"tcp://127.0.0.1:{port}"), psutil.Process(scheduler.pid)


def _task_s(
    engine: Engine, given: list[Given], size: int, scheduler: psutil.Process | None
) -> tuple[float, float]:
    """Processor seconds of this process and of the scheduler a task; all are out at once, as for many.

    With few out, this process would wait for two workers, and what it does meanwhile would count.
    """
    records = [given[k % len(given)] for k in range(size)]
    start_s, passed_s = time.process_time(), _spent_s(scheduler)
    for task in range(TASKS):
        engine.put(task, records, 1)
    for _ in range(TASKS):
        engine.take()
    return (time.process_time() - start_s) / TASKS, (_spent_s(scheduler) - passed_s) / TASKS


def _spent_s(process: psutil.Process | None) -> float:
    times = process.cpu_times() if process is not None else None
    return times.user + times.system if times is not None else 0.0


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
