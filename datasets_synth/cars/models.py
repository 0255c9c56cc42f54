"""The cars that each split may show: parametric shapes, or a user's own meshes; no shape in two splits."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from datasets_synth.cars.cars import car_mesh
from datasets_synth.cars.mesh_axes import MeshAxes
from datasets_synth.cars.paint import unusual_materials
from datasets_synth.cars.shapes import CarModel, CarShape, car_shapes
from datasets_synth.cars.table_shapes import SHAPES_PER_KIND, table_shapes
from datasets_synth.meshes.mesh import Mesh
from recon.errors import RescoreError
from rescore.data.frames import SPLITS
from rescore.speech import say

_SPLIT_OF_NUMBER = ("train", "test", "calibration", "train", "test", "validation", "train", "test")
"""Split of the k-th shape of a body type, so that every split sees every body type."""
_SPLIT_OF_TABLE_NUMBER = ("train", "test", "train", "validation")
"""Split of the k-th shape of a kind of ``table_shapes``."""


TRAINING_CARS = "training cars"
"""Where the part-labelled views come from unless some training cars have no part labels."""


@dataclass(frozen=True)
class ParametricCar:
    """A shape of the parametric family."""

    shape: CarShape

    @property
    def shape_id(self) -> str:
        """Name of the shape."""
        return self.shape.shape_id

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length, width and height."""
        return self.shape.size_m

    def build(self, rng: np.random.Generator) -> Mesh:
        """The mesh in a paint of its own."""
        return car_mesh(self.shape, rng)


@dataclass(frozen=True)
class RepaintedCar(ParametricCar):
    """A shape of the parametric family in looks as other people's models have."""

    def build(self, rng: np.random.Generator) -> Mesh:
        """The mesh in unusual materials."""
        return replace(car_mesh(self.shape, rng), materials=unusual_materials(rng))


def repainted(car: CarModel) -> CarModel:
    """The car in unusual looks; a user's mesh keeps its own."""
    return RepaintedCar(car.shape) if isinstance(car, ParametricCar) else car


@dataclass(frozen=True, eq=False)
class ImportedModel:
    """A user's mesh; it always looks the same."""

    shape_id: str
    size_m: tuple[float, float, float]
    mesh: Mesh

    @cached_property
    def digest(self) -> str:
        """Digest of everything that is seen of the mesh."""
        total = hashlib.sha256()
        m = self.mesh
        for array in (m.vertices_m, m.faces, m.corner_normals, m.corner_uv, m.face_material, m.face_part):
            total.update(np.ascontiguousarray(array).tobytes())
        for material in m.materials:
            numbers = (material.rgb, material.specular, material.shininess, material.mirror)
            total.update(repr(numbers).encode())
            if material.texture is not None:
                total.update(np.ascontiguousarray(material.texture).tobytes())
        return total.hexdigest()

    def build(self, rng: np.random.Generator) -> Mesh:
        """The mesh as it was loaded."""
        return self.mesh


def cars_of_splits(
    train_meshes: Path | None = None, test_meshes: Path | None = None, axes: MeshAxes | None = None
) -> Mapping[str, Sequence[CarModel]]:
    """The cars of each split; of eight shapes of a body type three train, three test, one serves each other.

    Args:
        train_meshes: Folder of meshes that replace the shapes of split "train".
        test_meshes: Folder of meshes that replace the shapes of split "test".
        axes: Those of the meshes; None for glTF's.

    Raises:
        RescoreError: A mesh cannot be used, stands in both folders, or has the name of a parametric shape.
    """
    return _with_meshes(_parametric(), train_meshes, test_meshes, axes)


def table_cars(
    test_meshes: Path | None = None, axes: MeshAxes | None = None
) -> Mapping[str, Sequence[CarModel]]:
    """The model cars of each split for the table: those of ``cars_of_splits``, then racers and other kinds.

    Args:
        test_meshes: Folder of meshes that replace the shapes of split "test".
        axes: Those of the meshes; None for glTF's.

    Raises:
        RescoreError: A mesh cannot be used, or has the name of a parametric shape.
    """
    cars = _parametric()
    for i, shape in enumerate(table_shapes()):
        cars[_SPLIT_OF_TABLE_NUMBER[i % SHAPES_PER_KIND]].append(ParametricCar(shape))
    return _with_meshes(cars, None, test_meshes, axes)


def _with_meshes(
    cars: dict[str, list[CarModel]],
    train_meshes: Path | None,
    test_meshes: Path | None,
    axes: MeshAxes | None,
) -> Mapping[str, Sequence[CarModel]]:
    """The cars with those of splits replaced by meshes; no name in two splits."""
    for split, folder in (("train", train_meshes), ("test", test_meshes)):
        if folder is not None:
            cars[split] = _imported(folder, axes)
    owner: dict[str, str] = {}
    for split, models in cars.items():
        for model in models:
            first = owner.setdefault(model.shape_id, split)
            if first != split:
                raise RescoreError(
                    f"car meshes: splits {first} and {split} must share no shape, both hold "
                    f"{model.shape_id!r}; rename it or take it out of one folder"
                )
    return cars


def _parametric() -> dict[str, list[CarModel]]:
    """The shapes of the parametric family by split."""
    cars: dict[str, list[CarModel]] = {split: [] for split in SPLITS}
    number: dict[str, int] = {}
    for shape in car_shapes():
        k = number.get(shape.body_type, 0)
        number[shape.body_type] = k + 1
        cars[_SPLIT_OF_NUMBER[k % len(_SPLIT_OF_NUMBER)]].append(ParametricCar(shape))
    return cars


def part_labelled_cars(training: Sequence[CarModel]) -> tuple[Sequence[CarModel], str]:
    """The cars whose part-labelled views the class model learns from, and where they come from, in words.

    These are the training cars with part labels. A user's meshes often have none; then the parametric shapes
    of split "train" stand in, which no other split shows.
    """
    labelled = [c for c in training if not isinstance(c, ImportedModel) or c.mesh.face_part.any()]
    if len(labelled) == len(training):
        return labelled, TRAINING_CARS
    if labelled:
        return labelled, f"{len(labelled)} of {len(training)} training cars, the others have no part labels"
    return _parametric()["train"], "parametric cars, since no training mesh has part labels"


def _imported(folder: Path, axes: MeshAxes | None) -> list[CarModel]:
    # here, since trimesh is slow to import and rarely needed
    from datasets_synth.cars.mesh_import import load_meshes  # noqa: PLC0415

    cars = load_meshes(folder, axes)
    for note in (note for car in cars for note in car.notes):
        say(f"note: {note}")
    return [ImportedModel(car.shape_id, car.size_m, car.mesh) for car in cars]
