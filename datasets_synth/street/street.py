"""The fixed parts of a street: ground strips with kerbs and markings, trees, poles, a far backdrop.

Everything stands in the world frame: x along the street, y away from the camera, z up, the road at z = 0.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from datasets_synth.meshes.materials import STEEL, TILE_M, paint_rgb, plain, surface, tint
from datasets_synth.meshes.mesh import Material, Placed
from datasets_synth.meshes.solids import MeshDraft

KERB_HEIGHT_M = 0.12


@dataclass(frozen=True)
class Strip:
    """A strip of ground along the street."""

    y0_m: float
    y1_m: float
    z_m: float
    role: str
    """"road", "lot" (both carry cars, z = 0), "pavement", "verge" or "square"."""
    surface: str
    lanes_m: tuple[float, ...] = ()
    """y of the middle of each lane or row of parking places."""


def sample_strips(car_y_m: float, rng: np.random.Generator) -> tuple[Strip, ...]:
    """Strips from behind the camera to the facades, one of them carrying a lane at ``car_y_m``.

    Args:
        car_y_m: Where the first planned car shall drive, 8 m or more.
        rng: Source of the widths.
    """
    strips: list[Strip] = []
    lane = 3.0
    n_lanes = int(rng.integers(1, 3)) if car_y_m < 11 else int(rng.integers(2, 4))
    which = int(rng.integers(n_lanes))
    road0 = car_y_m - lane * (which + 0.5)
    if road0 < 4.5:
        road0, which = car_y_m - lane * 0.5, 0
    road1 = road0 + lane * n_lanes
    fore = _foreground(road0, rng)
    strips += fore
    lanes = tuple(car_y_m + lane * (k - which) for k in range(n_lanes))
    strips.append(Strip(road0, road1, 0.0, "road", "cobbles" if rng.random() < 0.12 else "asphalt", lanes))
    y = road1
    if rng.random() < 0.3:  # a row of parking places behind the lanes
        strips.append(
            Strip(y, y + 2.6, 0.0, "lot", "cobbles" if rng.random() < 0.4 else "asphalt", (y + 1.25,))
        )
        y += 2.6
    width = float(rng.uniform(2.2, 5.0))
    strips.append(Strip(y, y + width, KERB_HEIGHT_M, "pavement", "slabs"))
    y += width
    if rng.random() < 0.35:
        width = float(rng.uniform(1.5, 8.0))
        strips.append(Strip(y, y + width, KERB_HEIGHT_M, "verge", "grass"))
        y += width
    return tuple(strips)


def _foreground(road0_m: float, rng: np.random.Generator) -> list[Strip]:
    """What lies between the camera and the road."""
    strips: list[Strip] = []
    y = -4.0
    pavement = float(rng.uniform(1.5, 3.0))
    gap = road0_m - pavement
    if gap > 16 and rng.random() < 0.6:  # another road or car park nearer to the camera
        near0 = float(rng.uniform(5.0, gap - 8.0))
        near1 = near0 + 5.6
        strips.append(
            Strip(y, near0, KERB_HEIGHT_M, "square", str(rng.choice(["slabs", "grass", "cobbles"])))
        )
        strips.append(Strip(near0, near1, 0.0, "lot", "asphalt", (near0 + 1.4, near0 + 4.2)))
        y = near1
    if gap - y > 1.0:
        kind = str(rng.choice(["slabs", "grass", "cobbles", "asphalt"], p=[0.3, 0.25, 0.15, 0.3]))
        strips.append(Strip(y, gap, 0.0 if kind == "asphalt" else KERB_HEIGHT_M, "square", kind))
        y = gap
    strips.append(Strip(y, road0_m, KERB_HEIGHT_M, "pavement", "slabs"))
    return strips


def ground_height_m(strips: tuple[Strip, ...], y_m: float) -> float:
    """Height of the ground at y."""
    for strip in strips:
        if strip.y0_m <= y_m < strip.y1_m:
            return strip.z_m
    return strips[-1].z_m


def ground_items(
    strips: tuple[Strip, ...], half_width_m: float, far_y_m: float, rng: np.random.Generator
) -> list[Placed]:
    """The ground with kerbs, joints, lane marks and manholes."""
    items: list[Placed] = []
    w = half_width_m
    for strip in strips:
        draft = MeshDraft()
        skin = surface(strip.surface, int(rng.integers(4)), tint(rng, 0.75, 1.05))
        z = strip.z_m
        draft.panel(
            [(-w, strip.y0_m, z), (w, strip.y0_m, z), (w, strip.y1_m, z), (-w, strip.y1_m, z)],
            skin,
            TILE_M[strip.surface],
            (float(rng.random()), float(rng.random())),
        )
        if strip.role in ("road", "lot"):
            _marks(draft, strip, w, rng)
        items.append(
            Placed(
                draft.mesh(), np.eye(4), "road" if strip.role in ("road", "lot") else strip.role, "", False
            )
        )
    stone = surface("concrete", 0, (0.95, 0.95, 0.95))
    draft = MeshDraft()
    for a, b in pairwise(strips):
        if abs(a.z_m - b.z_m) > 0.01:
            y, high = a.y1_m, max(a.z_m, b.z_m)
            inner = 0.15 if b.z_m > a.z_m else -0.15  # the kerb stone lies on the high side
            y0, y1 = min(y, y + inner), max(y, y + inner)
            draft.box(
                (0, (y0 + y1) / 2, high / 2 + 0.004),
                (2 * w, y1 - y0, high + 0.008),
                stone,
                1.0,
                skip=("-z", "+x", "-x"),
            )
    far = strips[-1]
    if draft.n_patches:
        items.append(Placed(draft.mesh(), np.eye(4), "kerb", "", False))
    back = MeshDraft()
    y0, y1, z = far.y1_m, far_y_m, far.z_m
    back.panel(
        [(-3 * w, y0, z), (3 * w, y0, z), (3 * w, y1, z), (-3 * w, y1, z)],
        surface("grass", 1, (0.8, 0.8, 0.8)),
        3.0,
    )
    items.append(Placed(back.mesh(), np.eye(4), "verge", "", False))
    return items


def _marks(draft: MeshDraft, strip: Strip, w: float, rng: np.random.Generator) -> None:
    """Lane marks, parking bays and manholes, a few millimetres above the surface."""
    white = surface("concrete", 1, (1.3, 1.3, 1.25))
    z = strip.z_m + 0.004

    def flat(x0: float, y0: float, x1: float, y1: float, material: Material) -> None:
        draft.panel([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], material, 2.0)

    if strip.role == "road":
        for a, b in pairwise(strip.lanes_m):
            y = (a + b) / 2
            start = float(rng.uniform(0, 9))
            for x in np.arange(-w + start, w, 9.0):
                flat(x, y - 0.06, x + 3.0, y + 0.06, white)
        if rng.random() < 0.5:
            flat(-w, strip.y1_m - 0.35, w, strip.y1_m - 0.23, white)
    else:
        for x in np.arange(-w, w, float(rng.choice([5.5, 6.0]))):
            flat(x, strip.y0_m + 0.2, x + 0.1, strip.y1_m - 0.1, white)
    iron = surface("rust", 2, (0.25, 0.25, 0.25))
    for _ in range(int(rng.integers(0, 4))):
        x, y = float(rng.uniform(-15, 15)), float(rng.uniform(strip.y0_m + 0.5, strip.y1_m - 0.5))
        angle = np.linspace(0, 2 * np.pi, 17)
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], 1) * 0.33
        draft.disc(np.array([x, y, z + 0.001]), ring, np.array([0, 0, 1.0]), iron)


def tree(rng: np.random.Generator) -> MeshDraft:
    """A street tree, its trunk on the origin."""
    draft = MeshDraft()
    bark = surface("bark", int(rng.integers(3)))
    height = float(rng.uniform(2.2, 3.2))
    radius = float(rng.uniform(0.1, 0.24))
    draft.cone((0, 0, -0.05), (0, 0, height + 0.8), (radius, radius * 0.6), bark, sides=12)
    leaves = surface("leaves", int(rng.integers(4)), tint(rng, 0.7, 1.5))
    crown = float(rng.uniform(1.3, 2.4))
    for _ in range(int(rng.integers(3, 7))):
        offset = rng.normal(0, 0.45, 3) * crown
        r = crown * float(rng.uniform(0.55, 0.9))
        draft.blob(
            (offset[0], offset[1], height + crown * 0.9 + offset[2] * 0.8),
            (r, r, r * 0.85),
            leaves,
            rng,
            bumps=0.2,
        )
    return draft


def bare_trunk(rng: np.random.Generator) -> MeshDraft:
    """A big trunk with low branches in winter."""
    draft = MeshDraft()
    bark = surface("bark", int(rng.integers(3)))
    radius = float(rng.uniform(0.15, 0.35))
    draft.cone((0, 0, -0.05), (0, 0, 6.0), (radius, radius * 0.15), bark, sides=14)
    for _ in range(6):
        angle, z = float(rng.uniform(0, 6.28)), float(rng.uniform(2.2, 5.5))
        reach = float(rng.uniform(0.8, 2.0))
        end = (reach * np.cos(angle), reach * np.sin(angle), z + reach * 1.2)
        draft.cone((0, 0, z), end, (radius * 0.4, 0.02), bark, sides=8)
    return draft


def lamp_post(rng: np.random.Generator) -> MeshDraft:
    """A lamp post."""
    draft = MeshDraft()
    steel = plain(STEEL, 0.2)
    height = float(rng.uniform(4, 7))
    draft.cone((0, 0, -0.05), (0, 0, height), (0.08, 0.05), steel, sides=12)
    draft.bar((0, 0, height - 0.05), (0, -1.0, height + 0.2), 0.04, steel)
    draft.box((0, -1.1, height + 0.2), (0.25, 0.5, 0.12), plain((0.6, 0.6, 0.6)))
    return draft


def sign_post(rng: np.random.Generator) -> MeshDraft:
    """A traffic sign on a pole, facing -y."""
    draft = MeshDraft()
    draft.bar((0, 0, -0.05), (0, 0, 2.7), 0.035, plain(STEEL, 0.2))
    face = plain((0.55, 0.03, 0.03)) if rng.random() < 0.5 else plain((0.03, 0.1, 0.45))
    z, r = 2.35, 0.32
    draft.cone((0, -0.04, z), (0, -0.06, z), (r, r), face, sides=20)
    draft.cone((0, -0.06, z), (0, -0.066, z), (r * 0.7, r * 0.7), plain((0.8, 0.8, 0.8)), sides=20)
    return draft


def bollards(rng: np.random.Generator) -> MeshDraft:
    """A short row of bollards along x."""
    draft = MeshDraft()
    skin = plain(paint_rgb(rng), 0.1) if rng.random() < 0.6 else surface("concrete", 2)
    for k in range(int(rng.integers(2, 5))):
        draft.cone((1.4 * k, 0, -0.03), (1.4 * k, 0, 0.95), (0.09, 0.08), skin, sides=12)
    return draft
