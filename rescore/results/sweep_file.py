"""What a sweep over a spoilt input found, as typed values, and the file sweep.json that holds it.

The report of a run shows a sweep, so that the file is known here and not with the study that makes it
(``rescore.studies.sweep``).
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter

from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.metrics.bootstrap import Interval


def _number(value: Any) -> Any:
    return math.nan if value is None else value


def _json_number(value: float) -> float | str | None:
    return value if math.isfinite(value) else "inf" if math.isinf(value) else None


StudyNumber = Annotated[float, BeforeValidator(_number), PlainSerializer(_json_number)]
"""A number that may be infinite or NaN; in files "inf" and null."""


class StudyPart(BaseModel):
    """A frozen part of the file of a study."""

    model_config = ConfigDict(frozen=True)

    def as_json(self) -> dict[str, Any]:
        """What the file holds of it, as JSON values."""
        return self.model_dump(mode="json")


class SweptInterval(StudyPart):
    """A figure with its interval over resampled images; NaN where it is undefined."""

    value: StudyNumber
    low: StudyNumber
    high: StudyNumber
    n_undefined: int
    """Resamples in which it is undefined."""
    n_infinite: int
    """Resamples in which it is infinite."""

    @classmethod
    def of(cls, i: Interval) -> "SweptInterval":
        """The figure of a bootstrap."""
        return cls(value=i.value, low=i.low, high=i.high, n_undefined=i.n_undefined, n_infinite=i.n_infinite)


def swept_levels(figures: Mapping[float, Interval]) -> dict[str, SweptInterval]:
    """Figures of a bootstrap by their level, which files write as "0.7"."""
    return {f"{level:g}": SweptInterval.of(figure) for level, figure in figures.items()}


class SweepFigures(StudyPart):
    """One mode at one level of one dial."""

    fppi: SweptInterval
    """False positives per image where 70 % of all cars are found."""
    auc: SweptInterval
    """Area under the candidate ROC."""
    reduction: SweptInterval | None
    """How many times fewer false positives than the detector alone; None for the detector itself."""
    with_evidence: float
    """Share of the candidates with depth evidence."""
    significant_loss: bool
    """Whether depth makes significantly more false positives."""


class SweepPoint(StudyPart):
    """One level of a dial."""

    level: int | float
    """As the dial has it: whole numbers stay whole in the file."""
    figures: dict[str, SweepFigures]
    """By mode."""


class SweptDial(StudyPart):
    """All levels of one dial."""

    what: str
    """The quantity that is turned, with its unit."""
    points: tuple[SweepPoint, ...]


class VisibilityGroup(StudyPart):
    """The figures on the cars that are seen to some share."""

    visible: tuple[float, float]
    """From, to."""
    n_cars: int
    figures: dict[str, SweepFigures]
    """By mode."""


class SweepResult(StudyPart):
    """The content of sweep.json."""

    detector: str
    n_images: int
    dials: dict[str, SweptDial]
    visibility: tuple[VisibilityGroup, ...] = ()


def write_sweep(path: Path, sweep: SweepResult) -> None:
    """Write sweep.json."""
    write_json(path, sweep.as_json())


def read_sweep(path: Path) -> SweepResult:
    """The sweep in a file.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(SweepResult), "a sweep")
