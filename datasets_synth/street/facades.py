"""House fronts along a street: walls with windows, doors, shops and garages, roofs, balconies, signs."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from datasets_synth.meshes.materials import (
    TILE_M,
    day_glass,
    paint_rgb,
    plain,
    surface,
    tint,
    window_glass,
)
from datasets_synth.meshes.mesh import Material, Placed
from datasets_synth.meshes.solids import MeshDraft, pose
from datasets_synth.meshes.textures import lettering

STOREY_M = 3.0
DOOR_HEIGHT_M = 2.1
DEPTH_M = 8.0
"""From the front of a house to its back."""

Opening = tuple[float, float, float, float, str]
"""x0, z0, x1, z1 and what fills it: "window", "door", "shop" or "garage"."""


@dataclass(frozen=True)
class _Skins:
    wall: Material
    tile_m: float
    frame: Material
    glass: Callable[[np.random.Generator], Material] = window_glass


def facade(
    width_m: float, storeys: int, rng: np.random.Generator, *, is_seen_obliquely: bool = False
) -> MeshDraft:
    """A house with its front from x = 0 to the width in the plane y = 0, facing -y.

    Args:
        width_m: Length of its front.
        storeys: With the ground floor, 2 or more.
        rng: Source of its looks.
        is_seen_obliquely: Close its gables, put windows into its sides, and mirror the other side of a
            street in its panes.
    """
    draft = MeshDraft()
    wall = _wall(rng)
    ground_m = float(rng.uniform(3.2, 3.9))
    height = ground_m + STOREY_M * (storeys - 1) + 0.6
    bays = max(1, round(width_m / float(rng.uniform(2.2, 3.4))))
    bay = width_m / bays
    frame = plain((0.75, 0.75, 0.72) if rng.random() < 0.7 else (0.12, 0.1, 0.08))
    win_w, win_h = min(bay - 0.5, float(rng.uniform(0.9, 1.8))), float(rng.uniform(1.3, 1.9))
    floors = [0.0, ground_m, *(ground_m + STOREY_M * k for k in range(1, storeys))]
    floors[-1] = height
    openings: list[Opening] = []
    balcony = rng.random() < 0.25
    for k in range(storeys - 1):
        sill = ground_m + STOREY_M * k + 0.85
        openings += [
            (bay * (j + 0.5) - win_w / 2, sill, bay * (j + 0.5) + win_w / 2, sill + win_h, "window")
            for j in range(bays)
        ]
    openings += _ground_floor(bays, bay, ground_m, (win_w, win_h), rng)
    skins = _Skins(*wall, frame, day_glass if is_seen_obliquely else window_glass)
    _wall_with_openings(draft, (width_m, height), openings, skins, rng)
    depth = DEPTH_M
    for x, s in ((0.0, -1), (width_m, 1)):
        corners = [(x, depth, 0), (x, 0, 0), (x, 0, height), (x, depth, height)]
        draft.panel(corners if s < 0 else [corners[1], corners[0], corners[3], corners[2]], wall[0], wall[1])
    rise = _roof_and_trim(draft, (width_m, height, depth), ground_m, rng)
    if is_seen_obliquely:
        _sides(draft, (width_m, height, rise), floors[:-1], skins, rng)
    if balcony:
        for k in range(1, storeys - 1):
            _balcony(
                draft, bay * (int(rng.integers(bays)) + 0.5), ground_m + STOREY_M * k, min(bay * 1.3, 3.0)
            )
    return draft


def _wall(rng: np.random.Generator) -> tuple[Material, float]:
    kind = str(rng.choice(["plaster", "bricks", "concrete", "planks"], p=[0.5, 0.32, 0.13, 0.05]))
    if kind == "plaster":
        tints = [
            (0.85, 0.8, 0.65),
            (0.8, 0.8, 0.8),
            (0.75, 0.55, 0.4),
            (0.55, 0.6, 0.6),
            (0.8, 0.7, 0.4),
            (0.5, 0.35, 0.3),
        ]
        return surface(kind, int(rng.integers(4)), tints[rng.integers(len(tints))]), TILE_M[kind]
    return surface(kind, int(rng.integers(5)), (0.85, 0.85, 0.85)), TILE_M[kind]


def _ground_floor(
    bays: int, bay_m: float, ground_m: float, window_m: tuple[float, float], rng: np.random.Generator
) -> list[Opening]:
    """Openings of the ground floor."""
    win_w, win_h = window_m
    style = str(rng.choice(["flat", "shop", "garage"], p=[0.42, 0.38, 0.2]))
    door = int(rng.integers(bays))
    out = []
    for j in range(bays):
        middle = bay_m * (j + 0.5)
        if j == door:
            out.append((middle - 0.5, 0.05, middle + 0.5, 0.05 + DOOR_HEIGHT_M, "door"))
        elif style == "shop":
            half = min(bay_m / 2 - 0.15, 1.6)
            out.append((middle - half, 0.5, middle + half, 2.6, "shop"))
        elif style == "garage" and bay_m > 2.7:
            out.append((middle - 1.2, 0.02, middle + 1.2, 2.2, "garage"))
        else:
            out.append(
                (middle - win_w / 2, 1.0, middle + win_w / 2, min(1.0 + win_h, ground_m - 0.4), "window")
            )
    return out


def _wall_with_openings(
    draft: MeshDraft,
    size_m: tuple[float, float],
    openings: list[Opening],
    skins: _Skins,
    rng: np.random.Generator,
) -> None:
    """The wall cut into rows around its openings, each opening recessed with its filling."""
    width, height = size_m
    skin, tile = skins.wall, skins.tile_m
    rows = sorted({(o[1], o[3]) for o in openings})
    # cut the wall into bands at every edge of an opening, then each band at its holes
    cuts = sorted({0.0, height, *(z for row in rows for z in row)})
    for z0, z1 in pairwise(cuts):
        x = 0.0
        holes = sorted((o[0], o[2]) for o in openings if o[1] < z1 - 1e-6 and o[3] > z0 + 1e-6)
        for h0, h1 in [*holes, (width, width)]:
            if h0 > x + 1e-6:
                draft.panel(
                    [(x, 0, z0), (h0, 0, z0), (h0, 0, z1), (x, 0, z1)], skin, tile, (x / tile, z0 / tile)
                )
            x = h1
    for opening in openings:
        _filling(draft, opening, skins, rng)


def _filling(draft: MeshDraft, opening: Opening, skins: _Skins, rng: np.random.Generator) -> None:
    x0, z0, x1, z1, kind = opening
    skin, tile, frame = skins.wall, skins.tile_m, skins.frame
    d = 0.14
    for corners in (
        [(x0, 0, z0), (x1, 0, z0), (x1, d, z0), (x0, d, z0)],
        [(x0, d, z1), (x1, d, z1), (x1, 0, z1), (x0, 0, z1)],
        [(x0, 0, z0), (x0, d, z0), (x0, d, z1), (x0, 0, z1)],
        [(x1, d, z0), (x1, 0, z0), (x1, 0, z1), (x1, d, z1)],
    ):
        draft.panel(corners, skin, tile)
    back = [(x0, d, z0), (x1, d, z0), (x1, d, z1), (x0, d, z1)]
    if kind == "garage":
        draft.panel(back, surface("shutter", int(rng.integers(3)), paint_rgb(rng), 0.1), 1.6)
        return
    if kind == "door":
        draft.panel(back, surface("planks", int(rng.integers(3)), paint_rgb(rng), 0.1), 1.2)
        return
    draft.panel(back, skins.glass(rng))
    bar = 0.06 if kind == "window" else 0.09
    middle = (z0 + z1) / 2, (x0 + x1) / 2
    for a, b, c, e in ((x0, z0, x1, z0 + bar), (x0, z1 - bar, x1, z1),
                       (x0, z0, x0 + bar, z1), (x1 - bar, z0, x1, z1),
                       (middle[1] - bar / 2, z0, middle[1] + bar / 2, z1)):  # fmt: skip
        draft.panel([(a, d - 0.03, b), (c, d - 0.03, b), (c, d - 0.03, e), (a, d - 0.03, e)], frame)
    if kind == "window":
        draft.box(((x0 + x1) / 2, -0.05, z0 - 0.04), (x1 - x0 + 0.2, 0.14, 0.07), frame)


def _sides(
    draft: MeshDraft,
    size_m: tuple[float, float, float],
    floors_m: list[float],
    skins: _Skins,
    rng: np.random.Generator,
) -> None:
    """Gables below the roof, and windows in both side walls.

    size_m is the width, the height of the wall and the rise of the roof.
    """
    width, height, rise = size_m
    sign = [-1.0, 1.0]
    for x, out in zip((0.0, width), sign, strict=True):
        if rise > 0:
            top = (x, DEPTH_M / 2, height + rise)
            corners = np.array([(x, 0, height), (x, DEPTH_M, height), top, top])
            draft.panel(corners if out > 0 else corners[[1, 0, 3, 2]], skins.wall, skins.tile_m)
        bare = rng.random() < 0.25
        for floor in [] if bare else floors_m:
            for y in (2.2, 5.6):
                _side_window(draft, (x, out), (y, floor + 0.9), skins, rng)


def _side_window(
    draft: MeshDraft,
    wall: tuple[float, float],
    at_m: tuple[float, float],
    skins: _Skins,
    rng: np.random.Generator,
) -> None:
    """A window on a side wall; ``wall`` is its x and where it looks, ``at_m`` the middle and the sill."""
    (x, out), (y, z) = wall, at_m
    for half, low, high, lift, skin in (
        (0.55, z, z + 1.4, 0.02, skins.frame),
        (0.47, z + 0.08, z + 1.32, 0.035, skins.glass(rng)),
    ):
        a, b = (y - half, y + half) if out > 0 else (y + half, y - half)
        s = x + out * lift
        draft.panel([(s, a, low), (s, b, low), (s, b, high), (s, a, high)], skin)
    draft.box((x + out * 0.05, y, z - 0.03), (0.12, 1.3, 0.06), skins.frame)


def _roof_and_trim(
    draft: MeshDraft, size_m: tuple[float, float, float], ground_m: float, rng: np.random.Generator
) -> float:
    """Roof, cornice and sign of a house; gives how far the ridge stands above the wall, 0 for a flat roof."""
    width, height, depth = size_m
    rise = 0.0
    if rng.random() < 0.6:  # pitched, eaves towards the street
        rise = depth / 2 * float(rng.uniform(0.6, 0.9))
        tiles = surface("roof", int(rng.integers(3)), tint(rng, 0.6, 1.1))
        draft.panel(
            [
                (-0.1, -0.4, height),
                (width + 0.1, -0.4, height),
                (width + 0.1, depth / 2, height + rise),
                (-0.1, depth / 2, height + rise),
            ],
            tiles,
            2.4,
        )
        draft.panel(
            [
                (width + 0.1, depth, height),
                (-0.1, depth, height),
                (-0.1, depth / 2, height + rise),
                (width + 0.1, depth / 2, height + rise),
            ],
            tiles,
            2.4,
        )
    else:
        draft.box((width / 2, 0.0, height + 0.1), (width, 0.3, 0.25), plain((0.5, 0.5, 0.48)))
        draft.panel(
            [(0, 0, height), (width, 0, height), (width, depth, height), (0, depth, height)],
            plain((0.2, 0.2, 0.2)),
        )
    if rng.random() < 0.5:
        draft.box((width / 2, -0.05, ground_m - 0.1), (width, 0.12, 0.18), plain((0.6, 0.58, 0.55)))
    if rng.random() < 0.45:  # a shop sign
        w = min(width * 0.6, float(rng.uniform(1.6, 4.5)))
        sign = Material("sign", (0.9, 0.9, 0.9), lettering(rng, 320, 56))
        x, z = float(rng.uniform(w / 2, width - w / 2)), ground_m - 0.42
        draft.box((x, -0.06, z), (w, 0.1, 0.5), plain((0.2, 0.2, 0.2)))
        draft.panel(
            [
                (x - w / 2, -0.12, z - 0.25),
                (x + w / 2, -0.12, z - 0.25),
                (x + w / 2, -0.12, z + 0.25),
                (x - w / 2, -0.12, z + 0.25),
            ],
            sign,
        )
    return rise


def _balcony(draft: MeshDraft, x: float, z: float, width: float) -> None:
    iron = plain((0.05, 0.05, 0.05))
    draft.box((x, -0.5, z), (width, 1.0, 0.14), plain((0.5, 0.5, 0.48)))
    draft.box((x, -0.98, z + 1.0), (width, 0.05, 0.05), iron)
    for t in np.linspace(-width / 2, width / 2, max(3, int(width / 0.25))):
        draft.box((x + t, -0.98, z + 0.53), (0.025, 0.025, 0.95), iron)


def facade_row(y_m: float, z_m: float, half_width_m: float, rng: np.random.Generator) -> list[Placed]:
    """House fronts side by side along the street, with a gap now and then."""
    items: list[Placed] = []
    x = -half_width_m + float(rng.uniform(0, 5))
    while x < half_width_m:
        if rng.random() < 0.1:
            x += float(rng.uniform(2, 6))
            continue
        width = float(rng.uniform(6, 15))
        setback = float(rng.choice([0.0, 0.0, 0.25]))
        items.append(
            Placed(facade(width, int(rng.integers(2, 5)), rng).mesh(), pose(x, y_m + setback, z_m), "facade")
        )
        x += width
    return items
