"""The family of airplanes: the fixed list of shapes, and their meshes."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from datasets_synth.meshes.families import draws_by_style, standing_mesh
from datasets_synth.meshes.lofts import circle, loft, xyz
from datasets_synth.meshes.materials import plain
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.objects.airplane_details import (
    Airfoil,
    engine,
    gear_leg,
    lifting_surface,
    propeller,
    window_row,
)
from recon.arrays import FloatArray

AIRPLANE_PARTS = ("fuselage", "left_wing", "right_wing", "tail_fin", "tailplane")
SHAPES_PER_STYLE = 4

_LABEL = {name: i + 1 for i, name in enumerate(AIRPLANE_PARTS)}


@dataclass(frozen=True)
class AirplaneShape:
    """Measures of one airplane in metres. Stations count from the nose."""

    shape_id: str
    style: str
    """"airliner" has engines under low wings, "business_jet" at the tail, "turboprop" in high wings, "light"
    one in the nose."""
    length: float
    radius: float
    """Radius of the fuselage, which is round."""
    span: float
    sweep_rad: float
    """Sweep of the wing's quarter chord, in radians."""
    dihedral_rad: float
    wing_station: float
    """How far behind the nose the leading edge of the wing meets the fuselage."""
    root_chord: float
    taper: float
    """Chord at the tip over chord at the root."""
    fin_height: float
    tail_span: float
    tail_height: float
    """Where the tailplane sits on the fin: 0 at its foot, 1 at its top."""
    clearance: float
    """Height of the underside of the fuselage over the ground."""

    @property
    def wing_z(self) -> float:
        """Height of the wing root over the axis of the fuselage, in radii."""
        return 0.85 if self.style in ("turboprop", "light") else -0.6

    @property
    def axis_z(self) -> float:
        """Height of the axis of the fuselage over the ground."""
        return self.clearance + self.radius


# Lengths but "length" and "clearance" are shares of the length, the root chord too.
_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "airliner": {
        "length": (31, 46), "radius": (0.047, 0.056), "span": (0.88, 1.02), "sweep": (23, 32),
        "dihedral": (4, 7), "wing": (0.34, 0.39), "root_chord": (0.17, 0.20), "taper": (0.24, 0.32),
        "fin": (0.15, 0.18), "tail_span": (0.34, 0.40), "tail_height": (0.02, 0.06), "clearance": (1.7, 2.2),
    },
    "business_jet": {
        "length": (14, 21), "radius": (0.054, 0.062), "span": (0.86, 1.0), "sweep": (22, 32),
        "dihedral": (2, 5), "wing": (0.42, 0.47), "root_chord": (0.17, 0.20), "taper": (0.28, 0.38),
        "fin": (0.15, 0.18), "tail_span": (0.34, 0.42), "tail_height": (0.90, 0.97), "clearance": (0.8, 1.1),
    },
    "turboprop": {
        "length": (21, 32), "radius": (0.048, 0.056), "span": (0.98, 1.12), "sweep": (1, 5),
        "dihedral": (1, 3), "wing": (0.39, 0.43), "root_chord": (0.10, 0.125), "taper": (0.5, 0.65),
        "fin": (0.17, 0.20), "tail_span": (0.28, 0.34), "tail_height": (0.88, 0.97), "clearance": (1.0, 1.4),
    },
    "light": {
        "length": (7.2, 9.2), "radius": (0.082, 0.092), "span": (1.25, 1.42), "sweep": (0, 3),
        "dihedral": (1, 4), "wing": (0.26, 0.30), "root_chord": (0.18, 0.21), "taper": (0.7, 0.95),
        "fin": (0.17, 0.20), "tail_span": (0.40, 0.48), "tail_height": (0.02, 0.06), "clearance": (0.6, 0.8),
    },
}  # fmt: skip


@lru_cache(maxsize=1)
def airplane_shapes() -> tuple[AirplaneShape, ...]:
    """All airplanes of the family, always the same: `SHAPES_PER_STYLE` of each style."""
    return tuple(
        AirplaneShape(
            shape_id=shape_id,
            style=style,
            length=p["length"],
            radius=p["radius"] * p["length"],
            span=p["span"] * p["length"],
            sweep_rad=float(np.deg2rad(p["sweep"])),
            dihedral_rad=float(np.deg2rad(p["dihedral"])),
            wing_station=p["wing"] * p["length"],
            root_chord=p["root_chord"] * p["length"],
            taper=p["taper"],
            fin_height=p["fin"] * p["length"],
            tail_span=p["tail_span"] * p["length"],
            tail_height=p["tail_height"],
            clearance=p["clearance"],
        )
        for shape_id, style, p in draws_by_style(_RANGES, SHAPES_PER_STYLE, 20090423)
    )


