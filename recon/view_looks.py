"""The side from which an object is seen, from how its box looks: gradients and colours, weighed linearly.

Gradients tell the shape of the outline and of its parts; colours against the paint tell lamps, plates, glass
and tyres. The weights are learned from boxes of known heading (multinomial logistic regression).
"""

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from recon.arrays import Float32Array, FloatArray, UInt8Array, median
from recon.errors import RescoreError
from recon.view_bins import ViewBins

_SIZE = (64, 48)
"""Columns and rows that a box is scaled to."""
_MARGIN = 0.08
"""Share of the box's extent that is seen beyond each side."""
_COLOURS = (8, 6)
"""Columns and rows of the grid of colours."""
_COLOUR_UNIT = np.array([30.0, 8.0, 8.0])
"""Differences of Lab from the paint that are much; larger ones count little more."""
_COLOUR_WEIGHT = 0.3
"""Weight of colours beside gradients."""


@dataclass(frozen=True)
class LooksConfig:
    """Settings of learning."""

    headings: int = 12
    """Headings that are told apart."""
    inverse_penalty: float = 0.1
    """scikit-learn's C."""
    jitter: float = 0.05
    """Standard deviation of the edges of a second copy of each box, as a share of its extent."""
    min_boxes: int = 60
    """Fewer boxes teach nothing."""
    doubt: float = 0.1
    """Share of a flat density that is mixed in: real pictures differ from those that were learned from."""


@dataclass(frozen=True, eq=False)
class ViewLooks:
    """Weights of each heading; heading i is ``2 pi i / headings`` from the picture's right to its far end."""

    weights: Float32Array
    """Shape (headings, features)."""
    bias: Float32Array
    """Shape (headings,)."""
    doubt: float
    """See ``LooksConfig``."""

    def log_density(self, rgb: UInt8Array, xyxy_px: FloatArray) -> FloatArray:
        """Log probability of each heading for each box (n, 4), pixel edges, shape (n, headings)."""
        from scipy.special import log_softmax  # noqa: PLC0415 (a third of a second)

        if not len(xyxy_px):
            return np.zeros((0, len(self.bias)))
        features = np.stack([box_features(rgb, box) for box in xyxy_px])
        logs = log_softmax(features @ self.weights.T.astype(float) + self.bias, axis=1)
        return np.asarray(np.log((1 - self.doubt) * np.exp(logs) + self.doubt / len(self.bias)))

    def bins_log_density(self, rgb: UInt8Array, xyxy_px: FloatArray, bins: ViewBins) -> FloatArray:
        """Log probability density of the middle of each view bin for each box (n, 4), shape (n, bins)."""
        logs = self.log_density(rgb, xyxy_px)
        # seen from the front, the nose points along the ray towards the camera
        heading = 1.5 * np.pi - 2 * np.pi / bins.count * np.arange(bins.count)
        at = heading / (2 * np.pi) * logs.shape[1] % logs.shape[1]
        low, part = np.floor(at).astype(np.intp), at % 1
        return np.asarray(
            (1 - part) * logs[:, low % logs.shape[1]] + part * logs[:, (low + 1) % logs.shape[1]]
        )

    def as_json(self) -> dict[str, Any]:
        """The weights as JSON values, in half precision."""
        table = np.concatenate([self.weights, self.bias[:, None]], axis=1).astype("<f2")
        return {
            "shape": list(table.shape),
            "weights": base64.b64encode(table.tobytes()).decode("ascii"),
            "doubt": self.doubt,
        }

    @staticmethod
    def from_json(value: Mapping[str, Any]) -> "ViewLooks":
        """The weights of ``as_json``.

        Raises:
            KeyError, TypeError, ValueError: something else was given.
        """
        shape = tuple(int(n) for n in value["shape"])
        data = base64.b64decode(value["weights"], validate=True)
        table = np.frombuffer(data, "<f2").reshape(shape).astype(np.float32)
        return ViewLooks(table[:, :-1].copy(), table[:, -1].copy(), float(value["doubt"]))


