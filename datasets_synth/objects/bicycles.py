"""The family of bicycles: the fixed list of shapes, and their meshes."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from datasets_synth.meshes.families import draws_by_style, standing_mesh
from datasets_synth.meshes.lofts import circle, curve, loft, tube, xyz
from datasets_synth.meshes.materials import plain
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from recon.arrays import FloatArray

BICYCLE_PARTS = ("front_wheel", "rear_wheel", "frame", "handlebar")
SHAPES_PER_STYLE = 4

_LABEL = {name: i + 1 for i, name in enumerate(BICYCLE_PARTS)}


@dataclass(frozen=True)
class BicycleShape:
    """Measures of one bicycle in metres; x is the way it rides, the axles lie in y."""

    shape_id: str
    style: str
    """"road" has a drop bar, "mountain" a straight one and thick tyres, "city" and "step_through" a swept
    one and mudguards; "step_through" has no top tube."""
    wheel_radius: float
    """Radius of a wheel to the outside of its tyre."""
    tyre_radius: float
    """Radius of the tyre's section."""
    wheelbase: float
    chainstay: float
    """Length from the crank to the rear axle."""
    crank_z: float
    saddle_z: float
    bar_z: float
    bar_width: float
    head_rad: float
    """Angle of the steering axis from the ground."""
    seat_rad: float
    """Angle of the seat tube from the ground."""
    tube_radius: float
    spokes: int


_COMMON: dict[str, tuple[float, float]] = {
    "wheel_radius": (0.325, 0.350), "chainstay": (0.42, 0.46), "crank_z": (0.26, 0.295),
    "seat": (70, 74), "spokes": (24, 36.99),
}  # fmt: skip
_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "city": {
        **_COMMON, "tyre_radius": (0.018, 0.023), "wheelbase": (1.05, 1.14), "saddle_z": (0.90, 1.02),
        "bar_z": (1.00, 1.12), "bar_width": (0.54, 0.64), "head": (67, 71), "tube_radius": (0.015, 0.018),
    },
    "road": {
        **_COMMON, "tyre_radius": (0.013, 0.016), "wheelbase": (0.97, 1.03), "saddle_z": (0.93, 1.04),
        "bar_z": (0.89, 0.97), "bar_width": (0.40, 0.45), "head": (71, 74), "tube_radius": (0.014, 0.019),
    },
    "mountain": {
        **_COMMON, "tyre_radius": (0.026, 0.032), "wheelbase": (1.06, 1.18), "saddle_z": (0.86, 0.98),
        "bar_z": (0.96, 1.06), "bar_width": (0.66, 0.78), "head": (66, 69), "tube_radius": (0.018, 0.024),
    },
    "step_through": {
        **_COMMON, "tyre_radius": (0.018, 0.024), "wheelbase": (1.07, 1.16), "saddle_z": (0.86, 0.98),
        "bar_z": (1.04, 1.16), "bar_width": (0.55, 0.66), "head": (66, 70), "tube_radius": (0.017, 0.021),
    },
}  # fmt: skip


@lru_cache(maxsize=1)
def bicycle_shapes() -> tuple[BicycleShape, ...]:
    """All bicycles of the family, always the same: `SHAPES_PER_STYLE` of each style."""
    return tuple(
        BicycleShape(
            shape_id=shape_id,
            style=style,
            wheel_radius=p["wheel_radius"],
            tyre_radius=p["tyre_radius"],
            wheelbase=p["wheelbase"],
            chainstay=p["chainstay"],
            crank_z=p["crank_z"],
            saddle_z=p["saddle_z"],
            bar_z=p["bar_z"],
            bar_width=p["bar_width"],
            head_rad=float(np.deg2rad(p["head"])),
            seat_rad=float(np.deg2rad(p["seat"])),
            tube_radius=p["tube_radius"],
            spokes=int(p["spokes"]),
        )
        for shape_id, style, p in draws_by_style(_RANGES, SHAPES_PER_STYLE, 20090422)
    )


