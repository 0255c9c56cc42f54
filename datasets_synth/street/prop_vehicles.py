"""Things on wheels that are no cars: trucks, buses, caravans, trailers, boats, tractors, bicycles.

Each function returns a draft in its own frame: x along the street, y away from the camera, z up, the origin
on the ground under its middle, the side that matters facing -y.
"""

import numpy as np

from datasets_synth.meshes.materials import DARK, STEEL, paint_rgb, plain, surface
from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.meshes.textures import lettering
from datasets_synth.street.prop_parts import (
    Pictures,
    back_panel,
    extrude,
    front_panel,
    print_material,
    tyre_rubber,
    vehicle_glass,
    wheel_pairs,
)
from recon.arrays import FloatArray


def _cab(draft: MeshDraft, x0: float, width: float, rng: np.random.Generator, skin: Material) -> None:
    """A lorry's cab from x0 - 1.9 to x0 (the nose at -x)."""
    length, height = 1.9, float(rng.uniform(2.1, 2.6))
    draft.box((x0 - length / 2, 0, 0.45 + height / 2), (length, width, height), skin, skip=("-z",))
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (x0 - length + 0.25, x0 - 0.55, 1.45, 2.25), y, vehicle_glass())
        face(draft, (x0 - length + 0.02, x0 - length + 0.2, 1.5, 2.2), y, plain(DARK))
    x = x0 - length - 0.01
    draft.panel(
        [
            (x, width / 2 - 0.1, 1.4),
            (x, -width / 2 + 0.1, 1.4),
            (x, -width / 2 + 0.1, 2.3),
            (x, width / 2 - 0.1, 2.3),
        ],
        vehicle_glass(),
    )
    draft.box((x0 - length, 0, 0.5), (0.15, width, 0.3), plain(DARK))


def _lorry(rng: np.random.Generator, side: tuple[Material, float] | None) -> MeshDraft:
    draft = MeshDraft()
    box, width = float(rng.uniform(4.2, 6.2)), 2.2
    skin = plain(paint_rgb(rng), 0.15)
    high = float(rng.uniform(2.0, 2.4))
    low = 0.75
    body = (
        surface("corrugated", int(rng.integers(3)), (0.8, 0.8, 0.8))
        if rng.random() < 0.3 and side is None
        else skin
    )
    draft.box((box / 2, 0, low + high / 2), (box, width, high), body, 2.0)
    _cab(draft, -0.08, width - 0.1, rng, skin if rng.random() < 0.5 else plain(paint_rgb(rng), 0.2))
    draft.box((box / 2 - 0.9, 0, 0.62), (box + 1.6, 0.9, 0.22), plain(DARK))
    for y in (-0.95, 0.95):
        draft.box((box * 0.42, y, 0.58), (box * 0.35, 0.05, 0.3), plain(DARK))
    wheel_pairs(draft, (-1.15, box * 0.72), (width, 0.24), 0.42, rng)
    if side is not None:
        material, aspect = side
        h = min(high * 0.92, box * 0.96 / aspect)
        w = h * aspect
        for y, face in ((-width / 2 - 0.012, front_panel), (width / 2 + 0.012, back_panel)):
            rect = (box / 2 - w / 2, box / 2 + w / 2, low + (high - h) / 2, low + (high + h) / 2)
            face(draft, rect, y, material)
    elif rng.random() < 0.5:
        words = Material("lettering", (0.85, 0.85, 0.85), lettering(rng, 360, 90))
        for y, face in ((-width / 2 - 0.012, front_panel), (width / 2 + 0.012, back_panel)):
            face(draft, (box * 0.15, box * 0.85, low + 0.6, low + 0.6 + box * 0.7 / 4), y, words)
    draft.transform(np.eye(3), (-box / 2 + 0.95, 0, 0))
    return draft


