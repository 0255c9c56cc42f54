"""Candidates: the detections c_i = (b_i, l_i) of one image (the report, section 6)."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError


@dataclass(frozen=True, eq=False)
class Candidates:
    """At most 15 detections of one image, best detector score first."""

    image_id: int
    xyxy_px: FloatArray
    """Boxes b_i, shape (n, 4), pixel edges."""
    score: FloatArray
    """Raw detector score, shape (n,); any range."""
    likelihood: FloatArray
    """l_i in [0, 1], shape (n,): the score after Platt scaling."""
    azimuth_deg: FloatArray | None = None
    """From where the detector says that the object is seen (see ``rescore.frames.Truth``), shape (n,), NaN
    where unknown; None where it never says."""

    def __post_init__(self) -> None:
        n = len(self.score)
        if self.xyxy_px.shape != (n, 4) or self.likelihood.shape != (n,) or self.score.shape != (n,):
            raise ValueError(
                f"candidates: {self.xyxy_px.shape} boxes, {self.score.shape} scores, "
                f"{self.likelihood.shape} likelihoods"
            )
        if self.azimuth_deg is not None and self.azimuth_deg.shape != (n,):
            raise ValueError(f"candidates: {n} boxes, {self.azimuth_deg.shape} azimuths")
        if not (np.isfinite(self.xyxy_px).all() and np.isfinite(self.score).all()):
            raise RescoreError(
                f"image {self.image_id}: boxes and scores must be finite, got NaN or infinity; "
                "mend the detections"
            )
        if n and not ((self.likelihood >= 0) & (self.likelihood <= 1)).all():
            raise RescoreError(
                f"image {self.image_id}: likelihoods must lie in [0, 1], got {self.likelihood.min()} to "
                f"{self.likelihood.max()}; calibrate the scores first"
            )

    def __len__(self) -> int:
        return len(self.score)
