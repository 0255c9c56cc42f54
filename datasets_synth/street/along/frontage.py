"""What stands beside a street: houses, gardens, parks, walls, yards, furniture, and what closes its end."""

from functools import lru_cache

import numpy as np

from datasets_synth.meshes.materials import DARK, STEEL, TILE_M, plain, surface
from datasets_synth.meshes.mesh import Mesh
from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.street.along.plants import N_VARIANTS, coarseness, hedge, plant
from datasets_synth.street.along.road import END_M, REAR_M, SIDES, Band
from datasets_synth.street.along.stage import CLEAR_M, Stage
from datasets_synth.street.distractors import PROP
from datasets_synth.street.facades import DEPTH_M, facade
from datasets_synth.street.prop_parts import Pictures

COARSEST = coarseness(np.inf)
N_HOUSES = 18
"""Different houses of each sort."""
STYLES = ("row", "villas", "park", "wall", "yard")
_STYLE_SHARES = (0.27, 0.29, 0.3, 0.07, 0.07)
_TREES = ("broadleaf", "broadleaf", "slender", "conifer")


@lru_cache(maxsize=2 * N_HOUSES)
def house(sort: str, variant: int) -> Mesh:
    """A house of a sort, "row" or "villa", its front along x from 0, facing -y."""
    rng = np.random.default_rng([20110928, ("row", "villa").index(sort), variant])
    widest_m, most_storeys = (16, 6) if sort == "row" else (11, 4)
    width_m = float(rng.uniform(7, widest_m))
    return facade(width_m, int(rng.integers(2, most_storeys)), rng, is_seen_obliquely=True).mesh()


@lru_cache(maxsize=24)
def garden_wall(length_m: int, variant: int) -> Mesh:
    """A wall along x with its middle on the origin."""
    rng = np.random.default_rng([20110929, length_m, variant])
    draft = MeshDraft()
    height = float(rng.uniform(0.5, 2.1))
    kind = str(rng.choice(["bricks", "plaster", "concrete"]))
    skin = surface(kind, int(rng.integers(5)), (0.8, 0.8, 0.8))
    draft.box((0, 0, height / 2 - 0.1), (length_m, 0.3, height + 0.2), skin, TILE_M[kind])
    draft.box((0, 0, height + 0.04), (length_m, 0.4, 0.08), surface("concrete", 1, (0.7, 0.7, 0.7)), 2.0)
    return draft.mesh()


def put_frontage(stage: Stage, pictures: Pictures) -> None:
    """Fill both sides of the street, block by block, and its far end."""
    blocks = [(REAR_M + 3, 120.0)]
    crossing = stage.road.crossing
    if crossing is not None:
        low, high = crossing.gap_m
        blocks = [(REAR_M + 3, low), (high, 120.0)]
        _corners(stage)
    for side in SIDES:
        for block in blocks:
            style = str(stage.rng.choice(STYLES, p=_STYLE_SHARES))
            _BUILDERS[style](stage, side, block)
    _street_trees(stage)
    _lamp_row(stage)
    _traffic_lights(stage)
    _furniture(stage, pictures)
    _background(stage)
    _far_end(stage)


def facing_rad(side: int) -> float:
    """Yaw of a thing whose front looks at -y, so that it looks at the street from a side."""
    return -np.pi / 2 if side > 0 else np.pi / 2


def _front(stage: Stage, side: int) -> float:
    return stage.road.frontage_m[0 if side < 0 else 1]


def _house(stage: Stage, sort: str, side: int, y: float, setback: float, yaw_error: float = 0.0) -> float:
    """A house whose front begins at y; gives its length along the street."""
    mesh = house(sort, int(stage.rng.integers(N_HOUSES)))
    width = float(mesh.vertices_m[:, 0].max())
    x = _front(stage, side) + side * setback
    start = y + width if side > 0 else y
    stage.put_freely(mesh, "facade", (x, start, facing_rad(side) + yaw_error), takes_ground=True)
    return width