def airplane_mesh(shape: AirplaneShape, rng: np.random.Generator) -> Mesh:
    """The mesh of an airplane on its wheels in the object frame; rng picks the paint. Every face has a part.

    Nose at +x, left wing at +y, z up, metres, the origin on the ground below the middle. Engines belong to
    what carries them, landing gear and propellers of the nose to the fuselage.
    """
    white = plain((0.68, 0.69, 0.70), 0.25, 0.05)
    accents = (
        (0.03, 0.08, 0.30), (0.45, 0.03, 0.03), (0.02, 0.20, 0.12), (0.62, 0.33, 0.03), (0.03, 0.03, 0.035),
        (0.02, 0.25, 0.40),
    )  # fmt: skip
    accent = plain(accents[int(rng.integers(len(accents)))], 0.3, 0.05)
    wings = plain((0.48, 0.49, 0.50), 0.35, 0.08) if shape.style != "light" else white
    draft = MeshDraft()
    with draft.labelling(_LABEL["fuselage"]):
        _fuselage(draft, shape, white, accent)
        _gear(draft, shape)
    for side, name in ((1, "left_wing"), (-1, "right_wing")):
        with draft.labelling(_LABEL[name]):
            _wing(draft, shape, side, wings, white)
    with draft.labelling(_LABEL["tail_fin"]):
        _fin(draft, shape, accent)
    with draft.labelling(_LABEL["tailplane"]):
        _tailplane(draft, shape, wings)
    return standing_mesh(draft)


# Until the mesh is stood on the ground the nose tip is the origin and the axis of the fuselage the x axis.


def _profile(s: AirplaneShape) -> FloatArray:
    """Station, radius and height of the middle of sections of the fuselage, shape (n, 3), shares of length
    and radius."""
    if s.style == "light":
        return np.array(
            [
                (0.0, 0.0, -0.1), (0.004, 0.45, -0.1), (0.02, 0.62, -0.1), (0.10, 0.72, -0.08),
                (0.19, 0.80, -0.05), (0.27, 1.0, 0.02), (0.44, 1.0, 0.0), (0.56, 0.80, 0.0),
                (0.75, 0.48, 0.05), (0.9, 0.27, 0.1), (0.985, 0.12, 0.14), (1.0, 0.0, 0.14),
            ]
        )  # fmt: skip
    t = np.array([0, 0.004, 0.016, 0.035, 0.06, 0.09, 0.13, 0.18])
    nose = np.sqrt(np.clip(1 - (1 - t / 0.18) ** 2, 0, 1)) ** 1.15
    front = np.stack([t * (1.0 if s.style == "airliner" else 1.15), nose, -0.25 * (1 - nose)], axis=1)
    u = np.linspace(0, 1, 9)
    tail = (1 - u**1.6 * 0.9) * np.where(u == 1, 0.0, 1.0)
    rear = np.stack([0.66 + 0.34 * u, tail, 0.62 * u**1.6], axis=1)
    rear[-1] = (1.0, 0.0, rear[-2, 2] + 0.02)
    return np.concatenate([front, [(0.4, 1, 0), (0.55, 1, 0)], rear])


def _fuselage(draft: MeshDraft, s: AirplaneShape, white: Material, accent: Material) -> None:
    profile = _profile(s)
    ring = circle((0, 0, 0), 1.0, "x", 28)
    rings = np.repeat(ring[None], len(profile), axis=0) * (profile[:, 1] * s.radius)[:, None, None]
    rings[:, :, 0] = -profile[:, 0, None] * s.length
    rings[:, :, 2] += profile[:, 2, None] * s.radius
    if s.style == "light":  # a cabin is taller than wide
        rings[:, :, 2] *= 1.12
    loft(draft, rings, white, capped=False)
    if s.style == "business_jet":
        for side in (1, -1):
            _tail_engine(draft, s, side, white)
    window_row(draft, profile * [s.length, s.radius, s.radius], s.style, accent)
    if s.style == "light":
        hub = np.array([0.005 * s.length, 0, -0.1 * s.radius])
        propeller(draft, hub, 0.95, 2, accent)


def _tail_engine(draft: MeshDraft, s: AirplaneShape, side: int, white: Material) -> None:
    radius = 0.42 * s.radius
    mouth = np.array([-0.68 * s.length, side * 1.42 * s.radius, 0.45 * s.radius])
    engine(draft, mouth, radius, 4.2 * radius, white)
    pylon = mouth + xyz(-2.2 * radius, -side * 0.45 * s.radius, 0)
    draft.box(pylon, (2.2 * radius, 0.7 * s.radius, 0.22 * radius), white)


