"""Rescoring (section 6): candidates of a frame in, posterior likelihoods out; and that over many frames."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.depth_map import DepthMap
from recon.errors import Failure
from rescore.data.frames import DataSet, Frame, FrameRecord, GroundSource, load_frame
from rescore.evidence.align_depth import (
    DepthAlignment,
    Normalisation,
    align_depth,
    depth_range,
    measured_depth,
)
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.cues import frame_cues
from rescore.evidence.files import Predicted, evidence_path, write_evidence
from rescore.evidence.predicted import BoxPrediction, PredictedDepth, cut_to_boxes
from rescore.evidence.predicted_files import PredictedFile, Predictions
from rescore.evidence.registration import CUES
from rescore.evidence.settings import RescoreConfig, assumed_camera
from rescore.evidence.views import NO_VIEWS, Views, reconstruct_views, views_of, views_without_model
from rescore.parallel import one_thread, track


@dataclass(frozen=True, eq=False)
class Instances:
    """What is predicted of the candidates of one frame: 3D instances, or depth of another system."""

    found: tuple[Predicted, ...]
    """One a candidate."""
    views: Views
    """From where each is taken to be seen."""

    @property
    def inverse(self) -> bool:
        """Whether inverse depth is predicted, and eq. 6 is solved there."""
        return any(isinstance(i, BoxPrediction) and i.inverse for i in self.found)

    @property
    def scaled_depths(self) -> tuple[DepthMap | None, ...]:
        """Depth of each candidate; None where there is none, or its scale and offset are unknown."""
        return tuple(
            None if isinstance(i, Failure) or (isinstance(i, BoxPrediction) and not i.metric) else i.depth
            for i in self.found
        )


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """What depth says about the candidates of one frame, before w."""

    candidates: Candidates
    views: Views
    """From where each candidate is taken to be seen."""
    instances: tuple[Predicted, ...]
    """The 3D instance of each candidate, or the depth that another system predicts in its box."""
    alignments: tuple[DepthAlignment | Failure, ...]
    """The outcome of eq. 6 of each candidate; why nothing is predicted where nothing is."""
    cues: FloatArray
    """Parts of the evidence of the other modes, shape (n, k), columns ``rescore.evidence.registration.CUES``."""
    ground: GroundSource | None = None
    """Where the ground plane of the frame came from; None where the frame was not read."""

    @property
    def table(self) -> CandidateTable:
        """The candidates with the outcome of eq. 6, a row each."""
        return CandidateTable.of_alignments(self.candidates, self.alignments, self.cues, self.ground or "")


def depth_evidence(
    frame: Frame, candidates: Candidates, model: ClassModel, config: RescoreConfig
) -> FrameEvidence:
    """Segment, register parts, predict depth, align with the measured depth, for each candidate.

    One reconstruction serves all modes.
    """
    return compare_depth(frame, candidates, instances_of(frame, candidates, model, config), config)


def compared_with_prediction(
    frame: Frame, candidates: Candidates, predicted: PredictedDepth, config: RescoreConfig
) -> FrameEvidence:
    """``depth_evidence`` with the depth that another system predicts in place of the class model's.

    Raises:
        RescoreError: the prediction is of another size than the picture.
    """
    height, width = frame.left_rgb.shape[:2]
    found = cut_to_boxes(predicted, candidates.xyxy_px, (width, height), config.reconstruct.min_inside)
    views = views_without_model(candidates, config.view_bin)
    return compare_depth(frame, candidates, Instances(found, views), config)


def instances_of(frame: Frame, candidates: Candidates, model: ClassModel, config: RescoreConfig) -> Instances:
    """The 3D instance of each candidate, from the left picture, camera and ground alone."""
    camera, ground = assumed_camera(frame, config.camera)
    views = views_of(frame.left_rgb, candidates, config.view_bin, model, config.reconstruct)
    found = reconstruct_views(
        frame.left_rgb, candidates.xyxy_px, views, model, camera, ground, config.reconstruct
    )
    return Instances(found, views)


def compare_depth(
    frame: Frame, candidates: Candidates, instances: Instances, config: RescoreConfig
) -> FrameEvidence:
    """What the measured depth of a frame says about candidates whose depth is predicted."""
    z_s = measured_depth(frame.disparity_px, frame.camera)
    if instances.inverse:
        z_s = np.float32(1) / z_s
    limits = None
    if config.align.normalisation is Normalisation.IMAGE_RANGE:
        limits = depth_range(z_s, config.align.percentiles)
    alignments = tuple(
        i if isinstance(i, Failure) else align_depth(i.depth, z_s, box, config.align, limits)
        for i, box in zip(instances.found, candidates.xyxy_px, strict=True)
    )
    views = instances.views
    cues = frame_cues(frame, candidates.xyxy_px, instances.scaled_depths, views.azimuth_rad, config.cues)
    return FrameEvidence(candidates, views, instances.found, alignments, cues, frame.ground_source)


def evidence_of_frames(
    data: DataSet,
    candidates: Mapping[int, Candidates],
    source: ClassModel | Predictions,
    config: RescoreConfig,
    *,
    jobs: int = 1,
    evidence_dir: Path | None = None,
) -> Iterator[CandidateTable]:
    """One table a frame, in the order of the data set, as frames are done; memory does not grow with their
    number.

    Args:
        data: the frames.
        candidates: of each frame by image id; a frame without an entry has none.
        source: what predicts depth: the class model, or files of every frame that has candidates.
        config: settings.
        jobs: frames at a time.
        evidence_dir: the detector's folder of evidence files, one a frame; None writes none.
    """
    none = (np.zeros((0, 4)), np.zeros(0), np.zeros(0))
    tasks = (
        delayed(_evidence_of_frame)(
            record,
            candidates.get(record.image_id, Candidates(record.image_id, *none)),
            source.files.get(record.image_id) if isinstance(source, Predictions) else source,
            config,
            file=evidence_path(evidence_dir.parent, evidence_dir.name, record.image_id)
            if evidence_dir
            else None,
        )
        for record in data.frames
    )
    # two tasks ahead for each worker keep it busy without loading more
    return iter(Parallel(n_jobs=jobs, return_as="generator", pre_dispatch="2*n_jobs", batch_size=1)(tasks))


def _evidence_of_frame(
    record: FrameRecord,
    candidates: Candidates,
    source: ClassModel | PredictedFile | None,
    config: RescoreConfig,
    *,
    file: Path | None,
) -> CandidateTable:
    """One frame from disk to its table; reconstructions go to the file, not through the pipe."""
    if not len(candidates):
        evidence = FrameEvidence(candidates, NO_VIEWS, (), (), np.zeros((0, len(CUES))))
    else:
        assert source is not None, "every frame with candidates has a prediction"
        with one_thread():
            evidence = _evidence(load_frame(record, config.stereo), candidates, source, config)
    if file is not None:
        write_evidence(file, evidence.instances)
    return evidence.table


def _evidence(
    frame: Frame, candidates: Candidates, source: ClassModel | PredictedFile, config: RescoreConfig
) -> FrameEvidence:
    if isinstance(source, ClassModel):
        return depth_evidence(frame, candidates, source, config)
    height, width = frame.left_rgb.shape[:2]
    return compared_with_prediction(frame, candidates, source.read(width, height), config)


def find_evidence(
    data: DataSet,
    candidates: Mapping[int, Candidates],
    source: ClassModel | Predictions,
    config: RescoreConfig,
    *,
    jobs: int,
    detector: str,
    evidence_dir: Path | None = None,
    show: bool = True,
) -> CandidateTable:
    """The candidates of all frames with the outcome of eq. 6 (see ``pipeline.evidence_of_frames``)."""
    tables = evidence_of_frames(data, candidates, source, config, jobs=jobs, evidence_dir=evidence_dir)
    return CandidateTable.concatenate(
        list(track(tables, f"depth evidence {detector}", len(data.frames), show))
    )
