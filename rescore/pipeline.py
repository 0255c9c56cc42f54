"""Rescoring (section 6): candidates of a frame in, posterior likelihoods out; and that over many frames."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Literal

import numpy as np
from joblib import Parallel, delayed

from recon.arrays import FloatArray
from recon.camera import DEFAULT_GROUND, GroundPlane, PinholeCamera, default_camera
from recon.class_model import ClassModel
from recon.depth_map import DepthMap
from recon.errors import RescoreError
from recon.outcome import Failure
from recon.reconstruct import ReconstructConfig
from recon.stereo import SgbmConfig
from rescore.align_depth import (
    AlignConfig,
    DepthAlignment,
    Normalisation,
    align_depth,
    depth_range,
    measured_depth,
)
from rescore.candidates import Candidates
from rescore.cues import CUES, CueConfig, frame_cues
from rescore.evidence import CandidateTable
from rescore.evidence_files import Predicted, evidence_path, write_evidence
from rescore.frames import DataSet, Frame, FrameRecord, GroundSource, load_frame
from rescore.fuse import fuse
from rescore.predicted import BoxPrediction, PredictedDepth, cut_to_boxes
from rescore.predicted_files import PredictedFile, Predictions
from rescore.threads import one_thread
from rescore.views import NO_VIEWS, Views, reconstruct_views, views_of, views_without_model


class CameraChoice(StrEnum):
    """Which camera and ground plane predict depth."""

    CALIBRATED = "calibrated"
    """The camera and ground of the frame, each where it is known; the default ones where it is not.

    The default: what is known is used, and a picture without calibration is treated as in the report.
    """
    DEFAULT = "default"
    """One assumed camera and ground for every picture, as in the report, whose cameras were not known.

    An assumed horizon that is too low loses far cars, which then seem to stand above it: nearly a third of
    them on rendered streets with a camera pitch of -1 to 4 degrees.
    """


@dataclass(frozen=True)
class RescoreConfig:
    """Settings of rescoring."""

    camera: CameraChoice = CameraChoice.CALIBRATED
    view_bin: int | Literal["model"] = 3
    """The bin that a candidate is taken to be seen from where its detector does not say; 3 is the left side
    of a car. "model": the one that the class model explains it best with."""
    stereo: SgbmConfig = field(default_factory=SgbmConfig)
    """Used where a data set gives a right picture but no disparity."""
    nearest_m: float = 2.0
    """Depth in metres from which such pairs are measured where the camera is known: ``stereo`` then searches
    at least as many disparities as that takes. A search twice as far takes about twice as long."""
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)
    align: AlignConfig = field(default_factory=AlignConfig)
    cues: CueConfig = field(default_factory=CueConfig)
    """Of the modes that go past eq. 6."""

    def __post_init__(self) -> None:
        if not self.nearest_m > 0:
            raise RescoreError(f"nearest_m: expected metres above 0, got {self.nearest_m:g}; try 2")


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
    """Parts of the evidence of the other modes, shape (n, k), columns ``rescore.cues.CUES``."""
    ground: GroundSource | None = None
    """Where the ground plane of the frame came from; None where the frame was not read."""

    @property
    def table(self) -> CandidateTable:
        """The candidates with the outcome of eq. 6, a row each."""
        return CandidateTable.of_alignments(self.candidates, self.alignments, self.cues, self.ground or "")


@dataclass(frozen=True, eq=False)
class RescoredFrame:
    """The candidates of one frame with their posterior likelihood."""

    evidence: FrameEvidence
    posterior: FloatArray
    """Eq. 7, shape (n,), in [0, 1]; the likelihood itself where there is no depth evidence."""


def rescore_frame(
    frame: Frame, candidates: Candidates, model: ClassModel, w: float, config: RescoreConfig
) -> RescoredFrame:
    """Section 6 on one frame: what depth says (eq. 6), fused with what the detector says (eq. 7)."""
    evidence = depth_evidence(frame, candidates, model, config)
    return RescoredFrame(evidence, fuse(candidates.likelihood, evidence.table.depth_difference, w))


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


def assumed_camera(frame: Frame, choice: CameraChoice) -> tuple[PinholeCamera, GroundPlane]:
    """The camera M and the ground plane Qg that predict depth in a frame."""
    h, w = frame.left_rgb.shape[:2]
    assumed = default_camera(w, h)
    if choice is CameraChoice.DEFAULT:
        return assumed, DEFAULT_GROUND
    return (frame.camera.left if frame.camera else assumed), frame.ground or DEFAULT_GROUND


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
