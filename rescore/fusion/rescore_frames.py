"""Rescoring of many frames from disk, several at a time, in their order."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from recon.class_model import ClassModel
from rescore.data.depth_files import Quantity
from rescore.data.frames import DataSet, Frame, FrameRecord, load_frame
from rescore.data.units import refuse_other_size, refuse_other_unit
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.evidence.files import evidence_path, write_evidence
from rescore.evidence.fit_summaries import FitSummary, summarise_fits
from rescore.evidence.instances import DepthSource
from rescore.evidence.predicted_depth_files import PredictedFile, Predictions
from rescore.fusion.rescore_frame import RescoredFrame, Rescoring, rescore_frame, things_of
from rescore.parallel import one_thread, track


def rescore_frames(
    data: DataSet,
    candidates: Mapping[int, Candidates],
    source: ClassModel | Predictions,
    rescoring: Rescoring,
    *,
    jobs: Workers,
    evidence_dir: Path | None = None,
    progress: str = "",
) -> RescoredTable:
    """The candidates of all frames with D and posterior likelihood; images in the order of the data set.

    Args:
        data: the frames.
        candidates: of each frame by image id; a frame without an entry has none.
        source: what predicts depth: the class model, or files of every frame that has candidates.
        rescoring: settings, mode and weight.
        jobs: who runs the frames; the result is the same for any.
        evidence_dir: the detector's folder of evidence files, one a frame; None writes none.
        progress: what the bar of progress says, empty for none.
    """
    files = source.files if isinstance(source, Predictions) else {}
    model = source if isinstance(source, ClassModel) else None
    tasks = (
        FrameTask(
            record,
            candidates.get(record.image_id, Candidates.none(record.image_id)),
            files.get(record.image_id),
        )
        for record in data.frames
    )
    tables = map_frames(rescore_record, tasks, FrameShared(model, rescoring, evidence_dir), jobs)
    frames = track(tables, progress, len(data.frames), show=bool(progress))
    return RescoredTable.concatenate(list(frames))


@dataclass(frozen=True, eq=False)
class FrameTask:
    """What one frame is rescored from."""

    record: FrameRecord
    candidates: Candidates
    predicted: PredictedFile | None

    @property
    def image_id(self) -> int:
        """The frame."""
        return self.record.image_id


@dataclass(frozen=True, eq=False)
class FrameShared:
    """What is the same for all frames."""

    model: ClassModel | None
    rescoring: Rescoring
    evidence_dir: Path | None

    def file(self, image_id: int) -> Path | None:
        """The evidence file of a frame; None where none is written."""
        return None if self.evidence_dir is None else evidence_path(self.evidence_dir, image_id)


def rescore_record(task: FrameTask, shared: FrameShared) -> RescoredTable:
    """One frame from disk to its table; what led there goes to the file, not through the pipe."""
    record, candidates, rescoring = task.record, task.candidates, shared.rescoring
    source, file = shared.model or task.predicted, shared.file(record.image_id)
    if not len(candidates):
        if file is not None:
            write_evidence(file, ())
        return rescoring.fuse(CandidateTable.of_alignments(candidates, ()))
    with one_thread():
        frame = load_frame(record, rescoring.config.stereo)
        measured = record.measurement
        quantity = Quantity.DISPARITY if measured is None else measured.quantity
        where = f"image {record.image_id}"
        refuse_other_unit(where, frame, quantity)
        assert source is not None, "every frame with candidates has a prediction"
        found = source if isinstance(source, ClassModel) else source.read(record.width_px, record.height_px)
        if (things := things_of(candidates, found)) is not None:
            refuse_other_size(where, frame, quantity, things)
        rescored = rescore_frame(frame, candidates, found, rescoring)
    if file is not None:
        write_evidence(file, rescored.instances, _summaries(rescored, frame, found, rescoring))
    return rescored.table


def _summaries(
    rescored: RescoredFrame, frame: Frame, source: DepthSource, rescoring: Rescoring
) -> tuple[FitSummary | None, ...]:
    """What the file keeps of the instances that were fitted."""
    if not isinstance(source, ClassModel) or source.shape_space is None:
        return ()
    boxes = rescored.candidates.xyxy_px
    return summarise_fits(rescored.fits, boxes, frame, source.shape_space, rescoring.config.fit)
