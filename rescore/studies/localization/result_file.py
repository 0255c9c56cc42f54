"""What a study of localization found, as typed values, and the file localization.json that holds it."""

from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter

from recon.errors import Failure
from recon.localization.heading import NoseOdds
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.results.sweep_file import StudyPart
from rescore.studies.localization.scores import METHODS, REPORTED, MeanErrors, Score, summary

ORIENTATION_PERIOD_DEG = {"3dp": 360, "3dp_report": 360, "single_plane": 180}


class TablePose(StudyPart):
    """Where a car stands on the table."""

    x_mm: float
    y_mm: float
    yaw_deg: float


class Nose(StudyPart):
    """How sure the joint fit is which end is the front."""

    probability: float
    log_odds: dict[str, float]
    """By cue; they add up to the log odds of the nose."""

    @classmethod
    def of(cls, odds: NoseOdds) -> "Nose":
        """What the file holds of the odds."""
        return cls(probability=odds.probability, log_odds=dict(odds.cues))


class ScoredPlacement(StudyPart):
    """One car on the table, with the errors of every method."""

    car: str
    pose: TablePose
    methods: dict[str, Score | Failure]
    """By method: its errors, or why there is no estimate."""
    nose: Nose | None = None
    """How sure the joint fit is of it; None where there is no fit, or front and rear were not learned."""
    outside: bool | None = None
    """Whether the joint fit takes the car for a shape outside what was learned; None where it is lost."""


class ReportedErrors(StudyPart):
    """Errors that the report gives for a method."""

    overlap: float | None
    centroid_mm: float
    orientation_deg: float


class LocalizationResult(StudyPart):
    """The content of localization.json."""

    methods: dict[str, MeanErrors]
    """Means by method."""
    report: dict[str, ReportedErrors]
    """Figures of the report by method."""
    orientation_period_deg: dict[str, int]
    """By method: after how many degrees an orientation is the same."""
    placements: tuple[ScoredPlacement, ...]


def localization_result(placements: Sequence[ScoredPlacement]) -> LocalizationResult:
    """The placements with the means of every method beside the figures of the report."""
    return LocalizationResult(
        methods={m: summary([p.methods[m] for p in placements]) for m in METHODS},
        report={
            m: ReportedErrors(overlap=overlap, centroid_mm=centroid, orientation_deg=orientation)
            for m, (overlap, centroid, orientation) in REPORTED.items()
        },
        orientation_period_deg=ORIENTATION_PERIOD_DEG,
        placements=tuple(placements),
    )


def scores_by_car(placements: Sequence[ScoredPlacement]) -> dict[str, dict[str, list[Score | Failure]]]:
    """The results of every car by method, cars in the order in which they come."""
    found: dict[str, dict[str, list[Score | Failure]]] = {}
    for placement in placements:
        own = found.setdefault(placement.car, {m: [] for m in METHODS})
        for method in METHODS:
            own[method].append(placement.methods[method])
    return found


def outside_remark(placements: Sequence[ScoredPlacement]) -> str:
    """How many cars the joint fit takes for shapes outside what was learned, and how well it did on both."""
    marked = [p for p in placements if p.outside]
    others = [p for p in placements if p.outside is False]
    text = f"The joint fit takes {len(marked)} of {len(placements)} for shapes outside what was learned"
    means = [summary([p.methods["3dp"] for p in rows]).overlap for rows in (marked, others)]
    named = [
        f"overlap of {which} {100 * mean:.1f} %"
        for which, mean in zip(("these", "the others"), means, strict=True)
        if mean is not None
    ]
    return f"{text}: {', '.join(named)}." if named else f"{text}."


def write_localization(path: Path, result: LocalizationResult) -> None:
    """Write localization.json."""
    write_json(path, result.as_json())


def read_localization(path: Path) -> LocalizationResult:
    """The results of a finished `rescore localize`.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(LocalizationResult), "a finished `rescore localize`")
