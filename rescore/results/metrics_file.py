"""The figures of a run as typed values, and the file metrics.json that holds them.

JSON has neither infinity nor NaN. A figure that is undefined or never reached is null. An ``Estimate`` tells
the two apart: where it is undefined its interval is null too, and an end of null is infinity, as is a value
of null with an interval.

Keys that files of older versions lack have a default here; nobody else needs to ask for them.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    SerializerFunctionWrapHandler,
    TypeAdapter,
    ValidationError,
    field_serializer,
    model_serializer,
)

from recon.errors import RescoreError
from rescore.files import read_json_object, refuse_unsafe_name, write_json
from rescore.formats.checked_json import first_difference, read_checked
from rescore.fusion.fuse import LearnedFusion
from rescore.fusion.weight_interval import WeightInterval
from rescore.metrics.curves import Summary, Ties
from rescore.metrics.reliability import Reliability

Ends = tuple[float | None, float | None]
"""Lower and upper end of an interval; None is infinity."""


def finite(value: float) -> float | None:
    """The figure as files hold it: None where it is undefined or never reached."""
    return value if math.isfinite(value) else None


def _by_level(summary: Summary) -> dict[str, float | None]:
    return {f"{level:g}": value for level, value in summary.fppi_at_recall.items()}


class MetricsPart(BaseModel):
    """A frozen part of metrics.json."""

    model_config = ConfigDict(frozen=True)


class Estimate(MetricsPart):
    """A figure with its interval over resampled images."""

    value: float | None
    """None is infinity where there is an interval, else undefined."""
    interval: Ends | None
    """None where the figure is undefined."""
    n_undefined: int
    """Resamples in which it is undefined."""
    n_infinite: int
    """Resamples in which it is infinite."""


class Reduction(Estimate):
    """False positives an image before rescoring over those after, above 1 where there are fewer, with both.

    Without false positives before and after the factor is 1, without any after infinite, before 0.
    """

    before: float | None = None
    """False positives an image before; None where the recall is never reached, or not known in old files."""
    after: float | None = None

    @model_serializer(mode="wrap")
    def _known_rates(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        unknown = {"before", "after"} - self.model_fields_set
        return {name: value for name, value in handler(self).items() if name not in unknown}

    @property
    def none_before(self) -> bool:
        """Whether there is no false positive before."""
        return self.before == 0

    @property
    def none_after(self) -> bool:
        """Whether there is no false positive after."""
        return self.after == 0


class Intervals(MetricsPart):
    """Intervals of the figures of a row."""

    auc: Ends | None
    average_precision: Ends | None
    fppi_at_recall: dict[str, Ends | None]
    """By recall, as "0.7"."""
    n_undefined: dict[str, int]
    """Resamples in which a figure is undefined, by its name or recall."""
    n_infinite: dict[str, int]
    """Resamples in which a recall is never reached, by recall."""


class TiedScores(MetricsPart):
    """Hits and false positives of equal score: average precision depends on the order of the file."""

    n_candidates: int
    average_precision: tuple[float | None, float | None]
    """With the hits of each score last, and first; None where no car is annotated."""

    @classmethod
    def of(cls, tied: Ties) -> Self:
        """What the file holds of it."""
        return cls(n_candidates=tied.n, average_precision=(finite(tied.lowest), finite(tied.highest)))


class Row(MetricsPart):
    """The figures of one detector in one mode."""

    detector: str
    mode: str
    w: float | None = None
    """Weight of eq. 7; None where it is not known."""
    auc: float | None
    """Area under the ROC over candidates."""
    average_precision: float | None
    recall_ceiling: float | None
    """Share of the cars that all candidates together find."""
    fppi_at_recall: dict[str, float | None]
    """False positives per image by recall, as "0.7"; None where it is never reached."""
    intervals: Intervals | None = None
    ties: TiedScores | None = None
    """None where no hit has the score of a false positive, or in old files."""

    @model_serializer(mode="wrap")
    def _known_ties(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        unknown = {"ties"} if self.ties is None else set()
        return {name: value for name, value in handler(self).items() if name not in unknown}

    @classmethod
    def of(
        cls,
        detector: str,
        mode: str,
        w: float | None,
        summary: Summary,
        intervals: Intervals | None,
        tied: Ties | None = None,
    ) -> Self:
        """The row of a match table's figures."""
        return cls(
            detector=detector,
            mode=mode,
            w=w,
            auc=finite(summary.auc),
            average_precision=finite(summary.average_precision),
            recall_ceiling=finite(summary.recall_ceiling),
            fppi_at_recall=_by_level(summary),
            intervals=intervals,
            ties=None if tied is None or not tied.n else TiedScores.of(tied),
        )


