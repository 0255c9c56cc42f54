"""How well the parts of an instance, projected into a picture, meet its edges: it tells front from rear."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.border_evidence import BorderEvidenceConfig, agreement, border_channels, edge_channels

_MARGIN_PX = 2


@dataclass(frozen=True)
class EdgeWindowConfig:
    """Settings of the comparison."""

    longer_side_px: int = 160
    """Larger windows are reduced to this: edges and borders are compared coarsely."""
    borders: BorderEvidenceConfig = field(default_factory=BorderEvidenceConfig)


class EdgeWindow:
    """The edges of a picture in the box of an outline."""

    def __init__(
        self,
        picture: UInt8Array | Float32Array,
        ring_px: FloatArray,
        config: EdgeWindowConfig,
    ) -> None:
        """From a picture (h, w, 3), sRGB bytes or linear light in [0, 1], and an outline (m, 2)."""
        self.config = config
        self.low_px = np.maximum(np.floor(ring_px.min(axis=0)).astype(int) - _MARGIN_PX, 0)
        high = np.ceil(ring_px.max(axis=0)).astype(int) + _MARGIN_PX + 1
        crop = picture[self.low_px[1] : high[1], self.low_px[0] : high[0]]
        self.zoom = min(config.longer_side_px / max(crop.shape[:2]), 1.0)
        small = cv2.resize(crop, None, fx=self.zoom, fy=self.zoom, interpolation=cv2.INTER_AREA)
        lab = (
            cv2.cvtColor(small.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2Lab)
            if picture.dtype == np.uint8
            else cv2.cvtColor(small, cv2.COLOR_LRGB2Lab)
        )
        self.edges = edge_channels(np.asarray(lab, np.float32), config.borders)

    def agreement(self, instances: Sequence[Sequence[FloatArray]]) -> FloatArray:
        """Correlation in [-1, 1] of the edges with the borders of each instance's visible parts, shape (n,).

        An instance is a sequence of part outlines (m, 2), image pixel centres.
        """
        height, width = self.edges.shape[:2]
        drawn = [
            border_channels(tuple(self._inside(p) for p in parts), height, width, self.config.borders)
            for parts in instances
        ]
        return agreement(self.edges, np.stack(drawn))

    def _inside(self, uv_px: FloatArray) -> FloatArray:
        return np.asarray((uv_px + 0.5 - self.low_px) * self.zoom - 0.5)