def _row(stage: Stage, side: int, block: tuple[float, float]) -> None:
    """Houses side by side at the pavement, or behind narrow front gardens."""
    rng = stage.rng
    setback = float(rng.choice([0.05, 0.05, 2.5, 4.0]))
    y = block[0]
    while y < block[1] - 7:
        if rng.random() < 0.07:
            y += float(rng.uniform(3, 7))
            continue
        y += _house(stage, "row", side, y, setback + float(rng.choice([0.0, 0.0, 0.2])))
    if setback > 1:
        _border(stage, side, (block[0], min(block[1], 75.0)))


def _villas(stage: Stage, side: int, block: tuple[float, float]) -> None:
    """Houses in gardens with hedges, drives and trees."""
    rng = stage.rng
    _border(stage, side, (block[0], min(block[1], 75.0)))
    y = block[0] + float(rng.uniform(0, 3))
    while y < block[1] - 9:
        setback = float(rng.uniform(4.5, 8.5))
        y += _house(stage, "villa", side, y, setback, float(rng.normal(0, 0.03)))
        gap = float(rng.uniform(4, 9))
        for _ in range(int(rng.integers(1, 4))):
            _tree(stage, side, y + float(rng.uniform(0, gap)), float(rng.uniform(2, 12)))
        if rng.random() < 0.7:
            _bush(stage, side, y - float(rng.uniform(0, 8)), float(rng.uniform(1.0, 4.0)))
        y += gap


def _park(stage: Stage, side: int, block: tuple[float, float]) -> None:
    """Trees and shrubs, thicker farther back, with houses behind."""
    rng = stage.rng
    if rng.random() < 0.5:
        _border(stage, side, (block[0], min(block[1], 75.0)))
    near = float(rng.uniform(1.5, 5.0))
    for _ in range(int((block[1] - block[0]) / 4.5)):
        _tree(stage, side, float(rng.uniform(*block)), near + float(rng.uniform(0, 22)))
    for _ in range(int((block[1] - block[0]) / 9)):
        _bush(stage, side, float(rng.uniform(*block)), near + float(rng.uniform(0, 10)))
    y = block[0]
    while y < block[1] - 12:
        y += _house(stage, "row", side, y, 30.0) + float(rng.uniform(4, 20))


def _wall(stage: Stage, side: int, block: tuple[float, float]) -> None:
    """A long wall with trees behind."""
    rng = stage.rng
    variant = int(rng.integers(4))
    for y in np.arange(block[0] + 3, min(block[1], 90.0) - 3, 6.0):
        stage.put(
            garden_wall(6, variant),
            "wall",
            (_front(stage, side) + side * 0.25, float(y), facing_rad(side)),
            gap_m=-0.05,
        )
    for _ in range(int((block[1] - block[0]) / 5)):
        _tree(stage, side, float(rng.uniform(*block)), 2.5 + float(rng.uniform(0, 14)))
    _row_behind(stage, side, block)


def _yard(stage: Stage, side: int, block: tuple[float, float]) -> None:
    """An open yard with few things on it and houses behind."""
    rng = stage.rng
    for _ in range(int(rng.integers(1, 4))):
        prop = PROP[
            str(rng.choice(["container", "skip", "crates", "pallets", "bins", "trailer", "caravan", "boat"]))
        ]
        at = (_front(stage, side) + side * float(rng.uniform(3, 9)), float(rng.uniform(8, 50)))
        if block[0] + 3 < at[1] < block[1] - 3:
            stage.put(
                prop.build(rng, ()).mesh(), prop.kind, (*at, facing_rad(side) + float(rng.normal(0, 0.4)))
            )
    _row_behind(stage, side, block)


def _row_behind(stage: Stage, side: int, block: tuple[float, float]) -> None:
    y = block[0]
    while y < block[1] - 10:
        y += _house(stage, "row", side, y, 16.0) + float(stage.rng.choice([0.0, 3.0, 9.0]))


