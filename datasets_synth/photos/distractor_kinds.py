"""What the bank of distractors shows: true cars, and kinds of things that a detector takes for one.

Meshes are in the frame of the props: x along the street, y away from the camera, z up, on the ground.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from datasets_synth.cars.paint import Finish
from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.materials import TILE_M, paint_rgb, plain, surface, window_glass
from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft, rotation_z
from datasets_synth.street.distractors import PROP
from datasets_synth.street.layout import FACING_LEFT_RAD
from datasets_synth.street.prop_parts import Pictures, extrude, front_panel
from datasets_synth.street.prop_prints import mural
from recon.arrays import Float32Array

Rng = np.random.Generator
Build = Callable[[Rng, Sequence[CarModel], Pictures], Mesh]

ORDINARY_CAR = "car"
TRUE_CARS = (ORDINARY_CAR, "dark_car")
"""Kinds that are cars seen from the side."""
POSTERS = ("board", "mural", "truck_print")
"""Kinds that are flat pictures of a car."""
TOY_SCALE = 0.1
_DARK = (0.006, 0.006, 0.006)


@dataclass(frozen=True)
class BankKind:
    """A kind of thing, and where in its picture a detector would put its box."""

    name: str
    title: str
    """Name of the kind, for people."""
    build: Build
    target: str = ""
    """Material whose faces the box goes around; around all faces where it is empty."""
    inset: float = 1.0
    """Size of what the target shows as a share of the target: a print is larger than the car on it."""
    part: bool = False
    """The thing goes on beyond a box of a car's size: the box is put somewhere on it."""
    scale: float = 1.0
    """Factor on size and distance: below 1 the thing is a toy on a post, with the picture of a full-size
    thing."""


