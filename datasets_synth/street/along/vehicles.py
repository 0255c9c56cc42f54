"""Vehicles in traffic that are no cars, dressed at both ends: trucks, buses, trams, vans for goods.

Each function returns a draft in the object frame: x forward, y left, z up, the origin on the ground below the
middle.
"""

from collections.abc import Callable

import numpy as np

from datasets_synth.meshes.materials import DARK, paint_rgb, plain, surface
from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.solids import MeshDraft, rotation_z
from datasets_synth.meshes.textures import lettering
from datasets_synth.street.distractors import PROP
from datasets_synth.street.prop_parts import (
    Pictures,
    back_panel,
    extrude,
    front_panel,
    vehicle_glass,
    wheel_pairs,
)

LAMP = (0.62, 0.62, 0.60)
TAIL_LAMP = (0.30, 0.010, 0.012)
PLATE = (0.72, 0.72, 0.70)


def end_panel(
    draft: MeshDraft, x: float, out: int, rect_m: tuple[float, float, float, float], skin: Material
) -> None:
    """A panel across the vehicle that looks forward (out = 1) or back (-1); rect_m is (y0, y1, z0, z1)."""
    y0, y1, z0, z1 = rect_m
    a, b = (y0, y1) if out > 0 else (y1, y0)
    draft.panel([(x, a, z0), (x, b, z0), (x, b, z1), (x, a, z1)], skin)


def _lamps(draft: MeshDraft, x: float, out: int, width: float, z: float, rng: np.random.Generator) -> None:
    """A pair of lamps, a plate and a bumper at one end."""
    skin = plain(LAMP if out > 0 else TAIL_LAMP, 0.4)
    w, h = float(rng.uniform(0.16, 0.3)), float(rng.uniform(0.14, 0.34))
    half = width / 2 - 0.06
    for y in (-half + w / 2, half - w / 2):
        end_panel(draft, x, out, (y - w / 2, y + w / 2, z, z + h), skin)
    end_panel(draft, x, out, (-0.26, 0.26, z - 0.12, z), plain(PLATE))
    draft.box((x - 0.02 * out, 0, z - 0.2), (0.12, width * 0.98, 0.18), plain(DARK))


def _turned(draft: MeshDraft) -> tuple[MeshDraft, float, float, float]:
    """A prop with its nose at -x turned about, centred; with its length, width and height."""
    draft.transform(rotation_z(np.pi), (0, 0, 0))
    vertices = draft.mesh().vertices_m
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    draft.transform(np.eye(3), (-float(low[0] + high[0]) / 2, -float(low[1] + high[1]) / 2, 0))
    return draft, float(high[0] - low[0]), float(high[1] - low[1]), float(high[2])


