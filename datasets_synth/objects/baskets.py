"""The family of baskets with a handle: the fixed list of shapes, and their meshes."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from datasets_synth.meshes.families import draws_by_style, standing_mesh
from datasets_synth.meshes.lofts import loft, superellipse, tube
from datasets_synth.meshes.materials import surface
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft
from recon.arrays import FloatArray

BASKET_PARTS = ("front_side", "left_side", "rear_side", "right_side", "bottom", "handle")
SHAPES_PER_STYLE = 4

_LABEL = {name: i + 1 for i, name in enumerate(BASKET_PARTS)}
_AROUND = 64
"""Corners around the body; a multiple of 8, so that sides meet at corners."""


@dataclass(frozen=True)
class BasketShape:
    """Measures of one basket in metres; the handle spans its width (y)."""

    shape_id: str
    style: str
    length: float
    """Length of the rim along x."""
    width: float
    height: float
    """Height of the rim, without the handle."""
    taper: float
    """Size of the bottom over size of the rim."""
    power: float
    """Exponent of the superellipse of the outline."""
    wall: float
    rim_radius: float
    handle_height: float
    """Height of the top of the handle above the ground."""
    handle_radius: float
    handle_power: float
    """Exponent of the superellipse of the handle's arch: 2 is a half circle, larger is squarer."""


_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "round": {
        "length": (0.30, 0.42), "aspect": (0.97, 1.0), "height": (0.16, 0.24), "taper": (0.70, 0.85),
        "power": (2.0, 2.2), "wall": (0.008, 0.012), "rim": (0.008, 0.013), "handle": (1.9, 2.3),
        "handle_radius": (0.008, 0.012), "handle_power": (2.0, 2.5),
    },
    "oval": {
        "length": (0.38, 0.52), "aspect": (0.66, 0.78), "height": (0.16, 0.24), "taper": (0.74, 0.88),
        "power": (2.3, 3.0), "wall": (0.008, 0.012), "rim": (0.008, 0.013), "handle": (1.8, 2.2),
        "handle_radius": (0.008, 0.012), "handle_power": (2.0, 2.8),
    },
    "rectangular": {
        "length": (0.36, 0.50), "aspect": (0.62, 0.76), "height": (0.15, 0.23), "taper": (0.82, 0.96),
        "power": (7.0, 14.0), "wall": (0.008, 0.012), "rim": (0.007, 0.011), "handle": (1.8, 2.2),
        "handle_radius": (0.008, 0.012), "handle_power": (2.4, 4.0),
    },
}  # fmt: skip


@lru_cache(maxsize=1)
def basket_shapes() -> tuple[BasketShape, ...]:
    """All baskets of the family, always the same: `SHAPES_PER_STYLE` of each style."""
    return tuple(
        BasketShape(
            shape_id=shape_id,
            style=style,
            length=p["length"],
            width=p["length"] * p["aspect"],
            height=p["height"],
            taper=p["taper"],
            power=p["power"],
            wall=p["wall"],
            rim_radius=p["rim"],
            handle_height=p["height"] * p["handle"],
            handle_radius=p["handle_radius"],
            handle_power=p["handle_power"],
        )
        for shape_id, style, p in draws_by_style(_RANGES, SHAPES_PER_STYLE, 20090424)
    )


def basket_mesh(shape: BasketShape, rng: np.random.Generator) -> Mesh:
    """The mesh of an open basket in the object frame; rng picks the willow. Every face has a part.

    Length along x, the handle from the left side (+y) to the right one, z up, metres, the origin on the
    ground below the middle. A round body is split into four sides where its normal turns 45 degrees from the
    axes; both faces of a wall, and the rim on it, belong to its side.
    """
    tints = ((1.0, 1.0, 1.0), (0.66, 0.56, 0.46), (1.25, 1.25, 1.2), (0.45, 0.32, 0.24))
    tint = tints[int(rng.integers(len(tints)))]
    weave, rod = surface("wicker", int(rng.integers(3)), tint, 0.04), surface("wood", 0, tint, 0.06)
    draft = MeshDraft()
    for quarter, name in enumerate(("front_side", "left_side", "rear_side", "right_side")):
        with draft.labelling(_LABEL[name]):
            _side(draft, shape, quarter, weave, rod)
    with draft.labelling(_LABEL["bottom"]):
        outline = _outline(shape, shape.taper)[:-1]
        z = np.array([0.0, 2 * shape.wall])[:, None, None]
        plate = np.concatenate(
            [np.broadcast_to(outline, (2, *outline.shape)), np.broadcast_to(z, (2, len(outline), 1))], -1
        )
        loft(draft, plate * [0.985, 0.985, 1.0], weave, tile_m=0.3, uv_axes=(0, 1))
    with draft.labelling(_LABEL["handle"]):
        _handle(draft, shape, rod)
    return standing_mesh(draft)


def _outline(s: BasketShape, size: float) -> FloatArray:
    """Corners (_AROUND + 1, 2) around the body, closed, from the middle of the front side's right end."""
    points = superellipse(s.length / 2, s.width / 2, s.power, _AROUND) * size
    points = np.roll(points, _AROUND // 8, axis=0)
    return np.concatenate([points, points[:1]])


def _side(draft: MeshDraft, s: BasketShape, quarter: int, weave: Material, rod: Material) -> None:
    """A quarter of the wall as a closed shell, with its piece of the rim."""
    pick = slice(quarter * _AROUND // 4, (quarter + 1) * _AROUND // 4 + 1)
    share = np.linspace(0, 1, 5)
    size = s.taper + (1 - s.taper) * share**0.8
    outer = np.stack([_outline(s, k)[pick] for k in size])
    shrink = 1 - s.wall / np.hypot(*np.moveaxis(outer, -1, 0))
    inner = outer * shrink[..., None]
    z = np.broadcast_to((share * s.height)[:, None, None], (*outer.shape[:2], 1))
    faces = [np.concatenate([outer, z], -1), np.concatenate([inner[::-1], z[::-1]], -1)]
    # sections of the wall, one after the other around the body
    rings = np.concatenate(faces).transpose(1, 0, 2)
    loft(draft, rings, weave, tile_m=0.3)
    rim = np.concatenate([(outer[-1] + inner[-1]) / 2, np.full((rings.shape[0], 1), s.height)], -1)
    tube(draft, rim, s.rim_radius, rod, sides=10, tile_m=0.3)


def _handle(draft: MeshDraft, s: BasketShape, rod: Material) -> None:
    """Add the handle: an arch of two rods over the middle, from one side to the other."""
    half, rise = s.width / 2, s.handle_height - s.height * 0.55 - s.handle_radius
    arch = superellipse(half, rise, s.handle_power, 48)[:25]
    for x in (-0.9, 0.9):
        path = np.stack([np.full(25, x * s.handle_radius), arch[:, 0], arch[:, 1] + s.height * 0.55], axis=1)
        tube(draft, path, s.handle_radius, rod, sides=10, tile_m=0.3)
