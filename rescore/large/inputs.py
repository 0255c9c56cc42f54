"""What a run in parts works on: frames in memory or in parts, one after another."""

import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from recon.arrays import IntArray
from recon.errors import RescoreError
from recon.stores import remote
from rescore.data.frames import SPLITS, DataSet, FrameRecord
from rescore.formats.labels import ClassMap
from rescore.formats.open import read_dataset
from rescore.formats.parts.frames import (
    count_part_frames,
    data_of,
    data_parts,
    frame_of_each_camera,
    frame_table,
    records_of_part,
)
from rescore.formats.parts.manifest import is_parts
from rescore.formats.parts.table import PartTable
from rescore.results.evaluate_parts import EvaluatedFrames

Frames = DataSet | PartTable
"""A data set in memory, or the table of one in parts."""


def frames_of(dataset: Path, split: str, class_name: str, classes: ClassMap) -> Frames:
    """The frames of a data set, in parts where it is: then nothing of them is in memory.

    Raises:
        RescoreError: no such data set or split, or no frame of the split.
    """
    if split not in (*SPLITS, "all"):
        raise RescoreError(
            f"--split: expected {', '.join(SPLITS)} or all, got {split!r}; choose one of these"
        )
    frames: Frames
    if is_parts(dataset):
        frames = frame_table(dataset, class_name)
    else:
        data = read_dataset(dataset, class_name, classes)
        frames = data if split == "all" else data.split(split)
    if not count_frames(frames, split):
        raise RescoreError(f"{dataset}: expected frames of split {split!r}, got none; choose another --split")
    return frames


def count_frames(frames: Frames, split: str) -> int:
    """Frames of a split ("all" for every frame)."""
    if isinstance(frames, DataSet):
        return len(frames.frames)
    return count_part_frames(frames, split)


def data_sets(frames: Frames, split: str) -> Iterator[DataSet]:
    """The frames of a split as data sets of no more than a part each."""
    if isinstance(frames, DataSet):
        yield frames
        return
    for part in data_parts(frames):
        yield part if split == "all" else part.split(split)


def records(frames: Frames, split: str) -> Iterator[FrameRecord]:
    """The records of a split ("all" for every frame), one after another; what is annotated is not read."""
    if isinstance(frames, DataSet):
        yield from frames.frames
        return
    for part in frames.parts:
        yield from (r for r in records_of_part(frames, part) if split in {r.split, "all"})


def in_memory(frames: Frames, split: str) -> DataSet:
    """The frames of a split as one data set."""
    if isinstance(frames, DataSet):
        return frames
    parts = list(data_sets(frames, split))
    truth = {i: t for p in parts for i, t in p.truth.items()}
    return replace(parts[0], frames=tuple(f for p in parts for f in p.frames), truth=truth)


def cameras_of(frames: Frames, split: str) -> DataSet:
    """A data set with one frame of each camera: what the search for disparities is set by."""
    if isinstance(frames, DataSet):
        return frames
    return replace(chosen_frames(frames, frame_of_each_camera(frames, split)), truth={})


def chosen_frames(frames: Frames, image_id: IntArray) -> DataSet:
    """Some frames as a data set, in the order of all."""
    if isinstance(frames, PartTable):
        parts = list(data_parts(frames, image_id))
        truth = {i: t for p in parts for i, t in p.truth.items()}
        return data_of(frames, [f for p in parts for f in p.frames], truth)
    wanted = set(image_id.tolist())
    own = tuple(f for f in frames.frames if f.image_id in wanted)
    return replace(frames, frames=own, truth={f.image_id: frames.truth[f.image_id] for f in own})


def evaluated_frames(frames: Frames, split: str) -> EvaluatedFrames:
    """What is known of the frames of a split, for an evaluation in parts."""
    if isinstance(frames, DataSet):
        return EvaluatedFrames.of_data(frames)
    return EvaluatedFrames.of_parts(frames, split)


def record_digest(record: FrameRecord, root: Path, *more: Path) -> bytes:
    """Digest of a record, wherever its data set lies, with the state of its files and of ``more``.

    The state is size and time of change on this machine. Of a store it would take a request a file, so
    there a file that is replaced under its name is not noticed.
    """
    measured = None if record.measured is None else record.measured.path
    own = (record.left_path, record.right_path, record.disparity_path, record.instance_path, measured)
    states = [_state(path) for path in (*own, *more) if path is not None and remote(path) is None]
    return hashlib.sha256(repr((record, states)).replace(str(root), "").encode()).digest()


def _state(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:  # told where it is read
        return None
    return found.st_size, found.st_mtime_ns


def statuses(table: PartTable) -> Counter[str]:
    """Number of candidates of each status in a table of detections."""
    found: Counter[str] = Counter()
    for part in table.parts:
        for row in table.columns(part, ["status"])["status"].value_counts().to_pylist():
            found[row["values"] or ""] += row["counts"]
    return found


def grounds(table: PartTable) -> Counter[str]:
    """Number of frames with candidates by where their ground plane comes from."""
    found: Counter[str] = Counter()
    for part in table.parts:
        rows = table.columns(part, ["image_id", "ground"]).to_pylist()
        found.update({row["image_id"]: row["ground"] or "" for row in rows}.values())
    return found
