"""One rendered car on a street, seen from a given azimuth, with its truth."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from datasets_synth.cars.models import CarModel, cars_of_splits, part_labelled_cars
from datasets_synth.cars.parts import CAR_PARTS
from datasets_synth.meshes.materials import surface
from datasets_synth.meshes.mesh import Imaging, Light, Material, Placed, Scene
from datasets_synth.meshes.solids import MeshDraft, pose
from datasets_synth.render.part_render import render_part_labels
from datasets_synth.render.render import eye_rays, render_pair
from datasets_synth.render.scene_rays import MISS, RayTree, world_vertices
from datasets_synth.render.truth import projected_box
from recon.arrays import BoolArray, Float32Array, FloatArray, UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera, StereoCamera
from recon.class_model import ClassModel
from recon.learning.learn import LearnConfig, learn_class_model
from recon.part_views import PartView, PartViews
from recon.view_bins import ViewBins

BINS = ViewBins()


@dataclass(frozen=True, eq=False)
class CarPicture:
    """The picture and what it shows."""

    rgb: UInt8Array
    seen_from: GroundedCamera
    box_px: FloatArray
    """Edges x0, y0, x1, y1."""
    mask: BoolArray
    """Pixels of the car."""
    depth_m: Float32Array
    part_labels: UInt8Array
    cam_from_object: FloatArray
    size_m: tuple[float, float, float]
    placed: Placed


def car_from(
    azimuth_deg: float,
    seed: int = 0,
    car: CarModel | None = None,
    distance_m: float = 9.0,
    x_m: float = 0.0,
    width_px: int = 400,
    eye_m: float = 1.5,
    wall: bool = True,
) -> CarPicture:
    """A car whose azimuth is that of the camera seen from it; x_m moves it to the right."""
    rng = np.random.default_rng(seed)
    car = car or test_cars()[seed % len(test_cars())]
    bearing = np.arctan2(x_m, distance_m)
    yaw = float(-np.pi / 2 - np.radians(azimuth_deg) - bearing)
    items = [Placed(car.build(rng), pose(x_m, distance_m, 0.0, yaw), "car", car.shape_id)]
    items += _street(distance_m, rng, wall)
    sun = (0.45, -0.75, 0.9)
    light = Light(
        tuple(np.array(sun) / np.linalg.norm(sun)), (1.9, 1.85, 1.7), (0.4, 0.55, 0.9), (0.9, 0.95, 1.0), 0.9
    )
    focal = width_px * 1.05
    height_px = int(width_px * 0.75)
    left = PinholeCamera(focal, focal, (width_px - 1) / 2, height_px * 0.45, width_px, height_px)
    world_to_left = np.array([[1.0, 0, 0, 0], [0, 0, -1, eye_m], [0, 1, 0, 0], [0, 0, 0, 1]])
    imaging = Imaging((0.62, 0.62), (0.0, 0.0), 0.0, 0.0, 0.0, (0.0, 0.0))
    scene = Scene(tuple(items), light, StereoCamera(left, 0.1), world_to_left, imaging)
    seen = render_pair(scene, rng)
    box = projected_box(items[0], scene)
    assert box is not None
    mask = seen.instance == 1
    v, u = np.mgrid[:height_px, :width_px].astype(np.float32)
    rays = eye_rays(scene, np.stack([u.ravel(), v.ravel()], axis=1), 0)
    face = RayTree(world_vertices(items[0]).astype(np.float32), items[0].mesh.faces).cast(rays).face
    part = np.where(face == MISS, 0, items[0].mesh.face_part[face]).astype(np.uint8)
    return CarPicture(
        seen.left_rgb,
        GroundedCamera(left, GroundPlane(eye_m)),
        box,
        mask,
        seen.depth_m,
        part.reshape(height_px, width_px) * mask,
        world_to_left @ items[0].world_from_object,
        car.size_m,
        items[0],
    )


def test_cars() -> list[CarModel]:
    """Shapes that the class model was not learned from."""
    return list(cars_of_splits(None, None)["test"])


test_cars.__test__ = False  # type: ignore[attr-defined]


@lru_cache(maxsize=1)
def quick_car_model(size_px: int = 128) -> ClassModel:
    """A class model of all view bins from one training sedan."""
    cars, _ = part_labelled_cars(cars_of_splits(None, None)["train"])
    car = next(c for c in cars if "sedan" in c.shape_id)
    mesh = car.build(np.random.default_rng(0))
    views = [
        PartView(b, render_part_labels(mesh, BINS.view_from_object(b), size_px), car.shape_id)
        for b in range(BINS.count)
    ]
    config = LearnConfig(bins=BINS)
    return learn_class_model(PartViews(CAR_PARTS, BINS, tuple(views)), "car", CAR_PARTS, config)


def _street(distance_m: float, rng: np.random.Generator, wall: bool) -> list[Placed]:
    ground = MeshDraft()
    ground.panel([(-60, 1, 0), (60, 1, 0), (60, 200, 0), (-60, 200, 0)], surface("asphalt", 0), 6.0)
    items = [Placed(ground.mesh(), np.eye(4), "road", "", False)]
    if wall:
        draft = MeshDraft()
        y = distance_m + float(rng.uniform(6, 9))
        material = Material("wall", (0.55, 0.5, 0.42))
        draft.panel([(-60, y, 0), (60, y, 0), (60, y, 30), (-60, y, 30)], material)
        items.append(Placed(draft.mesh(), np.eye(4), "facade"))
    return items
