"""The painted body of a car as a smooth lofted surface: profile curves, cross-sections and end caps.

Only the left half (y >= 0) is built. Along the car the station t counts metres from the nose; the
section at a station goes from the middle of the underside over the sill, the side and the roof edge to the
middle of the top.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from datasets_synth.cars.shapes import CarShape
from datasets_synth.meshes.mesh_build import Soup, grid_corners, join, smooth_normals, soup_of
from recon.arrays import FloatArray

BOTTOM, SIDE, TOP, FRONT_CAP, REAR_CAP = range(5)
"""Zones of the body's faces."""

_STATIONS = 54
_SIDE_ROWS_LOW = 7
_CROWN_ROWS = 6
_CAP_COLUMNS = 8
_CREASE_RAD = float(np.deg2rad(38.0))


@dataclass(frozen=True)
class Ends:
    """How nose and tail are rounded: all lengths in metres."""

    radius_t: float
    """Length over which the plan view narrows to the corner."""
    radius_y: float
    """How much the plan view narrows to the corner."""
    sag: float
    """How far the corners lie behind the middle."""
    tuck: float
    """How far the lower edge lies behind the bumper."""
    rake: float
    """How far the upper edge lies behind the bumper."""
    bumper_z: float
    """Height of the foremost point."""


@dataclass(frozen=True)
class BodyLines:
    """The curves that define the body of a shape."""

    shape: CarShape

    @property
    def side_rows_high(self) -> int:
        """Rows of faces between belt and roof edge: none higher than about 12 cm."""
        return max(4, round((self.shape.height - self.shape.belt_front_z) / 0.12))

    @cached_property
    def profile(self) -> tuple[FloatArray, FloatArray]:
        """Silhouette from the side: stations t (increasing) and heights z, both shape (n,)."""
        s = self.shape
        roof_mid = 0.5 * (s.roof_front_t + min(s.roof_rear_t, s.roof_front_t + 1.2))
        front_drop = 0.05 * (s.height - s.cowl_z) / 0.5
        tall = s.body_type in ("van", "minivan")
        hood = [(0.02, s.hood_z - 0.06), (0.09, s.hood_z)]
        bulge_hood = 0.035 if not tall else 0.02
        hood_mid = (0.5 * (0.09 + s.cowl_t), 0.5 * (s.hood_z + s.cowl_z) + bulge_hood)
        screen_mid = (
            0.5 * (s.cowl_t + s.roof_front_t) - 0.01,
            0.5 * (s.cowl_z + s.height - front_drop) + 0.025,
        )
        roof = [(s.roof_front_t, s.height - front_drop), (roof_mid, s.height), (s.roof_rear_t, s.roof_rear_z)]
        tail_mid = (0.5 * (s.roof_rear_t + s.tail_t) + 0.015, 0.5 * (s.roof_rear_z + s.tail_z) + 0.02)
        deck_end = s.length - 0.05
        points = [(0.0, s.hood_z - 0.12), *hood, hood_mid, (s.cowl_t, s.cowl_z), screen_mid, *roof, tail_mid]
        points.append((s.tail_t, s.tail_z))
        if s.tail_t < deck_end - 0.1:
            points.append((deck_end, s.deck_z))
        points.append((s.length, min(s.deck_z, points[-1][1]) - 0.05))
        return _smooth_curve(np.array(points), corners=_corner_rows(points, s))

    def top_z(self, t: FloatArray) -> FloatArray:
        """Height of the middle of the top at stations t."""
        return np.interp(t, *self.profile)

    def belt_z(self, t: FloatArray) -> FloatArray:
        """Height where side windows begin, at stations t."""
        s = self.shape
        return np.interp(t, [s.cowl_t, s.tail_t], [s.belt_front_z, s.belt_rear_z])

    def crown(self, t: FloatArray) -> FloatArray:
        """How much lower than the middle the side edge of the top is, at stations t."""
        s = self.shape
        hood, screen, roof, deck = 0.10, 0.13, 0.10, 0.09
        if s.body_type in ("van", "pickup"):
            roof = 0.085
        knots = [0.0, s.cowl_t, 0.5 * (s.cowl_t + s.roof_front_t), s.roof_front_t, s.roof_rear_t, s.tail_t]
        usual = np.interp(t, [*knots, s.length], [hood, hood, screen, roof, roof, deck, deck])
        return np.asarray(s.form.crown * usual)

    def edge_z(self, t: FloatArray) -> FloatArray:
        """Height where the side ends and the top begins, at stations t."""
        return self.top_z(t) - self.crown(t)

    @property
    def front(self) -> Ends:
        """Rounding of the nose."""
        tall = self.shape.body_type in ("van", "suv", "pickup")
        form, rake = self.shape.form, 0.10 if tall else 0.14
        radius_t, radius_y, sag = (v * form.end_round for v in (0.42, 0.20, 0.16))
        return Ends(radius_t, radius_y, sag, form.end_tuck, rake, self.shape.clearance + 0.27)

    @property
    def rear(self) -> Ends:
        """Rounding of the tail."""
        flat = self.shape.body_type in ("van", "pickup")
        form = self.shape.form
        radius = (0.12 if flat else 0.26) * form.end_round
        sag = (0.05 if flat else 0.10) * form.end_round
        return Ends(radius, 0.5 * radius, sag, form.end_tuck, 0.07, self.shape.clearance + 0.30)

    def half_width(self, t: FloatArray, z: FloatArray) -> FloatArray:
        """Distance of the side from the middle plane at stations t and heights z (broadcast)."""
        s = self.shape
        belt = self.belt_z(t)
        h = np.clip((z - s.clearance) / (belt - s.clearance), 0, None)
        y = self._plan_half_width(t) - s.form.sill_tuck * np.clip(1 - h / 0.4, 0, 1) ** 2
        # A shallow hollow under the shoulder line, a tuck over the sill: doors look like sheet metal.
        y = y - 0.018 * np.exp(-(((h - 0.62) / 0.14) ** 2)) - 0.02 * np.clip((h - 0.82) / 0.18, 0, 1) ** 2
        soft = 0.02
        above = soft * np.logaddexp(0, (z - belt) / soft)
        bow = 0.10 * above**2
        return np.asarray(y - np.tan(s.lean_rad) * above * 0.92 - bow)

    def _plan_half_width(self, t: FloatArray) -> FloatArray:
        """Half width of the widest line of the body at stations t."""
        s = self.shape
        middle = 0.52 * s.length
        bow_front = 0.05 * np.clip((middle - t) / middle, 0, 1) ** 3
        bow_rear = (0.015 if s.body_type in ("van", "pickup") else 0.055) * np.clip(
            (t - middle) / (s.length - middle), 0, 1
        ) ** 3
        y = s.width / 2 - bow_front - bow_rear
        for end, distance in ((self.front, t), (self.rear, s.length - t)):
            u = np.clip(1 - distance / end.radius_t, 0, 1)
            y = y - end.radius_y * (1 - np.sqrt(np.clip(1 - u**2.4, 0, 1)))
        return np.asarray(y)

    def end_shift(self, t: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """How far points are moved along t (positive: towards the tail) to round nose and tail."""
        s = self.shape
        shift = np.zeros(np.broadcast_shapes(t.shape, y.shape, z.shape))
        for end, distance, sign, top in (
            (self.front, t, 1.0, s.hood_z), (self.rear, s.length - t, -1.0, s.tail_z),
        ):  # fmt: skip
            reach = 0.75
            blend = np.clip(1 - distance / reach, 0, 1) ** 2
            below = np.clip((end.bumper_z - z) / (end.bumper_z - s.clearance), 0, 1)
            over = np.clip((z - end.bumper_z - 0.08) / (top - end.bumper_z - 0.08), 0, 1)
            depth = end.sag * (2 * y / s.width) ** 2 + end.tuck * below**2 + end.rake * over**1.5
            shift = shift + sign * blend * depth
        return shift

    def stations(self) -> FloatArray:
        """Stations of the sections, closer where the silhouette is steep and at both ends."""
        t, z = self.profile
        length = self.shape.length
        density = np.hypot(np.gradient(t), np.gradient(z))
        density += np.gradient(t) * (
            1.6 * np.exp(-t / 0.12) + 1.6 * np.exp(-(length - t) / 0.10) + 0.5 * np.exp(-t / 0.6)
        )
        total = np.cumsum(density)
        total = (total - total[0]) / (total[-1] - total[0])
        return np.interp(np.linspace(0, 1, _STATIONS), total, t)


def _corner_rows(points: list[tuple[float, float]], shape: CarShape) -> list[tuple[float, float]]:
    """Control points where the curve has a corner (the rest are points of a smooth bow)."""
    names = {(shape.cowl_t, shape.cowl_z), (shape.tail_t, shape.tail_z)}
    names |= {
        (shape.roof_rear_t, shape.roof_rear_z),
        (0.09, shape.hood_z),
        (shape.length - 0.05, shape.deck_z),
    }
    return [p for p in points if p in names or p[0] in (0.0, shape.length, shape.roof_front_t)]


def _smooth_curve(points: FloatArray, corners: list[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    """A dense curve: parabolas between corners through the point between them, the corners then rounded."""
    rows = [i for i, p in enumerate(points) if (float(p[0]), float(p[1])) in corners]
    pieces = []
    for i, j in pairwise(rows):
        u = np.linspace(0, 1, 200, endpoint=False)[:, None]
        a, b = points[i], points[j]
        if j == i + 2:
            c = 2 * points[i + 1] - 0.5 * (a + b)
            pieces.append((1 - u) ** 2 * a + 2 * u * (1 - u) * c + u**2 * b)
        else:
            pieces.append(a + u * (b - a))
    curve = np.concatenate([*pieces, points[-1:]])
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    step = 0.005
    even = np.arange(0, length[-1], step)
    dense = np.stack([np.interp(even, length, curve[:, k]) for k in range(2)], axis=1)
    sigma = 0.045 / step
    smooth = np.stack([gaussian_filter1d(dense[:, k], sigma, mode="nearest") for k in range(2)], axis=1)
    t, z = smooth[:, 0], smooth[:, 1]
    t = np.maximum.accumulate(t) + 1e-6 * np.arange(len(t))
    t = points[0, 0] + (t - t[0]) * (points[-1, 0] - points[0, 0]) / (t[-1] - t[0])
    top = points[:, 1].max()
    high = z > 0.8 * top
    z = np.where(high, 0.8 * top + (z - 0.8 * top) * 0.2 * top / (z.max() - 0.8 * top), z)
    return t, z


def loft_body(lines: BodyLines) -> Soup:
    """The left half of the closed body, object frame, before anything is cut; zones as named above."""
    shape = lines.shape
    t = lines.stations()
    section_y, section_z = _sections(lines, t)
    n_side = _SIDE_ROWS_LOW + lines.side_rows_high
    shifted = t[:, None] + lines.end_shift(t[:, None], section_y, section_z)
    points = np.stack([shifted, section_y, section_z], axis=-1)
    bottom_row = np.stack([shifted[:, :1], 0 * section_y[:, :1], section_z[:, :1]], axis=-1)
    bottom = np.concatenate([bottom_row, 0.5 * (bottom_row + points[:, :1]), points[:, :1]], axis=1)
    side, top = points[:, : n_side + 1], points[:, n_side:]
    pieces = [(bottom, BOTTOM), (side, SIDE), (top, TOP)]
    pieces += [(_cap(lines, points[0], 0.0), FRONT_CAP), (_cap(lines, points[-1], shape.length), REAR_CAP)]
    lowest, highest = points[..., 0].min(), points[..., 0].max()
    caps = [p[0][..., 0] for p in pieces[3:]]
    lowest, highest = min(lowest, caps[0].min()), max(highest, caps[1].max())
    widest = points[..., 1].max()
    soups = []
    for grid, zone in pieces:
        x = shape.length * (0.5 - (grid[..., 0] - lowest) / (highest - lowest))
        y = grid[..., 1] * (0.5 * shape.width / widest)
        along = {FRONT_CAP: np.zeros((1, 1)), REAR_CAP: np.full((1, 1), shape.length)}.get(zone, t[:, None])
        station = np.broadcast_to(along, grid.shape[:2])
        corners = grid_corners(np.stack([x, y, grid[..., 2], station], axis=-1), flip=zone == FRONT_CAP)
        soups.append(soup_of(corners[..., :3], zone=zone, crease_rad=_CREASE_RAD, station=corners[..., 3]))
    return _with_common_normals(join(soups))


def _with_common_normals(soup: Soup) -> Soup:
    """The soup with normals smoothed across its zones."""
    # With the other half, so that normals on the middle plane come out symmetric.
    other = (soup.corners_m * [1.0, -1.0, 1.0])[:, ::-1]
    whole = smooth_normals(np.concatenate([soup.corners_m, other]), _CREASE_RAD)
    return replace(soup, normals=whole[: len(soup)])


def _sections(lines: BodyLines, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half-sections at stations t: y and z, shape (stations, rows), from sill to middle of the top."""
    s = lines.shape
    edge, crown = lines.edge_z(t), lines.crown(t)
    belt = np.minimum(lines.belt_z(t), s.clearance + 0.86 * (edge - s.clearance))
    bottom = (
        s.clearance
        + 0.05 * s.form.end_rise * np.clip(1 - t / 0.5, 0, 1) ** 2
        + 0.08 * s.form.end_rise * np.clip(1 - (s.length - t) / 0.6, 0, 1) ** 2
    )
    low = np.linspace(0, 1, _SIDE_ROWS_LOW + 1)
    high = np.linspace(0, 1, lines.side_rows_high + 1)[1:]
    z_low = bottom[:, None] + (belt - bottom)[:, None] * low
    z_high = belt[:, None] + (edge - belt)[:, None] * high
    z_side = np.concatenate([z_low, z_high], axis=1)
    y_side = lines.half_width(t[:, None], z_side)
    angle = np.linspace(0, np.pi / 2, _CROWN_ROWS + 1)[1:]
    power = 2 / 2.7
    y_top = y_side[:, -1:] * np.clip(np.cos(angle), 0, 1) ** power
    y_top[:, -1] = 0.0
    z_top = edge[:, None] + crown[:, None] * np.sin(angle) ** power
    return np.concatenate([y_side, y_top], axis=1), np.concatenate([z_side, z_top], axis=1)


def _cap(lines: BodyLines, section: FloatArray, end_t: float) -> FloatArray:
    """Grid (rows, columns, 3) that closes the body at one end, from the middle plane to the section."""
    # The section itself is already shifted: rebuild each row from the middle outwards with the same rule.
    share = np.sin(np.linspace(0, np.pi / 2, _CAP_COLUMNS))
    y = section[:, 1:2] * share
    z = np.broadcast_to(section[:, 2:3], y.shape)
    t = np.full_like(y, end_t)
    grid = np.stack([t + lines.end_shift(t, y, z), y, z], axis=-1)
    grid[:, -1] = section
    return grid


def arch_radius(lines: BodyLines) -> float:
    """Radius of the wheel arches in metres."""
    gap = {"suv": 0.062, "pickup": 0.080, "coupe": 0.038}.get(lines.shape.body_type, 0.048)
    return lines.shape.wheel_radius + gap


def well_y(lines: BodyLines) -> float:
    """Distance of the inner wall of the wheel wells from the middle plane."""
    return 0.5 * lines.shape.width - 0.36
