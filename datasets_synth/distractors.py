"""Things that a car detector takes for a car, and things that hide a car.

Each function returns a draft in its own frame: x along the street, y away from the camera, z up, the origin
on the ground under its middle, the side that matters facing -y.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synth.mesh import Material
from datasets_synth.solids import MeshDraft
from datasets_synth.street import (
    DARK,
    GLASS_MIRROR,
    STEEL,
    TILE_M,
    bare_trunk,
    bollards,
    lamp_post,
    paint_rgb,
    plain,
    sign_post,
    surface,
    tree,
    window_glass,
)
from datasets_synth.textures import lettering

Image = NDArray[np.uint8]
Rect = tuple[float, float, float, float]
Pictures = Sequence[Image]
"""Pictures of cars seen from the side, (h, w, 3) sRGB."""


def _tyre() -> Material:
    return plain((0.02, 0.02, 0.02), 0.05)


def _rim(rng: np.random.Generator) -> Material:
    return plain((0.4, 0.4, 0.42), 0.3) if rng.random() < 0.6 else plain((0.08, 0.08, 0.09), 0.2)


def _glass() -> Material:
    return plain((0.025, 0.03, 0.035), 0.4, GLASS_MIRROR)


def _front(draft: MeshDraft, rect_m: Rect, y: float, material: Material, tile_m: float = 0.0) -> None:
    """A panel facing -y; rect_m is (x0, x1, z0, z1)."""
    x0, x1, z0, z1 = rect_m
    draft.panel([(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)], material, tile_m)


def _back(draft: MeshDraft, rect_m: Rect, y: float, material: Material) -> None:
    x0, x1, z0, z1 = rect_m
    draft.panel([(x1, y, z0), (x0, y, z0), (x0, y, z1), (x1, y, z1)], material)


def printed(picture: Image, rng: np.random.Generator) -> Image:
    """A print of a picture: faded, now and then with a line of words or a border."""
    print_rgb = picture.astype(np.float32)
    grey = print_rgb.mean(axis=2, keepdims=True)
    keep = float(rng.uniform(0.5, 1.0))
    print_rgb = (grey + keep * (print_rgb - grey)) * float(rng.uniform(0.85, 1.1)) + float(rng.uniform(0, 25))
    out = np.clip(print_rgb, 0, 255).astype(np.uint8)
    h, w = out.shape[:2]
    if rng.random() < 0.6:
        strip = max(12, int(h * rng.uniform(0.12, 0.2)))
        words = lettering(rng, w, strip, int(rng.integers(1, 3)))
        out = np.concatenate([words, out]) if rng.random() < 0.5 else np.concatenate([out, words])
    if rng.random() < 0.5:
        edge = int(rng.integers(3, 10))
        colour = [float(v) for v in rng.integers(30, 240, 3)]
        out = cv2.copyMakeBorder(out, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=colour)
    return np.ascontiguousarray(out)


def _print_material(pictures: Pictures, rng: np.random.Generator) -> tuple[Material, float]:
    """A print of one of the pictures and its width over its height."""
    picture = printed(pictures[int(rng.integers(len(pictures)))], rng)
    return Material("print", (0.85, 0.85, 0.85), picture, specular=0.04), picture.shape[1] / picture.shape[0]


def billboard(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A board near the ground with a life-size picture of a car."""
    draft = MeshDraft()
    skin, aspect = _print_material(pictures, rng)
    width = float(rng.uniform(4.2, 6.2))
    height = width / aspect
    low = float(rng.uniform(0.1, 0.6))
    timber = plain((0.25, 0.2, 0.14)) if rng.random() < 0.5 else plain(STEEL)
    draft.box((0, 0.03, low + height / 2), (width + 0.16, 0.06, height + 0.16), timber)
    _front(draft, (-width / 2, width / 2, low, low + height), -0.012, skin)
    for x in np.linspace(-width * 0.42, width * 0.42, 3):
        draft.box((x, 0.12, (low + height) / 2), (0.1, 0.1, low + height), timber)
        draft.bar((x, 0.12, (low + height) * 0.8), (x, 0.9, 0), 0.04, timber)
    return draft


