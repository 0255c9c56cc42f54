"""Pictures of cars for boards, hoardings and the sides of trucks: an advertisement's photographs."""

from collections.abc import Sequence

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.materials import surface
from datasets_synth.meshes.mesh import Imaging, Light, Material, Placed, Scene
from datasets_synth.meshes.solids import MeshDraft, pose
from datasets_synth.render.render import render_rgb
from datasets_synth.street.layout import FACING_LEFT_RAD
from recon.arrays import UInt8Array
from recon.camera import PinholeCamera, StereoCamera

WIDTH_PX = 440


def car_picture(cars: Sequence[CarModel], rng: np.random.Generator) -> UInt8Array:
    """A photograph of one car from its left side, nose to the left, shape (h, w, 3) sRGB."""
    car = cars[int(rng.integers(len(cars)))]
    distance = float(rng.uniform(9, 20))
    turn = float(np.radians(rng.uniform(-9, 9)))
    length, _, height = car.size_m
    items = [
        Placed(car.build(rng), pose(0, distance, 0, FACING_LEFT_RAD + turn), "car", car.shape_id),
        *_backdrop(distance, rng),
    ]
    elevation = float(np.radians(rng.uniform(30, 65)))
    azimuth = float(np.radians(rng.uniform(200, 340)))
    sun = (
        float(np.cos(elevation) * np.cos(azimuth)),
        float(np.cos(elevation) * np.sin(azimuth)),
        float(np.sin(elevation)),
    )
    light = Light(sun, (1.9, 1.85, 1.7), (0.4, 0.55, 0.9), (0.9, 0.95, 1.0), 0.9)
    span = length * float(rng.uniform(1.12, 1.4))
    high = height * float(rng.uniform(1.35, 1.7))
    focal = WIDTH_PX * distance / span
    rows = int(WIDTH_PX * high / span)
    eye = float(rng.uniform(0.9, 1.4))
    middle_z = height * 0.5 + float(rng.uniform(-0.05, 0.12))
    cx = (WIDTH_PX - 1) / 2 + float(rng.uniform(-0.04, 0.04)) * WIDTH_PX
    cy = (rows - 1) / 2 + focal * (middle_z - eye) / distance
    camera = StereoCamera(PinholeCamera(focal, focal, cx, cy, WIDTH_PX, rows), 0.1)
    left_from_world = np.array([[1.0, 0, 0, 0], [0, 0, -1, eye], [0, 1, 0, 0], [0, 0, 0, 1]])
    imaging = Imaging((0.62, 0.62), (0.0, 0.0), 0.0, 0.0, 0.0, (0.0, 0.0))
    return render_rgb(Scene(tuple(items), light, camera, left_from_world, imaging))


def _backdrop(distance_m: float, rng: np.random.Generator) -> list[Placed]:
    ground = MeshDraft()
    skin = surface(str(rng.choice(["asphalt", "slabs", "concrete", "grass"])), int(rng.integers(4)))
    w = 60.0
    ground.panel([(-w, 1, 0), (w, 1, 0), (w, 200, 0), (-w, 200, 0)], skin, 6.0)
    items = [Placed(ground.mesh(), np.eye(4), "road", "", False)]
    if rng.random() < 0.7:
        wall = MeshDraft()
        y = distance_m + float(rng.uniform(2, 9))
        if rng.random() < 0.5:
            rgb = rng.uniform(0.15, 0.8, 3)
            material = Material("studio", (float(rgb[0]), float(rgb[1]), float(rgb[2])))
            wall.panel([(-w, y, 0), (w, y, 0), (w, y, 30), (-w, y, 30)], material)
        else:
            kind = str(rng.choice(["bricks", "concrete", "leaves", "planks"]))
            wall.panel(
                [(-w, y, 0), (w, y, 0), (w, y, 30), (-w, y, 30)], surface(kind, int(rng.integers(4))), 2.5
            )
        items.append(Placed(wall.mesh(), np.eye(4), "facade"))
    return items