def _dressed(kind: str) -> Callable[[np.random.Generator, Pictures], MeshDraft]:
    """A truck or bus of the street props with lamps, doors or a rear window."""

    def build(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
        draft, length, width, height = _turned(PROP[kind].build(rng, pictures))
        front, rear = length / 2 + 0.012, -length / 2 - 0.012
        across = width - 0.1
        _lamps(draft, front, 1, across, 0.68, rng)
        _lamps(draft, rear, -1, across, 0.78 if kind != "flatbed" else 0.62, rng)
        if kind.startswith("bus") or kind == "minibus":
            end_panel(
                draft, rear, -1, (-across * 0.4, across * 0.4, height * 0.5, height * 0.82), vehicle_glass()
            )
        if kind == "minibus":
            end_panel(draft, front, 1, (-across * 0.42, across * 0.42, 1.25, 1.4), plain(DARK))
        if kind.startswith("truck"):
            end_panel(draft, rear - 0.004, -1, (-0.015, 0.015, 1.0, height - 0.1), plain(DARK))
            for y in (-across / 2 + 0.05, across / 2 - 0.05):
                end_panel(
                    draft, rear - 0.004, -1, (y - 0.02, y + 0.02, 1.0, height - 0.1), plain((0.2, 0.2, 0.2))
                )
        return draft

    return build


def goods_van(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A high van for goods: sloping bonnet, closed sides, two rear doors."""
    draft = MeshDraft()
    length, width, top = float(rng.uniform(5.2, 6.9)), 2.0, float(rng.uniform(2.25, 2.75))
    half, low, belt = length / 2, 0.26, float(rng.uniform(1.12, 1.25))
    nose, screen = float(rng.uniform(0.75, 1.0)), float(rng.uniform(0.6, 0.85))
    outline = np.array(
        [(-half, low), (half, low), (half + 0.02, belt - 0.35), (half - 0.08, belt - 0.18),
         (half - nose, belt), (half - nose - screen, top - 0.04), (half - nose - screen - 0.3, top),
         (-half + 0.06, top), (-half, top - 0.1)]
    )  # fmt: skip
    skin = plain((0.72, 0.72, 0.70), 0.2) if rng.random() < 0.55 else plain(paint_rgb(rng), 0.2)
    extrude(draft, outline, width, skin)
    _cab_glass(draft, (half - nose, belt), (half - nose - screen, top - 0.04), width)
    for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
        face(draft, (-half + 0.02, half - 0.02, low, low + 0.2), y, plain(DARK))
        for x in (half - nose - screen - 1.15, -half + 0.9):
            face(draft, (x, x + 0.02, low + 0.25, top - 0.15), y, plain(DARK))
    if rng.random() < 0.5:
        words = Material("lettering", (0.85, 0.85, 0.85), lettering(rng, 300, 90))
        for y, face in ((-width / 2 - 0.012, front_panel), (width / 2 + 0.012, back_panel)):
            face(draft, (-half + 0.7, -half + 2.7, belt + 0.15, belt + 0.75), y, words)
    rear = -half - 0.012
    _lamps(draft, half + 0.035, 1, width, 0.62, rng)
    _lamps(draft, rear, -1, width, 0.72, rng)
    end_panel(draft, rear, -1, (-0.012, 0.012, 0.6, top - 0.12), plain(DARK))
    if rng.random() < 0.6:
        for y in (-0.5, 0.5):
            end_panel(draft, rear, -1, (y - 0.36, y + 0.36, belt + 0.1, top - 0.35), vehicle_glass())
    wheel_pairs(draft, (half - 0.95, -half + 1.15), (width + 0.03, 0.22), 0.35, rng)
    return draft


def _cab_glass(
    draft: MeshDraft, foot_m: tuple[float, float], head_m: tuple[float, float], width: float
) -> None:
    """The windscreen between two points (x, z), and a side window behind it."""
    (x0, z0), (x1, z1) = foot_m, head_m
    a, b = np.array([x0, z0]), np.array([x1, z1])
    out = np.array([z1 - z0, x0 - x1]) / np.linalg.norm(b - a) * 0.012
    p, q = a + 0.06 * (b - a) + out, a + 0.92 * (b - a) + out
    w = width / 2 - 0.12
    draft.panel([(p[0], -w, p[1]), (p[0], w, p[1]), (q[0], w, q[1]), (q[0], -w, q[1])], vehicle_glass())
    for y, face in ((-width / 2 - 0.012, front_panel), (width / 2 + 0.012, back_panel)):
        face(draft, (x1 - 0.75, x1 + 0.15, z0 + 0.06, z0 + 0.72), y, vehicle_glass())


def tram(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A tram of three cars with bellows between them and a band of windows."""
    draft = MeshDraft()
    width, low, top, car = 2.4, 0.32, 3.35, float(rng.uniform(8.0, 10.0))
    skin = plain(
        ((0.5, 0.36, 0.03), (0.42, 0.03, 0.03), (0.05, 0.12, 0.3), (0.6, 0.6, 0.58))[rng.integers(4)], 0.2
    )
    light = plain((0.6, 0.58, 0.5), 0.2)
    for k in (-1, 0, 1):
        x = k * (car + 0.7)
        draft.box((x, 0, (low + 1.35) / 2), (car, width, 1.35 - low), skin)
        draft.box((x, 0, (1.35 + top) / 2), (car, width, top - 1.35), light)
        for y, face in ((-width / 2 - 0.01, front_panel), (width / 2 + 0.01, back_panel)):
            for start in np.arange(x - car / 2 + 0.3, x + car / 2 - 1.0, 1.5):
                face(draft, (start, start + 1.35, 1.4, 2.6), y, vehicle_glass())
        if k < 1:
            draft.box(
                (x + car / 2 + 0.35, 0, 1.8), (0.75, width - 0.25, 2.7), surface("shutter", 1, (0.1,) * 3)
            )
    half = 1.5 * car + 0.7
    for out in (1, -1):
        x = out * (half + 0.012)
        end_panel(draft, x, out, (-width * 0.43, width * 0.43, 1.35, 2.65), vehicle_glass())
        _lamps(draft, x, out, width, 0.85, rng)
    draft.box((0, 0, top + 0.15), (1.6, 1.2, 0.3), plain(DARK))
    draft.bar((0, -0.5, top + 0.3), (0.8, -0.5, top + 1.1), 0.03, plain(DARK))
    return draft


VEHICLES: dict[str, tuple[str, Callable[[np.random.Generator, Pictures], MeshDraft]]] = {
    "goods van": ("van", goods_van),
    "minibus": ("van", _dressed("minibus")),
    "flatbed": ("truck", _dressed("flatbed")),
    "truck": ("truck", _dressed("truck")),
    "truck with a print": ("truck", _dressed("truck_picture")),
    "bus": ("bus", _dressed("bus")),
    "tram": ("tram", tram),
}
"""What drives beside cars: the kind that truth names, and how it is built."""
OTHER_VEHICLES = ("van", "truck", "bus", "tram")
"""Kinds of vehicles that are annotated beside cars, as something that is not counted."""
