"""What is drawn on the lofted body: parts, trim, hood, bed, wheel wells.

Windows and doors, nose and tail have modules of their own.
"""

from collections.abc import Callable

import numpy as np

from datasets_synth.cars.body import BOTTOM, FRONT_CAP, REAR_CAP, SIDE, TOP, BodyLines, arch_radius, well_y
from datasets_synth.cars.body_cuts import Level, Points, band, divide, paint, smooth_max
from datasets_synth.cars.ends import front_face, rear_face
from datasets_synth.cars.paint import Finish
from datasets_synth.cars.parts import PART_LABEL
from datasets_synth.cars.windows import doors, rear_window, side_windows, top_half_width, windscreen
from datasets_synth.meshes.mesh_build import Soup, recess
from recon.arrays import FloatArray

_SHALLOW_M = 0.1
"""A bed less deep than this is closed."""
_COCKPIT_FLOOR_M = 0.45


def dress_body(body: Soup, lines: BodyLines) -> Soup:
    """The half body with its parts, windows, seams, lamps and wheel wells."""
    steps: tuple[Callable[[Soup, BodyLines], Soup], ...] = (
        _zones_to_parts, _low_trim, _hood, side_windows, windscreen, rear_window,
        doors, front_face, rear_face, _bed, _wheel_wells,
    )  # fmt: skip
    out = body
    for step in steps:
        out = step(out, lines)
    return out


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

        def ahead(p: Points, limit: float = limit) -> FloatArray:
            return p.s - limit

        out = paint(out, lines, (TOP,), ahead, part=part)

    # Round corners of nose and tail belong to the face that they turn into.
    out = paint(out, lines, (SIDE,), lambda p: p.t - 0.10, part="front")
    return paint(out, lines, (SIDE,), lambda p: s.length - 0.10 - p.t, part="rear")


def _low_trim(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    high = {"suv": 0.17, "pickup": 0.10, "van": 0.16}.get(s.body_type, 0.055)
    out = paint(soup, lines, (SIDE, FRONT_CAP, REAR_CAP), lambda p: p.z - s.clearance - high, Finish.CLADDING)
    if s.body_type != "suv":
        return out
    radius = arch_radius(lines) + 0.065
    for axle in s.axles_t:

        def ring(p: Points, axle: float = axle) -> FloatArray:
            return np.hypot(p.t - axle, p.z - s.wheel_radius) - radius

        out = paint(out, lines, (SIDE,), ring, Finish.CLADDING)
    return out


def _hood(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    out = paint(
        soup, lines, (TOP,), lambda p: np.maximum(s.cowl_t - 0.09 - p.s, p.s - s.cowl_t - 0.02), Finish.TRIM
    )  # fmt: skip

    def level(p: Points) -> FloatArray:
        side = p.y - 0.86 * top_half_width(lines, p.s)
        return smooth_max(side, 0.13 - p.s, p.s - s.cowl_t + 0.09, radius=0.03)

    return band(out, lines, (TOP,), level)


def _bed(soup: Soup, lines: BodyLines) -> Soup:
    """The open bed of a pickup, or its dark cover on every second shape and where the bed is low."""
    s = lines.shape
    if s.add_ons.screen_z:
        return _cockpit(soup, lines)
    if s.body_type != "pickup":
        return soup

    start, end = s.tail_t + 0.06, s.length - 0.22
    outline: tuple[Level, ...] = (
        lambda p: p.y - 0.5 * s.width + 0.17, lambda p: start - p.t, lambda p: p.t - end,
    )  # fmt: skip
    floor = s.wheel_radius + arch_radius(lines) + 0.02  # above the wheel wells
    if int(s.shape_id[-1]) % 2 or floor > s.deck_z - _SHALLOW_M:
        return paint(soup, lines, (TOP,), outline, Finish.CLADDING)
    out, inside = divide(soup, lines, (TOP,), *outline)
    hub = np.array([0.5 * (s.length - start - end), 0.0, 0.0])
    return recess(
        out, inside, axis=2, floor=floor, hub_m=hub, material=Finish.CLADDING, part=PART_LABEL["trunk"]
    )


def _cockpit(soup: Soup, lines: BodyLines) -> Soup:
    """The open inside of a car without a roof."""
    s = lines.shape
    start, end = s.cowl_t + 0.12, s.roof_rear_t + 0.02
    outline: tuple[Level, ...] = (
        lambda p: p.y - 0.5 * s.width + 0.19, lambda p: start - p.t, lambda p: p.t - end,
    )  # fmt: skip
    out, inside = divide(soup, lines, (TOP,), *outline)
    hub = np.array([0.5 * (s.length - start - end), 0.0, 0.0])
    return recess(
        out, inside, axis=2, floor=_COCKPIT_FLOOR_M, hub_m=hub, material=Finish.TRIM, part=PART_LABEL["roof"]
    )


def _wheel_wells(soup: Soup, lines: BodyLines) -> Soup:
    s = lines.shape
    if s.add_ons.track:
        return soup
    radius, inner = arch_radius(lines), well_y(lines)
    out = soup
    for axle in s.axles_t:

        def circle(p: Points, axle: float = axle) -> FloatArray:
            return np.hypot(p.t - axle, p.z - s.wheel_radius) - radius

        out, inside = divide(out, lines, (SIDE, BOTTOM), circle, lambda p: inner - p.y)
        hub = np.array([0.5 * s.length - axle, 0.0, s.wheel_radius])
        out = recess(
            out, inside, axis=1, floor=inner, hub_m=hub, material=Finish.DARK, part=PART_LABEL["left_body"]
        )
    return out