def learn_looks(
    boxes: Iterable[tuple[UInt8Array, FloatArray, FloatArray]],
    config: LooksConfig,
    rng: np.random.Generator,
) -> ViewLooks:
    """Weights from pictures with boxes (n, 4), pixel edges, and the headings (n,) of what they frame.

    Each box is seen as it is and with its edges moved, both also in a mirror.

    Raises:
        RescoreError: too few boxes, or one heading alone.
    """
    features, headings = [], []
    for rgb, xyxy_px, heading_rad in boxes:
        mirrored = np.ascontiguousarray(rgb[:, ::-1])
        for box, heading in zip(xyxy_px, heading_rad, strict=True):
            extent = np.tile(box[2:] - box[:2], 2)
            for moved in (box, box + rng.normal(0, config.jitter, 4) * extent):
                turned = np.array([rgb.shape[1] - moved[2], moved[1], rgb.shape[1] - moved[0], moved[3]])
                features += [box_features(rgb, moved), box_features(mirrored, turned)]
                headings += [heading, np.pi - heading]
    label = np.rint(np.array(headings) * (config.headings / (2 * np.pi))).astype(int) % config.headings
    if len(features) < 4 * config.min_boxes or len(np.unique(label)) < 2:
        raise RescoreError(
            f"looks of views: expected at least {config.min_boxes} boxes seen from several sides, got "
            f"{len(features) // 4}; add training frames"
        )
    from sklearn.linear_model import LogisticRegression  # noqa: PLC0415 (takes a second; learning alone needs it)

    fitted = LogisticRegression(C=config.inverse_penalty, max_iter=1000).fit(np.stack(features), label)
    weights = np.zeros((config.headings, features[0].size))
    # a heading that no box shows is as unlikely as can be told
    bias = np.full(config.headings, fitted.intercept_.min() - 3.0)
    weights[fitted.classes_], bias[fitted.classes_] = fitted.coef_, fitted.intercept_
    return ViewLooks(weights.astype(np.float32), bias.astype(np.float32), config.doubt)


def box_features(rgb: UInt8Array, xyxy_px: FloatArray) -> FloatArray:
    """Gradients, colours against the paint, and aspect of one box (4,), pixel edges, shape (features,)."""
    (left, top), extent = xyxy_px[:2], xyxy_px[2:] - xyxy_px[:2]
    low = np.floor(np.maximum([left, top] - _MARGIN * extent, 0)).astype(int)
    high = np.ceil(np.minimum(xyxy_px[2:] + _MARGIN * extent, [rgb.shape[1], rgb.shape[0]])).astype(int)
    high = np.maximum(high, low + 1)
    cut = rgb[low[1] : high[1], low[0] : high[0]]
    if not cut.size:
        cut = np.zeros((1, 1, 3), np.uint8)
    shrunk = extent[0] > _SIZE[0]
    small = cv2.resize(cut, _SIZE, interpolation=cv2.INTER_AREA if shrunk else cv2.INTER_LINEAR)
    gradients = np.ravel(_descriptor().compute(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)))
    lab = cv2.cvtColor(small, cv2.COLOR_RGB2LAB).astype(np.float32)
    quarter, half = _SIZE[1] // 4, _SIZE[1] // 2
    paint = [median(channel.ravel()) for channel in np.moveaxis(lab[quarter : quarter + half], -1, 0)]
    grid = cv2.resize(lab, _COLOURS, interpolation=cv2.INTER_AREA)
    colours = np.tanh((grid - paint) / _COLOUR_UNIT) * _COLOUR_WEIGHT
    aspect = np.log(max(extent[0], 1.0) / max(extent[1], 1.0))
    return np.concatenate([gradients, colours.ravel(), [aspect]]).astype(float)


@lru_cache(maxsize=1)
def _descriptor() -> cv2.HOGDescriptor:
    return cv2.HOGDescriptor(_SIZE, (16, 16), (8, 8), (8, 8), 9)
