"""Draws a street: where cars, pictures of cars, trucks, furniture and houses stand, the light, the camera."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Mesh, Placed, Scene
from datasets_synth.meshes.solids import pose
from datasets_synth.presets import SynthConfig
from datasets_synth.street.distractors import PROP, PROPS, Prop
from datasets_synth.street.facades import facade_row
from datasets_synth.street.footprints import Footprint, footprint
from datasets_synth.street.lighting import sample_imaging, sample_light
from datasets_synth.street.prop_parts import Pictures
from datasets_synth.street.prop_prints import mural
from datasets_synth.street.street import Strip, ground_height_m, ground_items, sample_strips
from recon.arrays import FloatArray
from recon.camera import PinholeCamera, StereoCamera

FACING_LEFT_RAD = np.pi
"""Yaw of a car whose nose points to -x, so that its left side is seen."""
_PICTURE_KINDS = tuple(p.kind for p in PROPS if p.needs_pictures)
_WHEELED_KINDS = ("truck", "bus", "caravan", "trailer", "boat", "tractor", "minibus", "flatbed", "teardrop")
_BOX_KINDS = ("kiosk", "stall", "shelter", "container", "skip", "cart")
MOST_COVERED = 0.35
"""Share of a car's length that a large thing put anywhere may hide."""
MOST_COVERED_BY_SMALL = 0.5
"""Share of a car's length that a small thing may hide; small things stand before cars in every street."""
_FURNITURE_KINDS = tuple(p.kind for p in PROPS if p.kind not in _PICTURE_KINDS + _WHEELED_KINDS + _BOX_KINDS)
_HIDING = tuple(p.kind for p in PROPS if p.hides)


@dataclass
class _Plan:
    """A street that is being filled."""

    config: SynthConfig
    strips: tuple[Strip, ...]
    facade_y_m: float
    camera_yaw_rad: float
    rng: np.random.Generator
    items: list[Placed] = field(default_factory=list)
    taken: list[Footprint] = field(default_factory=list)

    def half_view_rad(self) -> float:
        camera = self.config.camera
        return float(np.arctan(0.5 * 640 / camera.focal_px))

    def x_range_m(self, y_m: float, margin_rad: float = 0.0) -> tuple[float, float]:
        """Lowest and highest x in the picture at a distance; the camera stands at the origin."""
        half = self.half_view_rad() - margin_rad
        return y_m * float(np.tan(self.camera_yaw_rad - half)), y_m * float(
            np.tan(self.camera_yaw_rad + half)
        )

    def is_free(self, spot: Footprint) -> bool:
        """Whether a footprint stands on level ground before the houses and meets nothing."""
        corners = spot.corners()
        if corners[:, 1].max() > self.facade_y_m - 0.9 or corners[:, 1].min() < 2.2:
            return False
        return _level(self.strips, corners) and not any(spot.meets(other) for other in self.taken)

    def put(
        self,
        mesh: Mesh,
        kind: str,
        at: tuple[float, float, float],
        *,
        shape_id: str = "",
        gap_m: float = 0.12,
    ) -> bool:
        """Place a mesh at (x, y, yaw) where its ground is free; says whether it was."""
        x, y, yaw = at
        placed = Placed(mesh, pose(x, y, ground_height_m(self.strips, y), yaw), kind, shape_id)
        ground = footprint(placed, gap_m)
        if not self.is_free(ground):
            return False
        self.items.append(placed)
        self.taken.append(ground)
        return True

    def put_car(self, car: CarModel, x: float, y: float, yaw: float) -> bool:
        """Place a car; its mesh is built only where its size fits, since building costs more than looking."""
        length, width, _ = car.size_m
        if not self.is_free(Footprint(x, y, length / 2 + 0.35, width / 2 + 0.45, yaw)):
            return False
        return self.put(car.build(self.rng), "car", (x, y, yaw), shape_id=car.shape_id, gap_m=0.3)


def _level(strips: tuple[Strip, ...], corners: FloatArray) -> bool:
    """Whether a footprint stands on ground of one height."""
    heights = {ground_height_m(strips, float(y)) for y in corners[:, 1]}
    return len(heights) == 1


