"""The ground of a street seen along its length: bands that follow its rise and fall, kerbs, marks, rails."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from datasets_synth.meshes.materials import TILE_M, plain, surface, tint
from datasets_synth.meshes.mesh import Material, Placed
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.street.along.road import END_M, REAR_M, WIDE_M, Band, Road
from recon.arrays import FloatArray

STEP_M = 2.0
"""Length of the pieces that follow a bent road."""
MARK_LIFT_M = 0.008
"""Marks lie this far above the road; pieces of a bent road are off by less."""
KERB_WIDTH_M = 0.15
DASH_M = ((3.0, 6.0), (6.0, 6.0), (3.0, 9.0))
"""Length of the dashes between lanes and of the gaps between them."""


def ground_items(road: Road, rng: np.random.Generator) -> list[Placed]:
    """The bare street: its bands, kerbs, marks, manholes and the side street."""
    items = [_placed(_band(road, band, rng), _kind(band)) for band in road.bands]
    kerbs = MeshDraft()
    stone = surface("concrete", 0, (0.8, 0.8, 0.8))
    for x, low, high in road.kerbs():
        for y0, y1 in _blocks(road):
            _kerb(kerbs, road, (x, low, high), (y0, y1), stone)
    # a street may have no kerbs, and no marks
    more = [(kerbs, "kerb"), (_marks(road, rng), "road")]
    if road.crossing is not None:
        more.append((_side_street(road, rng), "road"))
    return items + [_placed(draft, kind) for draft, kind in more if draft.n_patches]


def _placed(draft: MeshDraft, kind: str) -> Placed:
    return Placed(draft.mesh(), np.eye(4), kind, "", False)


def _kind(band: Band) -> str:
    return "road" if band.role in ("road", "lot", "tracks") else band.role


def _blocks(road: Road) -> list[tuple[float, float]]:
    """Lengths of the street without the side street."""
    if road.crossing is None:
        return [(REAR_M, END_M)]
    low, high = road.crossing.road_m
    return [(REAR_M, low), (high, END_M)]


def _steps(road: Road, y0: float, y1: float) -> FloatArray:
    """Places along the street where a sheet must have corners to follow it."""
    grade, curve = road.grade, road.curve
    parts = [np.array([y0, y1])]
    if grade.bend:
        near, far = grade.at_m - 6 * grade.length_m, grade.at_m + 6 * grade.length_m
        parts.append(np.arange(max(y0, near), min(y1, far), STEP_M))
    if curve.turn:
        parts.append(np.arange(max(y0, curve.start_m), min(y1, curve.end_m + STEP_M), STEP_M))
    return np.unique(np.concatenate(parts))


def sheet(
    draft: MeshDraft,
    road: Road,
    x_m: tuple[float, float],
    z_m: tuple[float, float],
    y_m: tuple[float, float],
    material: Material,
    tile_m: float,
    shift: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Add a sheet between two x and two y that follows the grade; z at both x is above the grade."""
    ys = _steps(road, *y_m)
    height = road.grade.height_m(ys)
    rows = [np.stack([np.full(len(ys), x), ys, z + height], 1) for x, z in zip(x_m, z_m, strict=True)]
    vertices = np.concatenate(rows)
    i = np.arange(len(ys) - 1)
    j = i + len(ys)
    faces = np.concatenate([np.stack([i, j, j + 1], 1), np.stack([i, j + 1, i + 1], 1)])
    across = (z_m[1] - z_m[0]) / (x_m[1] - x_m[0])
    slope = np.array([road.grade.slope_at(float(y)) for y in ys])
    normal = np.stack([np.full(len(ys), -across), -slope, np.ones(len(ys))], 1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    uv = vertices[:, :2] / tile_m + shift
    vertices[:, 0] += road.curve.shift_m(vertices[:, 1])
    draft.add(vertices, faces, np.concatenate([normal, normal]), uv, material)


def _band(road: Road, band: Band, rng: np.random.Generator) -> MeshDraft:
    draft = MeshDraft()
    low, high = (0.55, 0.85) if band.surface == "road" else (0.75, 1.0)
    skin = surface(band.surface, int(rng.integers(4)), tint(rng, low, high))
    tile = TILE_M[band.surface]
    shift = (float(rng.random()), float(rng.random()))
    blocks = [(REAR_M, END_M)] if band.role in ("road", "tracks") else _blocks(road)
    for y in blocks:
        sheet(draft, road, (band.x0_m, band.x1_m), (band.z0_m, band.z1_m), y, skin, tile, shift)
    if band.role == "tracks":
        middle = (band.x0_m + band.x1_m) / 2
        rail = plain((0.16, 0.15, 0.14), 0.3)
        bed = surface("concrete", 2, (0.5, 0.48, 0.45))
        z = road.profile_m(middle, REAR_M)
        sheet(draft, road, (middle - 1.2, middle + 1.2), (z + 0.01, z + 0.01), (REAR_M, END_M), bed, 3.0)
        for x in (middle - 0.72, middle + 0.72):
            sheet(draft, road, (x - 0.04, x + 0.04), (z + 0.03, z + 0.03), (REAR_M, END_M), rail, 1.0)
    return draft


def _kerb(
    draft: MeshDraft,
    road: Road,
    step_m: tuple[float, float, float],
    y_m: tuple[float, float],
    stone: Material,
) -> None:
    """A kerb stone on the high side of a step: its face and its top."""
    x, low, high = step_m
    outward = 1 if x > 0 else -1
    ys = _steps(road, *y_m)
    height = road.grade.height_m(ys)
    top = high + 0.006
    xs = x + road.curve.shift_m(ys)
    foot = np.stack([xs, ys, low + height], 1)
    edge = np.stack([xs, ys, top + height], 1)
    i = np.arange(len(ys) - 1)
    j = i + len(ys)
    faces = np.concatenate([np.stack([i, i + 1, j + 1], 1), np.stack([i, j + 1, j], 1)])
    normal = np.tile([-float(outward), 0.0, 0.0], (2 * len(ys), 1))
    uv = np.stack([np.tile(ys, 2), np.repeat([0.0, 0.15], len(ys))], 1)
    draft.add(np.concatenate([foot, edge]), faces, normal, uv, stone)
    ends = (x, x + KERB_WIDTH_M) if outward > 0 else (x - KERB_WIDTH_M, x)
    sheet(draft, road, ends, (top, top), y_m, stone, 1.0)


def _marks(road: Road, rng: np.random.Generator) -> MeshDraft:
    """Dashes between lanes, lines at the edges and between places, a stop line, a zebra, manholes."""
    draft = MeshDraft()
    white = surface("marking", int(rng.integers(4)), tint(rng, 0.75, 1.1))

    def flat(x0: float, x1: float, y0: float, y1: float) -> None:
        z = (road.profile_m(x0, y0) + MARK_LIFT_M, road.profile_m(x1, y0) + MARK_LIFT_M)
        sheet(draft, road, (x0, x1), z, (y0, y1), white, 2.0)

    dash, gap = DASH_M[int(rng.integers(len(DASH_M)))]
    start = float(rng.uniform(0, dash + gap))
    between = [(a + b) / 2 for a, b in pairwise(road.lanes_m) if b - a < 4]
    for y0, y1 in _blocks(road):
        for x in between:
            for y in np.arange(y0 + start, y1 - dash, dash + gap):
                flat(x - 0.06, x + 0.06, y, y + dash)
        if rng.random() < 0.45:
            for x in (road.edge_m[0] + 0.25, road.edge_m[1] - 0.25):
                flat(x - 0.06, x + 0.06, y0, y1)
    for band, how in zip((b for b in road.bands if b.role == "lot"), _lots(road), strict=True):
        _bay_lines(road, band, how, flat, rng)
    if road.crossing is not None:
        low, high = road.crossing.road_m
        first = min(x for x in road.lanes_m if x > 0) - road.lane_width_m / 2
        flat(first + 0.15, road.edge_m[1] - 0.1, low - 1.2, low - 0.8)
        if rng.random() < 0.35:
            for x in np.arange(road.edge_m[0] + 0.3, road.edge_m[1] - 0.4, 1.0):
                flat(x, x + 0.5, high + 0.6, high + 3.6)
    _manholes(draft, road, rng)
    return draft


def _lots(road: Road) -> list[str]:
    return [how for how in road.parking if how != "none"]


def _bay_lines(
    road: Road,
    band: Band,
    how: str,
    flat: Callable[[float, float, float, float], None],
    rng: np.random.Generator,
) -> None:
    if how == "slanting" or rng.random() < 0.35:
        return
    pitch = 5.6 if how == "parallel" else 2.6
    for y0, y1 in _blocks(road):
        for y in np.arange(y0 + 1.0, min(y1, 90.0) - 1.0, pitch):
            flat(band.x0_m + 0.1, band.x1_m - 0.1, y, y + 0.1)


def _manholes(draft: MeshDraft, road: Road, rng: np.random.Generator) -> None:
    iron = surface("rust", 2, (0.22, 0.22, 0.22))
    angle = np.linspace(0, 2 * np.pi, 17)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], 1) * 0.31
    for _ in range(int(rng.integers(0, 5))):
        x, y = float(rng.choice(road.lanes_m)) + float(rng.normal(0, 0.7)), float(rng.uniform(4, 40))
        centre = road.world_m(x, y) + np.array([0, 0, 1.2 * MARK_LIFT_M])
        axes = road.axes(x, y)
        draft.disc(centre, ring @ axes.T, axes[:, 2], iron)


