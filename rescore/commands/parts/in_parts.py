"""What commands do with tables in parts: apply, detect and evaluate for very many frames."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recon.errors import RescoreError
from rescore.commands.base import detections_of
from rescore.commands.depth_source import Source
from rescore.speech import counted, say

if TYPE_CHECKING:
    from recon.class_model import ClassModel
    from rescore.engines.executor import Workers
    from rescore.evidence.candidates import Candidates
    from rescore.formats.parts.table import PartTable
    from rescore.large.inputs import Frames
    from rescore.large.rescored import PartsByImage
    from rescore.large.run import RunParts


def in_parts(out: Path) -> bool:
    """Whether detections are written to a path as a table in parts: whether it names no JSON file."""
    return out.suffix != ".json"


def frames_to_read(dataset: Path, split: str, class_name: str, maps: Sequence[str] | None) -> "Frames":
    """The frames of a data set, in parts where it is in parts."""
    from rescore.formats.labels import ClassMap
    from rescore.large.inputs import frames_of

    return frames_of(dataset, split, class_name, ClassMap.of(class_name, maps or (), of_several=True))


def detect_in_parts(
    dataset: Path, split: str, detector: Path, scaling: Path, out: Path, workers: "Workers"
) -> "PartTable":
    """Find candidates into a folder, in parts; what is there already is kept."""
    from rescore.detectors.platt import load_scaling
    from rescore.detectors.registry import load_detector
    from rescore.formats.parts.forms import DETECTIONS
    from rescore.formats.parts.table import PartTable, refuse_as_table
    from rescore.large.detected import DetectWork, detect_key, detect_tasks
    from rescore.large.inputs import count_frames
    from rescore.large.run import RunParts

    refuse_as_table(out, DETECTIONS, (dataset,))
    frames = frames_to_read(dataset, split, "car", None)
    work = DetectWork(load_detector(detector), load_scaling(scaling))
    key = detect_key(detector.read_bytes(), scaling.read_bytes())
    run = RunParts(out, work, key, frames.root, workers)
    name = work.detector.name
    parts = run.all(detect_tasks(frames, split), count_frames(frames, split), f"detect {name}")
    tell_reused(run)
    table = PartTable(out, DETECTIONS, {"detector": name}, parts)
    table.write()
    tell_failed(table)
    return table


def tell_reused(run: "RunParts") -> None:
    """Say how many parts were there before."""
    if run.reused:
        say(f"kept from before: {counted(len(run.reused), 'part')}")


def tell_failed(table: "PartTable") -> None:
    """Say how many frames failed, and how to see which."""
    if table.n_failed:
        failed = counted(table.n_failed, "frame")
        say(f"{failed} failed: `rescore inspect {table.root} --failed` says which and why")


def candidates_of(
    frames: "Frames", split: str, detections: Path
) -> "tuple[str, Mapping[int, Candidates] | PartsByImage]":
    """The detector's name, and its candidates by image: in parts where both frames and they are."""
    from rescore.formats.parts.manifest import is_parts
    from rescore.formats.parts.table import PartTable
    from rescore.large.inputs import in_memory
    from rescore.large.rescored import PartsByImage

    if is_parts(detections):
        table = PartTable.read(detections)
        return str(table.said("detector")), PartsByImage(table)
    data = in_memory(frames, split)
    file = detections_of(detections, data)
    return file.detector, file.candidates(data)


def source_of_frames(
    frames: "Frames", split: str, source: Source, found: Any
) -> "tuple[ClassModel | None, Mapping[int, Any], dict[str, Any]]":
    """The class model, or the predictions of each frame by image id and what is told of them."""
    from recon.class_model import ClassModel
    from rescore.commands.depth_source import source_as_json
    from rescore.large.inputs import data_sets, in_memory

    if source.folder is not None and not isinstance(found, dict):
        raise RescoreError(
            "--predicted: expected detections as a JSON file, got a table in parts; rescore these with a "
            "class model"
        )
    if source.folder is None:
        data, found = next(data_sets(frames, "all")), {}
    else:
        data = in_memory(frames, split)
    loaded = source.on(data, found)
    if isinstance(loaded, ClassModel):
        return loaded, {}, {}
    return None, loaded.files, source_as_json(loaded)
