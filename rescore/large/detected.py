"""Detections in parts: `rescore detect` for very many frames."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from recon.arrays import FloatArray
from rescore.data.frames import FrameRecord, Truth
from rescore.detectors import detect
from rescore.detectors.base import Detections, Detector
from rescore.detectors.detect import detect_frame_of, with_likelihoods
from rescore.detectors.platt import PlattScaling
from rescore.evidence.candidates import CandidateTable
from rescore.experiment.source_digest import source_digest
from rescore.large.inputs import Frames, data_sets, record_digest


@dataclass(frozen=True, eq=False)
class DetectTask:
    """A frame to find objects in, and its truth, which stand-ins for detectors ask for."""

    record: FrameRecord
    truth: Truth

    @property
    def image_id(self) -> int:
        """The frame."""
        return self.record.image_id

    def digest(self, root: Path) -> bytes:
        """The record and the state of its files, wherever the data set lies."""
        return record_digest(self.record, root)


@dataclass(frozen=True, eq=False)
class DetectWork:
    """A detector with its scaling."""

    detector: Detector
    scaling: PlattScaling

    def frame(self, task: DetectTask) -> tuple[int, Detections]:
        """What the detector finds in a frame."""
        return detect_frame_of((task.record, task.truth), self.detector)

    def failed(self, task: DetectTask, reason: str) -> None:
        """Nothing: what cannot be read has no detections."""

    def rows(
        self, results: Sequence[tuple[int, Detections] | None]
    ) -> tuple[CandidateTable, FloatArray | None]:
        """The candidates of several frames, which nothing has rescored."""
        return with_likelihoods([r for r in results if r is not None], self.scaling), None


def detect_key(detector: bytes, scaling: bytes) -> str:
    """Digest of the files of a detector and its scaling, and of the code."""
    total = hashlib.sha256(detector + b"\0" + scaling + b"\0" + source_digest(detect).encode())
    return total.hexdigest()


def detect_tasks(frames: Frames, split: str) -> Iterator[DetectTask]:
    """A task for each frame of a split ("all" for every frame), one after another."""
    for data in data_sets(frames, split):
        yield from (DetectTask(f, data.truth[f.image_id]) for f in data.frames)