@dataclass(frozen=True, eq=False)
class _Joints:
    """Points (3,) of the frame in the plane y = 0, in metres."""

    rear: FloatArray
    front: FloatArray
    crank: FloatArray
    saddle: FloatArray
    seat_top: FloatArray
    """Where the top tube meets the seat tube."""
    head_low: FloatArray
    head_top: FloatArray
    crown: FloatArray
    """The point where the fork splits."""
    stem: FloatArray
    """Top of the steering axis."""


def _joints(s: BicycleShape) -> _Joints:
    rear = np.array([-s.wheelbase / 2, 0, s.wheel_radius])
    front = np.array([s.wheelbase / 2, 0, s.wheel_radius])
    drop = s.wheel_radius - s.crank_z
    crank = np.array([rear[0] + np.sqrt(s.chainstay**2 - drop**2), 0, s.crank_z])

    def along_seat(z: float) -> FloatArray:
        return np.array([crank[0] - (z - s.crank_z) / np.tan(s.seat_rad), 0, z])

    def along_head(z: float) -> FloatArray:  # the axis passes 45 mm behind the front axle
        return np.array([front[0] - 0.045 - (z - s.wheel_radius) / np.tan(s.head_rad), 0, z])

    crown_z = 2 * s.wheel_radius + 0.035
    head_top_z = max(crown_z + 0.10, s.bar_z - (0.05 if s.style in ("road", "mountain") else 0.14))
    return _Joints(
        rear,
        front,
        crank,
        along_seat(s.saddle_z - 0.05),
        along_seat(s.saddle_z - (0.17 if s.style == "road" else 0.21)),
        along_head(crown_z + 0.025),
        along_head(head_top_z),
        along_head(crown_z),
        along_head(s.bar_z),
    )


def bicycle_mesh(shape: BicycleShape, rng: np.random.Generator) -> Mesh:
    """The mesh of a bicycle in the object frame; rng picks paint and trim. Every face has a part.

    It rides along +x, left at +y, z up, metres, upright, the origin on the ground between the wheels. Saddle,
    fork, cranks, pedals and mudguards belong to the part "frame", the stem to "handlebar".
    """
    paints = (
        (0.45, 0.03, 0.03), (0.03, 0.12, 0.38), (0.03, 0.20, 0.10), (0.02, 0.02, 0.022), (0.62, 0.62, 0.60),
        (0.65, 0.40, 0.03), (0.10, 0.35, 0.42),
    )  # fmt: skip
    paint = plain(paints[int(rng.integers(len(paints)))], 0.3, 0.06)
    leather = plain(((0.03, 0.028, 0.028), (0.16, 0.07, 0.03))[int(rng.integers(2))], 0.1)
    joints = _joints(shape)
    draft = MeshDraft()
    for name, hub in (("front_wheel", joints.front), ("rear_wheel", joints.rear)):
        with draft.labelling(_LABEL[name]):
            _wheel(draft, shape, hub)
    with draft.labelling(_LABEL["frame"]):
        _frame(draft, shape, joints, paint)
        _fork(draft, shape, joints, paint)
        _saddle(draft, joints, leather)
        _drive(draft, joints)
        if shape.style in ("city", "step_through"):
            for hub, reach in ((joints.front, (20, 165)), (joints.rear, (5, 200))):
                _mudguard(draft, shape, hub, reach, paint)
    with draft.labelling(_LABEL["handlebar"]):
        _handlebar(draft, shape, joints, leather)
    return standing_mesh(draft)


_RUBBER = plain((0.025, 0.025, 0.026), 0.03)
_CHROME = plain((0.5, 0.5, 0.51), 0.6, 0.3)
_STEEL = plain((0.2, 0.2, 0.21), 0.4, 0.1)


