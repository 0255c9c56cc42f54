"""Training of the classifier of ground pixels on rendered scenes, and how well it does."""

import warnings
from dataclasses import dataclass

import cv2
import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPClassifier
from sklearn.preprocessing import StandardScaler

from recon.arrays import BoolArray, Float32Array, UInt8Array
from recon.errors import RescoreError
from recon.reconstruction.ground_region import GroundPixels, ground_features, ground_probability
from rescore.data.frames import DataSet, FrameRecord
from rescore.data.pictures import read_rgb
from rescore.data.rendered_kinds import GROUND_KINDS, read_instances


@dataclass(frozen=True)
class GroundTrainingConfig:
    """Settings of the training."""

    copies: int = 12
    """Changed copies of each frame."""
    cells_per_copy: int = 1500
    """Cells drawn from each copy."""
    hidden: tuple[int, ...] = (24, 12)
    """Sizes of the hidden layers."""
    alpha: float = 0.1
    """Weight decay."""
    epochs: int = 12
    horizon_known_share: float = 0.5
    """Share of copies that are told the row of the horizon; the others take the middle of the picture."""


@dataclass(frozen=True)
class GroundScore:
    """How pixels were judged, over all frames."""

    n_frames: int
    accuracy: float
    precision: float
    recall: float


def train_ground(data: DataSet, config: GroundTrainingConfig, rng: np.random.Generator) -> GroundPixels:
    """The classifier of ground pixels of the frames of a data set.

    Raises:
        RescoreError: no frames, or frames without pictures of instance numbers.
    """
    if not data.frames:
        raise RescoreError(f"{data.root}: expected frames to learn from, got none; choose another --split")
    drawn = [_draw(record, config, rng) for record in data.frames for _ in range(config.copies)]
    features, is_ground = (np.concatenate(part) for part in zip(*drawn, strict=True))
    low, high = np.quantile(features, [0.01, 0.99], axis=0).astype(np.float32)
    features = np.clip(features, low, high)
    scaler = StandardScaler().fit(features)
    network = MLPClassifier(
        config.hidden,
        alpha=config.alpha,
        batch_size=512,
        max_iter=config.epochs,
        n_iter_no_change=config.epochs,
        random_state=int(rng.integers(2**31)),
    )
    with warnings.catch_warnings():
        # the number of epochs is chosen, so that the fit need not have converged
        warnings.simplefilter("ignore", ConvergenceWarning)
        network.fit(scaler.transform(features), is_ground)
    # the scaling goes into the first product
    weights = [network.coefs_[0] / scaler.scale_[:, None], *network.coefs_[1:]]
    biases = [
        network.intercepts_[0] - (scaler.mean_ / scaler.scale_) @ network.coefs_[0],
        *network.intercepts_[1:],
    ]
    return GroundPixels(
        low,
        high,
        tuple(np.asarray(w, np.float32) for w in weights),
        tuple(np.asarray(b, np.float32) for b in biases),
    )


def score_ground(data: DataSet, classifier: GroundPixels | None, horizon_known: bool) -> GroundScore:
    """How the pixels of rendered frames are judged at probability one half.

    Args:
        data: frames with pictures of instance numbers.
        classifier: None judges by the horizon alone: all below it is ground.
        horizon_known: whether the frame's own horizon is used, or the middle of the picture.
    """
    hits = np.zeros((2, 2))
    for record in data.frames:
        rgb, truth = _read(record)
        horizon = _horizon_row(record) if horizon_known else (record.height_px - 1) / 2
        if classifier is None:
            found = np.broadcast_to(np.arange(record.height_px)[:, None] > horizon, truth.shape)
        else:
            found = ground_probability(rgb, horizon, classifier) >= 0.5
        hits += [[(found == f)[truth == t].sum() for f in (False, True)] for t in (False, True)]
    return GroundScore(
        n_frames=len(data.frames),
        accuracy=float(np.trace(hits) / hits.sum()),
        precision=float(hits[1, 1] / hits[:, 1].sum()),
        recall=float(hits[1, 1] / hits[1].sum()),
    )


