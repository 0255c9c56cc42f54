"""Small pictures of single candidates: what was seen, measured, predicted, and what is left between them."""

import base64
from dataclasses import dataclass

import cv2
import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from reports.evidence_view import CandidateView, FrameView
from reports.palette import OUTCOME_COLOUR, part_colour, rgb

Rgb = NDArray[np.uint8]

PANEL_WIDTH_PX = 300
"""Width of a picture in the gallery."""
RESIDUAL_LIMIT_M = 1.0
"""Residuals beyond this are drawn in the end colours."""
_MARGIN = 0.12
_HOLE = (105, 105, 105)
_QUALITY = 82


@dataclass(frozen=True)
class CandidatePanels:
    """The four pictures of one candidate as data URIs, and the range of the depth colours."""

    picture: str
    measured: str
    predicted: str | None
    """None, like ``residual``, where there is no registered prediction."""
    residual: str | None
    near: float
    far: float
    """Depth of the first and the last colour, in the unit of the measured depth."""


def candidate_panels(view: FrameView, c: CandidateView) -> CandidatePanels:
    """The pictures of a candidate: crop with outline and parts, measured and predicted depth, residual."""
    rows, columns = _crop_window(c, view.measured.shape)
    measured = view.measured[rows, columns]
    predicted = np.full(view.measured.shape, np.nan, np.float32)
    if c.predicted is not None and c.registered is not None:
        predicted[c.predicted.window] = c.registered
    predicted = predicted[rows, columns]
    near, far = _depth_range(c, view, predicted)
    has = bool(np.isfinite(predicted).any())
    limit = RESIDUAL_LIMIT_M if view.metric else (far - near) / 4
    return CandidatePanels(
        picture=data_uri(
            _draw_outline(_resize(_tint_parts(view, c)[rows, columns], cv2.INTER_CUBIC), c, rows, columns)
        ),
        measured=data_uri(_resize(colourise(measured, near, far))),
        predicted=data_uri(_resize(colourise(predicted, near, far))) if has else None,
        residual=data_uri(_resize(colourise(measured - predicted, -limit, limit, "RdBu"))) if has else None,
        near=near,
        far=far,
    )


def colourise(values: NDArray[np.float32], low: float, high: float, colormap: str = "viridis") -> Rgb:
    """Values (h, w) as colours (h, w, 3) from ``low`` to ``high``; NaN is grey."""
    span = high - low if high > low else 1.0
    unit = np.clip((np.nan_to_num(values, nan=low) - low) / span, 0, 1)
    colours = (mpl.colormaps[colormap](unit)[..., :3] * 255).round().astype(np.uint8)
    colours[~np.isfinite(values)] = _HOLE
    return np.asarray(colours, np.uint8)


def data_uri(picture: Rgb) -> str:
    """A picture as a JPEG data URI."""
    _, jpeg = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode()


def _crop_window(c: CandidateView, shape: tuple[int, ...]) -> tuple[slice, slice]:
    x0, y0, x1, y1 = c.xyxy_px
    pad = _MARGIN * max(x1 - x0, y1 - y0)
    left, top = (int(np.clip(v - pad, 0, n - 2)) for v, n in ((x0, shape[1]), (y0, shape[0])))
    right = int(np.clip(np.ceil(x1 + pad), left + 2, shape[1]))
    bottom = int(np.clip(np.ceil(y1 + pad), top + 2, shape[0]))
    return slice(top, bottom), slice(left, right)


def _depth_range(c: CandidateView, view: FrameView, predicted: NDArray[np.float32]) -> tuple[float, float]:
    """The measured depths of the predicted region, or of the box, widened a little."""
    x0, y0, x1, y1 = np.round(c.xyxy_px).astype(int)
    values = view.measured[max(y0, 0) : y1, max(x0, 0) : x1]
    values = np.concatenate([values[np.isfinite(values)], predicted[np.isfinite(predicted)]])
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, [3, 97])
    return float(low), float(max(high, low + 0.05 * abs(low) + 1e-6))


def _tint_parts(view: FrameView, c: CandidateView) -> Rgb:
    """The left picture with the registered parts tinted."""
    rgb_image = view.rgb.copy()
    if c.instance is not None:
        window = c.instance.depth.window
        labels = c.instance.part_labels
        tint = np.array([rgb(part_colour(i)) for i in range(256)], np.uint8)[labels]
        part = rgb_image[window]
        mixed = (0.6 * part + 0.4 * tint).astype(np.uint8)
        rgb_image[window] = np.where((labels > 0)[..., None], mixed, part)
    return rgb_image


def _draw_outline(picture: Rgb, c: CandidateView, rows: slice, columns: slice) -> Rgb:
    """The enlarged crop with box and outline, drawn after enlarging so that their lines stay thin."""
    zoom = PANEL_WIDTH_PX / (columns.stop - columns.start)
    corner = np.array([columns.start, rows.start])
    x0, y0, x1, y1 = c.xyxy_px
    lines = [(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), rgb(OUTCOME_COLOUR[c.outcome]), 2)]
    if c.instance is not None:
        lines.append((c.instance.outline_px + 0.5, (255, 255, 255), 1))
    for points, colour, width in lines:
        at = np.round((points - corner) * zoom).astype(np.int32)
        cv2.polylines(picture, [at], isClosed=True, color=colour, thickness=width, lineType=cv2.LINE_AA)
    return picture


def _resize(picture: NDArray[np.uint8], how: int = cv2.INTER_NEAREST) -> Rgb:
    h, w = picture.shape[:2]
    height = max(1, round(h * PANEL_WIDTH_PX / w))
    return np.asarray(cv2.resize(picture, (PANEL_WIDTH_PX, height), interpolation=how), np.uint8)
