"""What is drawn on the lofted body: parts, windows, seams, lamps, grille, plates, wheel arches.

Every region is a level function over the surface. The surface is cut along its outline, so that outlines are
sharp at any size.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from datasets_synth.car_body import BOTTOM, FRONT_CAP, REAR_CAP, SIDE, TOP, BodyLines
from datasets_synth.car_paint import Finish
from datasets_synth.level_lines import above_curve_level, box_level, line_level, smooth_max
from datasets_synth.mesh_build import Floats, Mask, Soup, cut, recess
from datasets_synth.parts import PART_LABEL

SEAM_M = 0.011
"""Width of a door gap."""
GLAZED_REAR = ("estate", "suv", "minivan")
"""Body types with a window behind the rear door."""


@dataclass(frozen=True, eq=False)
class Points:
    """Coordinates of the corners that a level function is asked about; each of shape (m, 3)."""

    t: Floats
    """Distance from the nose as built."""
    y: Floats
    z: Floats
    s: Floats
    """Station: distance from the nose before nose and tail were bent."""


Level = Callable[[Points], Floats]


def arch_radius(lines: BodyLines) -> float:
    """Radius of the wheel arches in metres."""
    gap = {"suv": 0.062, "pickup": 0.080, "coupe": 0.038}.get(lines.shape.body_type, 0.048)
    return lines.shape.wheel_radius + gap


def well_y(lines: BodyLines) -> float:
    """Distance of the inner wall of the wheel wells from the middle plane."""
    return 0.5 * lines.shape.width - 0.36


def dress_body(body: Soup, lines: BodyLines) -> Soup:
    """The half body with its parts, windows, seams, lamps and wheel wells."""
    steps: tuple[Callable[[Soup, BodyLines], Soup], ...] = (
        _zones_to_parts, _low_trim, _hood, _side_windows, _windscreen, _rear_window,
        _doors, _front_face, _rear_face, _bed, _wheel_wells,
    )  # fmt: skip
    out = body
    for step in steps:
        out = step(out, lines)
    return out


def _points(soup: Soup, lines: BodyLines) -> Points:
    c = soup.corners_m
    return Points(0.5 * lines.shape.length - c[..., 0], c[..., 1], c[..., 2], soup.station)


def _values(soup: Soup, lines: BodyLines, zones: tuple[int, ...], level: Level) -> Floats:
    """Level at the corners of the faces in the zones, NaN elsewhere."""
    out = np.full(soup.corners_m.shape[:2], np.nan)
    where = np.flatnonzero(np.isin(soup.zone, zones))
    out[where] = level(_points(soup.take(where), lines))
    return out


def _divide(soup: Soup, lines: BodyLines, zones: tuple[int, ...], *levels: Level) -> tuple[Soup, Mask]:
    """The surface cut along each level's outline in turn, and its faces inside all of them.

    Several levels keep a corner sharp that one level, being interpolated over a face, would bevel.
    """
    out = soup
    for level in levels:
        out = cut(out, _values(out, lines, zones, level))
    highest = np.maximum.reduce([_values(out, lines, zones, level).mean(1) for level in levels])
    return out, highest < 0


def _paint(
    soup: Soup,
    lines: BodyLines,
    zones: tuple[int, ...],
    levels: Level | tuple[Level, ...],
    finish: Finish | None = None,
    *,
    part: str | None = None,
    only: Finish | None = None,
) -> Soup:
    """The surface with the region inside all levels painted; only: leave faces of other finishes alone."""
    out, inside = _divide(soup, lines, zones, *(levels if isinstance(levels, tuple) else (levels,)))
    if only is not None:
        inside &= out.material == only
    return out.painted(
        inside, None if finish is None else int(finish), None if part is None else PART_LABEL[part]
    )


def _band(soup: Soup, lines: BodyLines, zones: tuple[int, ...], level: Level, width: float = SEAM_M) -> Soup:
    """The surface with a dark line along the outline of a region, where there is paint or trim."""
    out = cut(soup, _values(soup, lines, zones, level))
    out = cut(out, _values(out, lines, zones, level), width)
    middle = _values(out, lines, zones, level).mean(1)
    inside = (middle > 0) & (middle < width) & np.isin(out.material, (Finish.PAINT, Finish.CLADDING))
    return out.painted(inside, int(Finish.SEAM))


def _zones_to_parts(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    rear_top = "trunk" if s.has_deck else "rear"
    steps = (
        (s.tail_t, "rear_window"), (s.roof_rear_t, "roof"), (s.roof_front_t, "windshield"),
        (s.cowl_t, "hood"), (0.06, "front"),
    )  # fmt: skip
    out = soup.painted(soup.zone == BOTTOM, int(Finish.DARK))
    for zone, part in ((SIDE, "left_body"), (FRONT_CAP, "front"), (REAR_CAP, "rear"), (TOP, rear_top)):
        out = out.painted(out.zone == zone, part=PART_LABEL[part])
    for limit, part in steps:

        def ahead(p: Points, limit: float = limit) -> Floats:
            return p.s - limit

        out = _paint(out, lines, (TOP,), ahead, part=part)

    # Round corners of nose and tail belong to the face that they turn into.
    out = _paint(out, lines, (SIDE,), lambda p: p.t - 0.10, part="front")
    return _paint(out, lines, (SIDE,), lambda p: s.length - 0.10 - p.t, part="rear")


def _low_trim(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    high = {"suv": 0.17, "pickup": 0.10, "van": 0.16}.get(s.body_type, 0.055)
    out = _paint(
        soup, lines, (SIDE, FRONT_CAP, REAR_CAP), lambda p: p.z - s.clearance - high, Finish.CLADDING
    )
    if s.body_type != "suv":
        return out
    radius = arch_radius(lines) + 0.065
    for axle in s.axles_t:

        def ring(p: Points, axle: float = axle) -> Floats:
            return np.hypot(p.t - axle, p.z - s.wheel_radius) - radius

        out = _paint(out, lines, (SIDE,), ring, Finish.CLADDING)
    return out


def _top_half_width(lines: BodyLines, s: Floats) -> Floats:
    """Half width of the top surface at stations s."""
    return lines.half_width(s, lines.edge_z(s))


def _hood(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    out = _paint(
        soup, lines, (TOP,), lambda p: np.maximum(s.cowl_t - 0.09 - p.s, p.s - s.cowl_t - 0.02), Finish.TRIM
    )  # fmt: skip

    def level(p: Points) -> Floats:
        side = p.y - 0.86 * _top_half_width(lines, p.s)
        return smooth_max(side, 0.13 - p.s, p.s - s.cowl_t + 0.09, radius=0.03)

    return _band(out, lines, (TOP,), level)


def _roof_edge(lines: BodyLines) -> tuple[Floats, Floats]:
    s = np.linspace(lines.shape.cowl_t - 0.4, lines.shape.length, 90)
    return s, lines.edge_z(s)


def _rear_pillar(p: Points, lines: BodyLines, extra: float = 0.0) -> Floats:
    """Level of the line where the last side window ends, moved back by extra."""
    s = lines.shape
    foot, head = {
        "sedan": (0.40, 0.12), "coupe": (0.62, 0.02), "hatchback": (0.42, 0.26), "estate": (0.26, 0.16),
        "suv": (0.30, 0.18), "minivan": (0.26, 0.16), "pickup": (0.16, 0.10), "van": (0.30, 0.30),
    }[s.body_type]  # fmt: skip
    bottom = (s.tail_t - foot + extra, s.belt_rear_z)
    top = (min(s.roof_rear_t - head, bottom[0] - 0.02) + extra, s.height - 0.1)
    return line_level(p.s, p.z, bottom, top)


def _side_windows(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    edge = _roof_edge(lines)

    def opening(p: Points) -> Floats:
        under_roof = above_curve_level(p.s, p.z, *edge) + (0.035 if s.body_type != "van" else 0.06)
        over_belt = lines.belt_z(p.s) + 0.012 - p.z
        return smooth_max(under_roof, over_belt, _window_end(p, lines), radius=0.06)

    out = _paint(soup, lines, (SIDE,), opening, Finish.SEAL, part="left_windows")

    out = _paint(out, lines, (SIDE,), lambda p: opening(p) + 0.022, Finish.GLASS)
    for centre, width in _pillars(lines):

        def ahead(p: Points, centre: float = centre, width: float = width) -> Floats:
            return centre - width / 2 + 0.06 * (p.z - s.belt_front_z) - p.s

        def behind(p: Points, centre: float = centre, width: float = width) -> Floats:
            return p.s - centre - width / 2 - 0.06 * (p.z - s.belt_front_z)

        out = _paint(out, lines, (SIDE,), (ahead, behind), Finish.SEAL, only=Finish.GLASS)
    return out


def _window_end(p: Points, lines: BodyLines) -> Floats:
    """Level of the rear end of the side windows (a panel van has windows in the front doors alone)."""
    s = lines.shape
    if s.body_type == "van":
        return p.s - s.pillar_t + 0.05
    return _rear_pillar(p, lines)


def _pillars(lines: BodyLines) -> list[tuple[float, float]]:
    """Stations and widths of the dark pillars between the side windows."""
    s = lines.shape
    out = [(s.pillar_t, 0.09 if s.doors == 4 else 0.07)]
    if s.body_type in GLAZED_REAR:
        out.append((_rear_door_end(lines), 0.08))
    elif s.body_type == "sedan":
        out.append((_rear_door_end(lines) - 0.10, 0.03))
    return out if s.body_type != "van" else []


def _rear_door_end(lines: BodyLines) -> float:
    return min(lines.shape.axles_t[1] + 0.12, lines.shape.length - 0.55)


def _windscreen(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape

    def level(p: Points) -> Floats:
        side = p.y - _top_half_width(lines, p.s) + 0.035
        return smooth_max(side, s.cowl_t - p.s, p.s - s.roof_front_t + 0.0, radius=0.06)

    out = _paint(soup, lines, (TOP,), level, Finish.SEAL, part="windshield")
    return _paint(out, lines, (TOP,), lambda p: level(p) + 0.022, Finish.GLASS)


def _rear_window(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    inset = {"sedan": 0.10, "coupe": 0.12, "pickup": 0.14, "van": 0.16}.get(s.body_type, 0.11)

    def level(p: Points) -> Floats:
        side = p.y - _top_half_width(lines, p.s) + inset
        head, foot = lines.top_z(np.array([s.roof_rear_t, s.tail_t])) - [0.05, -0.07]
        return smooth_max(side, s.roof_rear_t - 0.05 - p.s, p.z - head, foot - p.z, radius=0.06)

    out = _paint(soup, lines, (TOP,), level, Finish.SEAL, part="rear_window")
    return _paint(out, lines, (TOP,), lambda p: level(p) + 0.018, Finish.GLASS)


def _doors(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    edge = _roof_edge(lines)
    front_axle, rear_axle = s.axles_t
    radius = arch_radius(lines)
    foot = s.clearance + (0.20 if s.body_type in ("suv", "van", "pickup") else 0.13)
    hinge = max(front_axle + radius + 0.06, s.cowl_t - 0.10)

    def frame(p: Points) -> Floats:
        return np.maximum(above_curve_level(p.s, p.z, *edge) + 0.016, foot - p.z)

    def front(p: Points) -> Floats:
        return smooth_max(
            frame(p), hinge - p.s, p.s - s.pillar_t - 0.06 * (p.z - s.belt_front_z), radius=0.05
        )

    def rear(p: Points) -> Floats:
        start = s.pillar_t + SEAM_M + 0.06 * (p.z - s.belt_front_z)
        wheel = radius + 0.05 - np.hypot(p.t - rear_axle, p.z - s.wheel_radius)
        end = p.s - _rear_door_end(lines)
        if s.body_type not in GLAZED_REAR:
            end = np.maximum(end, _rear_pillar(p, lines, 0.05))
        return smooth_max(frame(p), start - p.s, end, wheel, radius=0.05)

    def sliding(p: Points) -> Floats:
        start = s.pillar_t + 0.02
        return smooth_max(
            frame(p) + 0.05, start - p.s, p.s - min(start + 1.05, rear_axle - radius - 0.05), radius=0.05
        )

    out = _band(soup, lines, (SIDE,), front)
    if s.body_type == "van":
        return _band(out, lines, (SIDE,), sliding)
    return _band(out, lines, (SIDE,), rear) if s.doors == 4 else out


def _front_face(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    w, top, bottom = s.width, s.hood_z, s.clearance
    zones = (FRONT_CAP, SIDE, TOP)
    near = 0.62

    def wrapped(p: Points) -> Floats:
        """Way along the nose from the middle plane, round the corner."""
        return np.where(p.t < near, p.y + 0.8 * p.t, 9.0)

    def sharp(z0: float, y1: float, z1: float) -> tuple[Level, ...]:
        def side(p: Points) -> Floats:
            return np.where(p.t < near, p.y - y1, np.nan)

        return (lambda p: z0 - p.z, lambda p: p.z - z1, side)

    def box(*limits: float, slant: float = 0.0, corner: float = 0.02) -> Level:
        y0, z0, y1, z1 = limits
        return lambda p: box_level(wrapped(p), p.z - slant * (wrapped(p) - y0), (y0, z0, y1, z1), corner)

    tall = s.body_type in ("suv", "van", "pickup")
    lamp_z = top - (0.24 if tall else 0.20)
    lamp = (0.29 * w, lamp_z, 0.29 * w + 0.50, lamp_z + (0.17 if tall else 0.13))
    out = _paint(soup, lines, zones, box(*lamp, slant=0.10, corner=0.05), Finish.LAMP)
    bulb = (lamp[0] + 0.05, lamp[1] + 0.03, lamp[0] + 0.20, lamp[3] - 0.03)
    out = _paint(out, lines, zones, box(*bulb, slant=0.10, corner=0.03), Finish.BULB)
    grille = (-1.0, top - (0.30 if tall else 0.22), 0.26 * w, top - (0.12 if tall else 0.11))
    out = _paint(out, lines, (FRONT_CAP, TOP), sharp(*grille[1:]), Finish.CHROME, only=Finish.PAINT)
    inner = (grille[1] + 0.018, grille[2] - 0.02, grille[3] - 0.02)
    out = _paint(out, lines, (FRONT_CAP, TOP), sharp(*inner), Finish.TRIM, only=Finish.CHROME)
    intake = (-1.0, bottom + 0.05, 0.34 * w, bottom + 0.17)
    out = _paint(out, lines, zones, box(*intake, corner=0.04), Finish.TRIM)
    fog = (0.37 * w, bottom + 0.08, 0.37 * w + 0.10, bottom + 0.15)
    out = _paint(out, lines, zones, box(*fog, corner=0.03), Finish.LAMP)
    plate_z = min(lines.front.bumper_z - 0.01, grille[1] - 0.07)
    out = _paint(out, lines, (FRONT_CAP,), sharp(plate_z - 0.055, 0.26, plate_z + 0.055), Finish.PLATE)
    return _band(
        out, lines, (SIDE,), lambda p: _bumper_edge(p, p.t, s.axles_t[0], lines, lines.front.bumper_z)
    )


def _bumper_edge(p: Points, distance: Floats, axle: float, lines: BodyLines, bumper_z: float) -> Floats:
    """Level of the bumper on the side: below its upper edge and up to the wheel arch."""
    return np.maximum(p.z - bumper_z - 0.17, distance - axle)


def _rear_face(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    w = s.width
    zones = (REAR_CAP, SIDE, TOP)

    def wrapped(p: Points) -> Floats:
        return np.where(s.length - p.t < 0.55, p.y + 0.8 * (s.length - p.t), 9.0)

    def box(y0: float, z0: float, y1: float, z1: float, corner: float = 0.02) -> Level:
        return lambda p: box_level(wrapped(p), p.z, (y0, z0, y1, z1), corner)

    if s.body_type in ("estate", "suv", "van", "minivan", "hatchback"):
        low, high = (0.34, 0.02) if s.body_type == "hatchback" else (0.36, 0.08)
        lamp = (0.355 * w, s.tail_z - low, 0.355 * w + 0.30, s.tail_z + high)
    elif s.body_type == "pickup":
        lamp = (0.43 * w, s.deck_z - 0.46, 0.43 * w + 0.17, s.deck_z - 0.12)
    else:
        lamp = (0.25 * w, s.deck_z - 0.29, 0.25 * w + 0.46, s.deck_z - 0.13)
    out = _paint(soup, lines, zones, box(*lamp, corner=0.04), Finish.TAIL_LAMP)
    blink = (lamp[0] + 0.03, lamp[1] + 0.03, lamp[0] + 0.10, lamp[1] + 0.08)
    out = _paint(out, lines, zones, box(*blink), Finish.INDICATOR)
    low_plate = s.body_type in ("pickup", "hatchback") and s.tail_z < 1.0
    plate_z = lines.rear.bumper_z + (0.02 if low_plate else 0.25)
    plate: tuple[Level, ...] = (
        lambda p: plate_z - 0.055 - p.z, lambda p: p.z - plate_z - 0.055, lambda p: p.y - 0.26,
    )  # fmt: skip
    out = _paint(out, lines, (REAR_CAP,), plate, Finish.PLATE)
    bumper_z = lines.rear.bumper_z + 0.15

    def tailgate(p: Points) -> Floats:
        return smooth_max(p.y - 0.40 * w, bumper_z - p.z, p.z - s.deck_z + 0.02, radius=0.05)

    out = _band(out, lines, (REAR_CAP,), tailgate)
    distance_axle = s.length - s.axles_t[1]
    return _band(
        out, lines, (SIDE,),
        lambda p: _bumper_edge(p, s.length - p.t, distance_axle, lines, lines.rear.bumper_z),
    )  # fmt: skip


def _bed(soup: Soup, lines: BodyLines) -> Soup:
    """The open bed of a pickup, or its dark cover on every second shape."""
    s = lines.shape
    if s.body_type != "pickup":
        return soup

    start, end = s.tail_t + 0.06, s.length - 0.22
    outline: tuple[Level, ...] = (
        lambda p: p.y - 0.5 * s.width + 0.17, lambda p: start - p.t, lambda p: p.t - end,
    )  # fmt: skip
    if int(s.shape_id[-1]) % 2:
        return _paint(soup, lines, (TOP,), outline, Finish.CLADDING)
    out, inside = _divide(soup, lines, (TOP,), *outline)
    hub = np.array([0.5 * (s.length - start - end), 0.0, 0.0])
    floor = s.wheel_radius + arch_radius(lines) + 0.02  # above the wheel wells
    return recess(
        out, inside, axis=2, floor=floor, hub_m=hub, material=Finish.CLADDING, part=PART_LABEL["trunk"]
    )


def _wheel_wells(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    radius, inner = arch_radius(lines), well_y(lines)
    out = soup
    for axle in s.axles_t:

        def circle(p: Points, axle: float = axle) -> Floats:
            return np.hypot(p.t - axle, p.z - s.wheel_radius) - radius

        out, inside = _divide(out, lines, (SIDE, BOTTOM), circle, lambda p: inner - p.y)
        hub = np.array([0.5 * s.length - axle, 0.0, s.wheel_radius])
        out = recess(
            out, inside, axis=1, floor=inner, hub_m=hub, material=Finish.DARK, part=PART_LABEL["left_body"]
        )
    return out
