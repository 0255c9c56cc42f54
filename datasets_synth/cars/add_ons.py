"""What stands on, beside or behind the body of a car: wings, the arms of free wheels, windscreens of open
cars, cargo boxes, spare wheels."""

import numpy as np

from datasets_synth.cars.body import BodyLines
from datasets_synth.cars.details import ellipsoid
from datasets_synth.cars.paint import Finish
from datasets_synth.cars.parts import PART_LABEL
from datasets_synth.meshes.mesh_build import Soup, grid_corners, soup_of
from recon.arrays import FloatArray

_CREASE_RAD = float(np.deg2rad(30))
_FRAME_M = 0.036
"""Thickness of the windscreen of an open car."""
_TYRE = 0.95
"""Radius of a spare wheel in radii of the others."""


def add_ons(lines: BodyLines) -> list[Soup]:
    """The left halves of everything that a shape has beside its body."""
    more = lines.shape.add_ons
    out: list[Soup] = []
    if more.wing_z:
        out += _rear_wing(lines)
    if more.track:
        out += _free_wheels(lines)
    if more.screen_z:
        out += _open_top(lines)
    if more.box_z:
        out += _cargo_box(lines)
    if more.spare:
        out.append(_spare_wheel(lines))
    return out


def _prism(
    profile_tz: FloatArray, y: tuple[float, float], lines: BodyLines, finish: Finish, part: str
) -> Soup:
    """A convex profile (n, 2) of stations and heights, clockwise as seen from the left, drawn from y[0] to
    y[1]; ends in the middle plane stay open."""
    t, z = np.concatenate([profile_tz, profile_tz[:1]]).T
    x = 0.5 * lines.shape.length - t
    rings = [np.stack([x, np.full_like(x, side), z], axis=-1) for side in y]
    middle = np.array([x[:-1].mean(), 0.0, z[:-1].mean()])
    caps = [np.broadcast_to(middle + np.array([0.0, side, 0.0]), rings[0].shape) for side in y]
    rows = [rings[0], rings[1], caps[1]] if y[0] == 0.0 else [caps[0], rings[0], rings[1], caps[1]]
    corners = grid_corners(np.stack(rows))
    return soup_of(corners, material=finish, part=PART_LABEL[part], crease_rad=_CREASE_RAD)


def _box(
    t: tuple[float, float], y: tuple[float, float], z: tuple[float, float], lines: BodyLines,
    finish: Finish, part: str,
) -> Soup:  # fmt: skip
    profile = np.array([(t[0], z[0]), (t[0], z[1]), (t[1], z[1]), (t[1], z[0])])
    return _prism(profile, y, lines, finish, part)


def _foil(start: float, chord: float, z: float, rise: float) -> FloatArray:
    """Profile (6, 2) of a wing that rises towards the tail, its upper rear edge at height z."""
    end = start + chord
    return np.array(
        [
            (start, z - rise - 0.03),
            (start + 0.04, z - rise),
            (end - 0.5 * chord, z - 0.35 * rise),
            (end, z),
            (end, z - 0.03),
            (end - 0.5 * chord, z - 0.35 * rise - 0.05),
        ]
    )


def _rear_wing(lines: BodyLines) -> list[Soup]:
    """A wing over the tail on two supports, with end plates."""
    s = lines.shape
    z, free = s.add_ons.wing_z, s.add_ons.track > 0
    half = 0.27 * s.add_ons.track if free else 0.44 * s.width
    chord = 0.34 if free else 0.30
    end = s.length - 0.01
    start = end - chord
    foot = float(lines.top_z(np.array(end - 0.15))) - 0.12
    stand = (0.0, 0.03) if free else (0.55 * half, 0.55 * half + 0.03)
    return [
        _prism(_foil(start, chord, z, 0.07), (0.0, half), lines, Finish.PAINT, "rear"),
        _box((start + 0.01, end), (half, half + 0.025), (z - 0.20, z), lines, Finish.PAINT, "rear"),
        _box((end - 0.24, end - 0.10), stand, (foot, z - 0.06), lines, Finish.CLADDING, "rear"),
    ]


