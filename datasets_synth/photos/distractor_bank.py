"""A bank of distractors: one thing in a street, a stereo pair of it, and the box that a detector would give.

What the depth evidence says of each kind of thing shows what it can tell from a car, and what not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.materials import STEEL, plain
from datasets_synth.meshes.mesh import Placed, Scene
from datasets_synth.meshes.solids import MeshDraft, pose
from datasets_synth.photos.distractor_kinds import KIND, BankKind, vertices_of
from datasets_synth.presets import CarConfig, ClutterConfig, SynthConfig
from datasets_synth.render.render import render_pair
from datasets_synth.render.scene_rays import build_scene_rays
from datasets_synth.street.frame_synth import camera_record
from datasets_synth.street.layout import sample_scene
from datasets_synth.street.prop_parts import Pictures
from recon.arrays import Float32Array, FloatArray
from recon.camera import GroundPlane
from recon.errors import RescoreError
from recon.stereo.sgbm import compute_disparity
from rescore.data.frames import Frame
from rescore.data.rendered_kinds import GROUND_KINDS

MAX_ATTEMPTS = 200
_EMPTY = ClutterConfig(0.0, 0.0, 0.0, 0.0, mural_share=0.0, occluder_share=0.0)
_BEHIND_M = 0.3
"""Smallest gap in metres between a thing and the houses behind it."""


@dataclass(frozen=True)
class BankConfig:
    """Where things stand, and how boxes lie around them."""

    distance_m: tuple[float, float] = (8.0, 35.0)
    """Least and greatest distance from the camera to the near side of a thing of full size."""
    toy_distance_m: tuple[float, float] = (20.0, 35.0)
    """Least and greatest distance of the car that a toy looks like; a nearer toy would stand less than 2 m
    from the camera, where nothing is measured."""
    aspect: float = 2.75
    """Width over height of a detector's boxes: that of the mean car from its side."""
    shift: float = 0.04
    """Spread of a detector's boxes to the side, as a share of their width; hits of both detectors on
    calibration frames have 0.034 and 0.060."""
    lift: float = 0.08
    """Spread of a detector's boxes up and down, as a share of their height; hits of both detectors on
    calibration frames have 0.078 and 0.120."""
    size: float = 0.1
    """Spread of the logarithm of a detector's box sizes; hits of both detectors on calibration frames have
    0.097 and 0.161."""
    synth: SynthConfig = field(default_factory=SynthConfig)
    """Camera, light, sensor and matcher, as of the data set."""


@dataclass(frozen=True, eq=False)
class BankItem:
    """One thing of the bank with its box."""

    kind: str
    distance_m: float
    frame: Frame
    xyxy_px: FloatArray
    """Pixel edges, shape (4,)."""


def bank_item(
    kind: BankKind,
    index: int,
    cars: Sequence[CarModel],
    pictures: Pictures,
    config: BankConfig,
    seed: int,
) -> BankItem:
    """The thing of a kind with a number; a pure function of its arguments.

    Raises:
        RescoreError: no street was found where it stands free and whole in the picture.
    """
    place = list(KIND).index(kind.name)
    for attempt in range(MAX_ATTEMPTS):
        rng = np.random.default_rng([seed, place, index, attempt])
        low, high = config.distance_m if kind.scale == 1 else config.toy_distance_m
        distance = low * (high / low) ** float(rng.uniform())
        scene = _street(distance, config, rng)
        mesh = kind.build(rng, cars, pictures)
        things = _placed(kind, mesh.vertices_m, distance, scene, rng)
        target = vertices_of(mesh, kind.target)
        # some props now and then show no print
        if things is None or not len(target):
            continue
        at, post = things
        thing = Placed(mesh, at, kind.name)
        seen = _seen_box(world_points(target, at), scene)
        box = detector_box(seen, kind, config, rng)
        if not _inside(box, scene):
            continue
        scene = replace(scene, items=(*scene.items, thing, *post))
        render = render_pair(scene, rng)
        known = camera_record(scene)
        frame = Frame(
            index,
            render.left_rgb,
            compute_disparity(render.left_rgb, render.right_rgb, config.synth.sgbm),
            scene.camera,
            GroundPlane(known["height_m"], known["pitch_rad"]),
        )
        return BankItem(kind.name, distance * kind.scale, frame, box)
    raise RescoreError(
        f"distractor bank: expected a street for {kind.name} {index}, found none in {MAX_ATTEMPTS} draws; "
        "widen the range of distances"
    )


