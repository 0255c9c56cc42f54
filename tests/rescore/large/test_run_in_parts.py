"""Runs in parts: what is there is kept, what fails is told, and the bytes are the same by any way."""

import hashlib
import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from recon.stores import StoreError, located
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.engines import map_frames
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.formats.parts.candidates import arrays_of_table, read_part_detections
from rescore.formats.parts.forms import DETECTIONS
from rescore.formats.parts.table import PARTS, Part, PartTable
from rescore.large import run as run_module
from rescore.large.detected import DetectTask
from rescore.large.run import RunParts

N_FRAMES = 25


@dataclass(frozen=True)
class Task:
    image_id: int

    def digest(self, _root: Path) -> bytes:
        return str(self.image_id).encode()


@dataclass(frozen=True)
class Boxes:
    """A detector of one box a frame, which fails or dies at some frames."""

    damaged: tuple[int, ...] = ()
    kills: tuple[int, ...] = ()
    lost_store: tuple[int, ...] = ()

    def frame(self, task: Task) -> Candidates:
        if task.image_id in self.kills:
            os.kill(os.getpid(), signal.SIGKILL)
        if task.image_id in self.lost_store:
            raise StoreError("s3://fleet: no answer")
        if task.image_id in self.damaged:
            raise RescoreError(f"{task.image_id}.png: expected a picture, could not decode it")
        box = np.array([[1.0, 2.0, 3.0 + task.image_id, 4.0]])
        return Candidates(task.image_id, box, np.ones(1), np.full(1, 0.5))

    def failed(self, _task: Task, _reason: str) -> None:
        return None

    def rows(self, results: Sequence[Candidates | None]) -> tuple[CandidateTable, None]:
        return CandidateTable.of_candidates([r for r in results if r is not None]), None


@pytest.fixture(autouse=True)
def _small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "FRAMES_A_PART", 10)


def run(root: Path, work: Boxes, jobs: int = 1, key: str = "one") -> tuple[RunParts, tuple[Part, ...]]:
    made = RunParts(root, work, key, root, jobs)
    return made, made.all(map(Task, range(N_FRAMES)), N_FRAMES, "boxes")


def table_of(root: Path, parts: tuple[Part, ...]) -> PartTable:
    table = PartTable(root, DETECTIONS, {"detector": "net"}, parts)
    table.write()
    return table


def digests(root: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted((root / PARTS).iterdir())}


def test_a_part_a_put_and_read_again(tmp_path: Path) -> None:
    made, parts = run(tmp_path, Boxes(damaged=(3,)))
    assert [(p.frames, p.rows, p.failed) for p in parts] == [(10, 9, 1), (10, 10, 0), (5, 5, 0)]
    assert made.reused == []
    table = table_of(tmp_path, parts)
    assert list(table.failed_frames()) == [(3, "3.png: expected a picture, could not decode it")]
    assert table.rows == 24
    again = PartTable.read(tmp_path)
    assert again.parts == parts
    ids = np.concatenate([arrays_of_table(again.columns(p, ["image_id"]))["image_id"] for p in parts])
    assert ids.tolist() == [i for i in range(N_FRAMES) if i != 3]
    # the lazy form has the same rows, those of frames beside those of candidates
    assert again.dataset().count_rows() == 24 + N_FRAMES


def test_what_is_there_is_not_made_again(tmp_path: Path) -> None:
    _, first = run(tmp_path, Boxes())
    (tmp_path / PARTS / f"{first[1].name}.parquet").unlink()
    before = digests(tmp_path)
    # were a part made again, its frames would end this process
    made, parts = run(tmp_path, Boxes(damaged=tuple(range(10, 20)), kills=(0, 24)))
    assert made.reused == [0, 2]
    assert (parts[0], parts[2]) == (first[0], first[2])
    assert parts[1].failed == 10
    assert digests(tmp_path).items() >= before.items()
    # other settings make other parts beside them
    made, _ = run(tmp_path, Boxes(), key="two")
    assert made.reused == []
    assert len(digests(tmp_path)) == 6


