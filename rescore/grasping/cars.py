"""The cars of the experiment: test shapes of the localisation study, three of them thin, one fragile."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from datasets_synth.cars.models import ParametricCar, table_cars
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import SCALE
from rescore.grasping.causes import Cause, Refusal
from rescore.grasping.solids import Solid, convex_pieces, filled_solid, is_closed

THIN = 0.78
"""Width of a thin car over that of the shape it is made of: as narrow as the small cars of Japan."""
_THIN_EVERY, _THIN_FIRST = 6, 2
BREAKS_AT_N = 40.0
"""Force of one touch at which the fragile car breaks."""
_MOST_PIECES = 60
"""A car of more convex pieces, as those of which every panel is one, would be slow in the engine."""
_DENSITY_KG_M3 = 250.0
"""Mass over the volume of the bounding box: a die-cast sedan 1:18 weighs about half a kilogram."""


@dataclass(frozen=True)
class TableCar:
    """A car that is to be grasped."""

    model: CarModel
    fragile: bool = False

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.model.shape_id} (fragile)" if self.fragile else self.model.shape_id

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length, width and height on the table."""
        length, width, height = (float(s) * SCALE for s in self.model.size_m)
        return length, width, height


def experiment_cars(count: int, split: str = "test") -> tuple[TableCar, ...]:
    """``count`` cars of a split spread over the body types, every sixth one thin, the lowest one fragile.

    Among twenty of split "test" that is a racer with free wheels, as in the report.
    """
    cars = table_cars()[split]
    count = min(count, len(cars))
    chosen = [cars[i * len(cars) // count] for i in range(count)]
    chosen = [_thin(c) if i % _THIN_EVERY == _THIN_FIRST else c for i, c in enumerate(chosen)]
    lowest = min(range(count), key=lambda i: chosen[i].size_m[2])
    return tuple(TableCar(c, i == lowest) for i, c in enumerate(chosen))


def own_cars(models: Sequence[CarModel]) -> tuple[TableCar, ...]:
    """A user's cars as they are."""
    return tuple(TableCar(m) for m in models)


def _thin(car: CarModel) -> CarModel:
    if not isinstance(car, ParametricCar):
        return car
    shape = car.shape
    return ParametricCar(replace(shape, shape_id=f"{shape.shape_id}_thin", width=shape.width * THIN))


@lru_cache(maxsize=64)
def solid_of(car: TableCar) -> Solid | Refusal:
    """The car as a body that can be touched; a refusal where its surface bounds no body.

    A surface that is not closed, or falls into very many pieces, is filled from outside.
    """
    mesh, size = car.model.build(np.random.default_rng(0)), np.array(car.size_m)
    mass = float(_DENSITY_KG_M3 * size.prod())
    pieces = convex_pieces(mesh, SCALE) if is_closed(mesh) else ()
    solid = (
        Solid.heavy_below(car.name, pieces, size, mass)
        if 0 < len(pieces) <= _MOST_PIECES
        else filled_solid(car.name, mesh, SCALE, size, mass)
    )
    if solid is None:
        return Refusal(
            Cause.NOT_CLOSED,
            f"{car.model.shape_id}: a surface around a body expected, got one that bounds next to nothing; "
            "close its large openings, as with a floor, or leave the car out",
        )
    return replace(solid, breaks_at_n=BREAKS_AT_N) if car.fragile else solid