def hoarding(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A builder's fence of boards, one print across several boards, low on the ground."""
    draft = MeshDraft()
    skin, aspect = _print_material(pictures, rng)
    height = float(rng.uniform(1.9, 2.4))
    width = height * aspect
    boards = plain(paint_rgb(rng))
    total = width + float(rng.uniform(1.5, 4.0))
    shift = float(rng.uniform(-0.5, 0.5)) * (total - width) * 0.8
    draft.box((0, 0.02, height / 2 + 0.03), (total, 0.04, height), boards)
    _front(draft, (shift - width / 2, shift + width / 2, 0.05, height), -0.012, skin)
    for x in np.arange(-total / 2, total / 2 + 0.01, 1.25):
        draft.box((x, -0.012, height / 2), (0.05, 0.03, height), plain((0.3, 0.3, 0.3)))
        draft.box((x, 0.3, 0.08), (0.25, 0.6, 0.16), surface("concrete", 0))
    return draft


def _cab(draft: MeshDraft, x0: float, width: float, rng: np.random.Generator, skin: Material) -> None:
    """A lorry's cab from x0 - 1.9 to x0 (the nose at -x)."""
    length, height = 1.9, float(rng.uniform(2.1, 2.6))
    draft.box((x0 - length / 2, 0, 0.45 + height / 2), (length, width, height), skin, skip=("-z",))
    for y, face in ((-width / 2 - 0.01, _front), (width / 2 + 0.01, _back)):
        face(draft, (x0 - length + 0.25, x0 - 0.55, 1.45, 2.25), y, _glass())
        face(draft, (x0 - length + 0.02, x0 - length + 0.2, 1.5, 2.2), y, plain(DARK))
    x = x0 - length - 0.01
    draft.panel(
        [
            (x, width / 2 - 0.1, 1.4),
            (x, -width / 2 + 0.1, 1.4),
            (x, -width / 2 + 0.1, 2.3),
            (x, width / 2 - 0.1, 2.3),
        ],
        _glass(),
    )
    draft.box((x0 - length, 0, 0.5), (0.15, width, 0.3), plain(DARK))


def _wheels(
    draft: MeshDraft,
    xs: Sequence[float],
    across_m: tuple[float, float],
    radius: float,
    rng: np.random.Generator,
) -> None:
    """Pairs of wheels at each x; across_m is the width over the wheels and the width of a tyre."""
    width, tread = across_m
    rim = _rim(rng)
    for x in xs:
        for y in (-1, 1):
            draft.wheel((x, y * (width / 2 - tread / 2), radius), radius, tread, _tyre(), rim)


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
    _wheels(draft, (-1.15, box * 0.72), (width, 0.24), 0.42, rng)
    if side is not None:
        material, aspect = side
        h = min(high * 0.92, box * 0.96 / aspect)
        w = h * aspect
        for y, face in ((-width / 2 - 0.012, _front), (width / 2 + 0.012, _back)):
            rect = (box / 2 - w / 2, box / 2 + w / 2, low + (high - h) / 2, low + (high + h) / 2)
            face(draft, rect, y, material)
    elif rng.random() < 0.5:
        words = Material("lettering", (0.85, 0.85, 0.85), lettering(rng, 360, 90))
        for y, face in ((-width / 2 - 0.012, _front), (width / 2 + 0.012, _back)):
            face(draft, (box * 0.15, box * 0.85, low + 0.6, low + 0.6 + box * 0.7 / 4), y, words)
    draft.transform(np.eye(3), (-box / 2 + 0.95, 0, 0))
    return draft


def truck(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A box truck."""
    return _lorry(rng, None)


def truck_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A box truck whose side shows a picture of a car."""
    return _lorry(rng, _print_material(pictures, rng))


def _bus(rng: np.random.Generator, side: tuple[Material, float] | None) -> MeshDraft:
    draft = MeshDraft()
    length, width, height = float(rng.uniform(6.5, 10.5)), 2.4, float(rng.uniform(2.6, 3.0))
    skin = plain(paint_rgb(rng), 0.2)
    draft.box((0, 0, 0.35 + (height - 0.35) / 2), (length, width, height - 0.35), skin, skip=("-z",))
    draft.box((0, 0, 0.3), (length - 0.6, width - 0.2, 0.2), plain(DARK))
    for y, face in ((-width / 2 - 0.01, _front), (width / 2 + 0.01, _back)):
        face(draft, (-length / 2 + 0.15, length / 2 - 0.3, 1.35, 2.35), y, _glass())
    for y, face in ((-width / 2 - 0.016, _front), (width / 2 + 0.016, _back)):
        for x in np.arange(-length / 2 + 1.3, length / 2 - 0.4, 1.35):
            face(draft, (x, x + 0.09, 1.35, 2.35), y, skin)
    x = -length / 2 - 0.01
    draft.panel([(x, 1.1, 1.1), (x, -1.1, 1.1), (x, -1.1, 2.4), (x, 1.1, 2.4)], _glass())
    _wheels(draft, (-length * 0.3, length * 0.28), (width + 0.04, 0.24), 0.46, rng)
    if side is not None:
        material, aspect = side
        h = 1.75
        w = h * aspect
        if w < length * 0.75:
            _front(draft, (0.2 - w / 2, 0.2 + w / 2, 0.55, 0.55 + h), -width / 2 - 0.022, material)
    return draft


def bus(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A bus with a dark window band."""
    return _bus(rng, None)


def bus_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A bus with an advertisement for a car over its side and windows."""
    return _bus(rng, _print_material(pictures, rng))


def caravan(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A caravan: light box, wide windows, one axle, a drawbar."""
    draft = MeshDraft()
    length, width, top = float(rng.uniform(3.6, 5.0)), 2.0, float(rng.uniform(1.9, 2.35))
    skin = plain((0.7, 0.7, 0.66), 0.15) if rng.random() < 0.7 else plain(paint_rgb(rng), 0.15)
    _profile(draft, _rounded(length, 0.42, top, 0.45), width, skin)
    _wheels(draft, (0.15,), (width, 0.2), 0.33, rng)
    band = plain(paint_rgb(rng), 0.1)
    for y, face in ((-width / 2 - 0.01, _front), (width / 2 + 0.01, _back)):
        face(draft, (-length / 2 + 0.5, -0.3, 1.15, 1.65), y, _glass())
        face(draft, (0.3, length / 2 - 0.5, 1.15, 1.65), y, _glass())
        face(draft, (-length / 2 + 0.25, length / 2 - 0.25, 0.75, 0.9), y, band)
        face(draft, (-0.2, 0.5, 0.42, 0.62), y, plain(DARK))
    draft.bar((-length / 2, 0, 0.5), (-length / 2 - 1.0, 0, 0.45), 0.05, plain(STEEL))
    draft.bar((-length / 2 - 0.8, 0, 0.45), (-length / 2 - 0.8, 0, 0.0), 0.03, plain(STEEL))
    return draft


def _rounded(length: float, low: float, top: float, radius: float) -> NDArray[np.float64]:
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


def _profile(draft: MeshDraft, outline_xz: NDArray[np.float64], width: float, skin: Material) -> None:
    """Extrude a convex outline across the street."""
    n = len(outline_xz)
    for y, flip in ((-width / 2, False), (width / 2, True)):
        p = np.stack([outline_xz[:, 0], np.full(n, y), outline_xz[:, 1]], 1)
        centre = p.mean(0, keepdims=True)
        i = np.arange(n)
        j = (i + 1) % n
        faces = np.stack([np.full(n, n), j, i] if flip else [np.full(n, n), i, j], 1)
        normal = np.tile([0.0, 1.0 if flip else -1.0, 0.0], (n + 1, 1))
        draft.add(np.concatenate([p, centre]), faces, normal, np.zeros((n + 1, 2)), skin)
    for a, b in zip(outline_xz, np.roll(outline_xz, -1, axis=0), strict=True):
        if np.linalg.norm(a - b) > 1e-6:
            h = width / 2
            draft.panel([(a[0], -h, a[1]), (a[0], h, a[1]), (b[0], h, b[1]), (b[0], -h, b[1])], skin)


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
    _wheels(draft, (0.1,) if length < 3.4 else (-0.35, 0.45), (width + 0.5, 0.2), 0.31, rng)
    for y in (-width / 2 - 0.12, width / 2 + 0.12):
        draft.box((0.05, y, 0.68), (0.8 if length < 3.4 else 1.6, 0.24, 0.06), plain(DARK))
    style = int(rng.integers(3))
    if style == 0:  # tarpaulin, sloping like a car's roof
        tarp = plain(paint_rgb(rng))
        low, top = deck + 0.44, deck + float(rng.uniform(0.8, 1.2))
        half = length / 2 - 0.05
        outline = np.array([(-half, low), (half, low), (half * 0.75, top), (-half * 0.55, top)])
        _profile(draft, outline, width - 0.06, tarp)
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


def covered_boat(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A small boat on a trailer."""
    draft = MeshDraft()
    length, width = float(rng.uniform(3.8, 5.2)), 1.8
    hull = plain((0.65, 0.65, 0.63), 0.2) if rng.random() < 0.6 else plain(paint_rgb(rng), 0.2)
    outline = np.array([(-length / 2, 1.25), (-length * 0.3, 0.65), (length / 2, 0.6), (length / 2, 1.3)])
    _profile(draft, outline, width, hull)
    cabin = np.array(
        [(-length * 0.12, 1.29), (length * 0.3, 1.29), (length * 0.26, 1.8), (-length * 0.02, 1.8)]
    )
    _profile(draft, cabin, width * 0.75, _glass() if rng.random() < 0.5 else plain(paint_rgb(rng)))
    draft.box((0, 0, 0.52), (length, 0.3, 0.1), plain(STEEL))
    _wheels(draft, (length * 0.12,), (width + 0.1, 0.2), 0.31, rng)
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
    draft.box((0.5, 0, 1.85), (1.2, 1.15, 0.85), _glass())
    draft.box((0.5, 0, 2.35), (1.4, 1.35, 0.14), skin)
    rim = plain((0.55, 0.45, 0.05))
    for y in (-0.75, 0.75):
        draft.wheel((-1.2, y, 0.45), 0.45, 0.3, _tyre(), rim)
        draft.wheel((0.75, y, 0.75), 0.75, 0.42, _tyre(), rim)
    return draft


def bicycle(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A row of one to three bicycles leaning along the street."""
    draft = MeshDraft()
    frame, tyre = plain(paint_rgb(rng), 0.3), _tyre()
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
    _front(
        draft,
        (-length / 2 + 0.1, length / 2 - 0.1, 1.1, 1.5),
        -0.2,
        surface("goods", int(rng.integers(4))),
        1.2,
    )
    return draft


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
            draft.wheel((x + s * (w / 2 - 0.12), -d / 2 + 0.1, 0.1), 0.1, 0.08, _tyre(), plain(STEEL))
            draft.wheel((x + s * (w / 2 - 0.12), d / 2 - 0.1, 0.1), 0.1, 0.08, _tyre(), plain(STEEL))
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


def shelter(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A bus shelter with glass and, where there are pictures, an advertisement."""
    draft = MeshDraft()
    steel, width = plain((0.1, 0.1, 0.11), 0.2), float(rng.uniform(3.0, 4.2))
    for x in (-width / 2, 0.0, width / 2):
        draft.box((x, 0.6, 1.2), (0.07, 0.07, 2.4), steel)
    draft.box((0, 0.1, 2.45), (width + 0.3, 1.4, 0.1), steel)
    draft.box((0, 0.62, 1.5), (width - 0.1, 0.02, 1.3), plain((0.12, 0.14, 0.14), 0.4, 0.3))
    draft.box((0, 0.35, 0.45), (width * 0.7, 0.4, 0.06), surface("planks", 2, (0.6, 0.6, 0.6)), 1.5)
    for x in (-width * 0.25, width * 0.25):
        draft.box((x, 0.4, 0.21), (0.06, 0.3, 0.42), steel)
    if len(pictures) and rng.random() < 0.5:
        skin, aspect = _print_material(pictures, rng)
        w = min(width - 0.4, 1.3 * aspect)
        draft.box((0, 0.56, 1.4), (w + 0.1, 0.06, w / aspect + 0.1), steel)
        _front(draft, (-w / 2, w / 2, 1.4 - w / aspect / 2, 1.4 + w / aspect / 2), 0.52, skin)
    return draft


def kiosk(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A low pavilion: a wide dark window band over a light base, a flat roof with a sign."""
    draft = MeshDraft()
    width, depth, height = float(rng.uniform(3.0, 5.0)), 1.9, float(rng.uniform(2.2, 2.7))
    skin = plain(paint_rgb(rng), 0.1)
    draft.box((0, 0, height / 2), (width, depth, height), skin)
    low = float(rng.uniform(0.75, 1.0))
    _front(
        draft,
        (-width / 2 + 0.15, width / 2 - 0.15, low, height - 0.5),
        -depth / 2 - 0.01,
        _glass() if rng.random() < 0.6 else window_glass(rng),
    )
    for x in np.linspace(-width / 2 + 0.15, width / 2 - 0.15, int(rng.integers(2, 5))):
        _front(draft, (x - 0.04, x + 0.04, low, height - 0.5), -depth / 2 - 0.016, skin)
    draft.box((0, -0.1, height + 0.06), (width + 0.4, depth + 0.5, 0.12), plain(paint_rgb(rng)))
    _front(
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
        _front(draft, (-length * 0.3, length * 0.3, 1.0, 1.75), -1.112, _glass())
    return draft


def container_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A container with a picture of a car on its long side."""
    draft = MeshDraft()
    skin, aspect = _print_material(pictures, rng)
    length, height = float(rng.uniform(4.5, 6.0)), float(rng.uniform(2.2, 2.6))
    colour = paint_rgb(rng)
    draft.box((0, 0, 0.1 + height / 2), (length, 2.2, height), surface("corrugated", 0, colour, 0.1), 1.6)
    draft.box((0, 0, 0.06), (length + 0.02, 2.22, 0.12), plain(DARK))
    w = min(length * 0.94, height * 0.9 * aspect)
    h = w / aspect
    middle = 0.1 + height / 2
    _front(draft, (-w / 2, w / 2, middle - h / 2, middle + h / 2), -1.115, skin)
    return draft


def banner(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A printed cloth with a picture of a car, tied between two posts."""
    draft = MeshDraft()
    skin, aspect = _print_material(pictures, rng)
    height = float(rng.uniform(1.3, 2.1))
    width, low = height * aspect, float(rng.uniform(0.08, 0.5))
    draft.box((0, 0.005, low + height / 2), (width, 0.01, height), plain((0.6, 0.6, 0.58)))
    _front(draft, (-width / 2, width / 2, low, low + height), -0.006, skin)
    for x in (-width / 2 - 0.12, width / 2 + 0.12):
        draft.bar((x, 0, -0.05), (x, 0, low + height + 0.15), 0.035, plain(STEEL, 0.2))
        for z in (low + 0.05, low + height - 0.05):
            draft.bar((x, 0, z), (x * 0.97, 0, z), 0.01, plain((0.7, 0.7, 0.7)))
    return draft


def showroom(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A pavilion of a car dealer: a life-size print fills its window."""
    draft = MeshDraft()
    skin, aspect = _print_material(pictures, rng)
    width, depth = float(rng.uniform(4.4, 6.0)), 1.9
    inside = width - 0.6
    height = inside / aspect + float(rng.uniform(0.7, 1.0))
    wall = plain(paint_rgb(rng), 0.1)
    draft.box((0, 0, height / 2), (width, depth, height), wall)
    low = 0.15
    _front(draft, (-inside / 2, inside / 2, low, low + inside / aspect), -depth / 2 - 0.01, skin)
    for x in np.linspace(-inside / 2, inside / 2, int(rng.integers(2, 4))):
        _front(draft, (x - 0.03, x + 0.03, low, low + inside / aspect), -depth / 2 - 0.016, wall)
    draft.box((0, -0.1, height + 0.06), (width + 0.3, depth + 0.4, 0.12), plain(paint_rgb(rng)))
    sign = Material("sign", (0.9, 0.9, 0.9), lettering(rng, 260, 44))
    _front(draft, (-width * 0.3, width * 0.3, height - 0.42, height - 0.06), -depth / 2 - 0.012, sign)
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


def _fixture(
    make: Callable[[np.random.Generator], MeshDraft],
) -> Callable[[np.random.Generator, Pictures], MeshDraft]:
    def build(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
        return make(rng)

    return build


@dataclass(frozen=True)
class Prop:
    """A kind of thing that may be put into a scene."""

    kind: str
    build: Callable[[np.random.Generator, Pictures], MeshDraft]
    on: tuple[str, ...]
    """Roles of the strips that it may stand on."""
    needs_pictures: bool = False
    hides: bool = False
    """Small enough to stand before a car and hide a part of it."""


_WALK = ("pavement", "verge", "square")
_DRIVE = ("road", "lot")
PROPS: tuple[Prop, ...] = (
    Prop("billboard", billboard, ("pavement", "verge", "square", "lot"), True),
    Prop("hoarding", hoarding, ("pavement", "verge", "square", "lot"), True),
    Prop("truck_picture", truck_picture, _DRIVE, True),
    Prop("bus_picture", bus_picture, ("road",), True),
    Prop("container_picture", container_picture, ("lot", "verge", "square", "road"), True),
    Prop("banner", banner, (*_WALK, "lot"), True),
    Prop("showroom", showroom, ("pavement", "verge", "square"), True),
    Prop("truck", truck, _DRIVE),
    Prop("bus", bus, ("road",)),
    Prop("caravan", caravan, ("lot", "road", "verge", "square")),
    Prop("trailer", trailer, ("lot", "road", "square")),
    Prop("boat", covered_boat, ("lot", "road", "verge")),
    Prop("tractor", tractor, ("lot", "road", "verge")),
    Prop("bicycle", bicycle, _WALK, hides=True),
    Prop("cart", cart, ("pavement", "square")),
    Prop("skip", skip, ("lot", "road", "square", "verge")),
    Prop("bins", bins, (*_WALK, "lot"), hides=True),
    Prop("bench", bench, _WALK, hides=True),
    Prop("hedge", hedge, ("verge", "square", "pavement"), hides=True),
    Prop("bush", bush, ("verge", "square"), hides=True),
    Prop("wall", low_wall, _WALK, hides=True),
    Prop("fence", fence, _WALK, hides=True),
    Prop("crates", crates, (*_WALK, "lot"), hides=True),
    Prop("pallets", pallets, (*_WALK, "lot"), hides=True),
    Prop("shelter", shelter, ("pavement", "square")),
    Prop("kiosk", kiosk, ("pavement", "square", "verge")),
    Prop("stall", stall, ("pavement", "square")),
    Prop("container", container, ("lot", "verge", "square", "road")),
    Prop("planters", planters, ("pavement", "square"), hides=True),
    Prop("person", person, _WALK, hides=True),
    Prop("tree", _fixture(tree), _WALK, hides=True),
    Prop("trunk", _fixture(bare_trunk), _WALK, hides=True),
    Prop("lamp", _fixture(lamp_post), ("pavement", "square"), hides=True),
    Prop("sign", _fixture(sign_post), ("pavement", "verge"), hides=True),
    Prop("bollards", _fixture(bollards), ("pavement", "square"), hides=True),
)
"""Everything that layout may add to a street."""

PROP = {prop.kind: prop for prop in PROPS}
