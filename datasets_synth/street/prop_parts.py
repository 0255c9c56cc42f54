"""What street props are made of: panels, prints, wheels, extruded outlines."""

from collections.abc import Sequence

import cv2
import numpy as np

from datasets_synth.meshes.materials import GLASS_MIRROR, plain
from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.meshes.textures import lettering
from recon.arrays import FloatArray, UInt8Array

Rect = tuple[float, float, float, float]
Pictures = Sequence[UInt8Array]
"""Pictures of cars seen from the side, (h, w, 3) sRGB."""


def tyre_rubber() -> Material:
    """Tyre rubber."""
    return plain((0.02, 0.02, 0.02), 0.05)


def wheel_rim(rng: np.random.Generator) -> Material:
    """A steel or alloy rim."""
    return plain((0.4, 0.4, 0.42), 0.3) if rng.random() < 0.6 else plain((0.08, 0.08, 0.09), 0.2)


def vehicle_glass() -> Material:
    """Dark vehicle glass."""
    return plain((0.025, 0.03, 0.035), 0.4, GLASS_MIRROR)


def front_panel(draft: MeshDraft, rect_m: Rect, y: float, material: Material, tile_m: float = 0.0) -> None:
    """A panel facing -y; rect_m is (x0, x1, z0, z1)."""
    x0, x1, z0, z1 = rect_m
    draft.panel([(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)], material, tile_m)


def back_panel(draft: MeshDraft, rect_m: Rect, y: float, material: Material) -> None:
    """A panel facing +y; rect_m is (x0, x1, z0, z1)."""
    x0, x1, z0, z1 = rect_m
    draft.panel([(x1, y, z0), (x0, y, z0), (x0, y, z1), (x1, y, z1)], material)


def printed(picture: UInt8Array, rng: np.random.Generator) -> UInt8Array:
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


def print_material(pictures: Pictures, rng: np.random.Generator) -> tuple[Material, float]:
    """A print of one of the pictures and its width over its height."""
    picture = printed(pictures[int(rng.integers(len(pictures)))], rng)
    return Material("print", (0.85, 0.85, 0.85), picture, specular=0.04), picture.shape[1] / picture.shape[0]


def wheel_pairs(
    draft: MeshDraft,
    xs: Sequence[float],
    across_m: tuple[float, float],
    radius: float,
    rng: np.random.Generator,
) -> None:
    """Pairs of wheels at each x; across_m is the width over the wheels and the width of a tyre."""
    width, tread = across_m
    rim = wheel_rim(rng)
    for x in xs:
        for y in (-1, 1):
            draft.wheel((x, y * (width / 2 - tread / 2), radius), radius, tread, tyre_rubber(), rim)


def extrude(draft: MeshDraft, outline_xz: FloatArray, width: float, skin: Material) -> None:
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