def test_the_same_bytes_by_two_jobs_and_after_a_kill(tmp_path: Path) -> None:
    run(tmp_path / "one", Boxes())
    known = digests(tmp_path / "one")
    with pytest.raises(RescoreError, match="no answer"):
        run(tmp_path / "two", Boxes(lost_store=(15,)))
    # the store fails for a while: the first part is there, nothing of the second
    assert len(digests(tmp_path / "two")) == 1
    run(tmp_path / "two", Boxes(), jobs=2)
    assert digests(tmp_path / "two") == known


def test_a_frame_that_ends_its_worker_is_set_aside_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # what counts to three is tested where it stands; a new worker takes seconds
    monkeypatch.setattr(map_frames, "TRIES", 1)
    _, parts = run(tmp_path, Boxes(kills=(12,)), jobs=2)
    table = table_of(tmp_path, parts)
    assert list(table.failed_frames()) == [(12, "ended its worker 1 times")]
    assert table.rows == N_FRAMES - 1
    assert [p.frames for p in parts] == [10, 10, 5]


def test_all_of_the_first_frames_fail(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match=r"all of the first 10 frames fail, the first for this: 0\.png"):
        run(tmp_path, Boxes(damaged=tuple(range(N_FRAMES))))


def test_as_detections_of_a_data_set(tmp_path: Path) -> None:
    table_of(tmp_path, run(tmp_path, Boxes(damaged=(3,)))[1])
    ids = (24, 5, 3, *range(6, 24), 0, 1, 2, 4)
    none = Truth(np.zeros(0, int), np.zeros((0, 4)), np.zeros(0, bool), np.zeros(0), ())
    frames = tuple(FrameRecord(i, Path(f"{i}.png"), None, None, "test", 99, 99, None, None) for i in ids)
    data = DataSet(tmp_path, 1, "car", frames, dict.fromkeys(ids, none))
    found = read_part_detections(tmp_path, data, 15)
    assert found.detector == "net"
    assert found.posterior is None
    assert found.table.image_id.tolist() == [i for i in ids if i != 3]
    assert found.table.xyxy_px[0].tolist() == [1.0, 2.0, 27.0, 4.0]
    assert "1 frame failed" in found.notes[0]
    fewer = DataSet(tmp_path, 1, "car", frames[1:], dict.fromkeys(ids[1:], none))
    with pytest.raises(RescoreError, match="got image_id 24"):
        read_part_detections(tmp_path, fewer, 15)


def test_a_picture_that_is_replaced_makes_its_part_anew(tmp_path: Path) -> None:
    paths = [tmp_path / f"{i}.png" for i in range(2)]
    for path in paths:
        path.write_bytes(b"first")
    none = Truth(np.zeros(0, int), np.zeros((0, 4)), np.zeros(0, bool), np.zeros(0), ())
    records = [FrameRecord(i, p, None, None, "test", 9, 9, None, None) for i, p in enumerate(paths)]
    tasks = [DetectTask(record, none) for record in records]
    before = [t.digest(tmp_path) for t in tasks]
    assert [t.digest(tmp_path) for t in tasks] == before
    # as large as the one before
    paths[1].write_bytes(b"other")
    os.utime(paths[1], ns=(0, 0))
    after = [t.digest(tmp_path) for t in tasks]
    assert (after[0], after[1] == before[1]) == (before[0], False)
    # a data set that is moved as a whole is the same
    moved = tmp_path.with_name("moved")
    tmp_path.rename(moved)
    there = [replace(t, record=replace(t.record, left_path=moved / t.record.left_path.name)) for t in tasks]
    assert [t.digest(moved) for t in there] == after
    moved.rename(tmp_path)
    # of a store no request is made
    away = replace(records[0], left_path=located("s3://fleet/0.png"))
    assert DetectTask(away, none).digest(tmp_path) == DetectTask(away, none).digest(tmp_path)
