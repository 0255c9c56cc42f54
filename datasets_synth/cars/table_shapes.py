"""Further car shapes, for model cars on a table: racers, open cars, small, old and working cars.

They stand apart from `datasets_synth.cars.shapes.car_shapes`, so that streets keep their cars.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

from datasets_synth.cars.shapes import AddOns, BodyForm, CarShape, shape_of
from datasets_synth.meshes.families import Ranges, latin_hypercube

SHAPES_PER_KIND = 4


@dataclass(frozen=True)
class _Kind:
    """Measures of a kind of car (see `datasets_synth.cars.shapes`); ranges named as in ``AddOns`` are of
    these."""

    body_type: str
    ranges: Ranges
    doors: int = 2


_WINGLESS = 2
"""One racer of four has no wing, as those of the sixties."""

_KINDS: dict[str, _Kind] = {
    "racer": _Kind("coupe", {
        "length": (4.20, 4.90), "width": (1.86, 2.04), "height": (1.04, 1.20),
        "overhang": (0.88, 1.06), "rear_axle": (0.74, 0.98),
        "wheel_radius": (0.295, 0.325), "clearance": (0.07, 0.11), "hood_z": (0.50, 0.60),
        "cowl": (0.20, 0.55),
        "cowl_z": (0.76, 0.84), "screen": (0.75, 1.00), "rear_roof": (1.30, 1.80),
        "roof_drop": (0.03, 0.08),
        "rear_tail": (0.35, 0.85), "tail_z": (0.82, 0.92), "deck_drop": (0.00, 0.08),
        "belt": (0.72, 0.78), "belt_rise": (0.02, 0.10),
        "lean": (22, 29), "pillar": (0.56, 0.62),
        "wing_z": (0.98, 1.28),
    }),
    "tuned": _Kind("hatchback", {
        "length": (3.80, 4.50), "width": (1.74, 1.88), "height": (1.34, 1.46),
        "overhang": (0.82, 0.94), "rear_axle": (0.62, 0.85),
        "wheel_radius": (0.300, 0.335), "clearance": (0.10, 0.14), "hood_z": (0.66, 0.74),
        "cowl": (0.28, 0.50),
        "cowl_z": (0.90, 0.97), "screen": (0.72, 0.95), "rear_roof": (0.70, 1.15),
        "roof_drop": (0.06, 0.12),
        "rear_tail": (0.10, 0.30), "tail_z": (0.92, 1.02), "deck_drop": (0.03, 0.08),
        "belt": (0.84, 0.90), "belt_rise": (0.02, 0.09),
        "lean": (16, 22), "pillar": (0.55, 0.61),
        "wing_z": (1.22, 1.50),
    }),
    "wedge": _Kind("coupe", {
        "length": (4.00, 4.60), "width": (1.80, 2.00), "height": (1.06, 1.22),
        "overhang": (0.92, 1.12), "rear_axle": (0.70, 0.92),
        "wheel_radius": (0.300, 0.325), "clearance": (0.10, 0.14), "hood_z": (0.52, 0.61),
        "cowl": (0.00, 0.35),
        "cowl_z": (0.76, 0.84), "screen": (0.90, 1.20), "rear_roof": (1.40, 2.00),
        "roof_drop": (0.02, 0.06),
        "rear_tail": (0.30, 1.10), "tail_z": (0.86, 0.96), "deck_drop": (0.00, 0.06),
        "belt": (0.72, 0.78), "belt_rise": (0.06, 0.14),
        "lean": (22, 29), "pillar": (0.52, 0.58),
    }),
    "formula": _Kind("coupe", {
        "length": (3.90, 4.80), "width": (0.78, 0.98), "height": (0.86, 1.00),
        "overhang": (0.92, 1.15), "rear_axle": (0.52, 0.68),
        "wheel_radius": (0.29, 0.335), "clearance": (0.06, 0.09), "hood_z": (0.40, 0.48),
        "cowl": (0.42, 0.62),
        "cowl_z": (0.60, 0.66), "screen": (0.50, 0.70), "rear_roof": (1.15, 1.45),
        "roof_drop": (0.02, 0.06),
        "rear_tail": (0.16, 0.30), "tail_z": (0.50, 0.60), "deck_drop": (0.02, 0.08),
        "belt": (0.56, 0.60), "belt_rise": (0.0, 0.04),
        "lean": (16, 22), "pillar": (0.40, 0.46),
        "track": (1.70, 2.00), "wing_z": (0.84, 1.06),
    }, doors=0),
    "roadster": _Kind("coupe", {
        "length": (3.80, 4.50), "width": (1.62, 1.84), "height": (0.90, 1.00),
        "overhang": (0.76, 0.92), "rear_axle": (0.72, 0.95),
        "wheel_radius": (0.290, 0.325), "clearance": (0.12, 0.16), "hood_z": (0.64, 0.72),
        "cowl": (0.45, 0.80),
        "cowl_z": (0.87, 0.94), "screen": (0.10, 0.14), "rear_roof": (0.85, 1.15),
        "roof_drop": (0.01, 0.03),
        "rear_tail": (0.70, 0.80), "tail_z": (0.88, 0.94), "deck_drop": (0.05, 0.14),
        "belt": (0.86, 0.90), "belt_rise": (0.00, 0.03),
        "lean": (10, 16), "pillar": (0.56, 0.62),
        "screen_z": (1.14, 1.34),
    }),
    "classic": _Kind("sedan", {
        "length": (4.50, 5.60), "width": (1.68, 1.98), "height": (1.42, 1.64),
        "overhang": (0.72, 0.95), "rear_axle": (1.15, 1.50),
        "wheel_radius": (0.320, 0.360), "clearance": (0.17, 0.21), "hood_z": (0.80, 0.90),
        "cowl": (0.55, 1.00),
        "cowl_z": (0.98, 1.06), "screen": (0.40, 0.62), "rear_roof": (1.65, 2.10),
        "roof_drop": (0.03, 0.09),
        "rear_tail": (1.05, 1.45), "tail_z": (0.98, 1.06), "deck_drop": (0.06, 0.22),
        "belt": (0.92, 0.97), "belt_rise": (0.00, 0.04),
        "lean": (14, 20), "pillar": (0.48, 0.54),
    }, doors=4),
    "bubble": _Kind("hatchback", {
        "length": (3.40, 4.30), "width": (1.52, 1.76), "height": (1.42, 1.56),
        "overhang": (0.66, 0.82), "rear_axle": (0.78, 0.98),
        "wheel_radius": (0.295, 0.335), "clearance": (0.16, 0.20), "hood_z": (0.68, 0.78),
        "cowl": (0.35, 0.60),
        "cowl_z": (0.96, 1.04), "screen": (0.45, 0.65), "rear_roof": (1.20, 1.60),
        "roof_drop": (0.12, 0.24),
        "rear_tail": (0.18, 0.42), "tail_z": (0.74, 0.88), "deck_drop": (0.08, 0.16),
        "belt": (0.90, 0.95), "belt_rise": (-0.10, -0.02),
        "lean": (16, 22), "pillar": (0.52, 0.58),
    }),
    "kei": _Kind("minivan", {
        "length": (2.50, 3.40), "width": (1.40, 1.56), "height": (1.46, 1.88),
        "overhang": (0.46, 0.62), "rear_axle": (0.36, 0.50),
        "wheel_radius": (0.260, 0.290), "clearance": (0.14, 0.18), "hood_z": (0.76, 0.88),
        "cowl": (-0.04, 0.14),
        "cowl_z": (0.98, 1.06), "screen": (0.45, 0.70), "rear_roof": (0.10, 0.30),
        "roof_drop": (0.02, 0.06),
        "rear_tail": (0.04, 0.10), "tail_z": (0.96, 1.06), "deck_drop": (0.03, 0.05),
        "belt": (0.90, 0.96), "belt_rise": (0.00, 0.06),
        "lean": (6, 12), "pillar": (0.52, 0.58),
    }),
    "stubby": _Kind("sedan", {
        "length": (2.70, 3.60), "width": (1.56, 1.84), "height": (1.34, 1.62),
        "overhang": (0.60, 0.74), "rear_axle": (0.58, 0.72),
        "wheel_radius": (0.320, 0.390), "clearance": (0.16, 0.22), "hood_z": (0.80, 0.92),
        "cowl": (0.05, 0.30),
        "cowl_z": (0.98, 1.06), "screen": (0.30, 0.50), "rear_roof": (0.60, 0.95),
        "roof_drop": (0.02, 0.06),
        "rear_tail": (0.30, 0.55), "tail_z": (1.00, 1.08), "deck_drop": (0.02, 0.10),
        "belt": (0.92, 0.97), "belt_rise": (0.00, 0.05),
        "lean": (12, 20), "pillar": (0.50, 0.56),
    }),
    "offroader": _Kind("suv", {
        "length": (3.40, 4.50), "width": (1.60, 1.90), "height": (1.74, 2.02),
        "overhang": (0.60, 0.76), "rear_axle": (0.58, 0.85),
        "wheel_radius": (0.345, 0.400), "clearance": (0.25, 0.32), "hood_z": (1.00, 1.10),
        "cowl": (0.35, 0.60),
        "cowl_z": (1.12, 1.20), "screen": (0.22, 0.42), "rear_roof": (0.05, 0.14),
        "roof_drop": (0.01, 0.04),
        "rear_tail": (0.03, 0.06), "tail_z": (1.14, 1.22), "deck_drop": (0.02, 0.05),
        "belt": (1.08, 1.14), "belt_rise": (0.00, 0.03),
        "lean": (5, 10), "pillar": (0.50, 0.56),
        "spare": (0.16, 0.24),
    }),
    "truck": _Kind("pickup", {
        "length": (4.60, 6.00), "width": (1.72, 2.00), "height": (1.80, 2.05),
        "overhang": (0.78, 0.95), "rear_axle": (0.95, 1.25),
        "wheel_radius": (0.320, 0.360), "clearance": (0.24, 0.30), "hood_z": (1.02, 1.12),
        "cowl": (0.00, 0.30),
        "cowl_z": (1.20, 1.28), "screen": (0.50, 0.75), "rear_roof": (2.40, 2.90),
        "roof_drop": (0.02, 0.05),
        "rear_tail": (2.25, 2.75), "tail_z": (1.00, 1.08), "deck_drop": (0.00, 0.02),
        "belt": (1.14, 1.20), "belt_rise": (0.0, 0.02),
        "lean": (8, 13), "pillar": (0.34, 0.38),
        "box_z": (2.00, 2.50),
    }),
    "flatbed": _Kind("pickup", {
        "length": (4.60, 5.80), "width": (1.72, 1.98), "height": (1.66, 1.92),
        "overhang": (0.82, 0.95), "rear_axle": (0.95, 1.25),
        "wheel_radius": (0.330, 0.370), "clearance": (0.26, 0.32), "hood_z": (0.98, 1.08),
        "cowl": (0.15, 0.60),
        "cowl_z": (1.16, 1.24), "screen": (0.50, 0.72), "rear_roof": (1.90, 2.50),
        "roof_drop": (0.02, 0.05),
        "rear_tail": (1.75, 2.35), "tail_z": (0.98, 1.04), "deck_drop": (0.00, 0.02),
        "belt": (1.08, 1.14), "belt_rise": (0.0, 0.02),
        "lean": (10, 15), "pillar": (0.40, 0.46),
    }),
}  # fmt: skip

_FORMS: Ranges = {
    "sill_tuck": (0.0, 0.10),
    "end_tuck": (-0.02, 0.14),
    "end_rise": (0.0, 1.5),
    "end_round": (0.6, 1.5),
    "crown": (0.6, 1.6),
    "skirt": (0.0, 0.7),
}
"""What the forms of shapes to learn from vary in, so that the class does not take one underside for that of
all cars: ``BodyForm``, and by how much of the clearance skirts lower the body."""
_FORMED = (0, 2)
"""Numbers of the shapes of a kind that have forms of their own."""

KINDS = tuple(_KINDS)
"""Names of the kinds; shapes are called after them."""


@lru_cache(maxsize=1)
def table_shapes() -> tuple[CarShape, ...]:
    """Further shapes for the table, always the same: `SHAPES_PER_KIND` of each kind."""
    plain = [
        _shape(name, i, draw)
        for k, (name, kind) in enumerate(_KINDS.items())
        for i, draw in enumerate(latin_hypercube(kind.ranges, SHAPES_PER_KIND, [20091130, k]))
    ]
    forms = iter(latin_hypercube(_FORMS, len(_FORMED) * len(_KINDS), [20091201]))
    return tuple(
        _formed(shape, next(forms)) if i % SHAPES_PER_KIND in _FORMED else shape
        for i, shape in enumerate(plain)
    )


def _formed(shape: CarShape, draw: dict[str, float]) -> CarShape:
    """The shape with a form of its own."""
    form = BodyForm(**{n: draw[n] for n in BodyForm.__annotations__})
    return replace(shape, clearance=shape.clearance * (1 - draw["skirt"]), form=form)


def _shape(name: str, number: int, draw: dict[str, float]) -> CarShape:
    kind, more = _KINDS[name], {n: draw[n] for n in draw if n in AddOns.__annotations__}
    if number == _WINGLESS:
        more["wing_z"] = 0.0
    plain = shape_of(kind.body_type, number, draw)
    if "screen_z" in more:
        tail_t = plain.roof_rear_t + 0.06
        plain = replace(plain, tail_t=tail_t)
    return replace(plain, shape_id=f"{name}_{number:02d}", doors=kind.doors, add_ons=AddOns(**more))
