"""The family of four-legged chairs: the fixed list of shapes, and their meshes."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from datasets_synth.meshes.families import draws_by_style, standing_mesh
from datasets_synth.meshes.lofts import curve, loft, rounded_edge, slab, superellipse, tube
from datasets_synth.meshes.materials import plain, surface
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from recon.arrays import FloatArray

CHAIR_PARTS = (
    "seat",
    "back",
    "front_left_leg",
    "front_right_leg",
    "rear_left_leg",
    "rear_right_leg",
)
SHAPES_PER_STYLE = 4

_LABEL = {name: i + 1 for i, name in enumerate(CHAIR_PARTS)}


@dataclass(frozen=True)
class ChairShape:
    """Measures of one chair in metres; x is where the sitter looks."""

    shape_id: str
    style: str
    """"slatted" and "ladder" are of wood with an open back, "shell" is a bent board on steel legs, "padded"
    has cushions."""
    seat_z: float
    """Height of the top of the seat."""
    seat_width: float
    seat_depth: float
    seat_thickness: float
    seat_power: float
    """Exponent of the superellipse of the seat's outline: larger is squarer."""
    back_z: float
    """Height of the top of the back."""
    back_lean_rad: float
    """How far the back leans backwards."""
    back_curve: float
    """How far the middle of the back lies behind its sides."""
    leg_radius: float
    splay_rad: float
    """How far the legs spread outwards."""
    slats: int


_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "slatted": {
        "seat_z": (0.43, 0.47), "seat_width": (0.40, 0.47), "seat_depth": (0.39, 0.45),
        "seat_thickness": (0.030, 0.042), "seat_power": (4.0, 9.0), "back_z": (0.82, 0.98),
        "back_lean": (6, 13), "back_curve": (0.015, 0.04), "leg_radius": (0.016, 0.022),
        "splay": (0, 4), "slats": (4, 7.99),
    },
    "ladder": {
        "seat_z": (0.43, 0.48), "seat_width": (0.41, 0.50), "seat_depth": (0.38, 0.46),
        "seat_thickness": (0.030, 0.045), "seat_power": (5.0, 10.0), "back_z": (0.88, 1.06),
        "back_lean": (4, 10), "back_curve": (0.01, 0.035), "leg_radius": (0.017, 0.024),
        "splay": (0, 3), "slats": (3, 5.99),
    },
    "shell": {
        "seat_z": (0.43, 0.47), "seat_width": (0.40, 0.48), "seat_depth": (0.38, 0.45),
        "seat_thickness": (0.022, 0.030), "seat_power": (2.6, 4.5), "back_z": (0.74, 0.86),
        "back_lean": (9, 17), "back_curve": (0.03, 0.06), "leg_radius": (0.011, 0.015),
        "splay": (5, 10), "slats": (0, 0),
    },
    "padded": {
        "seat_z": (0.45, 0.50), "seat_width": (0.43, 0.52), "seat_depth": (0.42, 0.50),
        "seat_thickness": (0.070, 0.105), "seat_power": (4.5, 9.0), "back_z": (0.86, 1.08),
        "back_lean": (5, 12), "back_curve": (0.01, 0.03), "leg_radius": (0.017, 0.025),
        "splay": (2, 7), "slats": (0, 0),
    },
}  # fmt: skip


@lru_cache(maxsize=1)
def chair_shapes() -> tuple[ChairShape, ...]:
    """All chairs of the family, always the same: `SHAPES_PER_STYLE` of each style."""
    return tuple(
        ChairShape(
            shape_id=shape_id,
            style=style,
            seat_z=p["seat_z"],
            seat_width=p["seat_width"],
            seat_depth=p["seat_depth"],
            seat_thickness=p["seat_thickness"],
            seat_power=p["seat_power"],
            back_z=p["back_z"],
            back_lean_rad=float(np.deg2rad(p["back_lean"])),
            back_curve=p["back_curve"],
            leg_radius=p["leg_radius"],
            splay_rad=float(np.deg2rad(p["splay"])),
            slats=int(p["slats"]),
        )
        for shape_id, style, p in draws_by_style(_RANGES, SHAPES_PER_STYLE, 20090421)
    )


