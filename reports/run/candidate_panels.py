"""Pictures of single candidates: what was seen, measured, predicted, and what is left between them."""

import base64
from dataclasses import dataclass
from functools import cache

import cv2
import matplotlib as mpl
import numpy as np

from recon.arrays import Float32Array, FloatArray, UInt8Array
from reports.palette import HOLE_GREY, NIGHT, OUTCOME_COLOUR, WHITE, part_colour, rgb
from reports.run.fitted_cars import dashes, error_m, instance_depth, shown_area
from reports.run.frame_view import CandidateView, FrameView

PICTURE_WIDTH_PX = 480
"""Width of the enlarged left picture."""
DEPTH_COLOURS, RESIDUAL_COLOURS = "viridis", "RdBu"
"""Colour maps of depth and of residuals, whose colours the colour-blind can tell apart."""
RESIDUAL_LIMIT_M = 1.0
"""Residuals beyond this are drawn in the end colours."""
_DEPTH_WIDTH_PX = 240
"""Narrower depth maps are enlarged by whole numbers, so that their pixels stay sharp."""
_DASH_PX = 7.0
_MARGIN = 0.2
_ASPECT = 1.8
"""Width over height of what is cut out, so that cards are alike."""
_HOLE = rgb(HOLE_GREY)
_STEPS = 256
"""Number of colours of a map of matplotlib."""
_QUALITY = 80
_FRAME_QUALITY = 72

Window = tuple[slice, slice]
"""Rows and columns of a frame."""


@dataclass(frozen=True)
class Picture:
    """A picture to put into a page."""

    uri: str
    """The WebP file as a data URI."""
    width_px: int
    height_px: int


@dataclass(frozen=True)
class CandidatePanels:
    """The pictures of one candidate, and the range of the depth colours."""

    frame: Picture
    """The whole left picture with the box."""
    picture: Picture
    measured: Picture
    predicted: Picture | None
    """Registered prediction; None, like ``residual``, where there is none."""
    residual: Picture | None
    near: float
    far: float
    """Depth of the first and the last colour, in the unit of the measured depth."""
    limit: float
    """Residual of the last colour, in the unit of the measured depth."""
    of_fit: bool = False
    """Whether the prediction is that of the fitted car that fits the depth best, whose end is dashed, and not
    a registered one with outline and parts."""


def candidate_panels(view: FrameView, c: CandidateView) -> CandidatePanels:
    """The pictures of a candidate: frame, crop with what was found in it, measured and predicted depth,
    residual."""
    rows, columns = window = crop_window(shown_area(c), view.measured.shape)
    measured = view.measured[rows, columns]
    predicted = _predicted(view, c)[rows, columns]
    near, far = _depth_range(c, view, predicted)
    has = bool(np.isfinite(predicted).any())
    limit = RESIDUAL_LIMIT_M if view.metric else (far - near) / 4
    if c.fit is not None and has:
        limit = max(limit, error_m(view, float(np.nanmedian(predicted))))
    residual = colourise(measured - predicted, -limit, limit, RESIDUAL_COLOURS)

    def depth(values: Float32Array) -> Picture:
        return as_webp(_draw_fit(_enlarged(colourise(values, near, far)), c, window))

    return CandidatePanels(
        frame=as_webp(_with_box(view.rgb, c), _FRAME_QUALITY),
        picture=as_webp(_draw_found(_widened(_tint_parts(view, c)[rows, columns]), c, window)),
        measured=depth(measured),
        predicted=depth(predicted) if has else None,
        residual=as_webp(_enlarged(residual)) if has else None,
        near=near,
        far=far,
        limit=limit,
        of_fit=c.fit is not None,
    )


def _predicted(view: FrameView, c: CandidateView) -> Float32Array:
    """Predicted depth (h, w): registered, or that of the car that fits the depth best; NaN elsewhere."""
    if c.fit is not None:
        return instance_depth(view, c.fit, c.fit.seen)
    predicted = np.full(view.measured.shape, np.nan, np.float32)
    if c.predicted is not None and c.registered is not None:
        predicted[c.predicted.window] = c.registered
    return predicted


def colourise(values: Float32Array, low: float, high: float, colormap: str = DEPTH_COLOURS) -> UInt8Array:
    """Values (h, w) as colours (h, w, 3) from ``low`` to ``high``; NaN is grey."""
    span = high - low if high > low else 1.0
    unit = np.clip((np.nan_to_num(values, nan=low) - low) / span, 0, 1)
    steps = np.minimum(unit * _STEPS, _STEPS - 1).astype(np.uint8)
    colours = _colour_table(colormap)[steps]
    colours[~np.isfinite(values)] = _HOLE
    return np.asarray(colours, np.uint8)


@cache
def _colour_table(colormap: str) -> UInt8Array:
    """The colours (256, 3) of a map: looked up by hand, as matplotlib converts every pixel in floats."""
    colours = mpl.colormaps[colormap](np.arange(_STEPS))[:, :3]
    return np.asarray((colours * 255).round(), np.uint8)


def colour_stops(colormap: str, count: int = 9) -> str:
    """The colours of a map from low to high, for a gradient of CSS."""
    colours = (mpl.colormaps[colormap](np.linspace(0, 1, count))[:, :3] * 255).round().astype(int)
    return ", ".join("rgb({}, {}, {})".format(*c) for c in colours.tolist())


