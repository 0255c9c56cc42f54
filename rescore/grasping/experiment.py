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
from rescore.experiment.source_digest import source_digest
from rescore.files import read_json_object, remove, write_json, write_provenance
from rescore.formats.checked_json import read_checked
from rescore.grasping import trial
from rescore.grasping.cars import TableCar, experiment_cars, own_cars
from rescore.grasping.perception import JOINT_FIT, METHODS
from rescore.grasping.result_file import GraspResult, GraspRow, write_grasps
from rescore.grasping.scene import require_robot
from rescore.grasping.trial import run_trial
from rescore.parallel import track
from rescore.studies.localization.kept_class import kept_table_class
from rescore.studies.localization.learned import TableClass, TableClassConfig


@dataclass(frozen=True)
class Experiment:
    """What is tried."""

    cars: tuple[TableCar, ...]
    placements: int
    """Placements of each car, with every method."""
    seed: int
    fit_placements: int = 0
    """Placements of each car with the joint fit, where these are more."""

    @staticmethod
    def of(
        cars: int,
        placements: int,
        meshes: Path | None,
        seed: int,
        axes: MeshAxes | None = None,
        fit_placements: int = 0,
    ) -> "Experiment":
        """The experiment of the report's size or another, with a user's cars where a folder is named.

        ``axes`` are those of the user's cars; None for glTF's.

        Raises:
            RescoreError: the packages of the robot are not installed, or a mesh cannot be used.
        """
        require_robot()
        if meshes is None:
            return Experiment(experiment_cars(cars), placements, seed, fit_placements)
        own = table_cars(meshes, axes)["test"]
        return Experiment(own_cars(own), placements, seed, fit_placements)

    def run(self, out: Path, jobs: Workers, table_class: TableClass | None = None) -> GraspResult:
        """The result, also written to ``out/grasp.json``; trials that a stopped run left there are kept.

        Args:
            out: the folder.
            jobs: trials at a time; the result is the same for any number.
            table_class: what is known of cars; None to learn it where a trial is still to do.
        """
        kept = _Kept(out / "trials", self)
        todo = [(i, k) for i, k in self._numbers() if kept.row(i, k, self._methods(k)) is None]
        if todo:
            known = table_class or learned_cars(out / "learned", jobs)
            for row in track(self._tried(todo, known, jobs), "grasp", len(todo)):
                kept.add(row)
        found = [kept.row(i, k, self._methods(k)) for i, k in self._numbers()]
        result = GraspResult(
            seed=self.seed,
            placements=self._most,
            cars=tuple(c.name for c in self.cars),
            rows=tuple(row for row in found if row is not None),
        )
        write_grasps(out / "grasp.json", result)
        settings = {"cars": list(result.cars), "placements": self.placements, "fit_placements": self._most}
        write_provenance(out / "grasp.json", "grasp", settings, self.seed)
        return result

    def require_trial(self, number: int | None) -> None:
        """Nothing, where there is a trial of this number or none is asked for.

        Raises:
            RescoreError: there is no such trial.
        """
        last = len(self.cars) * self._most - 1
        if number is not None and number > last:
            raise RescoreError(
                f"--show: expected a trial from 0 to {last}, got {number}; choose one of these"
            )

    @property
    def _most(self) -> int:
        """Placements of each car with any method."""
        return max(self.placements, self.fit_placements)

    def _numbers(self) -> Iterator[tuple[int, int]]:
        return ((i, k) for k in range(self._most) for i in range(len(self.cars)))

    def _methods(self, placement: int) -> tuple[str, ...]:
        """The methods that are tried at a placement of each car."""
        return METHODS if placement < self.placements else (JOINT_FIT,)

    def _tried(
        self, todo: Sequence[tuple[int, int]], table_class: TableClass, jobs: Workers
    ) -> Iterator[GraspRow]:
        trials = [(i, k, self._methods(k)) for i, k in todo]
        return map_frames(_trial_of, trials, (self.cars, table_class, self.seed), jobs)


def _trial_of(
    numbered: tuple[int, int, tuple[str, ...]], shared: tuple[tuple[TableCar, ...], TableClass, int]
) -> GraspRow:
    (i, k, methods), (cars, table_class, seed) = numbered, shared
    return run_trial(cars[i], i, k, table_class, seed, methods)


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
        settings = {"code": source_digest(trial), "seed": experiment.seed, "cars": [list(c) for c in cars]}
        file = folder / "settings.json"
        if not _same(file, settings):
            for old in folder.glob("[0-9]*_[0-9]*.json"):
                remove(old)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(file, settings)

    def row(self, index: int, placement: int, methods: tuple[str, ...]) -> GraspRow | None:
        """The trial of a placement with these methods; None where it is still to do."""
        file = self._file(index, placement)
        row = read_checked(file, TypeAdapter(GraspRow), "a trial") if file.is_file() else None
        return row.only(methods) if row and set(methods) <= set(row.verdicts) else None

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
