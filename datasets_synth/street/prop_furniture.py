"""Street furniture, stalls, plants and people.

Each function returns a draft in its own frame: x along the street, y away from the camera, z up, the origin
on the ground under its middle, the side that matters facing -y.
"""

import numpy as np

from datasets_synth.meshes.materials import DARK, STEEL, TILE_M, paint_rgb, plain, surface, window_glass
from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.meshes.textures import lettering
from datasets_synth.street.prop_parts import Pictures, front_panel, tyre_rubber, vehicle_glass


def skip(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A builder's skip with rubble."""
    draft = MeshDraft()
    skin = surface("rust", int(rng.integers(4)), paint_rgb(rng), 0.05)
    top, low = float(rng.uniform(1.7, 2.1)), 1.1
    for y, s in ((-0.85, -1), (0.85, 1)):
        a = [(-low, y, 0.05), (low, y, 0.05), (top, y, 1.3), (-top, y, 1.3)]
        draft.panel(a if s < 0 else [a[1], a[0], a[3], a[2]], skin, 2.0)
    for s in (-1, 1):
        a = [
            (s * low, s * -0.85, 0.05),
            (s * low, s * 0.85, 0.05),
            (s * top, s * 0.85, 1.3),
            (s * top, s * -0.85, 1.3),
        ]
        draft.panel(a, skin, 2.0)
    draft.box((0, -0.88, 1.27), (2 * top, 0.08, 0.1), skin)
    draft.blob(
        (0, 0, 1.1), (top * 0.85, 0.75, 0.4), surface("concrete", 2, (0.8, 0.72, 0.62)), rng, bumps=0.25
    )
    return draft


def bins(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """Wheeled bins or big containers in a row."""
    draft = MeshDraft()
    big = rng.random() < 0.5
    w, d, h = (1.3, 1.0, 1.25) if big else (0.58, 0.7, 1.0)
    x = 0.0
    for _ in range(int(rng.integers(1, 4))):
        skin = plain(
            ((0.02, 0.08, 0.03), (0.06, 0.06, 0.07), (0.02, 0.05, 0.2), (0.4, 0.32, 0.02))[rng.integers(4)],
            0.15,
        )
        draft.box((x, 0, 0.12 + h / 2), (w, d, h - 0.05), skin)
        draft.box((x, -0.02, h + 0.15), (w + 0.06, d + 0.06, 0.1), skin, tilt_rad=0.0)
        for s in (-1, 1):
            draft.wheel((x + s * (w / 2 - 0.12), -d / 2 + 0.1, 0.1), 0.1, 0.08, tyre_rubber(), plain(STEEL))
            draft.wheel((x + s * (w / 2 - 0.12), d / 2 - 0.1, 0.1), 0.1, 0.08, tyre_rubber(), plain(STEEL))
        x += w + float(rng.uniform(0.06, 0.3))
    return draft


def bench(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A park bench."""
    draft = MeshDraft()
    wood, iron = surface("planks", int(rng.integers(3)), (0.8, 0.7, 0.6)), plain(DARK)
    for k in range(4):
        draft.box((0, -0.18 + 0.12 * k, 0.46), (1.8, 0.1, 0.04), wood, 1.5)
    for k in range(3):
        draft.box((0, 0.27, 0.6 + 0.14 * k), (1.8, 0.04, 0.1), wood, 1.5)
    for x in (-0.75, 0.75):
        draft.box((x, 0, 0.23), (0.06, 0.45, 0.46), iron)
        draft.box((x, 0.27, 0.7), (0.05, 0.05, 0.5), iron)
    return draft


def hedge(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A clipped hedge."""
    draft = MeshDraft()
    leaves = surface("leaves", int(rng.integers(4)), (float(rng.choice([0.8, 1.1, 1.4])),) * 3)
    height = float(rng.choice([0.7, 0.9, 1.2, 1.5]))
    for k in range(int(rng.integers(1, 5))):
        draft.blob(
            (1.5 * k, 0, height / 2 - 0.05),
            (0.95, 0.45, height / 2 + 0.05),
            leaves,
            rng,
            bumps=0.1,
            tile_m=TILE_M["leaves"],
            power=0.35,
        )
    return draft


def bush(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """One or two round bushes."""
    draft = MeshDraft()
    leaves = surface("leaves", int(rng.integers(4)), (float(rng.choice([0.7, 1.0, 1.3])),) * 3)
    for k in range(int(rng.integers(1, 3))):
        r = float(rng.uniform(0.5, 0.95))
        draft.blob((1.3 * k, 0, r * 0.7), (r, r * 0.9, r * 0.8), leaves, rng, bumps=0.25)
    return draft


def low_wall(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A low garden wall with a cap."""
    draft = MeshDraft()
    length, height = float(rng.uniform(1.5, 5.0)), float(rng.uniform(0.5, 1.1))
    kind = str(rng.choice(["bricks", "concrete", "plaster"]))
    draft.box(
        (0, 0, height / 2),
        (length, 0.3, height),
        surface(kind, int(rng.integers(4)), (0.8, 0.8, 0.8)),
        TILE_M[kind],
    )
    draft.box(
        (0, 0, height + 0.03), (length + 0.06, 0.38, 0.07), surface("concrete", 1, (0.9, 0.9, 0.9)), 2.0
    )
    return draft


def fence(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A fence of rails or pickets."""
    draft = MeshDraft()
    length = float(rng.uniform(2.0, 6.0))
    skin = plain((0.6, 0.6, 0.58)) if rng.random() < 0.4 else plain((0.14, 0.1, 0.07))
    if rng.random() < 0.6:
        for x in np.arange(-length / 2, length / 2, 0.16):
            draft.box((x, 0, 0.5), (0.08, 0.025, 0.95), skin)
        for z in (0.25, 0.8):
            draft.box((0, 0.03, z), (length, 0.03, 0.07), skin)
    else:
        for x in np.linspace(-length / 2, length / 2, max(2, round(length / 1.5))):
            draft.bar((x, 0, 0), (x, 0, 1.05), 0.04, skin)
        for z in (0.45, 0.75, 1.02):
            draft.bar((-length / 2, 0, z), (length / 2, 0, z), 0.025, skin)
    return draft


def crates(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """Stacked crates and boxes, wide below."""
    draft = MeshDraft()
    n = int(rng.integers(2, 5))
    for level in range(int(rng.integers(1, 4))):
        for k in range(max(1, n - level)):
            skin = surface("planks", int(rng.integers(3)), (float(rng.choice([0.5, 0.8, 1.0])),) * 3)
            size = float(rng.uniform(0.52, 0.6))
            draft.box(
                ((k - (n - level - 1) / 2) * 0.78, 0.0, 0.3 + 0.6 * level), (0.72, 0.6, size), skin, 1.0
            )
    return draft


def pallets(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """Pallets with wrapped goods."""
    draft = MeshDraft()
    wood = surface("planks", 1, (0.8, 0.7, 0.55))
    for k in range(int(rng.integers(1, 4))):
        x = 1.35 * k
        for z in (0.02, 0.12):
            draft.box((x, 0, z + 0.01), (1.2, 0.8, 0.03), wood, 1.0)
        for s in (-0.5, 0, 0.5):
            draft.box((x + s, 0, 0.07), (0.1, 0.8, 0.08), wood, 1.0)
        h = float(rng.uniform(0.4, 1.5))
        kind = str(rng.choice(["goods", "concrete", "planks"]))
        draft.box(
            (x, 0, 0.14 + h / 2),
            (1.1, 0.76, h),
            surface(kind, int(rng.integers(3)), (0.8, 0.8, 0.8), 0.1),
            1.4,
        )
    return draft


def kiosk(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A low pavilion: a wide dark window band over a light base, a flat roof with a sign."""
    draft = MeshDraft()
    width, depth, height = float(rng.uniform(3.0, 5.0)), 1.9, float(rng.uniform(2.2, 2.7))
    skin = plain(paint_rgb(rng), 0.1)
    draft.box((0, 0, height / 2), (width, depth, height), skin)
    low = float(rng.uniform(0.75, 1.0))
    front_panel(
        draft,
        (-width / 2 + 0.15, width / 2 - 0.15, low, height - 0.5),
        -depth / 2 - 0.01,
        vehicle_glass() if rng.random() < 0.6 else window_glass(rng),
    )
    for x in np.linspace(-width / 2 + 0.15, width / 2 - 0.15, int(rng.integers(2, 5))):
        front_panel(draft, (x - 0.04, x + 0.04, low, height - 0.5), -depth / 2 - 0.016, skin)
    draft.box((0, -0.1, height + 0.06), (width + 0.4, depth + 0.5, 0.12), plain(paint_rgb(rng)))
    front_panel(
        draft,
        (-width * 0.3, width * 0.3, height - 0.42, height - 0.06),
        -depth / 2 - 0.012,
        Material("sign", (0.9,) * 3, lettering(rng, 260, 44)),
    )
    return draft


def stall(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A market stall with an awning."""
    draft = MeshDraft()
    width = float(rng.uniform(2.2, 3.8))
    cloth, post = plain(paint_rgb(rng)), plain((0.5, 0.5, 0.5))
    draft.box((0, 0, 0.45), (width, 1.0, 0.9), cloth)
    draft.box((0, 0, 1.02), (width - 0.1, 0.95, 0.22), surface("goods", int(rng.integers(4))), 1.2)
    for x in (-width / 2, width / 2):
        for y in (-0.6, 0.6):
            draft.bar((x, y, 0), (x, y, 2.2), 0.03, post)
    awning = plain(paint_rgb(rng))
    w = width / 2 + 0.25
    draft.panel([(-w, -0.95, 2.0), (w, -0.95, 2.0), (w, 0.7, 2.5), (-w, 0.7, 2.5)], awning)
    draft.panel([(w, -0.95, 1.99), (-w, -0.95, 1.99), (-w, 0.7, 2.49), (w, 0.7, 2.49)], awning)
    draft.panel([(-w, -0.95, 1.75), (w, -0.95, 1.75), (w, -0.95, 2.0), (-w, -0.95, 2.0)], awning)
    return draft


def container(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A builder's cabin or small container, often with a window."""
    draft = MeshDraft()
    length, height = float(rng.uniform(3.0, 6.0)), float(rng.uniform(1.9, 2.5))
    draft.box(
        (0, 0, 0.1 + height / 2),
        (length, 2.2, height),
        surface("corrugated", int(rng.integers(3)), paint_rgb(rng), 0.1),
        1.6,
    )
    draft.box((0, 0, 0.06), (length + 0.02, 2.22, 0.12), plain(DARK))
    if rng.random() < 0.6:
        front_panel(draft, (-length * 0.3, length * 0.3, 1.0, 1.75), -1.112, vehicle_glass())
    return draft


def planters(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """Concrete planters with bushes."""
    draft = MeshDraft()
    for k in range(int(rng.integers(1, 4))):
        draft.box(
            (1.5 * k, 0, 0.28),
            (1.15, 0.6, 0.56),
            surface("concrete", int(rng.integers(3)), (0.85, 0.85, 0.82)),
            1.5,
        )
        draft.blob(
            (1.5 * k, 0, 0.75),
            (0.5, 0.28, 0.32),
            surface("leaves", int(rng.integers(4)), (1.2, 1.2, 1.2)),
            rng,
            bumps=0.25,
        )
    return draft


def person(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A standing or walking person."""
    draft = MeshDraft()
    coat, trousers, skin = plain(paint_rgb(rng)), plain(paint_rgb(rng)), plain((0.45, 0.28, 0.2))
    stride = float(rng.uniform(0.05, 0.22))
    for s in (-1, 1):
        draft.cone((s * stride, s * 0.07, 0.0), (0, s * 0.08, 0.88), (0.07, 0.1), trousers)
        draft.box((s * stride - 0.05, s * 0.07, 0.04), (0.26, 0.1, 0.08), plain(DARK))
        draft.cone((-s * stride * 0.8, s * 0.24, 0.8), (0, s * 0.2, 1.42), (0.045, 0.06), coat)
    draft.blob((0, 0, 1.18), (0.17, 0.22, 0.38), coat, rng, bumps=0.03)
    draft.blob((-0.02, 0, 1.66), (0.1, 0.09, 0.13), skin, rng, bumps=0.02)
    draft.blob((0.01, 0, 1.7), (0.105, 0.095, 0.115), plain((0.05, 0.03, 0.02)), rng, bumps=0.03)
    return draft
