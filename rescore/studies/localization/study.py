"""The study of section 5.1: cars placed on a table at random, localised by every method, counted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import SCALE, SEEN_FROM, Placement, photograph
from recon.arrays import FloatArray, UInt8Array
from recon.camera import GroundedCamera
from recon.errors import Failure, RescoreError
from recon.localization.localize import FitLocalization
from rescore.engines.executor import Workers
from rescore.files import write_provenance
from rescore.parallel import track
from rescore.speech import say
from rescore.studies.localization.learned import TableClass, TableClassConfig, learn_table_class
from rescore.studies.localization.result_file import (
    LocalizationResult,
    ScoredPlacement,
    TablePose,
    localization_result,
    scores_by_car,
    write_localization,
)
from rescore.studies.localization.scores import METHODS, Score
from rescore.studies.localization.segment import TableRegion, segment_table
from rescore.studies.localization.trials import (
    Trial,
    TrialConfig,
    empty_table,
    fit_region,
    run_trials,
    several_at_once,
)

_SEVERAL_STREAM = 1_000_000
"""Beyond every number of a trial, so that the picture of several cars draws from a stream of its own."""


@dataclass(frozen=True, eq=False)
class SeveralCars:
    """One photograph of several cars, and what the joint fit finds in it."""

    rgb: UInt8Array
    """The photograph, shape (h, w, 3)."""
    placed: tuple[Placement, ...]
    found: tuple[tuple[TableRegion, FitLocalization], ...]


@dataclass(frozen=True, eq=False)
class LocalizationStudy:
    """Learned class and cars, ready for trials."""

    cars: tuple[CarModel, ...]
    """What is placed."""
    placements: int
    table_class: TableClass
    seed: int
    config: TrialConfig = field(default_factory=TrialConfig)

    seen_from: GroundedCamera = SEEN_FROM
    """The table."""

    def parts_m(self, fit: FitLocalization) -> FloatArray:
        """Part outlines of a fit in the ground frame, shape (p, m, 3)."""
        return fit.fit.parts_m(self.table_class.space, SCALE)

    @property
    def part_labels(self) -> tuple[int, ...]:
        """Labels of the parts of ``parts_m``."""
        return self.table_class.space.part_labels

    def trials(self, jobs: Workers) -> Iterator[Trial]:
        """The trials in order, as they are done."""
        trials = run_trials(self.cars, self.placements, self.table_class, self.config, self.seed, jobs)
        return track(trials, "localise", self.placements)

    def several(self) -> SeveralCars:
        """Up to nine of the cars in one photograph, localised by the joint fit."""
        rng = np.random.default_rng([self.seed, _SEVERAL_STREAM])
        placed = several_at_once([self.cars[i] for i in rng.permutation(len(self.cars))][:9], rng)
        rgb = photograph(placed, rng)
        regions = segment_table(rgb, empty_table(self.config.segment))
        fits = [
            (region, fit_region(rgb, region, self.table_class, self.config))
            for region in ([] if isinstance(regions, Failure) else regions)
        ]
        found = tuple((region, fit) for region, fit in fits if isinstance(fit, FitLocalization))
        return SeveralCars(rgb, tuple(placed), found)


def learned_study(
    cars: int, placements: int, meshes: Path | None, seed: int, jobs: Workers
) -> LocalizationStudy:
    """The study with its class learned.

    Args:
        cars: Cars to place, spread over the body types.
        placements: Trials in all, spread evenly over the cars.
        meshes: Folder of cars to place instead; None for none.
        seed: Of every random choice.
        jobs: Pictures at a time while learning.

    Raises:
        RescoreError: fewer placements than cars, or a mesh that cannot be used.
    """
    split = cars_of_splits(test_meshes=meshes)
    chosen = _spread(split["test"], cars)
    if placements < len(chosen):
        raise RescoreError(
            f"--placements: expected at least one for each of {len(chosen)} cars, got {placements}; "
            "ask for more placements or fewer --cars"
        )
    say(f"learning from {len(split['train'])} cars")
    learned = learn_table_class(split["train"], TableClassConfig(), jobs)
    return LocalizationStudy(chosen, placements, learned, seed)


def _spread(cars: Sequence[CarModel], count: int) -> tuple[CarModel, ...]:
    """``count`` of the cars evenly over their list, which goes by body type; all where there are fewer."""
    if count >= len(cars):
        return tuple(cars)
    return tuple(cars[i * len(cars) // count] for i in range(count))


@dataclass(eq=False)
class Tally:
    """The numbers of trials; their pictures are not kept."""

    placements: list[ScoredPlacement] = field(default_factory=list)
    """A placement a trial, as in ``localization.json``."""

    @property
    def by_car(self) -> dict[str, dict[str, list[Score | Failure]]]:
        """Scores by car and method."""
        return scores_by_car(self.placements)

    @property
    def result(self) -> LocalizationResult:
        """Content of ``localization.json``."""
        return localization_result(self.placements)

    def add(self, trial: Trial) -> None:
        """Count a trial."""
        methods = {m: trial.scores[m] for m in METHODS}
        self.placements.append(ScoredPlacement(car=trial.shape_id, pose=_pose(trial), methods=methods))

    def save(self, out: Path, study: LocalizationStudy, meshes: Path | None) -> None:
        """Write ``localization.json`` with its settings to a folder."""
        write_localization(out / "localization.json", self.result)
        settings = {
            "cars": len(study.cars),
            "placements": study.placements,
            "meshes": str(meshes) if meshes else None,
        }
        write_provenance(out / "localization.json", "localize", settings, study.seed)


def _pose(trial: Trial) -> TablePose:
    x, y = trial.truth.xy_m
    yaw_deg = float(trial.truth.yaw_rad * 57.29577951)
    return TablePose(x_mm=1000 * float(x), y_mm=1000 * float(y), yaw_deg=yaw_deg)
