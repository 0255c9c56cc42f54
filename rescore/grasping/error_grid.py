"""The accuracy that a grasp needs: success against errors of the estimate, one kind at a time, by hand."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from recon.arrays import FloatArray
from recon.localization.standing_box import StandingBox, turn
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.files import write_json
from rescore.formats.checked_json import read_checked
from rescore.grasping.cars import TableCar, experiment_cars, solid_of
from rescore.grasping.choose import Estimate
from rescore.grasping.hands import HANDS
from rescore.grasping.judge import Verdict, wilson
from rescore.grasping.scene import MOUNT, require_robot
from rescore.grasping.trial import REACH_M, grasp_and_judge
from rescore.parallel import track
from rescore.results.sweep_file import StudyPart

LEVELS: dict[str, tuple[float, ...]] = {
    "lateral": (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0),
    "lengthwise": (10.0, 20.0, 40.0, 60.0, 80.0),
    "height": (-30.0, -15.0, 15.0, 30.0),
    "heading": (5.0, 10.0, 15.0, 20.0, 30.0, 45.0),
}
"""Errors by kind: millimetres, of the heading degrees. The others of an estimate are none."""
KIND_NAME = {
    "lateral": "across the car, mm",
    "lengthwise": "along the car, mm",
    "height": "of the height, mm",
    "heading": "of the heading, degrees",
}
_SMALLEST_M = 0.005


class GridPoint(StudyPart):
    """One error with one hand."""

    kind: str
    level: float
    """Millimetres, of the heading degrees."""
    hand: str
    trials: int
    held: int
    gentle: int


class ErrorGrid(StudyPart):
    """The content of errors.json."""

    seed: int
    points: tuple[GridPoint, ...]

    def points_of(self, kind: str, hand: str) -> tuple[GridPoint, ...]:
        """The points of one kind of error with one hand, rising, with that of no error."""
        none = [p for p in self.points if p.kind == "lateral" and p.level == 0.0 and p.hand == hand]
        own = [p for p in self.points if p.kind == kind and p.hand == hand and p not in none]
        return tuple(sorted([*none, *own], key=lambda p: p.level))


def error_grid(placements: int, seed: int, jobs: Workers) -> ErrorGrid:
    """The grid, on cars that are not those of the experiment.

    Args:
        placements: placements of each of eight cars, at each error.
        seed: of every random choice.
        jobs: points at a time.

    Raises:
        RescoreError: the packages of the robot are not installed.
    """
    require_robot()
    cars = experiment_cars(8, "validation")
    wanted = [(k, level, h) for k, levels in LEVELS.items() for level in levels for h in HANDS]
    points = map_frames(_point, wanted, (cars, placements, seed), jobs)
    return ErrorGrid(seed=seed, points=tuple(track(points, "errors", len(wanted))))


def _point(wanted: tuple[str, float, str], shared: tuple[Sequence[TableCar], int, int]) -> GridPoint:
    (kind, level, hand), (cars, placements, seed) = wanted, shared
    verdicts = list(_verdicts(cars, kind, level, hand, placements, seed))
    return GridPoint(
        kind=kind,
        level=level,
        hand=hand,
        trials=len(verdicts),
        held=sum(v.held for v in verdicts),
        gentle=sum(v.ending == "gentle" for v in verdicts),
    )


def _verdicts(
    cars: Sequence[TableCar], kind: str, level: float, hand: str, placements: int, seed: int
) -> Iterator[Verdict]:
    for i, car in enumerate(cars):
        for k in range(placements):
            # the same places for every error and hand
            rng = np.random.default_rng([seed, i, k])
            truth = _anywhere(np.array(car.size_m), rng)
            sign = 1.0 if kind == "height" or rng.random() < 0.5 else -1.0
            estimate = with_error(truth, kind, sign * level)
            yield grasp_and_judge(estimate, HANDS[hand], solid_of(car), truth, seed)


def _anywhere(size_m: FloatArray, rng: np.random.Generator) -> StandingBox:
    """A place within reach, well away from its ends, so that an error does not leave it."""
    distance, angle = rng.uniform(REACH_M[0] + 0.08, REACH_M[1] - 0.08), rng.uniform(-0.7, 0.7)
    direction = MOUNT.yaw_rad + angle
    place = np.array(MOUNT.xy_m) + distance * np.array([np.cos(direction), np.sin(direction)])
    return StandingBox(place, float(rng.uniform(-np.pi, np.pi)), size_m)


def with_error(truth: StandingBox, kind: str, level: float) -> Estimate:
    """The true box with an error of one kind: millimetres, of the heading degrees."""
    metres = level / 1000
    size = truth.size_m.copy()
    shift = {"lengthwise": (metres, 0.0), "lateral": (0.0, metres)}.get(kind, (0.0, 0.0))
    if kind == "height":
        size[2] = max(_SMALLEST_M, size[2] + metres)
    yaw = truth.yaw_rad + (np.deg2rad(level) if kind == "heading" else 0.0)
    return Estimate(StandingBox(truth.xy_m + turn(truth.yaw_rad) @ shift, float(yaw), size))


def error_table(grid: ErrorGrid) -> str:
    """A Markdown table with a row for each error: shares held and gently held with intervals, by hand."""
    head = ["error", "level", *(f"{HANDS[h].name}: {c}" for h in HANDS for c in ("held", "gentle"))]
    lines = ["| " + " | ".join(head) + " |", "|---|---:|" + "---:|" * (2 * len(HANDS))]
    for kind in LEVELS:
        by_hand = [grid.points_of(kind, h) for h in HANDS]
        for points in zip(*by_hand, strict=True):
            cells = [c for p in points for c in (_share(p.held, p.trials), _share(p.gentle, p.trials))]
            lines.append(f"| {KIND_NAME[kind]} | {points[0].level:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _share(n: int, trials: int) -> str:
    low, high = wilson(n, trials)
    return f"{100 * n / trials:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def write_errors(path: Path, grid: ErrorGrid) -> None:
    """Write errors.json."""
    write_json(path, grid.as_json())


def read_errors(path: Path) -> ErrorGrid:
    """The grid in a file.

    Raises:
        RescoreError: no such file, or something else in it.
    """
    return read_checked(path, TypeAdapter(ErrorGrid), "a finished `rescore grasp-errors`")