def as_webp(picture: UInt8Array, quality: int = _QUALITY) -> Picture:
    """A picture as WebP."""
    _, data = cv2.imencode(".webp", picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    uri = "data:image/webp;base64," + base64.b64encode(data.tobytes()).decode()
    return Picture(uri, picture.shape[1], picture.shape[0])


def crop_window(xyxy_px: FloatArray, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns around a box (4,), of one aspect as far as the image allows."""
    x0, y0, x1, y1 = xyxy_px
    pad = 2 * _MARGIN * max(x1 - x0, y1 - y0)
    width, height = x1 - x0 + pad, y1 - y0 + pad
    width, height = max(width, _ASPECT * height), max(height, width / _ASPECT)
    return _within((y0 + y1) / 2, height, shape[0]), _within((x0 + x1) / 2, width, shape[1])


def _within(middle: float, length: float, size: int) -> slice:
    """A slice of ``length`` pixels around a place, moved into an image of ``size`` pixels."""
    count = int(np.clip(round(length), 2, size))
    first = int(np.clip(round(middle - count / 2), 0, size - count))
    return slice(first, first + count)


def _depth_range(c: CandidateView, view: FrameView, predicted: Float32Array) -> tuple[float, float]:
    """The measured depths of the predicted region, or of the box, widened a little."""
    x0, y0, x1, y1 = np.round(c.xyxy_px).astype(int)
    values = view.measured[max(y0, 0) : y1, max(x0, 0) : x1]
    values = np.concatenate([values[np.isfinite(values)], predicted[np.isfinite(predicted)]])
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, [3, 97])
    return float(low), float(max(high, low + 0.05 * abs(low) + 1e-6))


def _tint_parts(view: FrameView, c: CandidateView) -> UInt8Array:
    """The left picture with the registered parts tinted."""
    rgb_image = view.rgb.copy()
    if c.instance is not None and c.fit is None:
        window = c.instance.depth.window
        labels = c.instance.part_labels
        tint = np.array([rgb(part_colour(i)) for i in range(256)], np.uint8)[labels]
        part = rgb_image[window]
        mixed = (0.7 * part + 0.3 * tint).astype(np.uint8)
        rgb_image[window] = np.where((labels > 0)[..., None], mixed, part)
    return rgb_image


def _draw_found(picture: UInt8Array, c: CandidateView, window: Window) -> UInt8Array:
    """The enlarged crop with box and what was found, drawn after enlarging so that their lines stay thin."""
    _draw_line(picture, _corners(c), rgb(OUTCOME_COLOUR[c.outcome]), 3, window)
    if c.fit is not None:
        return _draw_car(picture, c, window, 2)
    if c.instance is not None:
        _draw_line(picture, c.instance.outline_px + 0.5, rgb(WHITE), 2, window)
    return picture


def _draw_fit(picture: UInt8Array, c: CandidateView, window: Window) -> UInt8Array:
    """An enlarged depth map; where a car was fitted, with the box and the end of the car that fits best."""
    if c.fit is None:
        return picture
    _draw_line(picture, _corners(c), rgb(OUTCOME_COLOUR[c.outcome]), 2, window)
    return _draw_car(picture, c, window, 1)


def _draw_line(
    picture: UInt8Array, points_px: FloatArray, colour: tuple[int, int, int], width: int, window: Window
) -> None:
    """Draw a closed line through pixel edges (n, 2) of the frame."""
    at = np.round(_in_window(picture, points_px, window)).astype(np.int32)
    cv2.polylines(picture, [at], isClosed=True, color=colour, thickness=width, lineType=cv2.LINE_AA)


def _draw_car(picture: UInt8Array, c: CandidateView, window: Window, width: int) -> UInt8Array:
    """The picture with dashes where the car that fits the depth best ends."""
    if c.fit is not None:
        ends = _in_window(picture, c.fit.seen.silhouette_px.reshape(2, 2), window)
        for start, end in np.round(dashes(ends.ravel(), _DASH_PX)).astype(int).tolist():
            for colour, thickness in ((rgb(NIGHT), width + 2), (rgb(WHITE), width)):
                cv2.line(picture, start, end, colour, thickness, cv2.LINE_AA)
    return picture


def _in_window(picture: UInt8Array, points_px: FloatArray, window: Window) -> FloatArray:
    """Pixel edges (n, 2) of the frame as pixel edges of an enlarged crop."""
    rows, columns = window
    zoom = picture.shape[1] / (columns.stop - columns.start)
    return np.asarray((points_px - [columns.start, rows.start]) * zoom)


def _with_box(picture: UInt8Array, c: CandidateView) -> UInt8Array:
    """The picture with the box of a candidate, white around its colour so that it is seen on anything."""
    drawn = picture.copy()
    at = np.round(_corners(c)).astype(np.int32)
    for colour, width in ((rgb(WHITE), 4), (rgb(OUTCOME_COLOUR[c.outcome]), 2)):
        cv2.polylines(drawn, [at], isClosed=True, color=colour, thickness=width, lineType=cv2.LINE_AA)
    return drawn


def _corners(c: CandidateView) -> FloatArray:
    x0, y0, x1, y1 = c.xyxy_px
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _widened(picture: UInt8Array) -> UInt8Array:
    """The picture at the common width, smooth."""
    h, w = picture.shape[:2]
    height = max(1, round(h * PICTURE_WIDTH_PX / w))
    size = (PICTURE_WIDTH_PX, height)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _enlarged(picture: UInt8Array) -> UInt8Array:
    """The picture with each pixel as a square of pixels, where it is narrow."""
    times = -(-_DEPTH_WIDTH_PX // picture.shape[1])
    return np.asarray(picture.repeat(times, axis=0).repeat(times, axis=1), np.uint8)
