"""How well objects were localised: overlap, centroid, orientation, by method and object (section 5.1)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from recon.errors import Failure
from recon.localization.single_plane import UprightSurface
from recon.localization.standing_box import StandingBox, angle_between, volume_overlap
from rescore.results.sweep_file import StudyPart

METHODS = ("3dp", "3dp_report", "single_plane")
METHOD_NAME = {
    "3dp": "3DP, joint fit",
    "3dp_report": "3DP, the report's construction",
    "single_plane": "single plane",
}
REPORTED = {
    "3dp": (0.775, 8.75, 2.34),
    "single_plane": (None, 73.95, 16.26),
}
"""Overlap, centroid error in mm and orientation error in degrees of the report's table."""


@dataclass(frozen=True)
class Score:
    """Errors of one estimate."""

    overlap: float | None
    """Volume of the intersection with the truth over the volume of the union; None for a surface, which has
    no volume."""
    centroid_mm: float
    orientation_deg: float
    """Error of the direction in degrees, in [0, 180]; in [0, 90] for a surface, which has no front."""


def score(estimate: StandingBox | UprightSurface | Failure, truth: StandingBox) -> Score | Failure:
    """The errors of an estimate; a failure stays one."""
    if isinstance(estimate, Failure):
        return estimate
    period = 2 * np.pi if isinstance(estimate, StandingBox) else np.pi
    overlap = volume_overlap(estimate, truth) if isinstance(estimate, StandingBox) else None
    distance = float(np.linalg.norm(estimate.centroid_m - truth.centroid_m))
    turned = float(np.rad2deg(angle_between(estimate.yaw_rad, truth.yaw_rad, period)))
    return Score(overlap, 1000 * distance, turned)


class MeanErrors(StudyPart):
    """Means over the estimates that there are; None where there are none."""

    overlap: float | None
    centroid_mm: float | None
    orientation_deg: float | None
    n: int
    """Estimates."""
    lost: int


def summary(scores: Sequence[Score | Failure]) -> MeanErrors:
    """Means over the estimates that there are, their number, and how many were lost."""
    found = [s for s in scores if isinstance(s, Score)]
    overlaps = [s.overlap for s in found if s.overlap is not None]
    return MeanErrors(
        overlap=float(np.mean(overlaps)) if overlaps else None,
        centroid_mm=float(np.mean([s.centroid_mm for s in found])) if found else None,
        orientation_deg=float(np.mean([s.orientation_deg for s in found])) if found else None,
        n=len(found),
        lost=len(scores) - len(found),
    )


def markdown_table(by_car: Mapping[str, Mapping[str, Sequence[Score | Failure]]]) -> str:
    """A table with a row a car and the averages, from scores by car and method."""
    head = ["car", "placements"]
    for method in METHODS:
        columns = ("centroid mm", "orientation deg")
        head += [
            f"{METHOD_NAME[method]}: {c}"
            for c in (() if method == "single_plane" else ("overlap %",)) + columns
        ]
    lines = [_line(head), _line(["---", *["---:"] * (len(head) - 1)])]
    for car in sorted(by_car):
        lines.append(_line(_cells(car, by_car[car])))
    everything = {m: [s for car in by_car.values() for s in car[m]] for m in METHODS}
    lines.append(_line(_cells("**all**", everything)))
    return "\n".join(lines) + "\n"


def _cells(name: str, scores: Mapping[str, Sequence[Score | Failure]]) -> list[str]:
    cells = [name, str(len(scores[METHODS[0]]))]
    for method in METHODS:
        mean = summary(scores[method])
        lost = f" ({mean.lost} lost)" if mean.lost else ""
        if method != "single_plane":
            cells.append("" if mean.overlap is None else f"{100 * mean.overlap:.1f}{lost}")
        cells += ["" if v is None else f"{v:.2f}" for v in (mean.centroid_mm, mean.orientation_deg)]
    return cells


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
