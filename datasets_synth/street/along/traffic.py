"""Vehicles on a street: parked rows at its kerbs, traffic in its lanes, crossing traffic, cars in yards."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from datasets_synth.cars.models import ParametricCar
from datasets_synth.cars.shapes import CarModel
from datasets_synth.street.along.road import SIDES, Band
from datasets_synth.street.along.stage import AWAY_RAD, CLEAR_M, TOWARDS_RAD, Stage
from datasets_synth.street.along.vehicles import VEHICLES
from datasets_synth.street.prop_parts import Pictures

SHARE_OF_TYPE = {"van": 0.5, "pickup": 0.25, "coupe": 0.5}
"""How often body types stand in a street, 1 for those not named."""
_BY_LANE = (
    *("goods van", "goods van", "minibus", "truck", "truck", "truck with a print"),
    *("bus", "bus", "bus", "flatbed"),
)
_AT_KERB = ("goods van", "goods van", "goods van", "minibus", "truck", "flatbed")


@dataclass(frozen=True)
class Traffic:
    """How busy a street is."""

    flow: float
    """Traffic in the lanes; 1 is a gap of some 20 m between vehicles."""
    parked: float
    """Share of the parking places that are taken."""
    others: float
    """Share of vehicles that are no cars."""
    queue: bool
    """Whether traffic waits at the crossing."""
    crossing: int
    """Most vehicles that drive on either side of the side street."""


def sample_traffic(rng: np.random.Generator) -> Traffic:
    """A street between empty and full."""
    if rng.random() < 0.06:
        return Traffic(flow=0.0, parked=0.0, others=0.0, queue=False, crossing=0)
    return Traffic(
        flow=float(rng.choice([0.0, 0.5, 1.0, 1.8], p=[0.12, 0.3, 0.36, 0.22])),
        parked=float(rng.choice([0.0, 0.3, 0.65, 0.92], p=[0.1, 0.25, 0.35, 0.3])),
        others=float(rng.uniform(0.0, 0.25)),
        queue=bool(rng.random() < 0.35),
        crossing=int(rng.integers(1, 5)),
    )


@dataclass
class Vehicles:
    """Puts vehicles onto a stage, cars of a split and other vehicles among them."""

    stage: Stage
    models: Sequence[CarModel]
    pictures: Pictures
    traffic: Traffic
    far_m: float

    def __post_init__(self) -> None:
        types = [m.shape.body_type if isinstance(m, ParametricCar) else "" for m in self.models]
        weight = np.array([SHARE_OF_TYPE.get(t, 1.0) for t in types])
        self._weight = weight / weight.sum()

    def put(self, x: float, y: float, yaw: float, others: Sequence[str] = ()) -> float:
        """Stand a vehicle at (x, y) with its middle; gives its length, 0 where there is no room."""
        rng = self.stage.rng
        if others and rng.random() < self.traffic.others:
            name = others[int(rng.integers(len(others)))]
            if name == "truck with a print" and not len(self.pictures):
                name = "truck"
            kind, build = VEHICLES[name]
            mesh = build(rng, self.pictures).mesh()
            length = float(np.ptp(mesh.vertices_m[:, 0]))
            return length if self.stage.put_vehicle(mesh, kind, (x, y, yaw)) else 0.0
        model = self.models[int(rng.choice(len(self.models), p=self._weight))]
        return model.size_m[0] if self.stage.put_car(model, x, y, yaw) else 0.0


def put_vehicles(vehicles: Vehicles, camera_x_m: float) -> None:
    """Fill a street; the camera's own lane stays free for some metres."""
    _park(vehicles)
    _drive(vehicles, camera_x_m)
    _cross(vehicles)
    _run_tram(vehicles)
    _park_in_yards(vehicles)


def _park(vehicles: Vehicles) -> None:
    road = vehicles.stage.road
    lots = [b for b in road.bands if b.role == "lot"]
    for side, how in zip(SIDES, road.parking, strict=True):
        for band in lots:
            if band.side == side and how == "parallel":
                _park_in_line(vehicles, band)
            elif band.side == side:
                slant = 0.0 if how == "square" else float(vehicles.stage.rng.choice([0.6, -0.6]))
                _park_in_bays(vehicles, band, slant)


def _park_in_line(vehicles: Vehicles, band: Band) -> None:
    """Cars one behind the other along the kerb; most point the way the lane leads."""
    stage = vehicles.stage
    rng = stage.rng
    middle = (band.x0_m + band.x1_m) / 2
    y = float(rng.uniform(-1, 5))
    while y < vehicles.far_m:
        room = float(rng.uniform(5.0, 6.3))
        at = y + room / 2
        if (
            rng.random() < vehicles.traffic.parked
            and at > CLEAR_M + 1
            and not _in_crossing(vehicles, at, 4.5)
        ):
            usual = AWAY_RAD if band.side > 0 else TOWARDS_RAD
            yaw = usual + (np.pi if rng.random() < 0.25 else 0.0) + float(rng.normal(0, 0.025))
            x = middle + float(rng.normal(0, 0.1)) + 0.1 * band.side
            vehicles.put(x, at, float(yaw), _AT_KERB)
        y += room


