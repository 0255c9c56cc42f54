"""A run in parts: some hundred frames are one task, and what comes of them one file.

The name of a part begins with a digest of what it is made of: the frames, what is done with them, and the
code. So a part that is there needs not be made, a run that was killed goes on, and another setting makes
other parts. It ends with what ``parts.json`` tells of the part: going on takes one look at the folder.

A frame that cannot be worked on is a row that says why. Where a task ends its workers, its frames are tried
one by one, and the one that does it again is set aside and named.
"""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.stores import StoreError
from rescore.engines.executor import Workers
from rescore.engines.map_frames import Failed, map_frames
from rescore.evidence.candidates import CandidateTable
from rescore.formats.parts.candidates import FRAMES_A_PART, PartRows
from rescore.formats.parts.table import Part, counted_part, names_there, write_counted_part
from rescore.parallel import track


class FrameTask(Protocol):
    """What one frame is made from."""

    @property
    def image_id(self) -> int:
        """The frame."""

    def digest(self, root: Path) -> bytes:
        """What it is made from, wherever the data set lies; ``root`` is that place."""


class Work(Protocol):
    """What is done with each frame; the same for all, and goes to each worker once."""

    def frame(self, task: Any) -> Any:
        """The result of a frame."""

    def failed(self, task: Any, reason: str) -> Any:
        """What takes the place of the result of a frame that has none."""

    def rows(self, results: Sequence[Any]) -> tuple[CandidateTable, FloatArray | None]:
        """Candidates and posteriors of the results of several frames."""


@dataclass(frozen=True, eq=False)
class PartTask:
    """The frames of one part."""

    number: int
    digest: str
    tasks: Sequence[Any]
    first: bool
    """Whether it is the first to be done: where all its frames fail, so would all others."""

    @property
    def image_id(self) -> int:
        """The first frame, by which it is named."""
        return int(self.tasks[0].image_id)


@dataclass(frozen=True, eq=False)
class _Shared:
    """What all parts share."""

    root: Path
    work: Work


@dataclass(frozen=True, eq=False)
class RunParts:
    """A run in parts into a folder."""

    root: Path
    work: Work
    key: str
    """Digest of what is the same for all frames: settings, models and code."""
    data_root: Path
    """Where the data set lies."""
    workers: Workers
    reused: list[int] = field(default_factory=list)
    """Numbers of the parts that were there."""

    def all(self, tasks: Iterable[FrameTask], total: int, progress: str) -> tuple[Part, ...]:
        """The parts of all frames, made or found.

        Raises:
            RescoreError: all frames of the first part fail, or an error of the store.
        """
        done: dict[int, Part] = {}
        aside: list[PartTask] = []
        todo = self.todo(tasks, done)
        shared = _Shared(self.root, self.work)
        n_parts = -(-total // FRAMES_A_PART)
        made = map_frames(_part, todo, shared, self.workers, failed=_set_aside, ordered=False)
        # those that are there already count as they are passed
        for found in track(made, progress, n_parts):
            if isinstance(found, PartTask):
                aside.append(found)
            else:
                done[found[0]] = found[1]
        for part in aside:
            done[part.number] = self._one_by_one(part)
        return tuple(done[number] for number in sorted(done))

    def todo(self, tasks: Iterable[FrameTask], done: dict[int, Part]) -> Iterator[PartTask]:
        """The parts that are to be made; those that are there go to ``done``."""
        there = {p.name.partition("-")[0]: p for p in map(counted_part, names_there(self.root)) if p}
        first = True
        for number, own in enumerate(_chunks(tasks)):
            digest = self._digest(own)
            if digest in there:
                done[number] = there[digest]
                self.reused.append(number)
            else:
                yield PartTask(number, digest, own, first and not done)
                first = False

    def _digest(self, tasks: Sequence[FrameTask]) -> str:
        total = hashlib.sha256(self.key.encode())
        for task in tasks:
            total.update(task.digest(self.data_root))
        return total.hexdigest()[:24]

    def _one_by_one(self, part: PartTask) -> Part:
        """A part whose task ended its workers, its frames each a task of its own."""

        def set_aside(failure: Failed) -> tuple[Any, str]:
            task = _set_aside(failure)
            return self.work.failed(task, failure.reason), failure.reason

        results = map_frames(_tried, part.tasks, self.work, self.workers, failed=set_aside)
        return _written(self.root, part, self.work, list(results))


def _chunks(tasks: Iterable[FrameTask]) -> Iterator[list[FrameTask]]:
    own: list[FrameTask] = []
    for task in tasks:
        own.append(task)
        if len(own) == FRAMES_A_PART:
            yield own
            own = []
    if own:
        yield own


def _part(part: PartTask, shared: _Shared) -> tuple[int, Part]:
    """A part, made and written."""
    results = [_tried(task, shared.work) for task in part.tasks]
    reasons = [reason for _, reason in results if reason]
    if part.first and len(reasons) == len(results):
        raise RescoreError(f"all of the first {len(reasons)} frames fail, the first for this: {reasons[0]}")
    return part.number, _written(shared.root, part, shared.work, results)


def _tried(task: FrameTask, work: Work) -> tuple[Any, str]:
    """The result of a frame, or what takes its place and why."""
    try:
        return work.frame(task), ""
    except StoreError:
        # of all frames or of none: the run ends, and goes on later
        raise
    except Exception as error:
        # what decoders of damaged pictures raise has many names
        reason = " ".join(str(error).split()) or type(error).__name__
        return work.failed(task, reason), reason


def _written(root: Path, part: PartTask, work: Work, results: Sequence[tuple[Any, str]]) -> Part:
    ids = np.array([t.image_id for t in part.tasks], np.int64)
    failed = {i: reason for i, (_, reason) in zip(ids.tolist(), results, strict=True) if reason}
    table, posterior = work.rows([result for result, _ in results])
    rows = PartRows(ids, failed, table, posterior)
    counts = Part(name=part.digest, rows=len(table), bytes=0, frames=len(ids), failed=len(failed))
    return write_counted_part(root, counts, rows.groups)


def _set_aside(failure: Failed) -> Any:
    """The part, where it ended its workers.

    Raises:
        RescoreError: it did not: then its error is everyone's.
    """
    if not failure.killed:
        raise RescoreError(failure.reason)
    return failure.record