def chair_mesh(shape: ChairShape, rng: np.random.Generator) -> Mesh:
    """The mesh of a chair in the object frame; rng picks wood, paint and cloth. Every face has a part.

    The sitter looks along +x, left at +y, z up, metres, the origin on the ground below the middle.
    """
    body, cover = _materials(shape, rng)
    draft = MeshDraft()
    with draft.labelling(_LABEL["seat"]):
        _seat(draft, shape, body, cover)
    with draft.labelling(_LABEL["back"]):
        _back(draft, shape, body, cover)
    for x, end in ((1, "front"), (-1, "rear")):
        for y, side in ((1, "left"), (-1, "right")):
            with draft.labelling(_LABEL[f"{end}_{side}_leg"]):
                _leg(draft, shape, x, y, body)
    return standing_mesh(draft)


def _materials(shape: ChairShape, rng: np.random.Generator) -> tuple[Material, Material]:
    """Materials of the frame (legs, posts), and of seat and back."""
    stains = ((1.0, 1.0, 1.0), (0.62, 0.52, 0.44), (0.30, 0.22, 0.17), (1.25, 1.3, 1.35))
    wood = surface("wood", int(rng.integers(3)), stains[int(rng.integers(len(stains)))], 0.08)
    paints = (
        (0.55, 0.04, 0.03),
        (0.05, 0.16, 0.34),
        (0.07, 0.25, 0.12),
        (0.70, 0.69, 0.66),
        (0.03, 0.03, 0.03),
    )
    paint = plain(paints[int(rng.integers(len(paints)))], 0.12, 0.02)
    if shape.style in ("slatted", "ladder"):
        body = paint if rng.random() < 0.35 else wood
        return body, body
    if shape.style == "shell":
        steel = plain((0.45, 0.46, 0.47), 0.6, 0.3) if rng.random() < 0.7 else plain((0.02, 0.02, 0.02), 0.2)
        return steel, paint if rng.random() < 0.5 else wood
    dyes = (
        (0.55, 0.16, 0.12),
        (0.20, 0.28, 0.42),
        (0.32, 0.38, 0.22),
        (0.62, 0.52, 0.36),
        (0.25, 0.25, 0.27),
    )
    return wood, surface("cloth", int(rng.integers(3)), dyes[int(rng.integers(len(dyes)))], 0.02)


def _seat(draft: MeshDraft, s: ChairShape, body: Material, cover: Material) -> None:
    outline = superellipse(s.seat_depth / 2, s.seat_width / 2, s.seat_power)
    # a little wider at the knees
    outline[:, 1] *= 1 + 0.06 * outline[:, 0] / (s.seat_depth / 2)
    low = s.seat_z - s.seat_thickness
    edge = s.seat_thickness * (0.48 if s.style in ("padded", "shell") else 0.25)
    slab(draft, outline, (low, s.seat_z), edge, cover, tile_m=0.5)
    if s.style != "shell":  # the frame under it
        apron = 0.05
        inner = superellipse(s.seat_depth / 2 - 0.025, s.seat_width / 2 - 0.03, 14.0)
        slab(draft, inner, (low - apron, low + 0.004), 0.004, body, tile_m=0.5)


def _leg_top(s: ChairShape, x: int, y: int) -> FloatArray:
    """Where the axis of a leg meets the underside of the seat."""
    inset = s.leg_radius + (0.03 if s.style in ("shell", "padded") else 0.012)
    shrink = 0.72 if s.style == "shell" else 1.0
    return np.array(
        [
            x * (s.seat_depth / 2 - inset) * shrink,
            y * (s.seat_width / 2 - inset) * shrink,
            s.seat_z - s.seat_thickness + 0.004,
        ]
    )


def _leg(draft: MeshDraft, s: ChairShape, x: int, y: int, body: Material) -> None:
    top = _leg_top(s, x, y)
    spread = np.tan(s.splay_rad) * top[2]
    # the rear legs of a chair with posts reach back a little, as the posts do above
    back = 0.03 if x < 0 and s.style in ("slatted", "ladder") else 0.0
    foot = np.array([top[0] + x * (spread + back), top[1] + y * spread, 0.0])
    t = np.linspace(0, 1, 5)[:, None]
    taper = 1.0 if s.style == "shell" else 0.68
    tube(
        draft,
        top + t * (foot - top),
        s.leg_radius * (1 + (taper - 1) * t[:, 0] ** 1.5),
        body,
        sides=12,
        tile_m=0.4,
    )


def _back_curve(s: ChairShape, y: FloatArray, z: FloatArray, half: float) -> FloatArray:
    """Points (..., 3) of the surface of the back: it leans backwards and is hollow towards the sitter."""
    lean = np.tan(s.back_lean_rad) * (z - s.seat_z)
    hollow = s.back_curve * (1 - (y / half) ** 2)
    start = -s.seat_depth / 2 + s.leg_radius + 0.012
    return np.stack([start - lean - hollow, y, z], axis=-1)


