"""Nose and tail of a car: lamps, grille, plates, bumpers, tailgate."""

import numpy as np

from datasets_synth.cars.body import FRONT_CAP, REAR_CAP, SIDE, TOP, BodyLines
from datasets_synth.cars.body_cuts import Level, Points, band, box_level, paint, smooth_max
from datasets_synth.cars.paint import Finish
from datasets_synth.meshes.mesh_build import Soup
from recon.arrays import FloatArray


def front_face(soup: Soup, lines: BodyLines) -> Soup:
    """Lamps, grille, intake, plate and bumper of the nose."""
    s = lines.shape
    w, top, bottom = s.width, s.hood_z, s.clearance
    zones = (FRONT_CAP, SIDE, TOP)
    near = 0.62

    def wrapped(p: Points) -> FloatArray:
        """Way along the nose from the middle plane, round the corner."""
        return np.where(p.t < near, p.y + 0.8 * p.t, 9.0)

    def sharp(z0: float, y1: float, z1: float) -> tuple[Level, ...]:
        def side(p: Points) -> FloatArray:
            return np.where(p.t < near, p.y - y1, np.nan)

        return (lambda p: z0 - p.z, lambda p: p.z - z1, side)

    def box(*limits: float, slant: float = 0.0, corner: float = 0.02) -> Level:
        y0, z0, y1, z1 = limits
        return lambda p: box_level(wrapped(p), p.z - slant * (wrapped(p) - y0), (y0, z0, y1, z1), corner)

    tall = s.body_type in ("suv", "van", "pickup")
    lamp_z = top - (0.24 if tall else 0.20)
    lamp = (0.29 * w, lamp_z, 0.29 * w + 0.50, lamp_z + (0.17 if tall else 0.13))
    out = paint(soup, lines, zones, box(*lamp, slant=0.10, corner=0.05), Finish.LAMP)
    bulb = (lamp[0] + 0.05, lamp[1] + 0.03, lamp[0] + 0.20, lamp[3] - 0.03)
    out = paint(out, lines, zones, box(*bulb, slant=0.10, corner=0.03), Finish.BULB)
    grille = (-1.0, top - (0.30 if tall else 0.22), 0.26 * w, top - (0.12 if tall else 0.11))
    out = paint(out, lines, (FRONT_CAP, TOP), sharp(*grille[1:]), Finish.CHROME, only=Finish.PAINT)
    inner = (grille[1] + 0.018, grille[2] - 0.02, grille[3] - 0.02)
    out = paint(out, lines, (FRONT_CAP, TOP), sharp(*inner), Finish.TRIM, only=Finish.CHROME)
    intake = (-1.0, bottom + 0.05, 0.34 * w, bottom + 0.17)
    out = paint(out, lines, zones, box(*intake, corner=0.04), Finish.TRIM)
    fog = (0.37 * w, bottom + 0.08, 0.37 * w + 0.10, bottom + 0.15)
    out = paint(out, lines, zones, box(*fog, corner=0.03), Finish.LAMP)
    plate_z = min(lines.front.bumper_z - 0.01, grille[1] - 0.07)
    out = paint(out, lines, (FRONT_CAP,), sharp(plate_z - 0.055, 0.26, plate_z + 0.055), Finish.PLATE)
    return band(
        out, lines, (SIDE,), lambda p: _bumper_edge(p, p.t, s.axles_t[0], lines, lines.front.bumper_z)
    )


def _bumper_edge(
    p: Points, distance: FloatArray, axle: float, lines: BodyLines, bumper_z: float
) -> FloatArray:
    """Level of the bumper on the side: below its upper edge and up to the wheel arch."""
    return np.maximum(p.z - bumper_z - 0.17, distance - axle)


def rear_face(soup: Soup, lines: BodyLines) -> Soup:
    """Lamps, plate, tailgate and bumper of the tail."""
    s = lines.shape
    w = s.width
    zones = (REAR_CAP, SIDE, TOP)

    def wrapped(p: Points) -> FloatArray:
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
    out = paint(soup, lines, zones, box(*lamp, corner=0.04), Finish.TAIL_LAMP)
    blink = (lamp[0] + 0.03, lamp[1] + 0.03, lamp[0] + 0.10, lamp[1] + 0.08)
    out = paint(out, lines, zones, box(*blink), Finish.INDICATOR)
    low_plate = s.body_type in ("pickup", "hatchback") and s.tail_z < 1.0
    plate_z = lines.rear.bumper_z + (0.02 if low_plate else 0.25)
    plate: tuple[Level, ...] = (
        lambda p: plate_z - 0.055 - p.z, lambda p: p.z - plate_z - 0.055, lambda p: p.y - 0.26,
    )  # fmt: skip
    out = paint(out, lines, (REAR_CAP,), plate, Finish.PLATE)
    bumper_z = lines.rear.bumper_z + 0.15

    def tailgate(p: Points) -> FloatArray:
        return smooth_max(p.y - 0.40 * w, bumper_z - p.z, p.z - s.deck_z + 0.02, radius=0.05)

    out = band(out, lines, (REAR_CAP,), tailgate)
    distance_axle = s.length - s.axles_t[1]
    return band(
        out, lines, (SIDE,),
        lambda p: _bumper_edge(p, s.length - p.t, distance_axle, lines, lines.rear.bumper_z),
    )  # fmt: skip