def truck(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A box truck."""
    return _lorry(rng, None)


def truck_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A box truck whose side shows a picture of a car."""
    return _lorry(rng, print_material(pictures, rng))


def _bus(rng: np.random.Generator, side: tuple[Material, float] | None) -> MeshDraft:
    draft = MeshDraft()
    length, width, height = float(rng.uniform(6.5, 10.5)), 2.4, float(rng.uniform(2.6, 3.0))
    skin = plain(paint_rgb(rng), 0.2)
    draft.box((0, 0, 0.35 + (height - 0.35) / 2), (length, width, height - 0.35), skin, skip=("-z",))
    draft.box((0, 0, 0.3), (length - 0.6, width - 0.2, 0.2), plain(DARK))
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (-length / 2 + 0.15, length / 2 - 0.3, 1.35, 2.35), y, vehicle_glass())
    for y, face in ((-width / 2 - 0.016, front_panel), (width / 2 + 0.016, back_panel)):
        for x in np.arange(-length / 2 + 1.3, length / 2 - 0.4, 1.35):
            face(draft, (x, x + 0.09, 1.35, 2.35), y, skin)
    x = -length / 2 - 0.01
    draft.panel([(x, 1.1, 1.1), (x, -1.1, 1.1), (x, -1.1, 2.4), (x, 1.1, 2.4)], vehicle_glass())
    wheel_pairs(draft, (-length * 0.3, length * 0.28), (width + 0.04, 0.24), 0.46, rng)
    if side is not None:
        material, aspect = side
        h = 1.75
        w = h * aspect
        if w < length * 0.75:
            front_panel(draft, (0.2 - w / 2, 0.2 + w / 2, 0.55, 0.55 + h), -width / 2 - 0.022, material)
    return draft


