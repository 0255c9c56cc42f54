"""Things that stand on the body: wheels, mirrors, handles, roof rails."""

from itertools import pairwise

import numpy as np

from datasets_synth.cars.body import BodyLines
from datasets_synth.cars.paint import Finish
from datasets_synth.cars.parts import PART_LABEL
from datasets_synth.meshes.mesh_build import Soup, grid_corners, join, soup_of
from recon.arrays import FloatArray

_AROUND = 28
"""Corners of a wheel's circle."""
TYRE_WIDTH_M = 0.205
_FREE_TYRE_WIDTH_M = 0.32
"""Width of a tyre that stands beside the body."""
_CREASE_RAD = float(np.deg2rad(50))


def wheel(lines: BodyLines, axle_t: float, part: str) -> Soup:
    """A left wheel that touches the ground: tyre, rim and spokes."""
    s = lines.shape
    r = s.wheel_radius
    rim_r = r * (0.70 if s.body_type in ("coupe", "suv", "sedan") else 0.66)
    outer = float(lines.half_width(np.array(axle_t), np.array(max(0.55, s.wheel_radius + 0.2)))) - 0.035
    inner = outer - TYRE_WIDTH_M
    if s.add_ons.track:
        outer = 0.5 * s.add_ons.track
        inner = outer - _FREE_TYRE_WIDTH_M
    centre = np.array([0.5 * s.length - axle_t, 0.0, r])
    label = PART_LABEL[part]
    shoulder = 0.985 * r
    tyre_rings = [
        (rim_r, inner + 0.03), (0.95 * r, inner), (r, inner + 0.03), (r, outer - 0.04),
        (shoulder, outer - 0.018), (0.94 * r, outer - 0.003), (rim_r, outer - 0.012),
    ]  # fmt: skip
    lip = [(rim_r, outer - 0.012), (0.94 * rim_r, outer - 0.006), (0.90 * rim_r, outer - 0.022)]
    dish = [(0.90 * rim_r, outer - 0.022), (0.88 * rim_r, outer - 0.09), (0.0, outer - 0.09)]
    pieces = [
        soup_of(_lathe(tyre_rings, centre), material=Finish.TYRE, part=label, crease_rad=_CREASE_RAD),
        soup_of(_lathe(lip, centre), material=Finish.RIM, part=label, crease_rad=_CREASE_RAD),
        soup_of(_lathe(dish, centre), material=Finish.DARK, part=label),
        soup_of(
            _lathe([(rim_r, inner + 0.03), (0.0, inner + 0.03)][::-1], centre),
            material=Finish.DARK,
            part=label,
        ),
        soup_of(_spokes(s.spokes, 0.92 * rim_r, outer - 0.02, centre), material=Finish.RIM, part=label),
    ]
    return join(pieces)


def _lathe(rings: list[tuple[float, float]], centre: FloatArray) -> FloatArray:
    """Faces of a surface of revolution about the y axis through centre; rings are (radius, y)."""
    angle = np.linspace(0, 2 * np.pi, _AROUND + 1)
    angle[-1] = 0.0
    radius, y = np.array(rings).T[..., None]
    points = np.stack(
        [
            centre[0] + radius * np.cos(angle),
            np.broadcast_to(y, radius.shape) + 0 * angle,
            centre[2] + radius * np.sin(angle),
        ],
        axis=-1,
    )
    return grid_corners(points)


def _spokes(count: int, radius: float, y: float, centre: FloatArray) -> FloatArray:
    """Faces of flat spokes and a hub cap, a little domed."""
    faces = []
    half = 0.42 * np.pi / count
    for k in range(count):
        a = 2 * np.pi * k / count + np.pi / 2
        ring = np.array([(0.20, a - 1.9 * half), (1.0, a - half), (1.0, a + half), (0.20, a + 1.9 * half)])
        p = np.stack(
            [
                centre[0] + radius * ring[:, 0] * np.cos(ring[:, 1]),
                np.array([y + 0.002, y - 0.004, y - 0.004, y + 0.002]),
                centre[2] + radius * ring[:, 0] * np.sin(ring[:, 1]),
            ],
            axis=-1,
        )
        faces += [p[[0, 2, 1]], p[[0, 3, 2]]]
    angle = np.linspace(0, 2 * np.pi, 17)
    rim = np.stack(
        [
            centre[0] + 0.24 * radius * np.cos(angle),
            np.full(17, y + 0.003),
            centre[2] + 0.24 * radius * np.sin(angle),
        ],
        axis=-1,
    )
    middle = np.array([centre[0], y + 0.012, centre[2]])
    faces += [np.stack([middle, b, a]) for a, b in pairwise(rim)]
    return np.stack(faces)