class ModeComparison(MetricsPart):
    """What one mode changes against another, the detector alone, paired over images."""

    detector: str
    mode: str
    against: str
    auc_difference: Estimate
    auc_p_value: float | None = None
    average_precision_difference: Estimate
    reduction: dict[str, Reduction]
    """How many times fewer false positives, by recall."""
    reduction_without_pictures: dict[str, Reduction] | None = None
    """How many times fewer, false alarms on pictures of cars left out; None where kinds are unknown."""
    n_on_pictures: int | None = None


class FusionRow(MetricsPart):
    """The figures of one way of fusing likelihood and depth."""

    detector: str
    mode: str
    rule: str
    auc: float | None
    average_precision: float | None
    recall_ceiling: float | None
    fppi_at_recall: dict[str, float | None]

    @classmethod
    def of(cls, detector: str, mode: str, rule: str, summary: Summary) -> Self:
        """The row of a match table's figures."""
        return cls(
            detector=detector,
            mode=mode,
            rule=rule,
            auc=finite(summary.auc),
            average_precision=finite(summary.average_precision),
            recall_ceiling=finite(summary.recall_ceiling),
            fppi_at_recall=_by_level(summary),
        )


class ReliabilityRow(MetricsPart):
    """Whether the scores of one detector in one mode are probabilities; a value a group of candidates."""

    detector: str
    mode: str
    brier_score: float
    calibration_error: float
    likelihood: tuple[float, ...]
    """Mean score of each group."""
    hit_rate: tuple[float, ...]
    low: tuple[float, ...]
    """Ends of the interval of 95 % of the hit rate."""
    high: tuple[float, ...]
    count: tuple[int, ...]
    """Candidates in each group."""

    @classmethod
    def of(cls, detector: str, mode: str, found: Reliability) -> Self:
        """The row of one detector in one mode."""
        return cls(
            detector=detector,
            mode=mode,
            brier_score=found.brier_score,
            calibration_error=found.calibration_error,
            likelihood=tuple(found.likelihood.tolist()),
            hit_rate=tuple(found.hit_rate.tolist()),
            low=tuple(found.low.tolist()),
            high=tuple(found.high.tolist()),
            count=tuple(found.count.tolist()),
        )


class BootstrapSettings(MetricsPart):
    """How the intervals were made."""

    n_resamples: int
    confidence: float
    seed: int


class DisparityErrors(MetricsPart):
    """Error of the measured disparity in some pixels; None where there is no truth."""

    n_pixels: float | None = None
    density: float | None = None
    """Share of the pixels that were measured."""
    end_point_error_px: float | None = None
    wrong_share: float | None = None
    """Share of all pixels that are wrong, holes filled."""
    wrong_share_measured: float | None = None
    """Share of the measured pixels that are wrong."""


class StereoStatistics(MetricsPart):
    """Error of the measured disparity of a data set; empty where it is not known."""

    wrong: str = ""
    """When a disparity counts as wrong."""
    sgbm: dict[str, Any] = {}
    splits: dict[str, dict[str, DisparityErrors]] = {}
    """By split and region."""


class TunedWeight(MetricsPart):
    """The choice of w for one detector in one mode."""

    w: float
    objective_name: str
    w_grid: tuple[float, ...]
    """Every w tried."""
    objective: tuple[float | None, ...]
    """The objective at each w; None where it is undefined or infinite."""
    n_images: int | None = None
    sentence: str = ""
    """What the data can tell of w."""
    uncertainty: WeightInterval | None = None
    learned: LearnedFusion | None = None


class DetectorTuning(TunedWeight):
    """The choice of w for eq. 6 as printed, or for the first mode there is, and that of every mode."""

    modes: dict[str, TunedWeight] = {}

    @classmethod
    def first_of(cls, modes: Mapping[str, TunedWeight]) -> Self:
        """The choices by mode, the first of them in front."""
        first = next(iter(modes.values()))
        return cls(**dict(first), modes=dict(modes))

    def of(self, mode: str) -> TunedWeight:
        """The choice in a mode; the first where this mode has none."""
        return self.modes.get(mode, self)


class DetectorDifficulty(MetricsPart):
    """What one detector alone makes of the cars that are seen well."""

    n_cars: int
    recall_ceiling: float | None
    fppi_at_70: float | None
    """False positives per image where 70 % of these cars are found."""
    share_by_kind: dict[str, float]
    """Share of those false positives by what they show, most first."""


class Precision3D(MetricsPart):
    """Average precisions at 40 recalls on the cars of one of KITTI's levels; None where there are too few.

    Each by the IoU from which a car is found, as "0.7".
    """

    level: str
    """"easy", "moderate" or "hard"; "all" for every car that is not ignored."""
    n_cars: int
    in_picture: dict[str, float | None]
    """Average precision of the boxes in the picture."""
    orientation: dict[str, float | None]
    """Average orientation similarity of the boxes in the picture."""
    from_above: dict[str, float | None]
    """Average precision of the footprints."""
    in_space: dict[str, float | None]
    """Average precision of the 3D boxes."""