def _airfoil(s: AirplaneShape) -> Airfoil:
    """The left wing."""
    y0 = 0.3 * s.radius
    x0 = -s.wing_station
    half = s.span / 2 - y0
    tip = s.root_chord * s.taper
    # the quarter chord runs back by the sweep
    back = half * np.tan(s.sweep_rad) + 0.25 * (s.root_chord - tip)
    root = np.array([x0, y0, s.wing_z * s.radius])
    end = root + xyz(-back, half, half * np.tan(s.dihedral_rad))
    return Airfoil(root, end, s.root_chord, tip, 0.12)


def _wing(draft: MeshDraft, s: AirplaneShape, side: int, skin: Material, white: Material) -> None:
    wing = _airfoil(s)
    lifting_surface(draft, wing, skin, side)
    flip = np.array([1.0, side, 1.0])
    if s.style == "airliner":
        at, chord = wing.at(0.32)
        radius = 0.42 * s.radius
        engine(draft, (at + xyz(0.42 * chord, 0, -1.15 * radius)) * flip, radius, 3.4 * radius, white)
        draft.box(
            (at + xyz(-0.25 * chord, 0, -0.25 * radius)) * flip,
            (chord * 0.8, 0.12 * radius, 0.8 * radius),
            white,
        )
    elif s.style == "turboprop":
        at, chord = wing.at(0.30)
        radius = 0.20 * s.radius + 0.18
        engine(
            draft,
            (at + xyz(0.85 * chord, 0, -0.35 * radius)) * flip,
            radius,
            1.9 * chord,
            white,
            pointed=True,
        )
        propeller(draft, (at + xyz(0.87 * chord, 0, -0.35 * radius)) * flip, 1.75, 6, white)


def _fin(draft: MeshDraft, s: AirplaneShape, skin: Material) -> None:
    lean = np.tan(0.25 if s.style == "light" else 0.62 if s.style != "turboprop" else 0.5)
    chord = 0.145 * s.length if s.style != "light" else 0.15 * s.length
    foot = np.array([-s.length * 0.985 + chord + 0.02 * s.length, 0, 0.55 * s.radius])
    top = foot + xyz(-lean * s.fin_height, 0, s.fin_height)
    lifting_surface(draft, Airfoil(foot, top, chord * 1.15, chord * 0.55, 0.09), skin, 1)


def _tailplane(draft: MeshDraft, s: AirplaneShape, skin: Material) -> None:
    """Add both halves of the tailplane, as one part."""
    chord = 0.09 * s.length if s.style != "light" else 0.115 * s.length
    lean = np.tan(0.25 if s.style == "light" else 0.62 if s.style != "turboprop" else 0.5)
    high = s.tail_height > 0.5
    fin_z = s.tail_height * s.fin_height
    x0 = -s.length * 0.985 + chord * 1.15 - (lean * fin_z - 0.05 * s.length if high else 0)
    z0 = 0.55 * s.radius + fin_z
    half = s.tail_span / 2
    back = half * np.tan(s.sweep_rad) + 0.1 * chord
    rise = half * np.tan(0.1 if s.style == "airliner" else 0.0)
    for side in (1, -1):
        airfoil = Airfoil(
            np.array([x0, 0, z0]), np.array([x0 - back, half, z0 + rise]), chord, chord * 0.5, 0.1
        )
        lifting_surface(draft, airfoil, skin, side)


def _gear(draft: MeshDraft, s: AirplaneShape) -> None:
    """A leg under the nose and two under the wings or the sides."""
    ground = -s.axis_z
    wheel = max(0.17, 0.011 * s.length) if s.style != "airliner" else 0.013 * s.length
    nose_x = -(0.12 if s.style != "light" else 0.11) * s.length
    gear_leg(
        draft,
        np.array([nose_x, 0, -0.55 * s.radius]),
        np.array([nose_x, 0, ground]),
        wheel,
        twin=s.style != "light",
    )
    main_x = -s.wing_station - 0.62 * s.root_chord
    track = {"airliner": 0.105, "business_jet": 0.095, "turboprop": 0.08, "light": 0.15}[s.style] * s.length
    for side in (1, -1):
        inner = 0.5 * s.radius if s.style in ("light", "turboprop") else track
        z = -0.5 * s.radius
        foot = np.array([main_x, side * track, ground])
        gear_leg(draft, np.array([main_x, side * inner, z]), foot, wheel * 1.15, twin=s.style != "light")