def _car(yaw_rad: tuple[float, ...], spread_rad: float) -> Build:
    def build(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
        car = cars[int(rng.integers(len(cars)))]
        yaw = yaw_rad[int(rng.integers(len(yaw_rad)))] + float(rng.uniform(-1, 1)) * spread_rad
        return turned(car.build(rng), yaw)

    return build


def _dark_car(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
    """A car whose paint and glass show the matcher nothing: dark, without gloss and mirror."""
    mesh = _SIDE(rng, cars, pictures)
    smooth = [
        replace(m, rgb=_DARK, specular=0.0, mirror=0.0) if k in (Finish.PAINT, Finish.GLASS) else m
        for k, m in enumerate(mesh.materials)
    ]
    return replace(mesh, materials=tuple(smooth))


def _props(*kinds: str) -> Build:
    def build(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
        return PROP[kinds[int(rng.integers(len(kinds)))]].build(rng, pictures).mesh()

    return build


def _bare_wall(rng: Rng) -> tuple[MeshDraft, float]:
    """A wall of its own and the height of its top."""
    draft = MeshDraft()
    kind = str(rng.choice(["bricks", "plaster", "concrete"]))
    skin = surface(kind, int(rng.integers(4)), (0.8, 0.8, 0.8) if kind == "bricks" else paint_rgb(rng))
    length, height = float(rng.uniform(7, 11)), float(rng.uniform(2.0, 3.2))
    draft.box((0, 0.15, height / 2), (length, 0.3, height), skin, TILE_M[kind])
    return draft, height


def _wall(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
    return _bare_wall(rng)[0].mesh()


def _mural(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
    wall, painted = _bare_wall(rng)[0].mesh(), mural(rng, pictures).mesh()
    return _joined(wall, painted)


def _window_wall(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
    """A wall with a shop window of a car's size, low on the ground."""
    draft, height = _bare_wall(rng)
    width, low = float(rng.uniform(3.6, 4.8)), float(rng.uniform(0.05, 0.3))
    top = low + min(float(rng.uniform(1.3, 1.7)), height - 0.3)
    frame = plain(paint_rgb(rng))
    draft.box((0, -0.02, (low + top) / 2), (width + 0.2, 0.06, top - low + 0.16), frame)
    front_panel(draft, (-width / 2, width / 2, low, top), -0.055, replace(window_glass(rng), name="pane"))
    for x in np.linspace(-width / 2, width / 2, int(rng.integers(2, 5)) + 1)[1:-1]:
        front_panel(draft, (x - 0.04, x + 0.04, low, top), -0.06, frame)
    return draft.mesh()


def _ramp(rng: Rng, cars: Sequence[CarModel], pictures: Pictures) -> Mesh:
    """A ramp that rises away from the camera, as wide as a car is long."""
    width, rise, run = (float(rng.uniform(a, b)) for a, b in ((3.8, 5.0), (1.1, 1.6), (1.5, 4.0)))
    draft = MeshDraft()
    extrude(draft, np.array([[-run / 2, 0.0], [run / 2, 0.0], [run / 2, rise]]), width, _concrete(rng))
    return turned(draft.mesh(), np.pi / 2)


def _concrete(rng: Rng) -> Material:
    return surface(str(rng.choice(["concrete", "planks"])), int(rng.integers(3)), paint_rgb(rng))


def turned(mesh: Mesh, yaw_rad: float) -> Mesh:
    """The mesh turned about z."""
    turn = rotation_z(yaw_rad).T.astype(np.float32)
    return replace(mesh, vertices_m=mesh.vertices_m @ turn, corner_normals=mesh.corner_normals @ turn)


def _joined(a: Mesh, b: Mesh) -> Mesh:
    """Two meshes as one."""
    return Mesh(
        np.concatenate([a.vertices_m, b.vertices_m]),
        np.concatenate([a.faces, b.faces + np.int32(len(a.vertices_m))]),
        np.concatenate([a.corner_normals, b.corner_normals]),
        np.concatenate([a.corner_uv, b.corner_uv]),
        np.concatenate([a.face_material, b.face_material + np.int32(len(a.materials))]),
        (*a.materials, *b.materials),
        np.concatenate([a.face_part, b.face_part]),
    )


def vertices_of(mesh: Mesh, material: str) -> Float32Array:
    """Vertices (n, 3) of the faces of a material; every vertex of the mesh for an empty name."""
    if not material:
        return mesh.vertices_m
    named = [m.name == material for m in mesh.materials]
    used = np.unique(mesh.faces[np.array(named)[mesh.face_material]])
    return np.asarray(mesh.vertices_m[used], np.float32)


_SIDE = _car((FACING_LEFT_RAD,), 0.1)
_PRINT_INSET = 0.8
"""Prints show a car 1.12 to 1.4 times their width (datasets_synth.street.car_pictures)."""
KINDS: tuple[BankKind, ...] = (
    BankKind(ORDINARY_CAR, "car", _SIDE),
    BankKind("dark_car", "car, dark glass and paint", _dark_car),
    BankKind("board", "board with a car", _props("billboard", "banner"), "print", _PRINT_INSET),
    BankKind("mural", "mural of a car", _mural, "print", _PRINT_INSET),
    BankKind(
        "truck_print",
        "truck, bus or trailer with a car on it",
        _props("truck_picture", "bus_picture", "trailer_picture", "container_picture"),
        "print",
        _PRINT_INSET,
    ),
    BankKind("wall", "wall", _wall, part=True),
    BankKind("window_wall", "wall with a shop window", _window_wall, "pane"),
    BankKind("ramp", "ramp", _ramp),
    BankKind("hedge", "hedge", _props("hedge"), part=True),
    BankKind("fence", "fence", _props("fence"), part=True),
    BankKind("van", "minibus, caravan, flatbed", _props("minibus", "caravan", "flatbed", "teardrop")),
    BankKind("wrong_size", "boat, trailer, skip, stall", _props("boat", "trailer", "skip", "stall")),
    BankKind("toy", "toy car, 1:10, on a post", _SIDE, scale=TOY_SCALE),
    BankKind("front_rear", "car from its front or rear", _car((np.pi / 2, -np.pi / 2), 0.1)),
)
"""Everything that the bank shows, true cars first."""

DISTRACTORS = tuple(k.name for k in KINDS if k.name not in TRUE_CARS)
KIND = {k.name: k for k in KINDS}
