"""The study of section 5.1: cars placed on a table at random, localised by every method, counted."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from datasets_synth.cars.mesh_axes import MeshAxes
from datasets_synth.cars.models import table_cars
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import SCALE, SEEN_FROM, Placement, photograph
from recon.arrays import FloatArray, UInt8Array
from recon.camera import GroundedCamera
from recon.errors import Failure, RescoreError
from recon.localization.localize import FitLocalization
from rescore.engines.executor import Workers
from rescore.experiment.source_digest import source_digest
from rescore.files import write_provenance
from rescore.parallel import track
from rescore.studies.localization import trials
from rescore.studies.localization.kept_class import kept_table_class
from rescore.studies.localization.kept_trials import KeptTrials
from rescore.studies.localization.learned import TableClass, TableClassConfig
from rescore.studies.localization.result_file import (
    LocalizationResult,
    Nose,
    ScoredPlacement,
    TablePose,
    localization_result,
    scores_by_car,
    write_localization,
)
from rescore.studies.localization.scores import METHODS, Score
from rescore.studies.localization.segment import TableRegion, empty_table, segment_table
from rescore.studies.localization.trials import (
    Trial,
    TrialConfig,
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

    def trials(self, numbers: Sequence[int], jobs: Workers) -> Iterator[Trial]:
        """The trials of these numbers in order, as they are done."""
        found = run_trials(self.cars, numbers, self.table_class, self.config, self.seed, jobs)
        return track(found, "localise", self.placements, done=self.placements - len(numbers))

    def kept(self, out: Path) -> KeptTrials:
        """The trials of this study that a run left in a folder; those of another study are removed."""
        settings = {
            "seed": self.seed,
            "cars": [[car.shape_id, getattr(car, "digest", "")] for car in self.cars],
            "class": self.table_class.digest,
            "code": source_digest(trials),
        }
        return KeptTrials(out / "placements", settings)

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
    cars: int,
    placements: int,
    meshes: Path | None,
    seed: int,
    jobs: Workers,
    out: Path,
    axes: MeshAxes | None = None,
) -> LocalizationStudy:
    """The study with its class learned, or read from where an earlier run kept it.

    Args:
        cars: Cars to place, spread over the body types.
        placements: Trials in all, spread evenly over the cars.
        meshes: Folder of cars to place instead; None for none.
        seed: Of every random choice.
        jobs: Pictures at a time while learning.
        out: Folder of the study; what is learned is kept in it.
        axes: Those of the meshes; None for glTF's.

    Raises:
        RescoreError: fewer placements than cars, or a mesh that cannot be used.
    """
    split = table_cars(meshes, axes)
    chosen = _spread(split["test"], cars)
    if placements < len(chosen):
        raise RescoreError(
            f"--placements: expected at least one for each of {len(chosen)} cars, got {placements}; "
            "ask for more placements or fewer --cars"
        )
    others = [*split["calibration"], *split["validation"]]
    learned = kept_table_class(out / "learned", split["train"], TableClassConfig(), jobs, others)
    return LocalizationStudy(chosen, placements, learned, seed)


def _spread(cars: Sequence[CarModel], count: int) -> tuple[CarModel, ...]:
    """``count`` of the cars evenly over their list, which goes by body type; all where there are fewer."""
    if count >= len(cars):
        return tuple(cars)
    return tuple(cars[i * len(cars) // count] for i in range(count))


@dataclass(frozen=True, eq=False)
class Tally:
    """The numbers of trials."""

    placements: Sequence[ScoredPlacement]
    """A placement a trial, as in ``localization.json``."""

    @property
    def by_car(self) -> dict[str, dict[str, list[Score | Failure]]]:
        """Scores by car and method."""
        return scores_by_car(self.placements)

    @property
    def result(self) -> LocalizationResult:
        """Content of ``localization.json``."""
        return localization_result(self.placements)

    def save(self, out: Path, study: LocalizationStudy, meshes: Path | None) -> None:
        """Write ``localization.json`` with its settings to a folder."""
        write_localization(out / "localization.json", self.result)
        settings = {
            "cars": len(study.cars),
            "placements": study.placements,
            "meshes": str(meshes) if meshes else None,
        }
        write_provenance(out / "localization.json", "localize", settings, study.seed)


def scored(trial: Trial) -> ScoredPlacement:
    """The numbers of a trial."""
    methods = {m: trial.scores[m] for m in METHODS}
    row = ScoredPlacement(car=trial.shape_id, pose=_pose(trial), methods=methods)
    if not isinstance(trial.fit, FitLocalization):
        return row
    nose = None if trial.fit.nose is None else Nose.of(trial.fit.nose)
    return row.model_copy(update={"nose": nose, "outside": trial.fit.outside})


def _pose(trial: Trial) -> TablePose:
    x, y = trial.truth.xy_m
    yaw_deg = float(trial.truth.yaw_rad * 57.29577951)
    return TablePose(x_mm=1000 * float(x), y_mm=1000 * float(y), yaw_deg=yaw_deg)