def bus(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A bus with a dark window band."""
    return _bus(rng, None)


def bus_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A bus with an advertisement for a car over its side and windows."""
    return _bus(rng, print_material(pictures, rng))


def caravan(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A caravan: light box, wide windows, one axle, a drawbar."""
    draft = MeshDraft()
    length, width, top = float(rng.uniform(3.6, 5.0)), 2.0, float(rng.uniform(1.9, 2.35))
    skin = plain((0.7, 0.7, 0.66), 0.15) if rng.random() < 0.7 else plain(paint_rgb(rng), 0.15)
    extrude(draft, _rounded(length, 0.42, top, 0.45), width, skin)
    wheel_pairs(draft, (0.15,), (width, 0.2), 0.33, rng)
    band = plain(paint_rgb(rng), 0.1)
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (-length / 2 + 0.5, -0.3, 1.15, 1.65), y, vehicle_glass())
        face(draft, (0.3, length / 2 - 0.5, 1.15, 1.65), y, vehicle_glass())
        face(draft, (-length / 2 + 0.25, length / 2 - 0.25, 0.75, 0.9), y, band)
        face(draft, (-0.2, 0.5, 0.42, 0.62), y, plain(DARK))
    draft.bar((-length / 2, 0, 0.5), (-length / 2 - 1.0, 0, 0.45), 0.05, plain(STEEL))
    draft.bar((-length / 2 - 0.8, 0, 0.45), (-length / 2 - 0.8, 0, 0.0), 0.03, plain(STEEL))
    return draft


def _rounded(length: float, low: float, top: float, radius: float) -> FloatArray:
    """Outline (n, 2) in x and z of a box with round corners, counter-clockwise seen from -y."""
    quarter = np.linspace(0, np.pi / 2, 6)
    out = []
    for cx, cz, start in (
        (length / 2 - radius, low + radius * 0.4, -np.pi / 2),
        (length / 2 - radius, top - radius, 0.0),
        (-length / 2 + radius, top - radius, np.pi / 2),
        (-length / 2 + radius, low + radius * 0.4, np.pi),
    ):
        squash = 0.4 if cz < (low + top) / 2 else 1.0
        out.append(
            np.stack(
                [cx + radius * np.cos(start + quarter), cz + squash * radius * np.sin(start + quarter)], 1
            )
        )
    return np.concatenate(out)


def trailer(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A car trailer with low boards, often with a load under a tarpaulin."""
    draft = MeshDraft()
    length, width = float(rng.uniform(2.6, 4.6)), 1.7
    skin = (
        surface("planks", int(rng.integers(3)), (0.7, 0.7, 0.7))
        if rng.random() < 0.5
        else plain(paint_rgb(rng), 0.1)
    )
    deck = 0.55
    draft.box((0, 0, deck + 0.22), (length, width, 0.44), skin, 1.5)
    wheel_pairs(draft, (0.1,) if length < 3.4 else (-0.35, 0.45), (width + 0.5, 0.2), 0.31, rng)
    for y in (-width / 2 - 0.12, width / 2 + 0.12):
        draft.box((0.05, y, 0.68), (0.8 if length < 3.4 else 1.6, 0.24, 0.06), plain(DARK))
    style = int(rng.integers(3))
    if style == 0:  # tarpaulin, sloping like a car's roof
        tarp = plain(paint_rgb(rng))
        low, top = deck + 0.44, deck + float(rng.uniform(0.8, 1.2))
        half = length / 2 - 0.05
        outline = np.array([(-half, low), (half, low), (half * 0.75, top), (-half * 0.55, top)])
        extrude(draft, outline, width - 0.06, tarp)
    elif style == 1:
        draft.blob(
            (0, 0, deck + 0.5),
            (length * 0.42, width * 0.42, 0.5),
            surface("grass", 2, (0.7, 0.6, 0.5)),
            rng,
            bumps=0.2,
        )
    draft.bar((-length / 2, 0, 0.5), (-length / 2 - 1.1, 0, 0.42), 0.05, plain(STEEL))
    draft.bar((-length / 2 - 0.9, 0, 0.42), (-length / 2 - 0.9, 0, 0.0), 0.03, plain(STEEL))
    return draft


def trailer_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """An advertising trailer: a board with a picture of a car above a low deck on wheels."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    width, deck = float(rng.uniform(3.6, 4.6)), float(rng.uniform(0.34, 0.48))
    height = width / aspect
    draft.box((0, 0, deck), (width + 0.1, 1.5, 0.12), plain(STEEL, 0.2))
    wheel_pairs(draft, (-0.2,) if width < 4.1 else (-0.35, 0.35), (1.9, 0.18), 0.29, rng)
    low = deck + 0.08
    draft.box((0, -0.6, low + height / 2), (width, 0.05, height), plain((0.5, 0.5, 0.5)))
    front_panel(draft, (-width / 2, width / 2, low, low + height), -0.64, skin)
    for x in (-width * 0.4, width * 0.4):
        draft.bar((x, -0.57, low + height * 0.9), (x, 0.6, deck), 0.03, plain(STEEL))
    draft.bar((-width / 2, 0, deck), (-width / 2 - 1.0, 0, 0.42), 0.05, plain(STEEL))
    draft.bar((-width / 2 - 0.8, 0, 0.42), (-width / 2 - 0.8, 0, 0.0), 0.03, plain(STEEL))
    return draft


def minibus(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A minibus for ten people or more: a short sloping nose, a high roof, a row of windows."""
    draft = MeshDraft()
    length, width, top = float(rng.uniform(5.2, 6.6)), 2.0, float(rng.uniform(2.35, 2.7))
    half, low, belt = length / 2, float(rng.uniform(0.24, 0.34)), float(rng.uniform(1.15, 1.3))
    nose, screen = float(rng.uniform(0.7, 1.0)), float(rng.uniform(0.5, 0.8))
    outline = np.array(
        [(-half, low), (half, low), (half, top - 0.15), (half - 0.15, top), (-half + nose + screen, top),
         (-half + nose, belt), (-half + 0.08, belt - 0.22)]
    )  # fmt: skip
    skin = plain(paint_rgb(rng), 0.25)
    extrude(draft, outline, width, skin)
    band = top - float(rng.uniform(0.32, 0.45))
    first = -half + nose + screen * (band - belt) / (top - belt) + 0.08
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (first, half - 0.25, belt, band), y, vehicle_glass())
        face(draft, (-half + 0.02, half - 0.02, low, low + 0.14), y, plain(DARK))
        face(draft, (-half + 0.02, -half + 0.3, belt - 0.5, belt - 0.3), y, plain((0.5, 0.5, 0.5), 0.4))
        face(draft, (half - 0.14, half - 0.02, belt - 0.3, belt), y, plain((0.26, 0.01, 0.01), 0.4))
    n_pillars = int(rng.integers(2, 5))
    for y, face in ((-width / 2 - 0.016, front_panel), (width / 2 + 0.016, back_panel)):
        for x in np.linspace(first, half - 0.25, n_pillars + 2)[1:-1]:
            face(draft, (x - 0.05, x + 0.05, belt, band), y, skin)
    wheel_pairs(draft, (-half + 0.95, half - float(rng.uniform(1.1, 1.5))), (width + 0.04, 0.22), 0.35, rng)
    return draft


def flatbed(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A light lorry with low boards round its bed, empty or with a load."""
    draft = MeshDraft()
    length, width, top = float(rng.uniform(4.4, 5.6)), 1.75, float(rng.uniform(1.75, 2.05))
    half, low, belt = length / 2, 0.42, float(rng.uniform(1.1, 1.22))
    nose, cab = float(rng.uniform(0.1, 0.6)), float(rng.uniform(1.3, 1.6))
    back = -half + nose + cab
    outline = np.array(
        [(-half, low), (back, low), (back, top), (-half + nose + 0.45, top), (-half + nose, belt),
         (-half, belt - 0.15)]
    )  # fmt: skip
    skin = plain(paint_rgb(rng), 0.25)
    extrude(draft, outline, width, skin)
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (-half + nose + 0.42, back - 0.2, belt, top - 0.16), y, vehicle_glass())
        face(draft, (-half + 0.02, -half + 0.2, belt - 0.4, belt - 0.22), y, plain((0.5, 0.5, 0.5), 0.4))
    bed, deck = (back + 0.08 + half) / 2, float(rng.uniform(0.68, 0.8))
    size = half - back - 0.08
    board = float(rng.uniform(0.3, 0.42))
    boards = skin if rng.random() < 0.4 else surface("planks", int(rng.integers(3)), (0.6, 0.6, 0.6))
    draft.box((bed, 0, deck + board / 2), (size, width + 0.1, board), boards, 1.5)
    draft.box((0, 0, 0.52), (length - 0.3, 0.8, 0.2), plain(DARK))
    wheel_pairs(draft, (-half + 0.75, half - float(rng.uniform(0.8, 1.1))), (width + 0.06, 0.2), 0.34, rng)
    if rng.random() < 0.6:
        tall = float(rng.uniform(0.25, 0.8))
        outline = np.array(
            [(bed - size * 0.46, deck + board), (bed + size * 0.46, deck + board),
             (bed + size * 0.38, deck + board + tall), (bed - size * 0.4, deck + board + tall)]
        )  # fmt: skip
        extrude(draft, outline, width - 0.2, plain(paint_rgb(rng)))
    return draft


def teardrop(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A low camping trailer whose roof falls to the rear like a car's."""
    draft = MeshDraft()
    length, width, top = float(rng.uniform(3.2, 4.2)), 1.75, float(rng.uniform(1.45, 1.75))
    t = np.linspace(0, np.pi, 13)
    # the front is rounder than the tail
    reach = np.where(np.cos(t) > 0, 0.62, 0.38) * length
    bow = np.stack(
        [0.12 * length + reach * np.cos(t) - 0.24 * length, 0.62 + (top - 0.62) * np.sin(t) ** 0.7], 1
    )
    left, right = float(bow[:, 0].min()), float(bow[:, 0].max())
    skin = plain(paint_rgb(rng), 0.3)
    extrude(draft, np.concatenate([[(left + 0.1, 0.34), (right - 0.15, 0.34)], bow]), width, skin)
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (left + 0.5, left + 0.42 * length, 0.95, top - 0.22), y, vehicle_glass())
        if rng.random() < 0.7:
            face(draft, (left + 0.48 * length, left + 0.7 * length, 0.95, top - 0.3), y, vehicle_glass())
    wheel_pairs(draft, (float(rng.uniform(0.0, 0.4)),), (width + 0.1, 0.2), 0.31, rng)
    draft.bar((left, 0, 0.45), (left - 0.9, 0, 0.42), 0.05, plain(STEEL))
    draft.bar((left - 0.7, 0, 0.42), (left - 0.7, 0, 0.0), 0.03, plain(STEEL))
    return draft


def covered_boat(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A small boat on a trailer."""
    draft = MeshDraft()
    length, width = float(rng.uniform(3.8, 5.2)), 1.8
    hull = plain((0.65, 0.65, 0.63), 0.2) if rng.random() < 0.6 else plain(paint_rgb(rng), 0.2)
    outline = np.array([(-length / 2, 1.25), (-length * 0.3, 0.65), (length / 2, 0.6), (length / 2, 1.3)])
    extrude(draft, outline, width, hull)
    cabin = np.array(
        [(-length * 0.12, 1.29), (length * 0.3, 1.29), (length * 0.26, 1.8), (-length * 0.02, 1.8)]
    )
    extrude(draft, cabin, width * 0.75, vehicle_glass() if rng.random() < 0.5 else plain(paint_rgb(rng)))
    draft.box((0, 0, 0.52), (length, 0.3, 0.1), plain(STEEL))
    wheel_pairs(draft, (length * 0.12,), (width + 0.1, 0.2), 0.31, rng)
    draft.bar((-length / 2, 0, 0.5), (-length / 2 - 1.0, 0, 0.42), 0.05, plain(STEEL))
    draft.bar((-length / 2 - 0.9, 0, 0.42), (-length / 2 - 0.9, 0, 0.0), 0.03, plain(STEEL))
    return draft


def tractor(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A tractor: bonnet, glass cab, a small and a large wheel."""
    draft = MeshDraft()
    skin = plain(((0.35, 0.03, 0.02), (0.03, 0.2, 0.05), (0.03, 0.08, 0.35))[rng.integers(3)], 0.2)
    draft.box((-0.95, 0, 1.05), (1.5, 0.7, 0.6), skin)
    draft.box((0, 0, 0.7), (2.6, 0.5, 0.3), plain(DARK))
    draft.box((0.55, 0, 1.2), (1.3, 1.2, 0.5), skin)
    draft.box((0.5, 0, 1.85), (1.2, 1.15, 0.85), vehicle_glass())
    draft.box((0.5, 0, 2.35), (1.4, 1.35, 0.14), skin)
    rim = plain((0.55, 0.45, 0.05))
    for y in (-0.75, 0.75):
        draft.wheel((-1.2, y, 0.45), 0.45, 0.3, tyre_rubber(), rim)
        draft.wheel((0.75, y, 0.75), 0.75, 0.42, tyre_rubber(), rim)
    return draft


def bicycle(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A row of one to three bicycles leaning along the street."""
    draft = MeshDraft()
    frame, tyre = plain(paint_rgb(rng), 0.3), tyre_rubber()
    for k in range(int(rng.integers(1, 4))):
        x0, y = 1.9 * k, 0.0
        for cx in (x0 - 0.52, x0 + 0.52):
            draft.ring((cx, y, 0.34), 0.33, 0.022, tyre)
        pts = {"rear": (x0 + 0.52, y, 0.34), "front": (x0 - 0.52, y, 0.34), "crank": (x0 + 0.08, y, 0.3),
               "seat": (x0 + 0.22, y, 0.85),
               "head": (x0 - 0.38, y, 0.82), "bar": (x0 - 0.36, y, 1.0)}  # fmt: skip
        for a, b in (
            ("rear", "crank"),
            ("crank", "head"),
            ("seat", "head"),
            ("crank", "seat"),
            ("rear", "seat"),
            ("front", "bar"),
        ):
            draft.bar(pts[a], pts[b], 0.02, frame, 6)
        draft.box((x0 + 0.22, y, 0.92), (0.26, 0.14, 0.06), plain(DARK))
        draft.box((x0 - 0.32, y, 1.02), (0.06, 0.5, 0.03), plain(DARK))
    return draft


def cart(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A street seller's cart: two big wheels, a box, a small roof."""
    draft = MeshDraft()
    length = float(rng.uniform(1.8, 3.0))
    skin = surface("planks", int(rng.integers(3)), (0.8, 0.6, 0.45))
    draft.box((0, 0, 0.85), (length, 0.9, 0.5), skin, 1.5)
    for x in (-length * 0.36, length * 0.36):
        for y in (-0.5, 0.5):
            draft.wheel((x, y, 0.36), 0.36, 0.07, plain((0.12, 0.07, 0.04)), plain((0.3, 0.2, 0.1)))
    for x in (-length / 2 + 0.05, length / 2 - 0.05):
        for y in (-0.4, 0.4):
            draft.box((x, y, 1.5), (0.05, 0.05, 0.9), plain((0.4, 0.35, 0.3)))
    draft.box((0, 0, 2.0), (length + 0.3, 1.2, 0.12), plain(paint_rgb(rng)))
    front_panel(
        draft,
        (-length / 2 + 0.1, length / 2 - 0.1, 1.1, 1.5),
        -0.2,
        surface("goods", int(rng.integers(4))),
        1.2,
    )
    return draft