def _park_in_bays(vehicles: Vehicles, band: Band, slant: float) -> None:
    """Cars side by side, turned from square to the kerb by an angle, noses in or out."""
    rng = vehicles.stage.rng
    pitch = 2.65 / np.cos(slant)
    inward = 0.0 if band.side > 0 else np.pi
    for y in np.arange(float(rng.uniform(2, 4)), vehicles.far_m, pitch):
        if rng.random() >= vehicles.traffic.parked or y < CLEAR_M or _in_crossing(vehicles, float(y), 4.0):
            continue
        yaw = inward + slant + (np.pi if rng.random() < 0.3 else 0.0) + float(rng.normal(0, 0.03))
        x = (band.x0_m + band.x1_m) / 2 + float(rng.normal(0, 0.12)) + 0.1 * band.side
        vehicles.put(x, float(y), yaw)


def _in_crossing(vehicles: Vehicles, y: float, margin_m: float) -> bool:
    crossing = vehicles.stage.road.crossing
    return crossing is not None and abs(y - crossing.y_m) < crossing.half_width_m + margin_m


def _drive(vehicles: Vehicles, camera_x_m: float) -> None:
    """Leading and oncoming traffic, one vehicle behind the other in each lane."""
    stage, traffic = vehicles.stage, vehicles.traffic
    rng, crossing = stage.rng, stage.road.crossing
    for x in stage.road.lanes_m:
        own = abs(x - camera_x_m) < stage.road.lane_width_m / 2
        y = float(rng.uniform(8.5, 24)) if own else float(rng.uniform(CLEAR_M + 1, 20))
        yaw = AWAY_RAD if x > 0 else TOWARDS_RAD
        while traffic.flow and y < vehicles.far_m:
            gap = float(rng.exponential(16 / traffic.flow)) + 3.0
            if traffic.queue and crossing is not None and x > 0 and y < crossing.road_m[0]:
                gap = float(rng.uniform(1.5, 3.5))
                if y + 5 > crossing.road_m[0] - 1.5:
                    y = crossing.road_m[1] + float(rng.uniform(6, 15))
                    continue
            others = _BY_LANE if y > 14 or not own else ()
            at = (x + float(rng.normal(0, 0.18)), y + 2.4)
            length = vehicles.put(*at, yaw + float(rng.normal(0, 0.02)), others)
            y += max(length, 4.5) + gap


def _cross(vehicles: Vehicles) -> None:
    """Crossing and turning traffic, and cars parked along the side street."""
    stage, crossing = vehicles.stage, vehicles.stage.road.crossing
    if crossing is None:
        return
    rng = stage.rng
    for yaw, y in (
        (0.0, crossing.y_m - crossing.half_width_m / 2),
        (np.pi, crossing.y_m + crossing.half_width_m / 2),
    ):
        for _ in range(int(rng.integers(0, vehicles.traffic.crossing + 1))):
            # while traffic waits in the street, the side street drives
            reach = 16 if vehicles.traffic.queue or not vehicles.traffic.flow else 24
            x = float(rng.uniform(-reach, reach))
            vehicles.put(x, y + float(rng.normal(0, 0.15)), yaw + float(rng.normal(0, 0.03)), _BY_LANE)
    for _ in range(int(rng.integers(0, 4)) if vehicles.traffic.crossing else 0):
        x, y = float(rng.uniform(*stage.road.edge_m)), crossing.y_m + float(rng.normal(0, 1.0))
        vehicles.put(x, y, float(rng.uniform(-np.pi, np.pi)))
    edge = max(stage.road.frontage_m[1], -stage.road.frontage_m[0]) + 1.0
    for side in SIDES:
        for k in range(4):
            if crossing.half_width_m > 4.0 and rng.random() < 0.6 * vehicles.traffic.parked:
                y = crossing.y_m - side * (crossing.half_width_m - 1.05)
                vehicles.put(side * (edge + 3 + 5.8 * k), y, 0.0 if side > 0 else np.pi)


def _run_tram(vehicles: Vehicles) -> None:
    """Now and then a tram on its tracks."""
    stage = vehicles.stage
    tracks = [b for b in stage.road.bands if b.role == "tracks"]
    if not tracks or stage.rng.random() >= 0.55:
        return
    band = tracks[int(stage.rng.integers(len(tracks)))]
    kind, build = VEHICLES["tram"]
    mesh = build(stage.rng, vehicles.pictures).mesh()
    yaw = AWAY_RAD if band.side > 0 else TOWARDS_RAD
    y = float(stage.rng.uniform(24, 60))
    stage.put_vehicle(mesh, kind, ((band.x0_m + band.x1_m) / 2, y, yaw))


def _park_in_yards(vehicles: Vehicles) -> None:
    """Cars on forecourts and drives beside the street, at any angle."""
    stage = vehicles.stage
    rng = stage.rng
    for side, front in zip(SIDES, stage.road.frontage_m, strict=True):
        for _ in range(int(rng.integers(0, 4))):
            y = float(rng.uniform(8, 45))
            if rng.random() < vehicles.traffic.parked and not _in_crossing(vehicles, y, 6.0):
                square = float(rng.choice([0.0, np.pi])) + float(rng.normal(0, 0.08))
                yaw = square if rng.random() < 0.55 else float(rng.uniform(-np.pi, np.pi))
                vehicles.put(front + side * float(rng.uniform(3.0, 4.5)), y, yaw)