def sample_scene(
    config: SynthConfig,
    shapes: Sequence[CarModel],
    rng: np.random.Generator,
    n_cars: int | None = None,
    pictures: Pictures = (),
) -> Scene:
    """A street with cars seen from the side.

    Whether each planned car is visible enough is not known before rendering; see build.render_frame.

    Args:
        config: What streets look like.
        shapes: The cars to choose from.
        rng: Source of everything.
        n_cars: Cars to place; drawn (0 to 2) where it is not given.
        pictures: Pictures of cars for posters; without them there are no posters.
    """
    count = int(rng.integers(0, 3)) if n_cars is None else n_cars
    plan = _empty_street(config, rng)
    for _ in range(count):
        _put_car(plan, shapes)
    _put_other_view(plan, shapes)
    _put_clutter(plan, pictures)
    low, high = plan.x_range_m(plan.facade_y_m)
    half_width = max(abs(low), abs(high)) + 12.0
    ground = ground_items(plan.strips, half_width, plan.facade_y_m + 120.0, rng)
    houses = _far_side(plan, half_width)
    houses += _murals(plan, houses, pictures)
    head, left_from_world = _camera(config, plan.camera_yaw_rad, rng)
    light, brightness = sample_light(config.light, rng)
    return Scene(
        items=(*ground, *houses, *plan.items),
        light=light,
        camera=head,
        left_from_world=left_from_world,
        imaging=sample_imaging(config.sensor, light, brightness, rng),
    )


def _empty_street(config: SynthConfig, rng: np.random.Generator) -> _Plan:
    cars = config.cars
    # more near cars than far ones, as streets show them, but far ones are no exception
    share = float(rng.uniform())
    car_y = float(cars.near_m * (cars.far_m / cars.near_m) ** share) * 0.97 + 0.3
    strips = sample_strips(min(car_y, cars.far_m - 1.0), rng)
    yaw = float(np.radians(rng.uniform(-1, 1) * config.camera.yaw_deg))
    return _Plan(config, strips, strips[-1].y1_m, yaw, rng)


def _car_lanes(plan: _Plan) -> list[float]:
    cars = plan.config.cars
    lanes = [y for s in plan.strips for y in s.lanes_m]
    return [y for y in lanes if cars.near_m <= y <= cars.far_m]


def _put_car(plan: _Plan, shapes: Sequence[CarModel]) -> bool:
    """One car in a lane, seen within the view bin; False where no free place was found."""
    cars, rng = plan.config.cars, plan.rng
    lanes = _car_lanes(plan)
    limit = np.radians(cars.bin_half_width_deg)
    for _ in range(30):
        shape = shapes[int(rng.integers(len(shapes)))]
        y = float(lanes[int(rng.integers(len(lanes)))] + rng.normal(0, 0.15))
        length = shape.size_m[0]
        low, high = plan.x_range_m(y)
        x = float(rng.uniform(low + 0.42 * length, max(low + 0.43 * length, high - 0.42 * length)))
        turn = float(np.radians(rng.uniform(-1, 1) * cars.heading_jitter_deg))
        # azimuth - 90 degrees = bearing of the car less its turn, for a nose at -x
        if abs(np.arctan2(x, y) + turn) > limit:
            continue
        if _hides_or_is_hidden(plan, shape, x, y):
            continue
        if plan.put_car(shape, x, y, FACING_LEFT_RAD + turn):
            return True
    return False


def _put_other_view(plan: _Plan, shapes: Sequence[CarModel]) -> None:
    """A car parked across the street, its front or its rear to the camera."""
    rng = plan.rng
    if rng.random() >= plan.config.cars.other_view_share:
        return
    lots = [s for s in plan.strips if s.role in ("lot", "square") and s.y1_m - s.y0_m > 5.2 and s.y1_m > 14]
    if not lots:
        return
    strip = lots[int(rng.integers(len(lots)))]
    for _ in range(4):
        shape = shapes[int(rng.integers(len(shapes)))]
        y = float(rng.uniform(max(strip.y0_m + 2.6, 12.0), max(strip.y1_m - 2.6, 12.1)))
        low, high = plan.x_range_m(y)
        yaw = float(rng.choice([-1, 1]) * np.pi / 2 + rng.normal(0, 0.1))
        x = float(rng.uniform(low, high))
        if not _hides_or_is_hidden(plan, shape, x, y) and plan.put_car(shape, x, y, yaw):
            return


