"""The window around a candidate, drawn at a fixed size, and what the colours of its pictures mean."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray
from reports.recording.entities import picture, pinhole
from reports.run.candidate_panels import RESIDUAL_LIMIT_M
from reports.run.fitted_cars import shown_area
from reports.run.frame_view import CandidateView, FrameView

CROP_WIDTH_PX, CROP_HEIGHT_PX = 160, 96
_AROUND = 1.45


@dataclass(frozen=True)
class Crop:
    """The window of the picture around a box, drawn at a fixed size so that all candidates fill the view."""

    left: float
    """Left edge of the window in the picture, in pixels."""
    top: float
    zoom: float

    @classmethod
    def around(cls, xyxy_px: FloatArray) -> "Crop":
        """The crop of a box."""
        x0, y0, x1, y1 = xyxy_px
        width = _AROUND * max(x1 - x0, (y1 - y0) * CROP_WIDTH_PX / CROP_HEIGHT_PX, 8.0)
        height = width * CROP_HEIGHT_PX / CROP_WIDTH_PX
        return cls((x0 + x1 - width) / 2, (y0 + y1 - height) / 2, CROP_WIDTH_PX / width)

    def points(self, edges_px: FloatArray) -> FloatArray:
        """Pixel edges (..., 2) of the crop at pixel edges (..., 2) of the picture."""
        return (edges_px - [self.left, self.top]) * self.zoom

    def matrix(self, camera_matrix: FloatArray) -> FloatArray:
        """The camera matrix (3, 3) of the crop; origin in the middle of the first pixel, as that given."""
        shift = np.array([[0, 0, 0.5 - self.left], [0, 0, 0.5 - self.top], [0, 0, 0]])
        matrix = np.diag([self.zoom, self.zoom, 1.0]) @ (camera_matrix + shift)
        return np.asarray(matrix - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]))

    def cut(self, image: NDArray[Any], how: int, fill: float) -> NDArray[Any]:
        """The window of an image (h, w) or (h, w, 3); ``fill`` where it reaches beyond."""
        step = 1 / self.zoom
        inverse = np.array([[step, 0, step / 2 + self.left - 0.5], [0, step, step / 2 + self.top - 0.5]])
        return cv2.warpAffine(
            image,
            inverse,
            (CROP_WIDTH_PX, CROP_HEIGHT_PX),
            flags=how | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=[fill] * 3,
        )


def log_picture(
    rec: rr.RecordingStream, root: str, c: CandidateView, view: FrameView, colour: tuple[int, int, int]
) -> Crop:
    """Log the window of the picture around a candidate and its box; returns the window."""
    crop = Crop.around(shown_area(c))
    rec.log(
        root,
        pinhole(
            crop.matrix(view.seen_from.camera.matrix), CROP_WIDTH_PX, CROP_HEIGHT_PX, image_plane_distance=2.0
        ),
    )
    rec.log(
        f"{root}/picture", picture(np.asarray(crop.cut(view.rgb, cv2.INTER_LINEAR, 40), np.uint8), quality=80)
    )
    x0, y0, x1, y1 = c.xyxy_px
    corners = crop.points(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]))
    rec.log(
        f"{root}/box",
        rr.LineStrips2D([corners], colors=[colour], radii=rr.Radius.ui_points(1.2), draw_order=20),
    )
    return crop


def depth_range(measured: Float32Array, fitted: Float32Array, least_m: float = 0.5) -> tuple[float, float]:
    """Depths of the first and last colour: those of the prediction widened, or around the crop's middle.

    A prediction that spans less than ``least_m`` is taken to span that.
    """
    if not np.isfinite(fitted).any():
        h, w = measured.shape
        middle = measured[h // 4 : -h // 4, w // 4 : -w // 4]
        depth_m = float(np.nanmedian(middle)) if np.isfinite(middle).any() else 16.0
        return 0.75 * depth_m, 1.25 * depth_m
    low, high = (float(v) for v in np.percentile(fitted[np.isfinite(fitted)], [2, 98]))
    wide = max(high - low, 0.06 * abs(high), least_m)
    return max(low - 0.6 * wide, 0.0), high + 0.9 * wide


def residual_limit(fitted: Float32Array, least_m: float = RESIDUAL_LIMIT_M) -> float:
    """Residual of the end colours: ``least_m``, or more where stereo is coarse."""
    if not np.isfinite(fitted).any():
        return least_m
    return max(least_m, 0.05 * float(np.nanmedian(fitted)))