def _border(stage: Stage, side: int, block: tuple[float, float]) -> None:
    """Hedges, low walls or fences between the pavement and the gardens, with gates left open."""
    rng = stage.rng
    sort = str(rng.choice(["hedge", "hedge", "wall", "fence", "none"]))
    height, variant = int(rng.choice([7, 10, 13, 17])), int(rng.integers(4))
    y = block[0] + 1.0
    while sort != "none" and y < block[1] - 6:
        length = int(rng.integers(3, 7))
        at = (_front(stage, side) + side * 0.45, y + length / 2, facing_rad(side))
        if sort == "hedge":
            stage.put(hedge(length, height, variant, coarseness(float(y))), "hedge", at)
        elif sort == "wall":
            stage.put(garden_wall(length, variant), "wall", at)
        else:
            stage.put(_fence(length, variant), "fence", at)
        y += length + (0.0 if rng.random() < 0.5 else float(rng.uniform(1.2, 3.8)))


@lru_cache(maxsize=32)
def _fence(length_m: int, variant: int) -> Mesh:
    rng = np.random.default_rng([20110930, length_m, variant])
    draft = MeshDraft()
    skin = surface("planks", variant % 3, (0.7, 0.66, 0.6))
    height = float(rng.uniform(0.8, 1.3))
    for x in np.arange(-length_m / 2 + 0.05, length_m / 2, 0.13):
        draft.box((x, 0, height / 2), (0.09, 0.025, height), skin, 1.5)
    for z in (0.25, height - 0.2):
        draft.box((0, 0.03, z), (length_m, 0.04, 0.08), skin, 1.5)
    return draft.mesh()


def _tree(stage: Stage, side: int, y: float, behind_m: float) -> None:
    """A tree behind the edge of the pavement, where no house stands."""
    rng = stage.rng
    kind = _TREES[int(rng.integers(len(_TREES)))]
    mesh = plant(kind, int(rng.integers(N_VARIANTS)), coarseness(float(y)))
    x = _front(stage, side) + side * behind_m
    if y > CLEAR_M:
        scale = float(rng.uniform(0.9, 1.3) if behind_m < 6 else rng.uniform(1.1, 1.9))
        stage.put(mesh, "tree", (x, y, float(rng.uniform(0, 6.28))), scale=scale, gap_m=0.0)


def _bush(stage: Stage, side: int, y: float, behind_m: float) -> None:
    rng = stage.rng
    mesh = plant("bush", int(rng.integers(N_VARIANTS)), coarseness(float(y)))
    x = _front(stage, side) + side * behind_m
    if y > CLEAR_M:
        stage.put(
            mesh, "bush", (x, y, float(rng.uniform(0, 6.28))), scale=float(rng.uniform(0.8, 1.5)), gap_m=0.0
        )


def _street_trees(stage: Stage) -> None:
    """A row of trees on the verge, and tufts of grass there."""
    rng, road = stage.rng, stage.road
    for band in road.bands:
        if band.role != "verge":
            continue
        middle = (band.x0_m + band.x1_m) / 2
        kind = str(rng.choice(["broadleaf", "broadleaf", "slender"]))
        variant, pitch = int(rng.integers(N_VARIANTS)), float(rng.uniform(6.5, 13))
        if rng.random() < 0.7:
            for y in np.arange(float(rng.uniform(5, 12)), 110, pitch):
                mesh = plant(kind, (variant + int(rng.integers(2))) % N_VARIANTS, coarseness(float(y)))
                if not _crosses(stage, float(y)):
                    scale = float(rng.uniform(0.85, 1.15))
                    at = (middle, float(y), float(rng.uniform(0, 6.28)))
                    stage.put(mesh, "tree", at, scale=scale, gap_m=0.0)
        for y in np.arange(4.0, 24.0, 0.9):
            if not _crosses(stage, float(y)):
                x = float(rng.uniform(band.x0_m + 0.5, band.x1_m - 0.5))
                tuft = plant("grass tuft", int(rng.integers(N_VARIANTS)), coarseness(2 * float(y)))
                at = (x, float(y), float(rng.uniform(0, 6.28)))
                stage.put_freely(tuft, "verge", at, scale=0.9, casts_shadow=False)


