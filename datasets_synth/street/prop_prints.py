"""Boards, cloths, containers and pavilions that show a flat picture of a car.

Each function returns a draft in its own frame: x along the street, y away from the camera, z up, the origin
on the ground under its middle, the side that matters facing -y.
"""

import numpy as np

from datasets_synth.meshes.materials import DARK, STEEL, paint_rgb, plain, surface
from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.meshes.textures import lettering
from datasets_synth.street.prop_parts import Pictures, front_panel, print_material


def billboard(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A board near the ground with a life-size picture of a car."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    width = float(rng.uniform(4.2, 6.2))
    height = width / aspect
    low = float(rng.uniform(0.1, 0.6))
    timber = plain((0.25, 0.2, 0.14)) if rng.random() < 0.5 else plain(STEEL)
    draft.box((0, 0.03, low + height / 2), (width + 0.16, 0.06, height + 0.16), timber)
    front_panel(draft, (-width / 2, width / 2, low, low + height), -0.012, skin)
    for x in np.linspace(-width * 0.42, width * 0.42, 3):
        draft.box((x, 0.12, (low + height) / 2), (0.1, 0.1, low + height), timber)
        draft.bar((x, 0.12, (low + height) * 0.8), (x, 0.9, 0), 0.04, timber)
    return draft


def hoarding(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A builder's fence of boards, one print across several boards, low on the ground."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    height = float(rng.uniform(1.9, 2.4))
    width = height * aspect
    boards = plain(paint_rgb(rng))
    total = width + float(rng.uniform(1.5, 4.0))
    shift = float(rng.uniform(-0.5, 0.5)) * (total - width) * 0.8
    draft.box((0, 0.02, height / 2 + 0.03), (total, 0.04, height), boards)
    front_panel(draft, (shift - width / 2, shift + width / 2, 0.05, height), -0.012, skin)
    for x in np.arange(-total / 2, total / 2 + 0.01, 1.25):
        draft.box((x, -0.012, height / 2), (0.05, 0.03, height), plain((0.3, 0.3, 0.3)))
        draft.box((x, 0.3, 0.08), (0.25, 0.6, 0.16), surface("concrete", 0))
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
        skin, aspect = print_material(pictures, rng)
        w = min(width - 0.4, 1.3 * aspect)
        draft.box((0, 0.56, 1.4), (w + 0.1, 0.06, w / aspect + 0.1), steel)
        front_panel(draft, (-w / 2, w / 2, 1.4 - w / aspect / 2, 1.4 + w / aspect / 2), 0.52, skin)
    return draft


def container_picture(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A container with a picture of a car on its long side."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    length, height = float(rng.uniform(4.5, 6.0)), float(rng.uniform(2.2, 2.6))
    colour = paint_rgb(rng)
    draft.box((0, 0, 0.1 + height / 2), (length, 2.2, height), surface("corrugated", 0, colour, 0.1), 1.6)
    draft.box((0, 0, 0.06), (length + 0.02, 2.22, 0.12), plain(DARK))
    w = min(length * 0.94, height * 0.9 * aspect)
    h = w / aspect
    middle = 0.1 + height / 2
    front_panel(draft, (-w / 2, w / 2, middle - h / 2, middle + h / 2), -1.115, skin)
    return draft


def banner(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A printed cloth with a picture of a car, tied between two posts."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    height = float(rng.uniform(1.3, 2.1))
    width, low = height * aspect, float(rng.uniform(0.08, 0.5))
    draft.box((0, 0.005, low + height / 2), (width, 0.01, height), plain((0.6, 0.6, 0.58)))
    front_panel(draft, (-width / 2, width / 2, low, low + height), -0.006, skin)
    for x in (-width / 2 - 0.12, width / 2 + 0.12):
        draft.bar((x, 0, -0.05), (x, 0, low + height + 0.15), 0.035, plain(STEEL, 0.2))
        for z in (low + 0.05, low + height - 0.05):
            draft.bar((x, 0, z), (x * 0.97, 0, z), 0.01, plain((0.7, 0.7, 0.7)))
    return draft


def mural(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A picture of a car for a house wall, near the ground: painted, pasted, or in a frame."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    width = float(rng.uniform(3.8, 5.6))
    low = float(rng.uniform(0.02, 0.35))
    front_panel(draft, (-width / 2, width / 2, low, low + width / aspect), -0.02, skin)
    if rng.random() < 0.5:
        frame = plain(paint_rgb(rng))
        for x in (-width / 2, width / 2):
            draft.box((x, -0.01, low + width / aspect / 2), (0.1, 0.06, width / aspect), frame)
        draft.box((0, -0.01, low + width / aspect), (width + 0.1, 0.06, 0.1), frame)
    return draft


def showroom(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
    """A pavilion of a car dealer: a life-size print fills its window."""
    draft = MeshDraft()
    skin, aspect = print_material(pictures, rng)
    width, depth = float(rng.uniform(4.4, 6.0)), 1.9
    inside = width - 0.6
    height = inside / aspect + float(rng.uniform(0.7, 1.0))
    wall = plain(paint_rgb(rng), 0.1)
    draft.box((0, 0, height / 2), (width, depth, height), wall)
    low = 0.15
    front_panel(draft, (-inside / 2, inside / 2, low, low + inside / aspect), -depth / 2 - 0.01, skin)
    for x in np.linspace(-inside / 2, inside / 2, int(rng.integers(2, 4))):
        front_panel(draft, (x - 0.03, x + 0.03, low, low + inside / aspect), -depth / 2 - 0.016, wall)
    draft.box((0, -0.1, height + 0.06), (width + 0.3, depth + 0.4, 0.12), plain(paint_rgb(rng)))
    sign = Material("sign", (0.9, 0.9, 0.9), lettering(rng, 260, 44))
    front_panel(draft, (-width * 0.3, width * 0.3, height - 0.42, height - 0.06), -depth / 2 - 0.012, sign)
    return draft
