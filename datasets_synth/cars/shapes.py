"""The family of car shapes: what a shape is made of, the list of shapes, what every car model offers."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from datasets_synth.meshes.families import latin_hypercube
from datasets_synth.meshes.mesh import Mesh

BODY_TYPES = ("hatchback", "sedan", "estate", "suv", "van", "minivan", "pickup", "coupe")
SHAPES_PER_TYPE = 8


@dataclass(frozen=True)
class AddOns:
    """What stands on, beside or behind the lofted body, in metres; 0 where there is none."""

    wing_z: float = 0.0
    """Height of the upper edge of a wing over the tail."""
    track: float = 0.0
    """Width over wheels that stand free beside the body; where 0, they turn inside it."""
    screen_z: float = 0.0
    """Height of the windscreen of an open car, whose body has no roof."""
    box_z: float = 0.0
    """Height of a cargo box behind the cab."""
    spare: float = 0.0
    """How far a spare wheel stands out behind the tail."""


@dataclass(frozen=True)
class BodyForm:
    """How a body is rounded and how it ends below: what cars of one kind and size still differ in."""

    sill_tuck: float = 0.075
    """How far the sill lies inside the side, in metres."""
    end_tuck: float = 0.10
    """How far the lower edges of nose and tail lie behind the bumpers, in metres."""
    end_rise: float = 1.0
    """How much the underside rises towards nose and tail, in multiples of the usual."""
    end_round: float = 1.0
    """How much nose and tail are rounded as seen from above, in multiples of the usual."""
    crown: float = 1.0
    """How much higher than its sides the middle of the top is, in multiples of the usual."""


@dataclass(frozen=True)
class CarShape:
    """Measures of one car in metres. Stations (t) count from the nose, heights (z) from the ground."""

    shape_id: str
    body_type: str
    """One of ``BODY_TYPES``: whose details the body has."""
    length: float
    """Length of the body without ``add_ons``; width and height too are without them."""
    width: float
    """Width without the mirrors, as in a car's papers."""
    height: float
    wheelbase: float
    front_overhang: float
    """Distance from the nose to the front axle."""
    wheel_radius: float
    clearance: float
    """Height of the underside."""
    hood_z: float
    """Height of the hood's front edge."""
    cowl_t: float
    cowl_z: float
    """Height of the foot of the windscreen."""
    roof_front_t: float
    roof_rear_t: float
    roof_rear_z: float
    tail_t: float
    tail_z: float
    """Height of the foot of the rear window."""
    deck_z: float
    """Height of the rear edge of the trunk lid (of the tailgate's shoulder where there is none)."""
    belt_front_z: float
    belt_rear_z: float
    lean_rad: float
    """How far the side windows lean inwards."""
    pillar_t: float
    """Station of the middle pillar."""
    doors: int
    """Number of side doors: 2, 4, or 0 for a racer that one climbs into."""
    spokes: int
    add_ons: AddOns = AddOns()
    form: BodyForm = BodyForm()

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length, width (without mirrors), height, with what stands on the body."""
        more = self.add_ons
        height = max(self.height, more.wing_z, more.screen_z, more.box_z)
        return (self.length + more.spare, max(self.width, more.track), height)

    @property
    def axles_t(self) -> tuple[float, float]:
        """Distances of the two axles from the nose."""
        return (self.front_overhang, self.front_overhang + self.wheelbase)

    @property
    def has_deck(self) -> bool:
        """Whether there is a trunk lid or a bed behind the rear window."""
        return self.body_type in ("sedan", "coupe", "pickup")


# Ranges (low, high). Stations with a leading "rear_" are measured from the tail, "screen" is the run of the
# windscreen behind the cowl, "cowl" is measured from the front axle.
_Range = tuple[float, float]
_RANGES: dict[str, dict[str, _Range]] = {
    "hatchback": {
        "length": (3.65, 4.40), "width": (1.68, 1.82), "height": (1.44, 1.56),
        "overhang": (0.76, 0.88), "rear_axle": (0.60, 0.76),
        "wheel_radius": (0.295, 0.335), "clearance": (0.17, 0.20), "hood_z": (0.70, 0.80),
        "cowl": (0.22, 0.40),
        "cowl_z": (0.95, 1.03), "screen": (0.72, 0.95), "rear_roof": (0.38, 0.66),
        "roof_drop": (0.04, 0.09),
        "rear_tail": (0.07, 0.16), "tail_z": (0.94, 1.04), "deck_drop": (0.03, 0.06),
        "belt": (0.88, 0.94), "belt_rise": (0.02, 0.09),
        "lean": (14, 20), "pillar": (0.54, 0.60),
    },
    "sedan": {
        "length": (4.35, 5.10), "width": (1.74, 1.90), "height": (1.40, 1.50),
        "overhang": (0.80, 0.94), "rear_axle": (0.95, 1.10),
        "wheel_radius": (0.305, 0.345), "clearance": (0.16, 0.19), "hood_z": (0.68, 0.76),
        "cowl": (0.40, 0.62),
        "cowl_z": (0.93, 1.00), "screen": (0.72, 0.92), "rear_roof": (1.30, 1.52),
        "roof_drop": (0.03, 0.07),
        "rear_tail": (0.52, 0.80), "tail_z": (1.01, 1.09), "deck_drop": (0.02, 0.06),
        "belt": (0.88, 0.93), "belt_rise": (0.03, 0.09),
        "lean": (18, 24), "pillar": (0.52, 0.57),
    },
    "estate": {
        "length": (4.40, 4.98), "width": (1.74, 1.88), "height": (1.43, 1.54),
        "overhang": (0.80, 0.94), "rear_axle": (0.95, 1.10),
        "wheel_radius": (0.305, 0.345), "clearance": (0.16, 0.20), "hood_z": (0.69, 0.77),
        "cowl": (0.36, 0.56),
        "cowl_z": (0.93, 1.00), "screen": (0.72, 0.92), "rear_roof": (0.34, 0.62),
        "roof_drop": (0.05, 0.10),
        "rear_tail": (0.08, 0.18), "tail_z": (0.98, 1.06), "deck_drop": (0.03, 0.06),
        "belt": (0.88, 0.93), "belt_rise": (0.02, 0.08),
        "lean": (17, 22), "pillar": (0.52, 0.57),
    },
    "suv": {
        "length": (4.15, 4.95), "width": (1.80, 1.98), "height": (1.60, 1.80),
        "overhang": (0.78, 0.92), "rear_axle": (0.74, 0.95),
        "wheel_radius": (0.335, 0.380), "clearance": (0.22, 0.27), "hood_z": (0.90, 1.02),
        "cowl": (0.32, 0.55),
        "cowl_z": (1.10, 1.20), "screen": (0.62, 0.85), "rear_roof": (0.30, 0.60),
        "roof_drop": (0.04, 0.10),
        "rear_tail": (0.07, 0.16), "tail_z": (1.10, 1.20), "deck_drop": (0.03, 0.06),
        "belt": (1.04, 1.11), "belt_rise": (0.02, 0.09),
        "lean": (13, 19), "pillar": (0.53, 0.58),
    },
    "van": {
        "length": (4.40, 5.50), "width": (1.82, 2.02), "height": (1.82, 2.25),
        "overhang": (0.86, 0.98), "rear_axle": (0.75, 1.00),
        "wheel_radius": (0.315, 0.350), "clearance": (0.20, 0.24), "hood_z": (0.92, 1.04),
        "cowl": (-0.05, 0.22),
        "cowl_z": (1.16, 1.28), "screen": (0.62, 0.85), "rear_roof": (0.10, 0.22),
        "roof_drop": (0.02, 0.05),
        "rear_tail": (0.03, 0.06), "tail_z": (1.12, 1.25), "deck_drop": (0.02, 0.04),
        "belt": (1.06, 1.14), "belt_rise": (0.0, 0.03),
        "lean": (5, 9), "pillar": (0.42, 0.46),
    },
    "minivan": {
        "length": (4.30, 5.10), "width": (1.78, 1.96), "height": (1.60, 1.84),
        "overhang": (0.84, 0.96), "rear_axle": (0.72, 0.98),
        "wheel_radius": (0.310, 0.345), "clearance": (0.17, 0.20), "hood_z": (0.78, 0.88),
        "cowl": (-0.02, 0.22),
        "cowl_z": (1.06, 1.14), "screen": (0.85, 1.10), "rear_roof": (0.24, 0.46),
        "roof_drop": (0.03, 0.08),
        "rear_tail": (0.05, 0.12), "tail_z": (1.06, 1.16), "deck_drop": (0.03, 0.05),
        "belt": (0.95, 1.02), "belt_rise": (0.02, 0.08),
        "lean": (10, 15), "pillar": (0.50, 0.55),
    },
    "pickup": {
        "length": (5.05, 5.55), "width": (1.80, 1.98), "height": (1.74, 1.90),
        "overhang": (0.86, 0.96), "rear_axle": (1.10, 1.28),
        "wheel_radius": (0.360, 0.400), "clearance": (0.28, 0.34), "hood_z": (1.00, 1.10),
        "cowl": (0.50, 0.68),
        "cowl_z": (1.18, 1.26), "screen": (0.58, 0.75), "rear_roof": (1.80, 2.25),
        "roof_drop": (0.03, 0.06),
        "rear_tail": (1.58, 1.95), "tail_z": (1.16, 1.24), "deck_drop": (0.00, 0.02),
        "belt": (1.12, 1.18), "belt_rise": (0.0, 0.04),
        "lean": (13, 18), "pillar": (0.48, 0.53),
    },
    "coupe": {
        "length": (4.10, 4.75), "width": (1.76, 1.92), "height": (1.26, 1.40),
        "overhang": (0.82, 0.96), "rear_axle": (0.80, 1.00),
        "wheel_radius": (0.315, 0.350), "clearance": (0.13, 0.16), "hood_z": (0.62, 0.70),
        "cowl": (0.48, 0.72),
        "cowl_z": (0.88, 0.95), "screen": (0.75, 0.95), "rear_roof": (1.35, 1.65),
        "roof_drop": (0.03, 0.07),
        "rear_tail": (0.36, 0.62), "tail_z": (0.93, 1.01), "deck_drop": (0.02, 0.05),
        "belt": (0.83, 0.88), "belt_rise": (0.04, 0.10),
        "lean": (20, 26), "pillar": (0.60, 0.66),
    },
}  # fmt: skip


@lru_cache(maxsize=1)
def car_shapes() -> tuple[CarShape, ...]:
    """All cars of the family, always the same: `SHAPES_PER_TYPE` of each body type."""
    shapes: list[CarShape] = []
    for number, body_type in enumerate(BODY_TYPES):
        draws = latin_hypercube(_RANGES[body_type], SHAPES_PER_TYPE, [20090411, number])
        shapes += [shape_of(body_type, i, draw) for i, draw in enumerate(draws)]
    return tuple(shapes)


def shape_of(body_type: str, number: int, p: dict[str, float]) -> CarShape:
    """One shape from its number within the type and its drawn parameters."""
    length, overhang = p["length"], p["overhang"]
    cowl_t = overhang + p["cowl"]
    roof_front_t = cowl_t + p["screen"]
    roof_rear_t = length - p["rear_roof"]
    tail_t = length - p["rear_tail"]
    if body_type == "pickup":
        tail_t = max(tail_t, roof_rear_t + 0.16)
    doors = {"coupe": 2, "van": 2, "pickup": 4 if number % 2 else 2}.get(body_type, 4)
    if body_type == "hatchback" and number % 4 == 3:
        doors = 2
    return CarShape(
        shape_id=f"{body_type}_{number:02d}",
        body_type=body_type,
        length=length,
        width=p["width"],
        height=p["height"],
        wheelbase=length - overhang - p["rear_axle"],
        front_overhang=overhang,
        wheel_radius=p["wheel_radius"],
        clearance=p["clearance"],
        hood_z=p["hood_z"],
        cowl_t=cowl_t,
        cowl_z=p["cowl_z"],
        roof_front_t=roof_front_t,
        roof_rear_t=roof_rear_t,
        roof_rear_z=p["height"] - p["roof_drop"],
        tail_t=tail_t,
        tail_z=p["tail_z"],
        deck_z=p["tail_z"] - p["deck_drop"],
        belt_front_z=p["belt"],
        belt_rear_z=p["belt"] + p["belt_rise"],
        lean_rad=float(np.deg2rad(p["lean"])),
        pillar_t=cowl_t + p["pillar"] * (min(tail_t, length - 0.25) - cowl_t),
        doors=doors,
        spokes=(5, 6, 7, 8, 10)[number % 5],
    )


class CarModel(Protocol):
    """A car that can be put into a scene."""

    @property
    def shape_id(self) -> str:
        """Name of the car, the same in every frame."""

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length, width and height."""

    def build(self, rng: np.random.Generator) -> Mesh:
        """Mesh of the car; ``rng`` picks its paint where the model leaves it open."""