def _crosses(stage: Stage, y: float) -> bool:
    crossing = stage.road.crossing
    return crossing is not None and crossing.gap_m[0] - 1.5 < y < crossing.gap_m[1] + 1.5


def _pavement(stage: Stage, side: int) -> Band:
    return next(b for b in stage.road.bands if b.role == "pavement" and b.side == side)


def _lamp_row(stage: Stage) -> None:
    """Street lamps along one pavement, their arms over the road."""
    rng = stage.rng
    side = int(rng.choice(SIDES))
    band = _pavement(stage, side)
    edge = band.x0_m if side > 0 else band.x1_m
    variant = int(rng.integers(4))
    for y in np.arange(float(rng.uniform(6, 26)), 110, float(rng.uniform(22, 34))):
        if not _crosses(stage, float(y)):
            stage.put(_lamp(variant), "lamp", (edge + 0.35 * side, float(y), facing_rad(side)))


@lru_cache(maxsize=4)
def _lamp(variant: int) -> Mesh:
    """A street lamp whose arm reaches to -y."""
    rng = np.random.default_rng([20110931, variant])
    draft = MeshDraft()
    steel = plain((0.2, 0.21, 0.22) if variant % 2 else STEEL, 0.2)
    height, reach = float(rng.uniform(6.5, 9.5)), float(rng.uniform(1.0, 2.2))
    draft.cone((0, 0, -0.1), (0, 0, height), (0.1, 0.05), steel, sides=10)
    draft.bar((0, 0, height - 0.05), (0, -reach, height + 0.35), 0.035, steel)
    draft.box((0, -reach - 0.25, height + 0.36), (0.22, 0.6, 0.1), plain((0.55, 0.55, 0.52)))
    return draft.mesh()


def _traffic_lights(stage: Stage) -> None:
    """Lights at the corners of some crossings; the far one on the right is seen from the front."""
    crossing = stage.road.crossing
    if crossing is None or stage.rng.random() < 0.5:
        return
    for side, y, yaw in ((1, crossing.road_m[0] - 0.8, 0.0), (-1, crossing.road_m[1] + 0.8, np.pi)):
        band = _pavement(stage, side)
        edge = band.x0_m if side > 0 else band.x1_m
        mesh = _traffic_light(int(stage.rng.integers(3)))
        stage.put(mesh, "lights", (edge + 0.4 * side, y, yaw))


@lru_cache(maxsize=3)
def _traffic_light(lit: int) -> Mesh:
    """A pole with a traffic light that looks at -y; one lamp of red, amber and green is lit."""
    draft = MeshDraft()
    draft.bar((0, 0, -0.1), (0, 0, 3.4), 0.05, plain((0.25, 0.26, 0.27), 0.2))
    draft.box((0, -0.1, 2.95), (0.3, 0.22, 0.9), plain(DARK))
    colours = ((0.9, 0.05, 0.03), (0.9, 0.5, 0.03), (0.05, 0.8, 0.35))
    for k, rgb in enumerate(colours):
        bright = 1.0 if k == lit else 0.08
        z = 3.24 - 0.29 * k
        skin = plain((rgb[0] * bright, rgb[1] * bright, rgb[2] * bright))
        draft.cone((0, -0.21, z), (0, -0.225, z), (0.1, 0.1), skin, sides=12)
    return draft.mesh()