def detector_box(
    seen: FloatArray, kind: BankKind, config: BankConfig, rng: np.random.Generator
) -> FloatArray:
    """The box (4,) that a detector of cars would put on the picture of a thing, jittered.

    Detectors know one shape of box. Around a whole thing it has the area of the thing's own box and the same
    middle and lower edge; on a thing that goes on it is as large as fits.

    Args:
        seen: extent of what is boxed in the picture, shape (4,), pixel edges.
        kind: whose box it is.
        config: shape and jitter.
        rng: source of the jitter.
    """
    x0, y0, x1, y1 = seen
    width, height = (x1 - x0) * kind.inset, (y1 - y0) * kind.inset
    bottom = y1 - (1 - kind.inset) / 2 * (y1 - y0)
    middle = (x0 + x1) / 2
    if kind.part:
        high = min(height, width / config.aspect)
        middle += float(rng.uniform(-0.5, 0.5)) * (width - high * config.aspect)
    else:
        high = float(np.sqrt(width * height / config.aspect))
    # a detector keeps a box only near the thing: beyond two spreads it would be no hit
    dx, dy, size = np.clip(rng.standard_normal(3), -2, 2) * (config.shift, config.lift, config.size)
    high *= float(np.exp(size))
    wide = high * config.aspect
    middle, bottom = middle + dx * wide, bottom + dy * high
    return np.array([middle - wide / 2, bottom - high, middle + wide / 2, bottom])


def _street(distance_m: float, config: BankConfig, rng: np.random.Generator) -> Scene:
    """An empty street with a lane at a distance."""
    lane = CarConfig(near_m=distance_m, far_m=distance_m + 1.0, other_view_share=0.0)
    return sample_scene(replace(config.synth, cars=lane, clutter=_EMPTY), (), rng, 0)


def _placed(
    kind: BankKind, vertices_m: Float32Array, distance_m: float, scene: Scene, rng: np.random.Generator
) -> tuple[FloatArray, tuple[Placed, ...]] | None:
    """Pose of a thing whose near side is at a distance, and what it stands on; None where houses are in the
    way."""
    camera = scene.camera.left
    world_from_left = np.linalg.inv(scene.left_from_world)
    u = float(rng.uniform(0.15, 0.85)) * camera.width_px
    ray = world_from_left[:3, :3] @ camera.rays(np.array([u, camera.cy_px]))
    y = distance_m - float(vertices_m[:, 1].min())
    x = float(y * ray[0] / ray[1])
    z = _ground_z(scene, x, y)
    houses = [float(world_points(p.mesh.vertices_m, p.world_from_object)[:, 1].min()) for p in _solid(scene)]
    if z is None or (houses and distance_m + float(np.ptp(vertices_m[:, 1])) > min(houses) - _BEHIND_M):
        return None
    if kind.scale == 1:
        return pose(x, y, z), ()
    # shrunk towards the camera, its picture stays as it is
    eye_z = float(world_from_left[2, 3])
    at = pose(x * kind.scale, y * kind.scale, eye_z + (z - eye_z) * kind.scale)
    at[:3, :3] *= kind.scale
    size = np.ptp(vertices_m, axis=0) * kind.scale
    post = MeshDraft()
    top = float(at[2, 3])
    post.box((0, 0, top / 2), (float(size[0]) * 1.2, float(size[1]) * 1.3, top), plain(STEEL))
    return at, (Placed(post.mesh(), pose(x * kind.scale, y * kind.scale), "post"),)


def _solid(scene: Scene) -> list[Placed]:
    return [p for p in scene.items if p.kind not in GROUND_KINDS]


def _ground_z(scene: Scene, x_m: float, y_m: float) -> float | None:
    """Height of the ground at a place; None beside it."""
    ground = tuple(p for p in scene.items if p.kind in GROUND_KINDS)
    down = np.array([[x_m, y_m, 5.0, 0, 0, -1]], np.float32)
    t = float(build_scene_rays(ground).cast(down).t[0])
    return 5.0 - t if np.isfinite(t) else None


def world_points(points_m: Float32Array, world_from_object: FloatArray) -> FloatArray:
    """Points (n, 3) of an object in the world frame."""
    return points_m @ world_from_object[:3, :3].T + world_from_object[:3, 3]


def _seen_box(points_m: FloatArray, scene: Scene) -> FloatArray:
    """Extent (4,) of points (n, 3) of the world in the left picture, pixel edges."""
    pose_cam = scene.left_from_world
    edges = scene.camera.left.project(points_m @ pose_cam[:3, :3].T + pose_cam[:3, 3]) + 0.5
    return np.concatenate([edges.min(axis=0), edges.max(axis=0)])


def _inside(box_px: FloatArray, scene: Scene) -> bool:
    """Whether a box lies in the picture and is large enough for a detector, 24 pixels high."""
    left = scene.camera.left
    low, high = box_px[:2], box_px[2:]
    whole = (low >= 0).all() and high[0] <= left.width_px and high[1] <= left.height_px
    return bool(whole and high[1] - low[1] >= 24)
