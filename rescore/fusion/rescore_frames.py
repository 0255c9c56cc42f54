"""Rescoring of many frames from disk, several at a time, in their order."""

from collections.abc import Mapping
from pathlib import Path

from joblib import delayed

from recon.class_model import ClassModel
from rescore.data.depth_files import Quantity
from rescore.data.frames import DataSet, Frame, FrameRecord, load_frame
from rescore.data.units import refuse_other_size, refuse_other_unit
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.evidence.files import evidence_path, write_evidence
from rescore.evidence.fit_summaries import FitSummary, summarise_fits
from rescore.evidence.instances import DepthSource
from rescore.evidence.predicted_depth_files import PredictedFile, Predictions
from rescore.fusion.rescore_frame import RescoredFrame, Rescoring, rescore_frame, things_of
from rescore.parallel import in_order, one_thread, track


def rescore_frames(
    data: DataSet,
    candidates: Mapping[int, Candidates],
    source: ClassModel | Predictions,
    rescoring: Rescoring,
    *,
    jobs: int,
    evidence_dir: Path | None = None,
    progress: str = "",
) -> RescoredTable:
    """The candidates of all frames with D and posterior likelihood; images in the order of the data set.

    Args:
        data: the frames.
        candidates: of each frame by image id; a frame without an entry has none.
        source: what predicts depth: the class model, or files of every frame that has candidates.
        rescoring: settings, mode and weight.
        jobs: frames at a time; the result is the same for any number.
        evidence_dir: the detector's folder of evidence files, one a frame; None writes none.
        progress: what the bar of progress says, empty for none.
    """
    tasks = (
        delayed(_rescore_record)(
            record,
            candidates.get(record.image_id, Candidates.none(record.image_id)),
            source.files.get(record.image_id) if isinstance(source, Predictions) else source,
            rescoring,
            file=None if evidence_dir is None else evidence_path(evidence_dir, record.image_id),
        )
        for record in data.frames
    )
    frames = track(in_order(tasks, jobs), progress, len(data.frames), show=bool(progress))
    return RescoredTable.concatenate(list(frames))


def _rescore_record(
    record: FrameRecord,
    candidates: Candidates,
    source: ClassModel | PredictedFile | None,
    rescoring: Rescoring,
    *,
    file: Path | None,
) -> RescoredTable:
    """One frame from disk to its table; what led there goes to the file, not through the pipe."""
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
