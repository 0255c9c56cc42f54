"""A street that is being filled: what stands on it, and the ground that is taken."""

from dataclasses import dataclass, field

import numpy as np

from datasets_synth.cars.models import ParametricCar
from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Mesh, Placed
from datasets_synth.meshes.solids import pose, rotation_z
from datasets_synth.street.along.road import Road
from datasets_synth.street.footprints import Footprint, footprint
from recon.arrays import FloatArray

AWAY_RAD = np.pi / 2
"""Yaw of a vehicle that drives away from the camera along the street."""
TOWARDS_RAD = -np.pi / 2
"""Yaw of a vehicle that comes towards the camera."""
CLEAR_M = 3.2
"""Nothing stands nearer to the camera than this along the street."""


@dataclass
class Stage:
    """A street and everything that was put on it so far.

    Places and yaws are given as in a straight street; what stands there follows the curve of this one.
    """

    road: Road
    rng: np.random.Generator
    items: list[Placed] = field(default_factory=list)
    taken: list[Footprint] = field(default_factory=list)

    def put_car(self, car: CarModel, x: float, y: float, yaw: float) -> bool:
        """Stand a car on the road where it meets nothing; says whether it could.

        Its mesh is built only where its size fits, since building costs more than looking.
        """
        length, width, _ = car.size_m
        place, heading = self.road.world_m(x, y), self.road.heading_rad(yaw, y)
        spot = Footprint(float(place[0]), y, length / 2 + 0.15, width / 2 + 0.2, heading)
        if not self._is_free(spot):
            return False
        return self.put_vehicle(car.build(self.rng), kind_of(car), (x, y, yaw), shape_id=car.shape_id)

    def put_vehicle(
        self, mesh: Mesh, kind: str, at: tuple[float, float, float], *, shape_id: str = ""
    ) -> bool:
        """Stand a vehicle on the road at (x, y, yaw), tilted as the road is; says whether it could."""
        x, y, yaw = at
        world = np.eye(4)
        world[:3, :3] = self.road.axes(x, y) @ rotation_z(self.road.heading_rad(yaw, y))
        world[:3, 3] = self.road.world_m(x, y)
        return self._add(Placed(mesh, world, kind, shape_id), 0.1)

    def put(
        self, mesh: Mesh, kind: str, at: tuple[float, float, float], *, scale: float = 1.0, gap_m: float = 0.1
    ) -> bool:
        """Stand a thing upright at (x, y, yaw) where it meets nothing; says whether it could."""
        return self._add(Placed(mesh, self._upright(at, scale), kind), gap_m)

    def put_freely(
        self,
        mesh: Mesh,
        kind: str,
        at: tuple[float, float, float],
        *,
        scale: float = 1.0,
        casts_shadow: bool = True,
        takes_ground: bool = False,
    ) -> None:
        """Stand a plant or a house upright at (x, y, yaw), whatever stands there."""
        placed = Placed(mesh, self._upright(at, scale), kind, "", casts_shadow)
        self.items.append(placed)
        if takes_ground:
            self.taken.append(footprint(placed))

    def reserve(self, spot: Footprint) -> None:
        """Keep ground free of what comes later, in the world."""
        self.taken.append(spot)

    def _upright(self, at: tuple[float, float, float], scale: float) -> FloatArray:
        x, y, yaw = at
        place = self.road.world_m(x, y)
        world = pose(float(place[0]), y, float(place[2]), self.road.heading_rad(yaw, y))
        world[:3, :3] *= scale
        return world

    def _add(self, placed: Placed, gap_m: float) -> bool:
        ground = footprint(placed, gap_m)
        if not self._is_free(ground):
            return False
        self.items.append(placed)
        self.taken.append(ground)
        return True

    def _is_free(self, spot: Footprint) -> bool:
        reach = float(np.hypot(spot.half_length_m, spot.half_width_m))
        for other in self.taken:
            far = reach + float(np.hypot(other.half_length_m, other.half_width_m))
            if abs(other.x_m - spot.x_m) < far and abs(other.y_m - spot.y_m) < far and spot.meets(other):
                return False
        return True


def kind_of(car: CarModel) -> str:
    """ "van" for vans, as KITTI tells them from cars (minivans are cars there), "car" for all others."""
    is_van = isinstance(car, ParametricCar) and car.shape.body_type == "van"
    return "van" if is_van else "car"
