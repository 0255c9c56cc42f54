"""Rescoring (section 6 of the report): candidates of a frame in, posterior likelihoods out.

Everything that rescores calls ``rescore_frame``: the library, the commands, the experiment and the studies.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.errors import Failure, RescoreError
from recon.localization.disparity_fit import BoxFit
from rescore.data.frames import Frame
from rescore.data.units import Things
from rescore.evidence.align_depth import DepthAlignment, align_instances, measured_depth
from rescore.evidence.candidates import Candidates, CandidateTable, RescoredTable
from rescore.evidence.cues import CueInput, frame_cues
from rescore.evidence.files import Predicted
from rescore.evidence.instance_fits import boxes_of_fits, fit_instances
from rescore.evidence.instances import DepthSource, Instances, candidate_views, predict_instances
from rescore.evidence.model import EvidenceModel, with_difference
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.evidence.views import Views, views_of_fits
from rescore.fusion.fuse import fuse
from rescore.fusion.suppress3d import suppress_second_boxes


@dataclass(frozen=True, eq=False)
class Rescoring:
    """How candidates are rescored: the settings, what D comes from, and the weight of eq. 7.

    Raises:
        RescoreError: w outside [0, 1].
    """

    config: RescoreConfig = field(default_factory=RescoreConfig)
    evidence_model: EvidenceModel | None = None
    """D of the modes that go past eq. 6; None for that of eq. 6, mode "paper"."""
    w: float = 1.0
    """Weight of the detector in eq. 7, in [0, 1]; 1 keeps the likelihoods, so that D can be looked at
    alone."""
    suppress: bool = False
    """Whether second boxes of a car are ranked below all others (``rescore.fusion.suppress3d``)."""
    predict: bool = True
    """Whether depth is predicted in each box and compared by eq. 6; a mode that does not look at that can do
    without (``Registration.predicts``)."""

    def __post_init__(self) -> None:
        if not 0 <= self.w <= 1:
            raise RescoreError(
                f"rescorer: expected w in [0, 1], got {self.w}; `rescore tune` finds it, 1 is the detector "
                "alone"
            )

    @property
    def mode(self) -> Registration:
        """How predicted and measured depth are compared."""
        return Registration.PAPER if self.evidence_model is None else self.evidence_model.registration

    def fuse(self, evidence: CandidateTable) -> RescoredTable:
        """Candidates with their depth evidence, of one frame or many, fused with what the detector says."""
        judged = with_difference(evidence, self.evidence_model)
        fused = RescoredTable(judged, fuse(judged.likelihood, judged.depth_difference, self.w))
        return suppress_second_boxes(fused) if self.suppress else fused


@dataclass(frozen=True, eq=False)
class RescoredFrame:
    """The candidates of one frame, rescored, with all that led there."""

    table: RescoredTable
    views: Views
    """View of each candidate: the side that it is taken to be seen from."""
    instances: tuple[Predicted, ...]
    """The 3D instance of each candidate, or the depth that another system predicts in its box; empty where
    none was asked for (``Rescoring.predict``)."""
    alignments: tuple[DepthAlignment | Failure, ...]
    """The outcome of eq. 6 of each candidate; why nothing is predicted where nothing is; empty where none
    was asked for."""
    fits: tuple[BoxFit | None, ...]
    """The instances fitted to each box and the disparity; None where none was."""

    @property
    def candidates(self) -> CandidateTable:
        """The candidates with D, a row each."""
        return self.table.candidates

    @property
    def posterior(self) -> FloatArray:
        """Eq. 7, shape (n,), in [0, 1]."""
        return self.table.posterior


def rescore_frame(
    frame: Frame, candidates: Candidates, source: DepthSource, rescoring: Rescoring
) -> RescoredFrame:
    """The candidates of a frame with D and posterior likelihood, in the order of the report.

    Outlines and parts (sections 4.1 and 4.2) are found on the way to the predicted depth (section 4.3), in
    ``recon.reconstruction.reconstruct``. One prediction and one look at the measured depth serve all modes.

    Args:
        frame: the left picture, measured disparity, and what is known of camera and ground.
        candidates: boxes b_i with likelihoods l_i.
        source: what predicts depth.
        rescoring: settings, mode and weight.

    Raises:
        RescoreError: see ``predict_instances``.
    """
    config = rescoring.config
    fits = _fitted(frame, candidates, source, rescoring)  # past eq. 6: an instance of the class, placed in 3D
    sides, told = None, dict[str, Any]()
    if isinstance(source, ClassModel):
        sides = views_of_fits(fits, source.bins)
        told = sides.columns(source.bins)
    if rescoring.predict:
        instances = predict_instances(frame, candidates, source, config, sides)  # Zi
        measured = measured_depth(frame.disparity_px, frame.camera, inverse=instances.inverse)  # Zs
        alignments = align_instances(instances.found, measured, candidates.xyxy_px, config.align)  # eq. 6
    else:
        instances, alignments = Instances((), candidate_views(frame, candidates, source, config, sides)), ()
    depths = instances.scaled_depths or (None,) * len(candidates)
    azimuth_rad = instances.views.azimuth_rad
    fitted = boxes_of_fits(fits, frame)
    cues = frame_cues(CueInput(frame, candidates.xyxy_px, depths, azimuth_rad, config.cues, fits, fitted))
    placed = candidates if fitted is None else replace(candidates, boxes3d=fitted.or_else(candidates.boxes3d))
    outcomes = alignments or (None,) * len(candidates)
    evidence = replace(CandidateTable.of_alignments(placed, outcomes, cues, frame.ground_source), **told)
    rescored = rescoring.fuse(evidence)  # eq. 7
    return RescoredFrame(rescored, instances.views, instances.found, alignments, fits)


def things_of(candidates: Candidates, source: DepthSource) -> Things | None:
    """The confident candidates, to judge their size; None where the source does not say how tall one is."""
    if not isinstance(source, ClassModel) or source.shape_space is None:
        return None
    height_m = float(np.exp(source.shape_space.log_size[2]))
    return Things.confident(candidates.xyxy_px, candidates.likelihood, height_m)


def _fitted(
    frame: Frame, candidates: Candidates, source: DepthSource, rescoring: Rescoring
) -> tuple[BoxFit | None, ...]:
    """Instances fitted to the boxes, where mode or view may ask for them and the source can tell."""
    asked = rescoring.evidence_model is None or rescoring.mode is Registration.INSTANCE or rescoring.suppress
    asked = asked or rescoring.config.view_bin == "fit"
    if not asked or not isinstance(source, ClassModel):
        return (None,) * len(candidates)
    return fit_instances(frame, candidates.xyxy_px, source, rescoring.config.fit)