def _background(stage: Stage) -> None:
    """Trees behind the houses, so that gaps between these do not open on bare land."""
    rng = stage.rng
    for side in SIDES:
        for y in np.arange(6.0, 125.0, float(rng.uniform(7, 12))):
            if rng.random() < 0.75:
                kind = _TREES[int(rng.integers(len(_TREES)))]
                x = _front(stage, side) + side * float(rng.uniform(32, 62))
                mesh = plant(kind, int(rng.integers(N_VARIANTS)), COARSEST)
                at = (x, float(y), float(rng.uniform(0, 6.28)))
                stage.put(mesh, "tree", at, scale=float(rng.uniform(1.1, 2.0)), gap_m=0.0)


def _furniture(stage: Stage, pictures: Pictures) -> None:
    """Furniture on the pavements: signs, bins, people, and now and then a look-alike of a car."""
    rng, road = stage.rng, stage.road
    common = ("sign", "sign", "bins", "person", "person", "bicycle", "bollards", "bench", "planters")
    rare = ("kiosk", "shelter", "stall", "container", "crates", "trailer", "caravan", "teardrop", "cart")
    flat = ("billboard", "hoarding", "banner", "showroom", "trailer_picture")
    chosen = [common[int(rng.integers(len(common)))] for _ in range(int(rng.integers(3, 11)))]
    chosen += [rare[int(rng.integers(len(rare)))] for _ in range(int(rng.integers(0, 3)))]
    if len(pictures) and rng.random() < 0.4:
        chosen.append(flat[int(rng.integers(len(flat)))])
    pavements = [b for b in road.bands if b.role == "pavement"]
    for kind in chosen:
        band = pavements[int(rng.integers(len(pavements)))]
        y = float(rng.uniform(CLEAR_M + 1, 48))
        if _crosses(stage, y):
            continue
        mesh = PROP[kind].build(rng, pictures).mesh()
        width = float(np.ptp(mesh.vertices_m[:, 1]))
        x = (band.x0_m + band.x1_m) / 2 + float(rng.normal(0, 0.3))
        if width > band.x1_m - band.x0_m - 0.3:  # too wide for the pavement: in the yard behind it
            x = _front(stage, band.side) + band.side * (width / 2 + 0.8)
        yaw = facing_rad(band.side) + float(rng.normal(0, 0.06))
        stage.put(mesh, kind, (x, y, yaw if kind != "person" else float(rng.uniform(-3, 3))))


def _corners(stage: Stage) -> None:
    """Houses along the side street, seen past the corners."""
    rng, crossing = stage.rng, stage.road.crossing
    assert crossing is not None
    for side in SIDES:
        x = _front(stage, side) + side * (DEPTH_M + 6)
        while abs(x) < 60:
            mesh = house("row", int(rng.integers(N_HOUSES)))
            width = float(mesh.vertices_m[:, 0].max())
            # the far row looks at the camera, the near one away from it
            start = x if side > 0 else x - width
            y = crossing.gap_m[1] + float(rng.choice([0.0, 2.0]))
            stage.put_freely(mesh, "facade", (start, y, 0.0), takes_ground=True)
            x += side * (width + float(rng.choice([0.0, 0.0, 5.0])))


def _far_end(stage: Stage) -> None:
    """Trees and houses far away that close the view."""
    rng = stage.rng
    for x in np.arange(-62, 62, float(rng.uniform(4.5, 8.0))):
        kind = str(rng.choice(["broadleaf", "broadleaf", "slender", "conifer"]))
        at = (float(x + rng.normal(0, 2)), float(rng.uniform(125, END_M - 5)), float(rng.uniform(0, 6)))
        if abs(at[0]) > 9 or at[1] > 165:
            stage.put_freely(
                plant(kind, int(rng.integers(N_VARIANTS)), COARSEST),
                "tree",
                at,
                scale=float(rng.uniform(1, 1.8)),
            )
    for x in np.arange(-70, 70, 17.0):
        mesh = house("row", int(rng.integers(N_HOUSES)))
        stage.put_freely(mesh, "facade", (float(x + rng.normal(0, 3)), END_M - float(rng.uniform(1, 9)), 0.0))


_BUILDERS = {"row": _row, "villas": _villas, "park": _park, "wall": _wall, "yard": _yard}
