"""Candidates rescored in parts: `rescore apply` for very many frames."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray, IntArray, rows_by_value
from recon.errors import Failure, Reason
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.evidence.model import models_as_json
from rescore.evidence.predicted_depth_files import PredictedFile
from rescore.experiment.config import part_as_json
from rescore.experiment.source_digest import source_digest
from rescore.formats.parts.candidates import read_rows, refuse_kind
from rescore.formats.parts.forms import DETECTIONS, RESCORED
from rescore.formats.parts.table import Part, PartTable
from rescore.fusion import rescore_frames
from rescore.fusion.rescore_frame import Rescoring
from rescore.fusion.rescore_frames import FrameShared, rescore_record
from rescore.large.inputs import Frames, record_digest, records


@dataclass(frozen=True, eq=False)
class RescoreTask(rescore_frames.FrameTask):
    """What one frame is rescored from, as a task of a run in parts."""

    def digest(self, root: Path) -> bytes:
        """The record and the state of its files, wherever the data set lies, and all of the candidates."""
        c, predicted = self.candidates, self.predicted
        files = () if predicted is None else filter(None, (predicted.path, predicted.mask_path))
        total = hashlib.sha256(record_digest(self.record, root, *files))
        total.update(repr(predicted).replace(str(root), "").encode())
        solid = (
            None if c.boxes3d is None else np.column_stack([c.boxes3d.values, c.boxes3d.deviations_or_nan])
        )
        for array in (c.xyxy_px, c.score, c.likelihood, c.azimuth_deg, solid):
            total.update(b"\0" if array is None else np.ascontiguousarray(array).tobytes())
        return total.digest()


@dataclass(frozen=True, eq=False)
class RescoreWork:
    """How each frame is rescored: its evidence is found, then fused."""

    finding: FrameShared
    fusing: Rescoring

    def frame(self, task: RescoreTask) -> RescoredTable:
        """The candidates of a frame with D and posterior."""
        return self.fusing.fuse(rescore_record(task, self.finding).candidates)

    def failed(self, task: RescoreTask, reason: str) -> RescoredTable:
        """The candidates of a frame that failed: as others without depth evidence."""
        why = Failure(Reason.FRAME_FAILED, reason)
        return self.fusing.fuse(CandidateTable.of_alignments(task.candidates, [why] * len(task.candidates)))

    def rows(self, results: Sequence[RescoredTable]) -> tuple[CandidateTable, FloatArray]:
        """Candidates and posteriors of several frames."""
        whole = RescoredTable.concatenate(results)
        return whole.candidates, whole.posterior

    @property
    def key(self) -> str:
        """Digest of settings, models and code."""
        fusing, model = self.fusing, self.finding.model
        learned = fusing.evidence_model
        made_with = {
            "config": part_as_json(fusing.config),
            "model": None if model is None else model.as_json(),
            "evidence": None if learned is None else models_as_json({fusing.mode: learned}),
            "w": fusing.w,
            "suppress": fusing.suppress,
            "predict": self.finding.rescoring.predict,
            "code": source_digest(rescore_frames),
        }
        return hashlib.sha256(json.dumps(made_with, sort_keys=True).encode()).hexdigest()


def rescore_tasks(
    frames: Frames,
    split: str,
    found: "Mapping[int, Candidates] | PartsByImage",
    predicted: Mapping[int, PredictedFile],
) -> Iterator[RescoreTask]:
    """A task for each frame of a split ("all" for every frame), with its candidates, one after another."""
    for record in records(frames, split):
        candidates = found.get(record.image_id, Candidates.none(record.image_id))
        yield RescoreTask(record, candidates, predicted.get(record.image_id))


class PartsByImage:
    """Detections in parts by image: the numbers of the images, and a few parts, are in memory.

    Raises:
        RescoreError: the table is none of detections.
    """

    def __init__(self, table: PartTable) -> None:
        refuse_kind(table, (DETECTIONS, RESCORED))
        self._table = table
        ids = [table.frame_rows(p, ["image_id"])["image_id"].to_numpy() for p in table.parts]
        image_id: IntArray = np.concatenate([np.zeros(0, np.int64), *ids])
        order = np.argsort(image_id, kind="stable")
        self._image_id = image_id[order]
        self._part = np.repeat(np.arange(len(ids)), [len(i) for i in ids])[order]
        self._held: dict[int, tuple[CandidateTable, FloatArray | None, dict[int, IntArray]]] = {}

    def rows(self, image_id: int) -> tuple[CandidateTable, FloatArray | None] | None:
        """The candidates of an image, and their posteriors where they were rescored; None where it has
        none."""
        found = self._of(image_id)
        if found is None:
            return None
        table, posterior, own = found
        return table.take(own), None if posterior is None else posterior[own]

    def _of(self, image_id: int) -> tuple[CandidateTable, FloatArray | None, IntArray] | None:
        """The candidates and posteriors of the part of an image, and its own rows of these."""
        at = int(np.searchsorted(self._image_id, image_id))
        if at == len(self._image_id) or self._image_id[at] != image_id:
            return None
        number = int(self._part[at])
        if number not in self._held:
            # frames mostly come in the order of the parts
            for oldest in list(self._held)[:-3]:
                del self._held[oldest]
            found = read_rows(self._table, self._table.parts[number])
            self._held[number] = (*found, rows_by_value(found[0].image_id))
        table, posterior, rows = self._held[number]
        return table, posterior, rows.get(image_id, np.zeros(0, np.int64))

    def get(self, image_id: int, none: Candidates) -> Candidates:
        """The candidates of an image; ``none`` where it has none."""
        found = self._of(image_id)
        return none if found is None else found[0].candidates(image_id, found[2])


def write_rescored_table(root: Path, detector: str, work: RescoreWork, parts: tuple[Part, ...]) -> PartTable:
    """Write ``parts.json`` of candidates that are rescored; returns the table."""
    about = {"detector": detector, "registration": work.fusing.mode.value, "w": work.fusing.w}
    table = PartTable(root, RESCORED, about, parts)
    table.write()
    return table
