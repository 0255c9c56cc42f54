"""Ground, wall and light around a single object, sized to it."""

import numpy as np

from datasets_synth.mesh import Light, Mesh, Placed
from datasets_synth.solids import MeshDraft, pose
from datasets_synth.street import TILE_M, plain, surface, tint

SETTINGS = ("street", "room")

_GROUNDS = {
    "street": ("asphalt", "slabs", "cobbles", "concrete", "grass"),
    "room": ("planks", "cloth", "slabs"),
}
_WALLS = {"street": ("bricks", "plaster", "concrete", "planks"), "room": ("plaster",)}
_TILE_M = {"street": TILE_M, "room": {"planks": 1.5, "cloth": 0.6, "slabs": 1.2, "plaster": 4.0}}
_LARGE_M = 3.0
"""Around larger things textures grow with them, so that their repeats do not show."""


def surroundings(
    mesh: Mesh, azimuth_rad: float, setting: str, rng: np.random.Generator
) -> tuple[tuple[Placed, ...], Light]:
    """Ground at z = 0 and a wall behind the object, in the object frame, and the light on them.

    Args:
        mesh: The object.
        azimuth_rad: Direction of the camera seen from the object.
        setting: "street" or "room".
        rng: Source of every choice.
    """
    # in this frame the camera stands at -y, the wall at +y
    object_from_stage = pose(0, 0, 0, azimuth_rad + np.pi / 2)
    radius = float(np.linalg.norm(mesh.vertices_m[:, :2], axis=1).max())
    far = 60 * max(radius, 1.0)
    kind = str(rng.choice(_GROUNDS[setting]))
    skin = surface(kind, int(rng.integers(4)), tint(rng, 0.7, 1.0))
    tile = _TILE_M[setting][kind] * max(1.0, radius / _LARGE_M)
    ground = MeshDraft()
    start = (float(rng.random()), float(rng.random()))
    ground.panel([(-far, -far, 0), (far, -far, 0), (far, far, 0), (-far, far, 0)], skin, tile, start)
    items = (
        Placed(ground.mesh(), object_from_stage, "ground", "", False),
        Placed(_wall(radius, far, setting, rng), object_from_stage, "wall"),
    )
    return items, _light(azimuth_rad, setting, rng)


def _wall(radius_m: float, far_m: float, setting: str, rng: np.random.Generator) -> Mesh:
    """A wall a step behind the object, turned a little; of a room it goes up out of sight."""
    kind = str(rng.choice(_WALLS[setting]))
    skin = surface(kind, int(rng.integers(4)), _wall_rgb(setting, rng))
    gap = radius_m * float(rng.uniform(1.3, 2.2)) + 0.3
    high = far_m if setting == "room" else max(3.0, 1.5 * radius_m)
    draft = MeshDraft()
    tile = _TILE_M[setting][kind] * max(1.0, radius_m / _LARGE_M)
    draft.panel([(-far_m, 0, 0), (far_m, 0, 0), (far_m, 0, high), (-far_m, 0, high)], skin, tile)
    if setting == "room":
        board = plain((0.5, 0.5, 0.49), 0.05)
        draft.box((0, -0.01, 0.04), (2 * far_m, 0.02, 0.08), board)
    turn = float(rng.uniform(-0.2, 0.2))
    # the wall turns about the point behind the object, so it never comes nearer than cos(0.2) of the gap
    draft.transform(pose(0, 0, 0, turn)[:3, :3], (0, gap, 0))
    return draft.mesh()


def _wall_rgb(setting: str, rng: np.random.Generator) -> tuple[float, float, float]:
    if setting == "street":
        return tint(rng, 0.6, 1.0)
    rgb = np.array([0.9, 0.88, 0.84]) * rng.uniform(0.65, 1.0, 3) ** 0.7
    return (float(rgb[0]), float(rgb[1]), float(rgb[2]))


def _light(azimuth_rad: float, setting: str, rng: np.random.Generator) -> Light:
    """Light from beside or behind the camera."""
    elevation = float(np.radians(rng.uniform(35, 60) if setting == "street" else rng.uniform(50, 70)))
    azimuth = azimuth_rad + float(np.radians(rng.uniform(25, 75))) * float(rng.choice([-1, 1]))
    direction = (
        float(np.cos(elevation) * np.cos(azimuth)),
        float(np.cos(elevation) * np.sin(azimuth)),
        float(np.sin(elevation)),
    )
    if setting == "street":
        return Light(direction, (1.9, 1.85, 1.7), (0.4, 0.55, 0.9), (0.9, 0.95, 1.0), 0.9)
    return Light(direction, (0.75, 0.72, 0.66), (0.85, 0.83, 0.8), (0.9, 0.88, 0.85), 1.0)
