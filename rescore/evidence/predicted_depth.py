"""Depth that another system predicts, such as a monocular network, in place of the class model's.

The class model predicts a car in every box, and D asks whether one stands there. A network predicts what it
sees, car or not, so D asks whether it saw right: a hedge that it saw as a hedge has a low D too, and what it
rules out are things that look nearer, farther or rounder than they are.

What its numbers leave open decides what they can be compared with:

- relative depth, ``s depth + t`` with unknown s and t: eq. 6 finds both, as it does for the class model;
- relative inverse depth, ``s / depth + t`` (MiDaS, Depth Anything): it cannot be turned to depth without t,
  so eq. 6 is solved in inverse depth, and measured depth is inverted for it;
- metric depth, and metric inverse depth, which is inverted: depth in metres, as the class model predicts it.
  Relief as a share of the distance and the ratio of measured to predicted depth have a meaning for these
  alone, so the modes past eq. 6 take no others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.depth_map import DepthMap
from recon.errors import Failure, Reason, RescoreError
from recon.reconstruction.reconstruct import check_extent
from rescore.evidence.candidates import OK, CandidateTable
from rescore.evidence.cues import CueConfig, cue_column
from rescore.evidence.registration import LEARNED, Registration

MIN_DOUBTED = 5
"""Smallest number of candidates with which a prediction can be doubted."""
UNLIKELY_RATIO = 2.0
"""A metric prediction that is off by more than this in the middle is doubted."""


class PredictedAs(StrEnum):
    """What grows with the predicted numbers."""

    DEPTH = "depth"
    """The numbers are depth along the optical axis."""
    INVERSE = "inverse"
    """The numbers are 1 / depth, which grows as disparity does."""


class PredictedUnit(StrEnum):
    """What is known of their scale."""

    RELATIVE = "relative"
    """Nothing is known of the scale: scale and offset are free, and may differ from picture to picture."""
    METRIC = "metric"
    """The numbers are metres, or 1 / metres."""


@dataclass(frozen=True, eq=False)
class PredictedDepth:
    """Depth of a whole picture as another system predicts it.

    Raises:
        RescoreError: another shape or type, or no such kind of prediction.
    """

    values: NDArray[np.floating] | NDArray[np.integer]
    """Predicted values, shape (h, w) of the left picture. NaN and infinity: none. Relative numbers may be 0
    or less, for metric ones that means none too."""
    predicted_as: PredictedAs | str
    """"depth" or "inverse"."""
    unit: PredictedUnit | str = PredictedUnit.RELATIVE
    """"relative" or "metric"."""
    mask: BoolArray | NDArray[np.integer] | None = None
    """What is an object, shape (h, w): not 0 there. Where it numbers objects, a box is taken to show the one
    that has most pixels in it. None: all of the box counts, with what is behind the object."""

    def __post_init__(self) -> None:
        _check_choice("predicted_as", self.predicted_as, PredictedAs)
        _check_choice("unit", self.unit, PredictedUnit)
        values, mask = self.values, self.mask
        allowed = (np.floating,) if self.unit == PredictedUnit.METRIC else (np.floating, np.integer)
        if not (_is_map(values) and any(np.issubdtype(values.dtype, kind) for kind in allowed)):
            raise RescoreError(
                f"predicted depth: expected an array (h, w) of {self.unit} numbers"
                f"{', floats' if len(allowed) == 1 else ''}, got {kind_of(values)}; convert the prediction"
            )
        if mask is None:
            return
        if not (_is_map(mask) and (mask.dtype == np.bool_ or np.issubdtype(mask.dtype, np.integer))):
            raise RescoreError(
                f"mask: expected an array (h, w) of whole numbers or truth values, got {kind_of(mask)}; "
                "convert the mask"
            )
        if mask.shape != values.shape:
            raise RescoreError(
                f"mask: expected shape {values.shape} as the prediction has, got {mask.shape}; "
                "take both from one picture"
            )

    @property
    def inverse(self) -> bool:
        """Whether ``depth_values`` are inverse depth up to scale and offset: eq. 6 is solved there."""
        return self.predicted_as == PredictedAs.INVERSE and self.unit == PredictedUnit.RELATIVE

    def depth_values(self) -> Float32Array:
        """Zi of eq. 6, shape (h, w), NaN where there is none: metres where metric, else as predicted."""
        values = np.asarray(self.values, np.float32)
        known = np.isfinite(values)
        if self.unit == PredictedUnit.METRIC:
            known &= values > 0
            if self.predicted_as == PredictedAs.INVERSE:
                values = np.reciprocal(np.where(known, values, np.float32(1)))
        return np.where(known, values, np.float32(np.nan))


@dataclass(frozen=True, eq=False)
class BoxPrediction:
    """What another system predicts in the box of one candidate; it has neither outline nor parts."""

    depth: DepthMap
    """Zi of eq. 6: NaN where nothing is predicted, or the mask has another object or none."""
    inverse: bool
    """Whether Zi is inverse depth up to scale and offset."""
    metric: bool
    """Whether Zi is depth in metres."""


def cut_to_boxes(
    predicted: PredictedDepth, xyxy_px: FloatArray, picture_px: tuple[int, int], min_inside: float
) -> tuple[BoxPrediction | Failure, ...]:
    """What is predicted in each box (n, 4) of a picture, or why there is nothing.

    Args:
        predicted: of the whole picture.
        xyxy_px: pixel edges.
        picture_px: width and height of the picture.
        min_inside: smallest share of a box that must lie in the picture.

    Raises:
        RescoreError: the prediction is of another size.
    """
    width, height = picture_px
    if predicted.values.shape != (height, width):
        raise RescoreError(
            f"predicted depth: expected shape {(height, width)} as the left picture has, got "
            f"{predicted.values.shape}; scale it to the picture"
        )
    values = predicted.depth_values()
    return tuple(
        check_extent(box, picture_px, min_inside) or _cut(predicted, values, box, picture_px)
        for box in xyxy_px
    )


def _cut(
    predicted: PredictedDepth, values: Float32Array, box: FloatArray, picture_px: tuple[int, int]
) -> BoxPrediction | Failure:
    limits = [*picture_px, *picture_px]
    # the pixels whose middle lies in the box, as ``predicted_region`` has it
    x0, y0, x1, y1 = np.clip(np.ceil(box - 0.5), 0, limits).astype(int).tolist()
    window = (slice(y0, y1), slice(x0, x1))
    depth = values[window].copy()
    if predicted.mask is not None:
        depth[~_most_frequent_object(predicted.mask[window])] = np.nan
    if not np.isfinite(depth).any():
        without = " on an object of the mask" if predicted.mask is not None else ""
        return Failure(Reason.NO_PREDICTION, f"predicted depth in the box{without} expected, got none")
    return BoxPrediction(DepthMap(x0, y0, depth), predicted.inverse, predicted.unit == PredictedUnit.METRIC)


def _most_frequent_object(numbers: NDArray[Any]) -> BoolArray:
    """Pixels of the object with the most pixels, shape of ``numbers``; none where there is no object."""
    found, counts = np.unique(numbers[numbers != 0], return_counts=True)
    if not len(found):
        return np.zeros(numbers.shape, np.bool_)
    return np.asarray(numbers == found[np.argmax(counts)])


def another_system(predicted_as: PredictedAs | str, unit: PredictedUnit | str) -> str:
    """Whose depth it is, in words; metric inverse depth is used as metric depth."""
    kind = PredictedAs.DEPTH if unit == PredictedUnit.METRIC else predicted_as
    return f"another system ({unit} {'inverse depth' if kind == PredictedAs.INVERSE else 'depth'})"


def check_mode(unit: PredictedUnit | str, mode: Registration) -> None:
    """Raises RescoreError where a mode cannot use predictions of a unit."""
    if mode in LEARNED and unit != PredictedUnit.METRIC:
        raise RescoreError(
            f"registration {mode}: expected metric predictions, got {unit} ones, whose scale and offset are "
            "free; use registration paper, or predictions in metres"
        )


def prediction_doubts(table: CandidateTable) -> tuple[str, ...]:
    """What of compared predictions is so unlikely that they may be of another kind than said; sentences."""
    ok = table.status == OK
    found = []
    rising = table.scale[ok] > 0
    if len(rising) >= MIN_DOUBTED and rising.mean() < 0.5:
        found.append(
            f"{np.mean(~rising):.0%} of the predictions in boxes fall where measured depth rises; "
            "check whether they are depth or inverse depth"
        )
    middle = float(np.median(logarithms)) if len(logarithms := _ratios(table)) else 0.0
    if abs(middle) > np.log(UNLIKELY_RATIO):
        found.append(
            f"for half of the boxes measured depth is {'larger' if middle > 0 else 'smaller'} than the "
            f"predicted depth by a factor of {_factor(table, middle):g} or more; check their unit and "
            "factor"
        )
    return tuple(found)


def _factor(table: CandidateTable, middle: float) -> float:
    """The factor of a median logarithm of depth ratios, in two digits.

    Logarithms are clipped, so beyond that the slope of measured over predicted depth tells it.
    """
    slope = table.scale * table.stereo_span
    known = np.log(slope[(table.status == OK) & (slope > 0)])
    beyond = float(np.median(known)) if len(known) else 0.0
    clipped = abs(middle) >= CueConfig().depth_ratio_limit
    logarithm = beyond if clipped and beyond * middle > middle**2 else middle
    return float(f"{np.exp(abs(logarithm)):.2g}")


def _ratios(table: CandidateTable) -> FloatArray:
    logarithms = table.cues[:, cue_column("depth_ratio")]
    known = logarithms[np.isfinite(logarithms)]
    return known if len(known) >= MIN_DOUBTED else known[:0]


def _is_map(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.size > 0


def _check_choice(name: str, value: Any, kinds: type[StrEnum]) -> None:
    choices: Sequence[str] = list(kinds)
    if value not in choices:
        raise RescoreError(
            f"{name}: expected {' or '.join(choices)}, got {value!r}; say what the numbers are"
        )


def kind_of(value: Any) -> str:
    """What came, for an error: shape and type of an array, the type of anything else."""
    if isinstance(value, np.ndarray):
        return f"shape {value.shape} of {value.dtype}"
    return type(value).__name__
