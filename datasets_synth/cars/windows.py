"""Windows and doors of a car."""

import numpy as np

from datasets_synth.cars.body import SIDE, TOP, BodyLines, arch_radius
from datasets_synth.cars.body_cuts import (
    SEAM_M,
    Points,
    above_curve_level,
    band,
    line_level,
    paint,
    smooth_max,
)
from datasets_synth.cars.paint import Finish
from datasets_synth.meshes.mesh_build import Soup
from recon.arrays import FloatArray

GLAZED_REAR = ("estate", "suv", "minivan")
"""Body types with a window behind the rear door."""


def top_half_width(lines: BodyLines, s: FloatArray) -> FloatArray:
    """Half width of the top surface at stations s."""
    return lines.half_width(s, lines.edge_z(s))


def _roof_edge(lines: BodyLines) -> tuple[FloatArray, FloatArray]:
    s = np.linspace(lines.shape.cowl_t - 0.4, lines.shape.length, 90)
    return s, lines.edge_z(s)


def _rear_pillar(p: Points, lines: BodyLines, extra: float = 0.0) -> FloatArray:
    """Level of the line where the last side window ends, moved back by extra."""
    s = lines.shape
    foot, head = {
        "sedan": (0.40, 0.12), "coupe": (0.62, 0.02), "hatchback": (0.42, 0.26), "estate": (0.26, 0.16),
        "suv": (0.30, 0.18), "minivan": (0.26, 0.16), "pickup": (0.16, 0.10), "van": (0.30, 0.30),
    }[s.body_type]  # fmt: skip
    bottom = (s.tail_t - foot + extra, s.belt_rear_z)
    top = (min(s.roof_rear_t - head, bottom[0] - 0.02) + extra, s.height - 0.1)
    return line_level(p.s, p.z, bottom, top)


def side_windows(soup: Soup, lines: BodyLines) -> Soup:
    """Side windows with their pillars."""
    s = lines.shape
    edge = _roof_edge(lines)

    def opening(p: Points) -> FloatArray:
        under_roof = above_curve_level(p.s, p.z, *edge) + (0.035 if s.body_type != "van" else 0.06)
        over_belt = lines.belt_z(p.s) + 0.012 - p.z
        return smooth_max(under_roof, over_belt, _window_end(p, lines), radius=0.06)

    out = paint(soup, lines, (SIDE,), opening, Finish.SEAL, part="left_windows")

    out = paint(out, lines, (SIDE,), lambda p: opening(p) + 0.022, Finish.GLASS)
    for centre, width in _pillars(lines):

        def ahead(p: Points, centre: float = centre, width: float = width) -> FloatArray:
            return centre - width / 2 + 0.06 * (p.z - s.belt_front_z) - p.s

        def behind(p: Points, centre: float = centre, width: float = width) -> FloatArray:
            return p.s - centre - width / 2 - 0.06 * (p.z - s.belt_front_z)

        out = paint(out, lines, (SIDE,), (ahead, behind), Finish.SEAL, only=Finish.GLASS)
    return out


def _window_end(p: Points, lines: BodyLines) -> FloatArray:
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


def windscreen(soup: Soup, lines: BodyLines) -> Soup:
    """Windscreen in its seal."""
    s = lines.shape

    def level(p: Points) -> FloatArray:
        side = p.y - top_half_width(lines, p.s) + 0.035
        return smooth_max(side, s.cowl_t - p.s, p.s - s.roof_front_t + 0.0, radius=0.06)

    out = paint(soup, lines, (TOP,), level, Finish.SEAL, part="windshield")
    return paint(out, lines, (TOP,), lambda p: level(p) + 0.022, Finish.GLASS)


def rear_window(soup: Soup, lines: BodyLines) -> Soup:
    """Rear window in its seal."""
    s = lines.shape
    inset = {"sedan": 0.10, "coupe": 0.12, "pickup": 0.14, "van": 0.16}.get(s.body_type, 0.11)

    def level(p: Points) -> FloatArray:
        side = p.y - top_half_width(lines, p.s) + inset
        head, foot = lines.top_z(np.array([s.roof_rear_t, s.tail_t])) - [0.05, -0.07]
        return smooth_max(side, s.roof_rear_t - 0.05 - p.s, p.z - head, foot - p.z, radius=0.06)

    out = paint(soup, lines, (TOP,), level, Finish.SEAL, part="rear_window")
    return paint(out, lines, (TOP,), lambda p: level(p) + 0.018, Finish.GLASS)


def doors(soup: Soup, lines: BodyLines) -> Soup:
    """Door gaps: two or four doors, or the sliding door of a van."""
    s = lines.shape
    if not s.doors:
        return soup
    edge = _roof_edge(lines)
    front_axle, rear_axle = s.axles_t
    radius = arch_radius(lines)
    foot = s.clearance + (0.20 if s.body_type in ("suv", "van", "pickup") else 0.13)
    hinge = max(front_axle + radius + 0.06, s.cowl_t - 0.10)

    def frame(p: Points) -> FloatArray:
        return np.maximum(above_curve_level(p.s, p.z, *edge) + 0.016, foot - p.z)

    def front(p: Points) -> FloatArray:
        return smooth_max(
            frame(p), hinge - p.s, p.s - s.pillar_t - 0.06 * (p.z - s.belt_front_z), radius=0.05
        )

    def rear(p: Points) -> FloatArray:
        start = s.pillar_t + SEAM_M + 0.06 * (p.z - s.belt_front_z)
        wheel = radius + 0.05 - np.hypot(p.t - rear_axle, p.z - s.wheel_radius)
        end = p.s - _rear_door_end(lines)
        if s.body_type not in GLAZED_REAR:
            end = np.maximum(end, _rear_pillar(p, lines, 0.05))
        return smooth_max(frame(p), start - p.s, end, wheel, radius=0.05)

    def sliding(p: Points) -> FloatArray:
        start = s.pillar_t + 0.02
        return smooth_max(
            frame(p) + 0.05, start - p.s, p.s - min(start + 1.05, rear_axle - radius - 0.05), radius=0.05
        )

    out = band(soup, lines, (SIDE,), front)
    if s.body_type == "van":
        return band(out, lines, (SIDE,), sliding)
    return band(out, lines, (SIDE,), rear) if s.doors == 4 else out