def _free_wheels(lines: BodyLines) -> list[Soup]:
    """Arms from the body to the wheels, and, where there is a rear wing, one under the nose."""
    s = lines.shape
    r, outer = s.wheel_radius, 0.5 * s.add_ons.track - 0.16
    out = [
        _box((axle + t - 0.03, axle + t + 0.03), (0.10, outer), (z - 0.02, z + 0.02), lines, Finish.CLADDING,
             "left_body")
        for axle in s.axles_t for t, z in ((-0.14, 0.8 * r), (0.14, 0.8 * r), (0.0, 1.25 * r))
    ]  # fmt: skip
    if s.add_ons.wing_z:
        half = 0.5 * s.add_ons.track - 0.06
        out.append(_prism(_foil(0.0, 0.42, 0.20, 0.06), (0.0, half), lines, Finish.PAINT, "front"))
        out.append(_box((0.0, 0.46), (half, half + 0.025), (0.07, 0.30), lines, Finish.PAINT, "front"))
    return out


def _open_top(lines: BodyLines) -> list[Soup]:
    """Windscreen in its frame, seats and head rests."""
    s = lines.shape
    low, high = s.cowl_z - 0.06, s.add_ons.screen_z - 0.5 * _FRAME_M
    start = s.cowl_t - 0.02
    foot, head = np.array([start, low]), np.array([start + 1.15 * (high - low), high])
    half = 0.41 * s.width
    along = (head - foot) / np.hypot(*(head - foot))
    back = np.array([along[1], -along[0]]) * 0.5 * _FRAME_M
    frame = np.array([foot - back, head - back, head + back, foot + back])
    glass = frame + np.array([-0.012, 0.008])
    glass += (glass.mean(axis=0) - glass) * 0.10
    x, middle = 0.5 * s.length - s.roof_rear_t + 0.22, 0.23 * s.width
    seat = ellipsoid((x, middle, 0.72), (0.12, 0.23, 0.34))
    rest = ellipsoid((x - 0.05, middle, 1.06), (0.05, 0.13, 0.09))
    label = PART_LABEL["roof"]
    return [
        _prism(frame, (0.0, half), lines, Finish.SEAL, "windshield"),
        _prism(glass, (0.0, half - 0.05), lines, Finish.GLASS, "windshield"),
        soup_of(seat, material=Finish.TRIM, part=label),
        soup_of(rest, material=Finish.TRIM, part=label),
    ]


def _cargo_box(lines: BodyLines) -> list[Soup]:
    """A box on the bed of a truck, from behind the cab to the tail."""
    s = lines.shape
    start, end, floor = s.tail_t + 0.04, s.length, s.deck_z - 0.12
    half, top = 0.5 * s.width, s.add_ons.box_z
    grid = _box((start, end), (0.0, half), (floor, top), lines, Finish.PAINT, "left_body")
    middle = grid.corners_m.mean(axis=1)
    x = 0.5 * s.length - middle[:, 0]
    out = grid.painted(middle[:, 2] > top - 0.01, part=PART_LABEL["roof"])
    return [out.painted(x > end - 0.01, part=PART_LABEL["rear"])]


def _spare_wheel(lines: BodyLines) -> Soup:
    """The left half of a wheel on the tail."""
    s = lines.shape
    r = _TYRE * s.wheel_radius
    x0, z0 = -0.5 * s.length, s.clearance + 0.42 + r
    angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
    end = -s.add_ons.spare
    rings = [
        (0.0, 0.06),
        (r, 0.06),
        (r, end + 0.04),
        (0.93 * r, end),
        (0.66 * r, end),
        (0.62 * r, end + 0.03),
    ]
    rings.append((0.0, end + 0.02))
    points = np.stack(
        [
            np.stack(
                [np.full_like(angle, x0 + x), radius * np.cos(angle), z0 + radius * np.sin(angle)], axis=-1
            )
            for radius, x in rings
        ]
    )
    points[:, [0, -1], 1] = 0.0
    return soup_of(
        grid_corners(points), material=Finish.TYRE, part=PART_LABEL["rear"], crease_rad=_CREASE_RAD
    )