def _side_street(road: Road, rng: np.random.Generator) -> MeshDraft:
    """The side street on both sides of the carriageway, its kerbs and its pavements."""
    draft = MeshDraft()
    crossing = road.crossing
    assert crossing is not None
    low, high = crossing.road_m
    asphalt = surface("road", int(rng.integers(4)), tint(rng, 0.55, 0.85))
    slabs = surface("slabs", int(rng.integers(4)), tint(rng, 0.75, 1.0))
    stone = surface("concrete", 0, (0.8, 0.8, 0.8))
    white = surface("marking", int(rng.integers(4)))
    for edge, front, end in zip(road.edge_m, road.frontage_m, (-WIDE_M, WIDE_M), strict=True):
        z = road.profile_m(edge, crossing.y_m)
        x = (min(edge, end), max(edge, end))
        sheet(draft, road, x, (z, z), (low, high), asphalt, TILE_M["road"])
        raised = road.profile_m(front, low - 0.5)
        x = (min(front, end), max(front, end))
        for y0, y1 in ((crossing.gap_m[0], low), (high, crossing.gap_m[1])):
            sheet(draft, road, x, (raised + 0.012,) * 2, (y0, y1), slabs, TILE_M["slabs"])
        for y, towards in ((low, 1.0), (high, -1.0)):
            _cross_kerb(draft, road, edge, end, (y, towards), z, stone)
        for at in np.arange(edge, end, 9.0 if end > 0 else -9.0):
            reach = (float(at), float(at) + (3.0 if end > 0 else -3.0))
            sheet(
                draft, road, (min(reach), max(reach)), (z + MARK_LIFT_M,) * 2,
                (crossing.y_m - 0.06, crossing.y_m + 0.06), white, 2.0,
            )  # fmt: skip
    return draft