def _put_clutter(plan: _Plan, pictures: Pictures) -> None:
    rng, clutter = plan.rng, plan.config.clutter
    for car in [p for p in plan.items if p.kind == "car"]:
        if rng.random() < clutter.occluder_share:
            _put_before(plan, car, pictures)
    groups = [
        (_WHEELED_KINDS, clutter.wheeled),
        (_BOX_KINDS, clutter.boxes),
        (_FURNITURE_KINDS, clutter.furniture),
    ]
    if len(pictures):
        groups.insert(0, (_PICTURE_KINDS, clutter.pictures))
    for kinds, mean in groups:
        # the whole number above or below the mean: a crowded street would fill a detector's candidates
        for _ in range(int(mean + rng.random())):
            _put_anywhere(plan, PROP[kinds[int(rng.integers(len(kinds)))]], pictures)


def _put_before(plan: _Plan, car: Placed, pictures: Pictures) -> None:
    """Put something small between the camera and a car, so that it hides a part of the car."""
    rng = plan.rng
    x, y = car.world_from_object[0, 3], car.world_from_object[1, 3]
    for _ in range(12):
        prop = PROP[_HIDING[int(rng.integers(len(_HIDING)))]]
        at = float(y * rng.uniform(0.45, 0.95))
        if not _allowed(plan, prop, at) or at < 4.0:
            continue
        aim = x + float(rng.uniform(-2.2, 2.2))
        if plan.put(
            prop.build(rng, pictures).mesh(), prop.kind, (float(aim * at / y), at, float(rng.normal(0, 0.06)))
        ):
            return


def _allowed(plan: _Plan, prop: Prop, y_m: float) -> bool:
    return any(s.role in prop.on for s in plan.strips if s.y0_m <= y_m < s.y1_m)


def _put_anywhere(plan: _Plan, prop: Prop, pictures: Pictures) -> None:
    """A prop on a strip where it may stand, clear of the view of the cars where it is large."""
    rng = plan.rng
    strips = [s for s in plan.strips if s.role in prop.on and s.y1_m > 6.5]
    if not strips:
        return
    mesh = prop.build(rng, pictures).mesh()
    for _ in range(8):
        strip = strips[int(rng.integers(len(strips)))]
        low_y = max(strip.y0_m, 5.0 if prop.hides else 7.5)
        if low_y >= strip.y1_m:
            continue
        if strip.lanes_m and prop.on[0] in ("road", "lot"):
            y = float(strip.lanes_m[int(rng.integers(len(strip.lanes_m)))] + rng.normal(0, 0.1))
        else:
            y = float(rng.uniform(low_y, strip.y1_m))
        low, high = plan.x_range_m(max(y, 1.0))
        x = float(rng.uniform(low, high))
        yaw = float(
            rng.normal(0, 0.03)
            + (
                np.pi
                if prop.on[0] in ("road", "lot") and not prop.needs_pictures and rng.random() < 0.4
                else 0
            )
        )
        if _covers_a_car(plan, mesh, x, y, MOST_COVERED_BY_SMALL if prop.hides else MOST_COVERED):
            continue
        if plan.put(mesh, prop.kind, (x, y, yaw)):
            return


def _covers_a_car(plan: _Plan, mesh: Mesh, x: float, y: float, most: float) -> bool:
    """Whether a thing at (x, y) would hide more than a share of the length of a car behind it."""
    low, high = mesh.extent_m[:, 0].tolist()
    thing = ((x + low) / y, (x + high) / y)
    return any(
        car.kind == "car" and car.world_from_object[1, 3] >= y and _hidden_share(_bearings(car), thing) > most
        for car in plan.items
    )


def _bearings(placed: Placed) -> tuple[float, float]:
    """Tangents of the bearings between which a placed mesh is seen, taken at its middle."""
    ground = footprint(placed)
    x = ground.corners()[:, 0]
    return float(x.min() / ground.y_m), float(x.max() / ground.y_m)


