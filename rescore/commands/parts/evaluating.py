"""What `rescore evaluate` does: detections in files, or in tables in parts."""

# ruff: noqa: PLC0415 - imports inside functions keep `--help` quick

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from recon.errors import RescoreError
from rescore.commands.base import detections_of, read_split
from rescore.commands.parts.in_parts import frames_to_read, tell_failed
from rescore.speech import counted, say

if TYPE_CHECKING:
    from rescore.data.frames import DataSet
    from rescore.evidence.registration import Registration
    from rescore.fusion.tune import Tuning
    from rescore.results.metrics_file import Metrics


SAMPLE = "sample"
"""Folder of a run in parts with the frames to look at, a run of its own."""


def run_to_show(run: Path) -> Path:
    """The run folder to look at: of a run in parts its sample, which is told."""
    if not (run / "candidates" / "parts.json").is_file():
        return run
    say(f"note: {run} is a run in parts: what is shown are the frames of its sample, chosen for what changed")
    return run / SAMPLE


@dataclass(frozen=True)
class Evaluating:
    """What `rescore evaluate` is to evaluate, and where to."""

    dataset: Path
    detections: Sequence[Path]
    out: Path
    split: str
    maps: list[str] | None
    tunings: "Mapping[tuple[str, Registration], Tuning]"
    min_iou: float

    def in_parts(self) -> bool:
        """Whether the detections are tables in parts.

        Raises:
            RescoreError: some are, and others are not.
        """
        from rescore.formats.parts.manifest import is_parts

        parts = [is_parts(path) for path in self.detections]
        if any(parts) and not all(parts):
            raise RescoreError(
                f"{self.detections[parts.index(False)]}: expected a table in parts as the others are, got a "
                "file; rescore it into a folder"
            )
        return all(parts)

    def files(self) -> "tuple[Metrics, list[str], DataSet]":
        """The metrics of files, their detectors, and the data set."""
        from rescore.results.evaluate import evaluate

        data = read_split(self.dataset, self.split, maps=self.maps)
        files = [detections_of(path, data) for path in self.detections]
        metrics = evaluate(data, files, self.out, tunings=self.tunings, min_iou=self.min_iou)
        return metrics, [f.detector for f in files], data

    def tables(self) -> "tuple[Metrics, list[str], DataSet]":
        """The metrics of tables in parts, their detectors, and a data set with each camera."""
        from rescore.formats.parts.table import PartTable
        from rescore.large.inputs import cameras_of, evaluated_frames
        from rescore.large.sample import write_sample
        from rescore.results.evaluate_parts import evaluate_parts

        frames = frames_to_read(self.dataset, self.split, "car", self.maps)
        tables = [PartTable.read(path) for path in self.detections]
        for table in tables:
            tell_failed(table)
        known = evaluated_frames(frames, self.split)
        metrics = evaluate_parts(known, tables, self.out, tunings=self.tunings, min_iou=self.min_iou)
        sample = write_sample(self.out, metrics, frames, tables, self.tunings, self.min_iou)
        say(f"sample of {counted(len(sample.frames), 'frame')} to look at: {self.out / 'sample'}")
        return metrics, [str(t.said("detector")) for t in tables], cameras_of(frames, self.split)