def _wheel(draft: MeshDraft, s: BicycleShape, hub: FloatArray) -> None:
    """Tyre, rim, spokes and hub."""
    middle = s.wheel_radius - s.tyre_radius
    tube(draft, circle(hub, middle, "y", 48), s.tyre_radius, _RUBBER, sides=10, closed=True)
    rim = middle - s.tyre_radius - 0.004
    tube(draft, circle(hub, rim, "y", 48), 0.009, _CHROME, sides=8, closed=True)
    axle = np.array([0, 0.05, 0])
    tube(draft, [hub - axle, hub + axle], 0.016, _STEEL, sides=10)
    angle = np.arange(s.spokes) * (2 * np.pi / s.spokes)
    for i, a in enumerate(angle):
        flange = hub + np.array([0, 0.032 * (1 - 2 * (i % 2)), 0])
        lead = a + 0.9 * (1 - 2 * (i // 2 % 2))  # spokes leave the hub at a slant
        start = flange + 0.018 * np.array([np.cos(lead), 0, np.sin(lead)])
        draft.bar(start, hub + rim * np.array([np.cos(a), 0, np.sin(a)]), 0.0014, _CHROME, 4)


def _frame(draft: MeshDraft, s: BicycleShape, j: _Joints, paint: Material) -> None:
    r = s.tube_radius
    tube(draft, [j.head_low, j.head_top], r * 1.15, paint)
    tube(draft, [j.crank, j.seat_top], r * 0.95, paint)
    tube(draft, [j.seat_top, j.saddle], 0.0125, _CHROME)
    low = j.head_low + 0.25 * (j.head_top - j.head_low)
    tube(draft, [j.crank, low], r * 1.15, paint)
    if s.style == "step_through":  # a second tube swings low from the head to the seat tube
        high = j.head_low + 0.85 * (j.head_top - j.head_low)
        foot = j.crank + 0.38 * (j.seat_top - j.crank)
        bend = np.array([(high[0] * 0.55 + foot[0] * 0.45), 0, foot[2] - 0.02])
        tube(draft, curve(high, bend, foot), r, paint)
    else:
        tube(draft, [j.head_low + 0.75 * (j.head_top - j.head_low), j.seat_top], r, paint)
    for y in (-0.055, 0.055):
        side = np.array([0, y, 0])
        tube(draft, [j.crank + side * 0.7, j.rear + side], 0.009, paint, sides=8)
        tube(draft, [j.seat_top + side * 0.4 - xyz(0.01, 0, 0), j.rear + side], 0.008, paint, sides=8)


def _fork(draft: MeshDraft, s: BicycleShape, j: _Joints, paint: Material) -> None:
    half = max(0.045, s.tyre_radius + 0.018)
    tube(draft, [j.crown - xyz(0, half, 0), j.crown + xyz(0, half, 0)], 0.016, paint)
    tube(draft, [j.crown, j.head_low], 0.018, paint)
    for y in (-half, half):
        side = np.array([0, y, 0])
        down = (j.crown - j.head_top) / np.linalg.norm(j.crown - j.head_top)
        bend = j.crown + down * 0.62 * np.linalg.norm(j.crown - j.front)
        radius = np.linspace(0.013, 0.008, 13) * (1.5 if s.style == "mountain" else 1.0)
        tube(draft, curve(j.crown + side, bend + side, j.front + side), radius, paint)


def _saddle(draft: MeshDraft, j: _Joints, leather: Material) -> None:
    x = np.linspace(-0.14, 0.15, 15)
    at = (-0.14, -0.13, -0.09, -0.04, 0.02, 0.12, 0.145, 0.15)
    half = np.interp(x, at, (0.030, 0.055, 0.075, 0.066, 0.034, 0.021, 0.014, 0.006))
    high = np.interp(x, at, (0.008, 0.016, 0.024, 0.025, 0.023, 0.020, 0.012, 0.006))
    ring = circle((0, 0, 0), 1.0, "x", 16)
    rings = np.zeros((len(x), 16, 3))
    rings[:, :, 0] = x[:, None]
    rings[:, :, 1] = half[:, None] * ring[:, 1]
    # flat above, hollow from nose to tail
    rings[:, :, 2] = high[:, None] * ring[:, 2] * np.where(ring[:, 2] < 0, 1.2, 0.6) + 0.4 * x[:, None] ** 2
    loft(draft, rings + j.saddle + xyz(0.0, 0, 0.03), leather)


def _drive(draft: MeshDraft, j: _Joints) -> None:
    """Chain ring, chain, cranks and pedals."""
    ring = j.crank + xyz(0, -0.045, 0)
    tube(draft, [ring - xyz(0, 0.003, 0), ring + xyz(0, 0.003, 0)], 0.085, _STEEL, sides=28)
    sprocket = j.rear + xyz(0, -0.045, 0)
    tube(draft, [sprocket - xyz(0, 0.006, 0), sprocket + xyz(0, 0.006, 0)], 0.04, _STEEL, sides=20)
    for up in (1, -1):
        tube(draft, [ring + xyz(0, 0, 0.083 * up), sprocket + xyz(0, 0, 0.038 * up)], 0.004, _STEEL, sides=6)
    tube(draft, [j.crank - xyz(0, 0.07, 0), j.crank + xyz(0, 0.07, 0)], 0.02, _STEEL)
    turn = np.deg2rad(-25)
    for y in (-1, 1):
        arm = y * 0.17 * np.array([np.cos(turn), 0, np.sin(turn)])
        start = j.crank + xyz(0, 0.07 * y, 0)
        tube(draft, [start, start + arm], 0.010, _STEEL, sides=8)
        draft.box(start + arm + xyz(0, 0.055 * y, 0), (0.09, 0.09, 0.024), _RUBBER)


def _mudguard(
    draft: MeshDraft, s: BicycleShape, hub: FloatArray, reach_deg: tuple[float, float], paint: Material
) -> None:
    """A band around a wheel over a range of angles, counted from the front over the top."""
    angle = np.deg2rad(np.linspace(*reach_deg, 17))
    out = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    radius, half = s.wheel_radius + 0.014, s.tyre_radius + 0.008
    profile = np.array(
        [(-half, -0.012), (0, 0.003), (half, -0.012), (half, -0.010), (0, 0.006), (-half, -0.010)]
    )
    rings = hub + (radius + profile[:, 1])[None, :, None] * out[:, None] + profile[:, :1] * [0.0, 1, 0]
    loft(draft, rings, paint)


def _handlebar(draft: MeshDraft, s: BicycleShape, j: _Joints, grip: Material) -> None:
    half = s.bar_width / 2
    tube(draft, [j.head_top, j.stem], 0.014, _CHROME)
    reach = {"road": 0.09, "mountain": 0.06, "city": 0.03, "step_through": 0.03}[s.style]
    clamp = j.stem + xyz(reach, 0, 0.0)
    tube(draft, [j.stem, clamp], 0.015, _CHROME)
    for y in (-1, 1):
        path, from_grip = _half_bar(s, half)
        points = clamp + path * [1, y, 1]
        tube(draft, points[: from_grip + 1], 0.0115, _CHROME)
        tube(draft, points[from_grip:], 0.016, grip)


def _half_bar(s: BicycleShape, half: float) -> tuple[FloatArray, int]:
    """The left half of a bar from the clamp (n, 3), and where its grip begins."""
    if s.style == "road":  # forward, then around and down to the drops
        turn = np.linspace(np.pi / 2, -np.pi / 2, 9)
        hook = np.stack(
            [0.07 + 0.065 * np.cos(turn), np.full(9, half), -0.065 + 0.065 * np.sin(turn)], axis=1
        )
        path = np.concatenate(
            [[(0, 0, 0), (0, half - 0.03, 0), (0.02, half, 0)], hook, [(-0.02, half, -0.13)]]
        )
        return path, 2
    if s.style == "mountain":
        return np.array([(0, 0, 0), (0, 0.08, 0.015), (-0.01, half - 0.14, 0.02), (-0.03, half, 0.02)]), 2
    path = curve(np.array([0, 0, 0.0]), np.array([0.10, half * 1.15, 0.05]), np.array([-0.19, half, 0.0]))
    return path, 8