def _back(draft: MeshDraft, s: ChairShape, body: Material, cover: Material) -> None:
    if s.style in ("slatted", "ladder"):
        _open_back(draft, s, body)
    elif s.style == "shell":
        half = s.seat_width / 2 * 0.92
        _bent_panel(draft, s, (s.seat_z + 0.10, s.back_z), half, 0.014, 3.2, cover)
        for y in (-0.35, 0.35):  # steel bars from under the seat to the back
            low = np.array([-s.seat_depth * 0.28, y * s.seat_width, s.seat_z - s.seat_thickness - 0.004])
            bend = np.array([-s.seat_depth / 2 - 0.015, y * s.seat_width, s.seat_z - 0.01])
            high = _back_curve(s, np.array(y * s.seat_width), np.array(s.seat_z + 0.2), half) - [0.012, 0, 0]
            tube(draft, curve(low, bend, high), s.leg_radius * 0.8, body)
    else:
        half = s.seat_width / 2 * 0.95
        _bent_panel(draft, s, (s.seat_z + 0.08, s.back_z), half, 0.055, 6.0, cover)
        for y in (-0.36, 0.36):
            foot = np.array([-s.seat_depth / 2 + 0.05, y * s.seat_width, s.seat_z - s.seat_thickness])
            high = _back_curve(s, np.array(y * s.seat_width), np.array(s.seat_z + 0.2), half)
            tube(draft, [foot, high], s.leg_radius, body, sides=12, tile_m=0.4)


def _bent_panel(
    draft: MeshDraft,
    s: ChairShape,
    z_m: tuple[float, float],
    half: float,
    thickness: float,
    power: float,
    material: Material,
) -> None:
    """A board or cushion with rounded corners, bent as the back is."""
    low, high = z_m
    outline = superellipse(half, (high - low) / 2, power, 64)
    edge, offset = rounded_edge(outline, thickness, thickness * 0.48)
    # rings shrink towards the middle on both faces, so that a bent face stays bent
    inner = [k * outline for k in (0.0, 0.35, 0.7)]
    faces = np.stack([*inner, *edge, *inner[::-1]])
    forward = np.array([np.cos(s.back_lean_rad), 0, np.sin(s.back_lean_rad)])
    depth = np.concatenate([np.full(3, offset[0]), offset, np.full(3, offset[-1])])
    rings = _back_curve(s, faces[..., 0], (low + high) / 2 + faces[..., 1], half)
    rings += depth[:, None, None] * forward
    loft(draft, rings, material, tile_m=0.5, capped=False, uv_axes=(2, 1))


def _open_back(draft: MeshDraft, s: ChairShape, body: Material) -> None:
    half = s.seat_width / 2 - s.leg_radius - 0.012
    z = np.linspace(s.seat_z - s.seat_thickness, s.back_z, 7)
    for side in (-half, half):
        post = _back_curve(s, np.full_like(z, side), z, half)
        tube(draft, post, s.leg_radius * np.linspace(1, 0.75, 7), body, sides=12, tile_m=0.4)
    y = np.linspace(-half, half, 9)
    if s.style == "ladder":
        step = (s.back_z - s.seat_z - 0.06) / s.slats
        for k in range(s.slats):
            top = s.back_z - 0.01 - k * step
            _board(draft, s, y, (top - min(0.075, 0.62 * step), top), half, body)
        return
    foot = s.seat_z + 0.18 * (s.back_z - s.seat_z)
    _board(draft, s, y, (s.back_z - 0.075, s.back_z - 0.005), half, body)
    _board(draft, s, y, (foot, foot + 0.04), half, body)
    wide = min(0.022, 0.5 * half / s.slats) * np.array([-1.0, 0, 1])
    for middle in np.linspace(-half, half, s.slats + 2)[1:-1]:
        _board(draft, s, middle + wide, (foot + 0.02, s.back_z - 0.04), half, body)


def _board(
    draft: MeshDraft,
    s: ChairShape,
    y_m: FloatArray,
    z_m: tuple[float, float],
    half: float,
    material: Material,
) -> None:
    """A thin board in the surface of the back, 12 mm thick."""
    low, high = z_m
    section = np.array([(0.006, low), (0.006, high), (0.0, high + 0.004), (-0.006, high), (-0.006, low)])
    rings = np.stack(
        [
            _back_curve(s, np.full(len(section), y), section[:, 1], half) + section[:, :1] * [1.0, 0, 0]
            for y in y_m
        ]
    )
    loft(draft, rings, material, tile_m=0.4, uv_axes=(2, 1))
