"""What the experiment of section 5.2 found, as typed values, and the files that hold it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from recon.errors import Failure
from recon.localization.standing_box import StandingBox
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.grasping.choose import Estimate
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import Verdict, count_causes, wilson
from rescore.grasping.perception import METHOD_NAME, METHODS
from rescore.results.sweep_file import StudyPart

REPORTED_PLACEMENTS = 3
"""Placements of each of twenty cars in the report."""
REPORTED = {"3dp": 57, "single_plane": 6}
"""Trials of 60 in which the report's robot held the car, by method; the 57 are all but those of the fragile
racer."""


class BoxRow(StudyPart):
    """A box on the table in the ground frame."""

    xy_m: tuple[float, float]
    yaw_rad: float
    size_m: tuple[float, float, float]
    """Length, width and height."""
    width_known: bool = True

    @classmethod
    def of(cls, box: StandingBox, width_known: bool = True) -> "BoxRow":
        """The row of a box."""
        x, y = (float(v) for v in box.xy_m)
        length, width, height = (float(v) for v in box.size_m)
        return cls(
            xy_m=(x, y), yaw_rad=float(box.yaw_rad), size_m=(length, width, height), width_known=width_known
        )

    @property
    def box(self) -> StandingBox:
        """The box of the row."""
        return StandingBox(np.array(self.xy_m), self.yaw_rad, np.array(self.size_m))

    @property
    def estimate(self) -> Estimate:
        """The estimate of the row."""
        return Estimate(self.box, self.width_known)


class GraspRow(StudyPart):
    """One placement of one car, with what became of every method and hand."""

    car: str
    index: int
    """Number of the car."""
    placement: int
    """Number of the placement of this car."""
    filled_from_outside: bool = False
    """Whether the mesh of the car was not closed, or in very many pieces, and was filled from outside."""
    truth: BoxRow
    estimates: dict[str, BoxRow | Failure]
    """By method."""
    verdicts: dict[str, dict[str, Verdict]]
    """By method and hand."""

    def only(self, methods: Sequence[str]) -> "GraspRow":
        """The row of some of its methods, in this order."""
        return self.model_copy(
            update={
                "estimates": {m: self.estimates[m] for m in methods},
                "verdicts": {m: self.verdicts[m] for m in methods},
            }
        )


class GraspResult(StudyPart):
    """The content of grasp.json."""

    seed: int
    placements: int
    """Placements of each car."""
    cars: tuple[str, ...]
    rows: tuple[GraspRow, ...]

    def first(self, placements: int) -> "GraspResult":
        """The result of the first placements of each car alone."""
        rows = tuple(r for r in self.rows if r.placement < placements)
        return self.model_copy(update={"placements": min(placements, self.placements), "rows": rows})

    def verdicts(self, method: str, hand: str) -> list[Verdict]:
        """The verdicts on one method with one hand, in the order of the trials that have it."""
        return [row.verdicts[method][hand] for row in self.rows if method in row.verdicts]

    @property
    def filled_cars(self) -> list[str]:
        """Names of the cars whose meshes were filled from outside."""
        return list(dict.fromkeys(row.car for row in self.rows if row.filled_from_outside))


def write_grasps(path: Path, result: GraspResult) -> None:
    """Write grasp.json."""
    write_json(path, result.as_json())


def read_grasps(path: Path) -> GraspResult:
    """The results of a finished `rescore grasp`.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(GraspResult), "a finished `rescore grasp`")


def grasp_table(result: GraspResult, methods: Sequence[str] = METHODS) -> str:
    """A Markdown table with a row for each method and hand: held and gentle with their 95 % intervals, causes
    of failure; below it the cars whose meshes were filled from outside."""
    lines = [
        "| method | hand | held | gentle | held, 95 % | gentle, 95 % | failed for | report: held |",
        "|---|---|---:|---:|---:|---:|---|---:|",
    ]
    for method in methods:
        for hand in HANDS:
            reported = f"{REPORTED[method]} of 60" if method in REPORTED and hand == next(iter(HANDS)) else ""
            lines.append(
                _line(
                    [METHOD_NAME[method], HANDS[hand].name, *counted(result.verdicts(method, hand)), reported]
                )
            )
    if result.filled_cars:
        names = ", ".join(result.filled_cars)
        lines += ["", f"Meshes filled from outside, not closed or in very many pieces: {names}."]
    return "\n".join(lines) + "\n"


def counted(verdicts: Sequence[Verdict]) -> list[str]:
    """Cells of a table: how many of them held, gently held, the intervals of both, and causes of failure."""
    n, held = len(verdicts), sum(v.held for v in verdicts)
    gentle = sum(v.ending == "gentle" for v in verdicts)
    causes = ", ".join(f"{c.value} {k}" for c, k in count_causes(verdicts).items())
    return [
        f"{held} of {n}",
        f"{gentle} of {n}",
        *(_interval(k, n) for k in (held, gentle)),
        causes or "none",
    ]


def _interval(successes: int, trials: int) -> str:
    low, high = wilson(successes, trials)
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def by_car_table(result: GraspResult, hand: str) -> str:
    """A Markdown table with a row for each car: held and gently held placements by method, with one hand."""
    lines = [_line(["car", *(METHOD_NAME[m] for m in METHODS)]), "|---|" + "---:|" * len(METHODS)]
    for car in result.cars:
        rows = [r for r in result.rows if r.car == car]
        cells = [_pair([r.verdicts[m][hand] for r in rows if m in r.verdicts]) for m in METHODS]
        lines.append(_line([car, *cells]))
    return "\n".join(lines) + "\n"


def _pair(verdicts: Sequence[Verdict]) -> str:
    held, gentle = sum(v.held for v in verdicts), sum(v.ending == "gentle" for v in verdicts)
    return f"{held} / {gentle} of {len(verdicts)}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