def _read(record: FrameRecord) -> tuple[UInt8Array, BoolArray]:
    """The picture of a frame and which of its pixels show ground."""
    instances = read_instances(record)
    if instances is None:
        raise RescoreError(
            f"image {record.image_id}: expected a picture of instance numbers, got none; "
            "use a data set of `rescore synth`"
        )
    ground = [number for number, kind in record.instance_kinds.items() if kind in GROUND_KINDS]
    return read_rgb(record.left_path, record.width_px, record.height_px), np.isin(instances, ground)


def _horizon_row(record: FrameRecord) -> float:
    if record.camera is None or record.ground is None:
        raise RescoreError(
            f"image {record.image_id}: expected a camera with height_m, got none; use rendered scenes"
        )
    return record.ground.horizon_row_px(record.camera.left)


def _draw(
    record: FrameRecord, config: GroundTrainingConfig, rng: np.random.Generator
) -> tuple[Float32Array, BoolArray]:
    """Features and truth of cells of one changed copy of a frame."""
    rgb, truth = _read(record)
    rgb, truth, horizon = _cropped(rgb, truth, _horizon_row(record), rng)
    known = rng.random() < config.horizon_known_share
    changed = _recoloured(_shaded(rgb, rng), rng)
    features = ground_features(changed, horizon if known else None)
    rows, columns, count = features.shape
    share = cv2.resize(truth.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    chosen = rng.choice(rows * columns, min(config.cells_per_copy, rows * columns), replace=False)
    return features.reshape(-1, count)[chosen], share.ravel()[chosen] > 0.5


def _cropped(
    rgb: UInt8Array, truth: BoolArray, horizon: float, rng: np.random.Generator
) -> tuple[UInt8Array, BoolArray, float]:
    """A part of the picture, mirrored at random, with the row of its horizon.

    Wide and low parts look as the pictures of a car's camera do. The horizon stays near the middle, as level
    cameras have it.
    """
    height, width = truth.shape
    high = round(height * rng.uniform(0.5, 1.0))
    wide = round(width * rng.uniform(0.6, 1.0))
    top = int(np.clip(round(horizon - high * rng.uniform(0.35, 0.6)), 0, height - high))
    left = int(rng.integers(0, width - wide + 1))
    part = (slice(top, top + high), slice(left, left + wide))
    flip = slice(None, None, -1 if rng.random() < 0.5 else 1)
    return np.ascontiguousarray(rgb[part][:, flip]), truth[part][:, flip], horizon - top


def _shaded(rgb: UInt8Array, rng: np.random.Generator) -> UInt8Array:
    """The picture under up to three shadows or patches of sun, as trees and houses make them."""
    height, width = rgb.shape[:2]
    light = np.ones((height, width), np.float32)
    for _ in range(rng.integers(0, 4)):
        corners = rng.uniform(-0.2, 1.2, (int(rng.integers(3, 7)), 2)) * [width, height]
        cv2.fillConvexPoly(
            light, cv2.convexHull(corners.astype(np.int32)), float(np.exp(rng.uniform(-1.4, 0.8)))
        )
    soft = cv2.GaussianBlur(light, (0, 0), rng.uniform(0.5, 4.0))
    return np.asarray(np.clip(rgb * soft[..., None], 0, 255), np.uint8)


def _recoloured(rgb: UInt8Array, rng: np.random.Generator) -> UInt8Array:
    """The picture through another camera: gamma, contrast, gains, colourfulness, sharpness, noise."""
    x = (rgb.astype(np.float32) / np.float32(255)) ** np.float32(np.exp(rng.normal(0, 0.35)))
    grey = x.mean(axis=2, keepdims=True)
    x = grey + (x - grey) * np.float32(rng.uniform(0.2, 1.8))
    x *= np.exp(rng.normal(0, 0.12, 3)).astype(np.float32)
    middle = x.mean()
    x = middle * np.float32(np.exp(rng.normal(0, 0.2))) + (x - middle) * np.float32(
        np.exp(rng.normal(0.2, 0.4))
    )
    smooth = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.8, 5.0))
    x = smooth + (x - smooth) * np.float32(np.exp(rng.uniform(-3.0, 1.4)))
    x += rng.normal(0, rng.uniform(0, 0.06), x.shape).astype(np.float32)
    return np.asarray(np.clip(x * 255, 0, 255), np.uint8)
