"""Materials of surfaces: colours, tiled textures, glass."""

from functools import lru_cache

import numpy as np

from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.textures import texture

TILE_M = {
    "asphalt": 9.0,
    "slabs": 2.4,
    "cobbles": 2.6,
    "bricks": 2.0,
    "plaster": 4.0,
    "concrete": 3.0,
    "grass": 3.0,
    "leaves": 1.3,
    "planks": 1.5,
    "road": 7.0,
    "lawn": 2.6,
    "foliage": 1.1,
}
"""Metres that one tile of a texture spans."""


@lru_cache(maxsize=512)
def surface(
    kind: str, variant: int = 0, rgb: tuple[float, float, float] = (1.0, 1.0, 1.0), gloss: float = 0.0
) -> Material:
    """The material of a texture kind, tinted."""
    return Material(f"{kind}_{variant}", rgb, texture(kind, variant), specular=gloss)


@lru_cache(maxsize=512)
def plain(rgb: tuple[float, float, float], gloss: float = 0.05, mirror: float = 0.0) -> Material:
    """An untextured material, linear albedo."""
    return Material("plain", rgb, specular=gloss, mirror=mirror)


GLASS_MIRROR = 0.25


DARK = (0.03, 0.03, 0.035)


STEEL = (0.32, 0.33, 0.35)


def window_glass(rng: np.random.Generator) -> Material:
    """A window pane: a dark room or a curtain behind a mirroring surface."""
    return _pane(int(rng.integers(10)), float(rng.choice([0.5, 0.8, 1.1])))


@lru_cache(maxsize=64)
def _pane(variant: int, bright: float) -> Material:
    return Material(
        f"window_{variant}", (bright, bright, bright), texture("curtain", variant), 0.3, 80.0, GLASS_MIRROR
    )


def day_glass(rng: np.random.Generator) -> Material:
    """A window pane by day that shows the room behind and the houses opposite."""
    return _day_pane(int(rng.integers(14)), float(rng.choice([0.55, 0.8, 1.0])))


@lru_cache(maxsize=64)
def _day_pane(variant: int, bright: float) -> Material:
    return Material(f"pane_{variant}", (bright, bright, bright), texture("pane", variant), 0.25, 90.0, 0.06)


def paint_rgb(rng: np.random.Generator) -> tuple[float, float, float]:
    """A linear colour of things that are painted: mostly grey, white or muted, now and then strong."""
    if rng.random() < 0.55:
        value = float(rng.choice([0.04, 0.1, 0.25, 0.45, 0.7]))
        return (value, value, value * float(rng.uniform(0.9, 1.1)))
    base = rng.uniform(0.03, 0.5, 3)
    mixed = 0.5 * base + 0.5 * base.mean()
    return (float(mixed[0]), float(mixed[1]), float(mixed[2]))


def tint(rng: np.random.Generator, low: float, high: float) -> tuple[float, float, float]:
    """A grey tint between two brightnesses."""
    value = round(float(rng.uniform(low, high)), 2)
    return (value, value, value)