def _hidden_share(behind: tuple[float, float], before: tuple[float, float]) -> float:
    return (min(behind[1], before[1]) - max(behind[0], before[0])) / (behind[1] - behind[0])


def _hides_or_is_hidden(plan: _Plan, car: CarModel, x: float, y: float) -> bool:
    """Whether a car at (x, y) would hide, or be hidden by, half of another car."""
    half = car.size_m[0] / 2
    new = ((x - half) / y, (x + half) / y)
    for other in plan.items:
        old = _bearings(other)
        share = _hidden_share(old, new) if other.world_from_object[1, 3] > y else _hidden_share(new, old)
        if share > 0.5:
            return True
    return False


def _far_side(plan: _Plan, half_width_m: float) -> list[Placed]:
    """House fronts, or trees and a hedge before open land."""
    rng = plan.rng
    y = plan.facade_y_m
    z = ground_height_m(plan.strips, y)
    if rng.random() < 0.8:
        return facade_row(y, z, half_width_m, rng)
    items = []
    x = -half_width_m
    while x < half_width_m:
        prop = PROP[str(rng.choice(["tree", "hedge", "bush", "fence", "tree"]))]
        mesh = prop.build(rng, ()).mesh()
        width = float(np.ptp(mesh.vertices_m[:, 0]))
        depth = -float(mesh.vertices_m[:, 1].min())
        items.append(Placed(mesh, pose(x - float(mesh.vertices_m[:, 0].min()), y + depth, z), prop.kind))
        x += width + float(rng.uniform(0.2, 1.5))
    return items + facade_row(y + float(rng.uniform(25, 60)), z, half_width_m * 2, rng)


def _murals(plan: _Plan, houses: Sequence[Placed], pictures: Pictures) -> list[Placed]:
    """Pictures of cars on the walls of the houses, at most one a house."""
    rng, share = plan.rng, plan.config.clutter.mural_share
    low, high = plan.x_range_m(plan.facade_y_m)
    murals: list[Placed] = []
    for house in houses if len(pictures) else ():
        x0, y, z = (float(v) for v in house.world_from_object[:3, 3])
        x1 = x0 + float(house.mesh.vertices_m[:, 0].max())
        # houses far behind an open far side stay bare
        in_view = house.kind == "facade" and x1 > low and x0 < high and y < plan.facade_y_m + 1
        if not in_view or rng.random() >= share:
            continue
        mesh = mural(rng, pictures).mesh()
        half = float(mesh.vertices_m[:, 0].max())
        if half < (x1 - x0) / 2:
            x = float(rng.uniform(x0 + half, x1 - half))
            # sills of windows reach 12 cm out of the wall
            murals.append(Placed(mesh, pose(x, y - 0.16, z), "mural"))
    return murals


def _camera(config: SynthConfig, yaw_rad: float, rng: np.random.Generator) -> tuple[StereoCamera, FloatArray]:
    """The stereo head above the origin, and its camera-from-world pose (4, 4)."""
    c = config.camera
    focal = c.focal_px * c.width_px / 640 * float(rng.uniform(0.985, 1.015))
    cx = (c.width_px - 1) / 2 + float(rng.uniform(-4, 4))
    cy = (c.height_px - 1) / 2 + float(rng.uniform(-4, 4))
    camera = PinholeCamera(focal, focal, cx, cy, c.width_px, c.height_px)
    height = float(rng.uniform(*c.height_m))
    pitch = float(np.radians(rng.uniform(*c.pitch_deg)))
    right = np.array([np.cos(yaw_rad), -np.sin(yaw_rad), 0.0])
    level = np.array([np.sin(yaw_rad), np.cos(yaw_rad), 0.0])
    forward = np.cos(pitch) * level + np.array([0, 0, -np.sin(pitch)])
    pose_cam = np.eye(4)
    pose_cam[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose_cam[:3, 3] = -pose_cam[:3, :3] @ np.array([0, 0, height])
    return StereoCamera(camera, float(rng.uniform(*c.baseline_m))), pose_cam