class MeanMedian(MetricsPart):
    """An error over several boxes; None where there is none."""

    mean: float | None
    median: float | None


class BoxErrorFigures(MetricsPart):
    """Errors of the 3D boxes that find a car within some metres along the ground."""

    within_m: float
    n_cars: int
    n_found: int
    """Cars that are found."""
    translation_m: MeanMedian
    scale: MeanMedian
    orientation_rad: MeanMedian


class PoseFigures(MetricsPart):
    """How many cars that are found in the picture have a 3D box at the right place with the right heading."""

    whole: bool
    """Whether cars alone count that are neither hidden nor cut off."""
    distance_m: tuple[float, float | None]
    """From, to; None is any."""
    n_found: int
    """Cars that are found in the picture."""
    n_boxes: int
    """Cars among them whose detection has a 3D box."""
    correct_share: float | None
    """Share of ``n_found`` with the right pose."""
    median_translation_m: float | None
    """Median error of the right poses, as the next."""
    median_orientation_rad: float | None


class Boxes3DRow(MetricsPart):
    """What the 3D boxes of one detector are worth in the order of one mode."""

    detector: str
    mode: str
    n_boxes: int
    """Detections with a 3D box."""
    precision: tuple[Precision3D, ...]
    errors: BoxErrorFigures
    poses: tuple[PoseFigures, ...]


class Metrics(MetricsPart):
    """All figures of a run: the content of metrics.json."""

    n_images: int
    n_cars: int
    n_ignored: int = 0
    """Annotated boxes and regions that count neither for nor against."""
    n_candidates: int
    rows: tuple[Row, ...]
    """One for each detector and mode, each detector alone first."""
    comparisons: tuple[ModeComparison, ...] = ()
    fusion: tuple[FusionRow, ...] = ()
    reliability: tuple[ReliabilityRow, ...] = ()
    bootstrap: BootstrapSettings | None = None
    stereo: StereoStatistics = StereoStatistics()
    reasons: dict[str, dict[str, int]] = {}
    """Number of candidates by detector and status."""
    tuning: dict[str, DetectorTuning] = {}
    """By detector."""
    difficulty: dict[str, DetectorDifficulty] = {}
    """By detector."""
    boxes3d: tuple[Boxes3DRow, ...] = ()
    """One for each detector with 3D boxes and mode, where the data set has true ones."""

    @field_serializer("stereo")
    def _known_stereo(self, stereo: StereoStatistics) -> dict[str, Any]:
        return stereo.model_dump(exclude_unset=True)

    @property
    def seed(self) -> int:
        """The seed that drew the resamples; 0 where it is not known."""
        return 0 if self.bootstrap is None else self.bootstrap.seed

    @property
    def detectors(self) -> tuple[str, ...]:
        """Detectors in the order of the rows."""
        return tuple(dict.fromkeys(row.detector for row in self.rows))

    @property
    def modes(self) -> tuple[str, ...]:
        """Ways of scoring in the order of the rows; "detector" is the detector alone."""
        return tuple(dict.fromkeys(row.mode for row in self.rows))

    def as_json(self) -> dict[str, Any]:
        """The figures as JSON values, keys in the order of the file."""
        return self.model_dump(exclude={name for name in ("n_ignored", "boxes3d") if not getattr(self, name)})


def write_metrics(path: Path, metrics: Metrics) -> None:
    """Write metrics.json."""
    write_json(path, metrics.as_json())


def read_metrics(path: Path) -> Metrics:
    """The figures in metrics.json.

    Raises:
        RescoreError: no such file, not JSON, or a figure is missing or of another kind.
    """
    value = read_json_object(path, "the results of a run")
    lacking = [
        name for name, field in Metrics.model_fields.items() if field.is_required() and name not in value
    ]
    if lacking:
        raise RescoreError(f"{path}: expected key {lacking[0]!r}, found none; run `rescore evaluate` again")
    try:
        metrics = Metrics.model_validate(value)
    except ValidationError as error:
        raise RescoreError(
            f"{path}: expected the figures of a run, got {first_difference(error)}; "
            "run `rescore evaluate` again"
        ) from error
    for detector in metrics.detectors:
        refuse_unsafe_name(path, "the name of a detector", detector)
    return metrics


def read_stereo_statistics(path: Path) -> StereoStatistics:
    """The errors of the measured disparity that a rendered data set was written with.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(StereoStatistics), "stereo statistics")