def ellipsoid(
    centre: tuple[float, float, float], radii: tuple[float, float, float], power: float = 0.6, rings: int = 6
) -> FloatArray:
    """Faces of a rounded box (superellipsoid): power 1 is an ellipsoid, towards 0 a box."""
    u = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)[:, None]
    v = np.linspace(0, 2 * np.pi, 2 * rings + 1)[None]

    def bent(c: FloatArray) -> FloatArray:
        c = np.where(np.abs(c) < 1e-12, 0.0, c)
        return np.asarray(np.sign(c) * np.abs(c) ** power)

    unit = np.stack(
        np.broadcast_arrays(
            bent(np.cos(u)) * bent(np.cos(v)), bent(np.cos(u)) * bent(np.sin(v)), bent(np.sin(u))
        ),
        -1,
    )
    return grid_corners(unit * radii + centre, flip=True)


def mirror(lines: BodyLines) -> Soup:
    """The left outside mirror: shell, glass and foot."""
    s = lines.shape
    tall = s.body_type in ("van", "pickup")
    t = s.cowl_t + (0.34 if s.body_type != "van" else 0.22)
    z = float(lines.belt_z(np.array(t))) + (0.13 if tall else 0.085)
    y = float(lines.half_width(np.array(t), np.array(z - 0.04)))
    x = 0.5 * s.length - t
    radii = (0.07, 0.095, 0.12) if tall else (0.075, 0.11, 0.075)
    label = PART_LABEL["left_body"]
    centre = (x, y + 0.125, z)
    finish = Finish.CLADDING if s.body_type == "van" else Finish.PAINT
    return join(
        [
            soup_of(ellipsoid(centre, radii), material=finish, part=label),
            soup_of(
                ellipsoid((x - 0.062, centre[1], z), (0.018, radii[1] * 0.9, radii[2] * 0.85), rings=4),
                material=Finish.GLASS,
                part=label,
            ),
            soup_of(
                ellipsoid((x, y + 0.02, z - 0.05), (0.05, 0.06, 0.02), rings=4),
                material=Finish.TRIM,
                part=label,
            ),
        ]
    )


def handle(lines: BodyLines, t: float) -> Soup:
    """A door handle of the left side at station t."""
    s = lines.shape
    z = float(lines.belt_z(np.array(t))) - 0.11
    y = float(lines.half_width(np.array(t), np.array(z)))
    finish = Finish.CLADDING if s.body_type == "van" else Finish.PAINT
    recess = ellipsoid((0.5 * s.length - t, y - 0.002, z - 0.004), (0.115, 0.006, 0.030), rings=4)
    grip = ellipsoid((0.5 * s.length - t, y + 0.018, z + 0.004), (0.10, 0.016, 0.013), rings=4)
    label = PART_LABEL["left_body"]
    return join(
        [soup_of(recess, material=Finish.SEAM, part=label), soup_of(grip, material=finish, part=label)]
    )


def roof_rail(lines: BodyLines) -> Soup:
    """The left roof rail."""
    s = lines.shape
    t = np.linspace(s.roof_front_t + 0.25, s.roof_rear_t - 0.10, 14)
    y = lines.half_width(t, lines.edge_z(t)) - 0.10
    crown = lines.crown(t)
    z = lines.edge_z(t) + crown * 0.80
    lift = 0.030 * np.clip(np.minimum(np.arange(14), np.arange(14)[::-1]) / 1.0, 0, 1)
    around = np.linspace(0, 2 * np.pi, 7)
    radius = 0.016 * (lift > 0)[:, None]  # closed at both ends
    points = np.stack(
        [
            np.broadcast_to((0.5 * s.length - t)[:, None], (14, 7)),
            y[:, None] + radius * np.cos(around),
            (z + lift - 0.01)[:, None] + radius * np.sin(around),
        ],
        axis=-1,
    )
    return soup_of(
        grid_corners(points), material=Finish.CHROME, part=PART_LABEL["roof"], crease_rad=np.deg2rad(70)
    )
