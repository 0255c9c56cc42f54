"""Trees, bushes, hedges and tufts of grass, each made of many small flat clumps of leaves.

A plant is drawn once for each variant and shared by all places where it stands; a place turns and scales it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from datasets_synth.meshes.materials import TILE_M, surface
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from recon.arrays import FloatArray

N_VARIANTS = 5
"""Different plants of each kind."""
SHADES = (0.5, 0.85, 1.2)
"""Brightness of leaves from the heart of a crown to its rim: the inner ones see little of the sky."""


@dataclass(frozen=True)
class _Leaves:
    """What a crown is made of."""

    n_clumps: int
    clump_m: float
    rgb: tuple[float, float, float]
    droop: float = 0.0
    """How far the clumps hang, 0 not at all, 1 straight down."""


def coarseness(y_m: float) -> int:
    """How many clumps are one in plants that stand this far away; a near clump is as wide as a hand."""
    return 1 if y_m < 16 else 2 if y_m < 36 else 5


@lru_cache(maxsize=96)
def plant(kind: str, variant: int, coarse: int = 1) -> Mesh:
    """A plant of a kind, "broadleaf", "slender", "conifer", "bush" or "grass tuft".

    Its foot is on the origin.

    Args:
        kind: What it is.
        variant: Which one, 0 to N_VARIANTS - 1.
        coarse: How many clumps are one, for plants that are seen from afar; see ``coarseness``.
    """
    rng = np.random.default_rng([20110926, sorted(_MAKERS).index(kind), variant])
    draft = MeshDraft()
    _MAKERS[kind](draft, rng, coarse)
    return draft.mesh()


@lru_cache(maxsize=64)
def hedge(length_m: int, height_dm: int, variant: int, coarse: int = 1) -> Mesh:
    """A clipped hedge along x, its middle on the origin."""
    rng = np.random.default_rng([20110927, length_m, height_dm, variant])
    draft = MeshDraft()
    half = np.array([length_m / 2, 0.32, height_dm / 20])
    leaves = _green(rng, int(240 / coarse * length_m * (0.5 + height_dm / 20)), 0.09 * np.sqrt(coarse))
    draft.box(
        (0, 0, half[2] * 0.92),
        half * (1.98, 1.7, 1.8),
        _leaf_materials(leaves, variant)[0],
        TILE_M["foliage"],
    )
    at = rng.uniform(-1, 1, (leaves.n_clumps, 3))
    side = np.where(rng.random(len(at)) < 0.7, 1, 2)  # the two long sides and the top
    at[np.arange(len(at)), side] = np.where(side == 2, 1, np.sign(at[np.arange(len(at)), 1]))
    outward = np.zeros_like(at)
    outward[np.arange(len(at)), side] = at[np.arange(len(at)), side]
    at = at * half + (0, 0, half[2]) + rng.normal(0, 0.035, at.shape)
    _clumps(draft, at, outward + np.array([0, 0, 0.35]), np.ones(len(at)), leaves, rng, variant)
    return draft.mesh()


def _green(rng: np.random.Generator, n_clumps: int, clump_m: float, droop: float = 0.0) -> _Leaves:
    """Leaves of a random green; now and then autumn has begun."""
    tone = float(rng.uniform(0.75, 1.25))
    warm = float(rng.choice([0.0, 0.12, 0.45], p=[0.6, 0.28, 0.12]))
    rgb = (tone * (0.92 + warm), tone * (1.0 - 0.15 * warm), tone * (0.85 - 0.4 * warm))
    return _Leaves(n_clumps, clump_m, rgb, droop)


def _leaf_materials(leaves: _Leaves, variant: int) -> tuple[Material, ...]:
    r, g, b = leaves.rgb
    return tuple(surface("foliage", variant % 4, (r * s, g * s, b * s), 0.02) for s in SHADES)


def _clumps(
    draft: MeshDraft,
    at_m: FloatArray,
    outward: FloatArray,
    depth: FloatArray,
    leaves: _Leaves,
    rng: np.random.Generator,
    variant: int = 0,
) -> None:
    """Flat kites of leaves at places (n, 3) that face outward (n, 3) more or less.

    ``depth`` (n,) is 0 in the heart of the plant and 1 at its rim.
    """
    n = len(at_m)
    normal = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-6)
    facing = normal + rng.normal(0, 0.55, (n, 3))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    down = np.array([0.0, 0.0, -1.0]) * leaves.droop + rng.normal(0, 1.0 - 0.8 * leaves.droop, (n, 3))
    along = down - (down * facing).sum(1, keepdims=True) * facing
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    across = np.cross(facing, along)
    size = leaves.clump_m * rng.uniform(0.6, 1.4, (n, 1))
    wide = size * rng.uniform(0.45, 0.9, (n, 1))
    corners = np.stack(
        [
            at_m - along * size,
            at_m + across * wide + along * size * rng.uniform(-0.5, 0.3, (n, 1)),
            at_m + along * size,
            at_m - across * wide + along * size * rng.uniform(-0.5, 0.3, (n, 1)),
        ],
        axis=1,
    )
    start = rng.uniform(0, 1, (n, 1, 2))
    unit = np.array([[0.5, 0.0], [1.0, 0.5], [0.5, 1.0], [0.0, 0.5]]) * 2 * leaves.clump_m / TILE_M["foliage"]
    uv = start + unit
    materials = _leaf_materials(leaves, variant)
    shade = np.clip((depth + rng.normal(0, 0.12, n)) * len(materials), 0, len(materials) - 1).astype(int)
    for k, material in enumerate(materials):
        chosen = np.flatnonzero(shade == k)
        if len(chosen):
            faces = np.arange(len(chosen))[:, None, None] * 4 + np.array([[0, 1, 2], [0, 2, 3]])
            draft.add(
                corners[chosen].reshape(-1, 3),
                faces.reshape(-1, 3),
                np.repeat(normal[chosen] * 0.8 + facing[chosen] * 0.4, 4, axis=0),
                uv[chosen].reshape(-1, 2),
                material,
            )


def _crown(
    draft: MeshDraft,
    boughs_m: FloatArray,
    radii_m: FloatArray,
    leaves: _Leaves,
    rng: np.random.Generator,
    variant: int,
) -> None:
    """Leaves on boughs, each a ball (k, 3) with its radius (k,); the crown is lit from outside and above."""
    share = radii_m**2 / (radii_m**2).sum()
    bough = rng.choice(len(radii_m), leaves.n_clumps, p=share)
    direction = rng.normal(size=(leaves.n_clumps, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    out = rng.uniform(0.35, 1.0, (leaves.n_clumps, 1)) ** 0.5
    at = boughs_m[bough] + direction * out * radii_m[bough, None] * (1, 1, 0.8)
    middle = boughs_m.mean(axis=0)
    from_middle = at - middle
    reach = np.linalg.norm(from_middle, axis=1)
    depth = 0.75 * reach / np.percentile(reach, 96) * out[:, 0] + 0.25 * (0.5 + 0.5 * direction[:, 2])
    outward = direction + 0.8 * from_middle / np.maximum(reach[:, None], 1e-6) + (0, 0, 0.3)
    _clumps(draft, at, outward, depth, leaves, rng, variant)


def _trunk(
    draft: MeshDraft, height_m: float, radius_m: float, boughs_m: FloatArray, rng: np.random.Generator
) -> None:
    """A trunk that forks to the boughs of its crown."""
    bark = surface("bark", int(rng.integers(3)), (0.8, 0.8, 0.8))
    fork = np.array([rng.normal(0, 0.12), rng.normal(0, 0.12), height_m])
    draft.cone((0, 0, -0.1), fork, (radius_m * 1.15, radius_m * 0.8), bark, sides=10)
    for bough in boughs_m:
        draft.cone(fork, bough, (radius_m * 0.55, radius_m * 0.12), bark, sides=6)


def _broadleaf(draft: MeshDraft, rng: np.random.Generator, coarse: int) -> None:
    """A lime, a maple or a chestnut."""
    trunk = float(rng.uniform(2.0, 2.9))
    spread, rise = float(rng.uniform(1.7, 3.0)), float(rng.uniform(2.0, 4.2))
    n = int(rng.integers(9, 15))
    angle = np.arange(n) * 2.4 + rng.uniform(0, 6.28)
    level = (np.arange(n) + 0.5) / n
    reach = spread * np.sqrt(np.clip(1 - (1.7 * level - 0.75) ** 2, 0.06, 1)) * rng.uniform(0.55, 1.0, n)
    boughs = np.stack(
        [reach * np.cos(angle), reach * np.sin(angle), trunk + 0.5 + rise * level + rng.normal(0, 0.25, n)], 1
    )
    radii = spread * rng.uniform(0.32, 0.52, n)
    _trunk(draft, trunk, float(rng.uniform(0.12, 0.26)), boughs, rng)
    leaves = _green(rng, 5200 // coarse, 0.13 * np.sqrt(coarse) * (spread / 2.2))
    _crown(draft, boughs, radii, leaves, rng, int(rng.integers(4)))


def _slender(draft: MeshDraft, rng: np.random.Generator, coarse: int) -> None:
    """A hornbeam or a poplar, narrow and high."""
    trunk, rise = float(rng.uniform(1.6, 2.4)), float(rng.uniform(5.0, 8.5))
    n = int(rng.integers(9, 14))
    level = (np.arange(n) + 0.5) / n
    wide = float(rng.uniform(0.5, 0.9)) * np.sin(np.pi * np.clip(level * 0.8 + 0.18, 0, 1))
    angle = rng.uniform(0, 6.28, n)
    boughs = np.stack([0.5 * wide * np.cos(angle), 0.5 * wide * np.sin(angle), trunk + rise * level], 1)
    _trunk(draft, trunk, float(rng.uniform(0.1, 0.2)), boughs[-1:], rng)
    leaves = _green(rng, 4200 // coarse, 0.13 * np.sqrt(coarse))
    _crown(draft, boughs, wide * 1.1 + 0.3, leaves, rng, int(rng.integers(4)))


def _conifer(draft: MeshDraft, rng: np.random.Generator, coarse: int) -> None:
    """A spruce: whorls of hanging branches round a straight trunk."""
    height, base = float(rng.uniform(7.0, 13.0)), float(rng.uniform(1.4, 2.4))
    bark = surface("bark", int(rng.integers(3)), (0.6, 0.55, 0.5))
    draft.cone((0, 0, -0.1), (0, 0, height), (0.16, 0.02), bark, sides=8)
    n = 5200 // coarse
    level = 1 - np.sqrt(rng.uniform(0, 1, n))
    whorl = np.floor(level * 16) / 16
    angle, out = rng.uniform(0, 6.28, n), np.sqrt(rng.uniform(0.04, 1, n))
    lobe = 0.8 + 0.2 * np.cos(5 * angle + 20 * whorl)
    radius = base * (1 - level) ** 0.9 * out * lobe
    z = 0.7 + (height - 0.7) * (whorl + (1 - out) * 0.055) + rng.normal(0, 0.05, n)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], 1)
    at = ring * radius[:, None] + np.stack([np.zeros(n), np.zeros(n), z], 1)
    leaves = _Leaves(n, 0.17 * np.sqrt(coarse), (0.42, 0.55, 0.48), 0.6)
    _clumps(draft, at, ring + np.array([0, 0, 0.6]), 0.1 + 0.85 * out, leaves, rng, int(rng.integers(4)))


def _bush(draft: MeshDraft, rng: np.random.Generator, coarse: int) -> None:
    """A shrub that reaches the ground."""
    n = int(rng.integers(4, 8))
    boughs = np.stack([rng.normal(0, 0.45, n), rng.normal(0, 0.35, n), rng.uniform(0.3, 1.0, n)], 1)
    leaves = _green(rng, 1700 // coarse, 0.085 * np.sqrt(coarse))
    _crown(draft, boughs, rng.uniform(0.35, 0.6, n), leaves, rng, int(rng.integers(4)))


def _grass_tuft(draft: MeshDraft, rng: np.random.Generator, coarse: int) -> None:
    """Long blades on a square metre of verge."""
    n = 420 // coarse
    foot = np.concatenate([rng.uniform(-0.55, 0.55, (n, 2)), np.zeros((n, 1))], axis=1)
    lean = np.concatenate([rng.normal(0, 0.05, (n, 2)), rng.uniform(0.04, 0.16, (n, 1))], axis=1)
    across = rng.normal(0, 1, (n, 3)) * (1, 1, 0)
    across *= 0.006 * coarse / np.linalg.norm(across, axis=1, keepdims=True)
    vertices = np.stack([foot - across, foot + across, foot + lean], axis=1).reshape(-1, 3)
    tone = float(rng.uniform(0.9, 1.3))
    skin = surface("lawn", int(rng.integers(4)), (tone * 1.15, tone * 1.1, tone))
    uv = np.repeat(rng.uniform(0, 1, (n, 2)), 3, axis=0) + np.tile([[0, 0], [0.01, 0], [0, 0.05]], (n, 1))
    draft.add(vertices, np.arange(3 * n).reshape(-1, 3), np.tile([0.0, 0.0, 1.0], (3 * n, 1)), uv, skin)


_MAKERS = {
    "broadleaf": _broadleaf,
    "slender": _slender,
    "conifer": _conifer,
    "bush": _bush,
    "grass tuft": _grass_tuft,
}
PLANTS = tuple(_MAKERS)
