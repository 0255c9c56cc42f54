"""The experiment of section 5.2: cars times placements, every method and hand, several trials at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from datasets_synth.cars.mesh_axes import MeshAxes
from datasets_synth.cars.models import table_cars
from recon.errors import RescoreError
from rescore.engines.executor import Workers
from rescore.engines.map_frames import map_frames
from rescore.files import read_json_object, remove, write_json, write_provenance
from rescore.formats.checked_json import read_checked
from rescore.grasping.cars import TableCar, experiment_cars, own_cars
from rescore.grasping.result_file import GraspResult, GraspRow, write_grasps
from rescore.grasping.scene import require_robot
from rescore.grasping.trial import run_trial
from rescore.parallel import track
from rescore.studies.localization.kept_class import kept_table_class
from rescore.studies.localization.learned import TableClass, TableClassConfig

RULES = 1
"""Number of the rules of choosing and judging; trials made under others are not taken up again."""


@dataclass(frozen=True)
class Experiment:
    """What is tried."""

    cars: tuple[TableCar, ...]
    placements: int
    """Placements of each car."""
    seed: int

    @staticmethod
    def of(
        cars: int, placements: int, meshes: Path | None, seed: int, axes: MeshAxes | None = None
    ) -> "Experiment":
        """The experiment of the report's size or another, with a user's cars where a folder is named.

        ``axes`` are those of the user's cars; None for glTF's.

        Raises:
            RescoreError: the packages of the robot are not installed, or a mesh cannot be used.
        """
        require_robot()
        if meshes is None:
            return Experiment(experiment_cars(cars), placements, seed)
        own = table_cars(meshes, axes)["test"]
        return Experiment(own_cars(own), placements, seed)

    def run(self, out: Path, jobs: Workers, table_class: TableClass | None = None) -> GraspResult:
        """The result, also written to ``out/grasp.json``; trials that a stopped run left there are kept.

        Args:
            out: the folder.
            jobs: trials at a time; the result is the same for any number.
            table_class: what is known of cars; None to learn it where a trial is still to do.
        """
        kept = _Kept(out / "trials", self)
        todo = [(i, k) for i, k in self._numbers() if kept.row(i, k) is None]
        if todo:
            known = table_class or learned_cars(out / "learned", jobs)
            for row in track(self._tried(todo, known, jobs), "grasp", len(todo)):
                kept.add(row)
        found = [kept.row(i, k) for i, k in self._numbers()]
        result = GraspResult(
            seed=self.seed,
            placements=self.placements,
            cars=tuple(c.name for c in self.cars),
            rows=tuple(row for row in found if row is not None),
        )
        write_grasps(out / "grasp.json", result)
        settings = {"cars": list(result.cars), "placements": self.placements}
        write_provenance(out / "grasp.json", "grasp", settings, self.seed)
        return result

    def require_trial(self, number: int | None) -> None:
        """Nothing, where there is a trial of this number or none is asked for.

        Raises:
            RescoreError: there is no such trial.
        """
        last = len(self.cars) * self.placements - 1
        if number is not None and number > last:
            raise RescoreError(
                f"--show: expected a trial from 0 to {last}, got {number}; choose one of these"
            )

    def _numbers(self) -> Iterator[tuple[int, int]]:
        return ((i, k) for k in range(self.placements) for i in range(len(self.cars)))

    def _tried(
        self, todo: Sequence[tuple[int, int]], table_class: TableClass, jobs: Workers
    ) -> Iterator[GraspRow]:
        return map_frames(_trial_of, todo, (self.cars, table_class, self.seed), jobs)


def _trial_of(numbers: tuple[int, int], shared: tuple[tuple[TableCar, ...], TableClass, int]) -> GraspRow:
    (i, k), (cars, table_class, seed) = numbers, shared
    return run_trial(cars[i], i, k, table_class, seed)


def learned_cars(folder: Path, jobs: Workers) -> TableClass:
    """What the training cars teach, kept in a folder; front and rear are not told apart, since a grasp needs
    neither."""
    config = TableClassConfig(heading_pictures=0)
    return kept_table_class(folder, table_cars()["train"], config, jobs)


class _Kept:
    """Trials in a folder, a file each, and what they are trials of."""

    def __init__(self, folder: Path, experiment: Experiment) -> None:
        self._folder = folder
        cars = [(c.name, getattr(c.model, "digest", "")) for c in experiment.cars]
        settings = {"rules": RULES, "seed": experiment.seed, "cars": [list(c) for c in cars]}
        file = folder / "settings.json"
        if not _same(file, settings):
            for old in folder.glob("[0-9]*_[0-9]*.json"):
                remove(old)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(file, settings)

    def row(self, index: int, placement: int) -> GraspRow | None:
        """The trial of a placement; None where it is still to do."""
        file = self._file(index, placement)
        return read_checked(file, TypeAdapter(GraspRow), "a trial") if file.is_file() else None

    def add(self, row: GraspRow) -> None:
        """Keep a trial."""
        write_json(self._file(row.index, row.placement), row.as_json())

    def _file(self, index: int, placement: int) -> Path:
        return self._folder / f"{index:03d}_{placement:03d}.json"


def _same(file: Path, settings: object) -> bool:
    try:
        return read_json_object(file, "settings") == settings
    except RescoreError:
        return False
