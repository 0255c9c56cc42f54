"""Rescoring (section 6 of the report): candidates of a frame in, posterior likelihoods out."""

from dataclasses import dataclass

from recon.arrays import FloatArray
from recon.class_model import ClassModel
from rescore.data.frames import Frame
from rescore.evidence.candidates import Candidates
from rescore.evidence.pipeline import FrameEvidence, depth_evidence
from rescore.evidence.settings import RescoreConfig
from rescore.fusion.fuse import fuse


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