def _cross_kerb(
    draft: MeshDraft,
    road: Road,
    start_m: float,
    end_m: float,
    face: tuple[float, float],
    low_m: float,
    stone: Material,
) -> None:
    """The kerb along one side of the side street, from the lanes out; ``face`` is y and where it looks."""
    y, towards = face
    inside = y - 0.3 * towards
    ground = float(road.grade.height_m(y))
    first, last = min(start_m, end_m), max(start_m, end_m)
    xs = sorted({first, last, *(b.x0_m for b in road.bands if first < b.x0_m < last)})
    for x0, x1 in pairwise(xs):
        tops = [road.profile_m(x, inside) for x in (x0 + 0.001, x1 - 0.001)]
        if max(tops) - low_m < 0.03:
            continue
        shift = float(road.curve.shift_m(y))
        a, b = (x0 + shift, tops[0]), (x1 + shift, tops[1])
        if towards < 0:
            a, b = b, a
        draft.panel(
            [
                (b[0], y, low_m + ground - 0.02),
                (a[0], y, low_m + ground - 0.02),
                (a[0], y, a[1] + ground + 0.006),
                (b[0], y, b[1] + ground + 0.006),
            ],
            stone,
            1.0,
        )
        y0, y1 = sorted((y, y - KERB_WIDTH_M * towards))
        sheet(draft, road, (x0, x1), (tops[0] + 0.014, tops[1] + 0.014), (y0, y1), stone, 1.0)
