"""Platt scaling: from raw detector scores to likelihoods l_i in [0, 1]."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.boxes import iou_matrix, paired_overlap
from recon.errors import RescoreError
from rescore.data.frames import Truth
from rescore.detectors.base import Detections
from rescore.files import read_json, write_json

MIN_IOU = 0.5
"""Overlap from which a detection is the car."""


@dataclass(frozen=True)
class PlattScaling:
    """l = 1 / (1 + exp(a score + b)), with a < 0: a better score is a higher likelihood."""

    a: float
    b: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.a) and np.isfinite(self.b) and self.a < 0):
            raise RescoreError(
                f"calibration: expected a finite slope a < 0 (better scores are likelier), got a = {self.a}, "
                f"b = {self.b}; the detector is no better than chance, train it on more frames"
            )

    def likelihood(self, score: FloatArray) -> FloatArray:
        """Likelihoods in [0, 1] of raw scores, same shape."""
        from scipy.special import expit  # noqa: PLC0415 (a third of a second)

        return np.asarray(expit(-(self.a * np.asarray(score, dtype=float) + self.b)), dtype=float)


def fit_platt(score: FloatArray, is_car: BoolArray) -> PlattScaling:
    """The scaling fitted to labelled scores (n,), with Platt's smoothed targets.

    scikit-learn fits it: maximum likelihood for targets (n+ + 1)/(n+ + 2) and 1/(n- + 2) (Platt 1999).

    Raises:
        RescoreError: scores are not finite, all candidates have one label, or better scores are not likelier.
    """
    score, is_car = np.asarray(score, dtype=float), np.asarray(is_car, dtype=bool)
    if score.shape != is_car.shape or score.ndim != 1 or not np.isfinite(score).all():
        raise RescoreError(
            f"calibration: expected as many finite scores as labels, got {score.shape} and {is_car.shape}; "
            "mend the detections"
        )
    n_cars = int(is_car.sum())
    if not 0 < n_cars < len(score):
        raise RescoreError(
            f"calibration: expected candidates that are cars and some that are not, got {n_cars} cars of "
            f"{len(score)}; add frames to the calibration split"
        )
    # a second to import, which fitting alone needs
    from sklearn.calibration import CalibratedClassifierCV  # noqa: PLC0415
    from sklearn.frozen import FrozenEstimator  # noqa: PLC0415

    from rescore.detectors.score_itself import ScoreItself  # noqa: PLC0415

    frozen = FrozenEstimator(ScoreItself().fit(score[:, None], is_car))
    # one fold that holds everything: the estimator is frozen, there is nothing to hold out for
    everything = np.arange(len(score))
    fold = [(everything, everything)]
    fitted = CalibratedClassifierCV(frozen, method="sigmoid", cv=fold, ensemble=False).fit(
        score[:, None], is_car
    )
    sigmoid = fitted.calibrated_classifiers_[0].calibrators[0]
    return PlattScaling(float(sigmoid.a_), float(sigmoid.b_))


def label_candidates(found: Detections, truth: Truth) -> tuple[BoolArray, BoolArray]:
    """For each detection (n,): is it a car, and does it count for calibration.

    A detection is a car when it overlaps an annotated car by an IoU of at least 0.5, whether or not another
    one has found that car too. One that is no car and overlaps an ignored one so far, or lies in it by half
    of its own area, does not count.
    """
    car = iou_matrix(found.xyxy_px, truth.xyxy_px[~truth.ignore])
    is_car = np.asarray((car >= MIN_IOU).any(axis=1))
    regions = truth.xyxy_px[truth.ignore]
    overlap, of_own_area = paired_overlap(found.xyxy_px[:, None], regions[None])
    ignored = np.asarray(((overlap >= MIN_IOU) | (of_own_area >= 0.5)).any(axis=1))
    return is_car, is_car | ~ignored


def save_scaling(path: Path, scaling: PlattScaling) -> None:
    """Write Platt scaling as JSON."""
    write_json(path, {"format": "platt-scaling 1", **asdict(scaling)})


def load_scaling(path: Path) -> PlattScaling:
    """Read Platt scaling.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    value = read_json(path, "Platt scaling")
    numbers = [value.get(k) for k in ("a", "b")] if isinstance(value, dict) else [None]
    if not all(isinstance(v, float) for v in numbers):
        raise RescoreError(f"{path}: expected Platt scaling with numbers a and b, got {numbers}; train again")
    return PlattScaling(value["a"], value["b"])
