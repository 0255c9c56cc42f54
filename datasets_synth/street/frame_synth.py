"""One rendered frame: a street whose planned cars are really visible, its truth and its annotations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Scene
from datasets_synth.presets import MAX_CARS, CarConfig, SplitSize, SynthConfig
from datasets_synth.render.render import FEW_SUBSAMPLES_PX, StereoRender, eye_rays, render_pair
from datasets_synth.render.scene_rays import MISS, SceneRays, build_scene_rays
from datasets_synth.render.truth import VisibleObject, visible_objects
from datasets_synth.street.along.layout import AlongStreet, sample_along
from datasets_synth.street.along.truth import visible_vehicles
from datasets_synth.street.layout import sample_scene
from datasets_synth.street.prop_parts import Pictures
from recon.camera import PinholeCamera, StereoCamera
from recon.errors import RescoreError
from rescore.data.frames import SPLITS

MAX_ATTEMPTS = 200
PREVIEW_STEP = 4
"""The coarse picture has every fourth pixel."""
SIDE_VIEW_DEG = (75.0, 105.0)
"""Azimuths of view bin 3."""
_SCHEDULE_STREAM = 1_000_000
"""Seed number of the schedule, larger than any frame index, so that no frame draws the same random
numbers."""


@dataclass(frozen=True, eq=False)
class SynthFrame:
    """A frame before it is written."""

    scene: Scene
    render: StereoRender
    cars: tuple[VisibleObject, ...]
    attempts: int
    """How many streets were drawn until the planned cars could be seen."""
    along: AlongStreet | None = None
    """The street, where it is seen along its length."""


def car_schedule(size: SplitSize, seed: int, split: str) -> tuple[int | None, ...]:
    """Cars to annotate in each frame, 0 to MAX_CARS, adding up to the size of the split.

    None for every frame where the split does not say how many.
    """
    if size.n_cars is None:
        return (None,) * size.n_images
    rng = np.random.default_rng([seed, SPLITS.index(split), _SCHEDULE_STREAM])
    counts = rng.choice(MAX_CARS + 1, size.n_images, p=[0.2, 0.5, 0.24, 0.06])
    while (missing := size.n_cars - int(counts.sum())) != 0:
        step = int(np.sign(missing))
        open_frames = np.flatnonzero(counts < MAX_CARS if step > 0 else counts > 0)
        counts[rng.choice(open_frames)] += step
    return tuple(int(c) for c in counts)


def is_counted(car: VisibleObject, config: CarConfig) -> bool:
    """Whether a car is annotated without ``ignore``: seen from the side, not too hidden, not cut off."""
    low, high = SIDE_VIEW_DEG
    return (
        low <= car.azimuth_deg <= high
        and car.visible_share >= config.min_visibility
        and car.truncated_share <= config.max_truncation
    )


def synth_frame(
    config: SynthConfig,
    seed: int,
    split: str,
    index: int,
    *,
    n_cars: int | None,
    cars: Sequence[CarModel],
    pictures: Pictures,
) -> SynthFrame:
    """The frame of a split with exactly ``n_cars`` counted cars; a pure function of its arguments.

    A street seen along its length shows as many cars as it happens to hold.

    Raises:
        RescoreError: No street was found in which so many cars can be seen.
    """
    if config.layout == "along":
        return _along_frame(config, [seed, SPLITS.index(split), index], cars, pictures)
    wanted = n_cars or 0
    for attempt in range(MAX_ATTEMPTS):
        rng = np.random.default_rng([seed, SPLITS.index(split), index, attempt])
        scene = sample_scene(config, cars, rng, wanted, pictures)
        if sum(item.kind == "car" for item in scene.items) < wanted:
            continue
        rays = build_scene_rays(scene.items)
        if sum(is_counted(c, config.cars) for c in _preview(scene, rays)) != wanted:
            continue
        render = render_pair(scene, rng, rays)
        seen = tuple(c for c in visible_objects(render, scene) if c.visible_share > 0)
        if sum(is_counted(c, config.cars) for c in seen) == wanted:
            return SynthFrame(scene, render, seen, attempt + 1)
    raise RescoreError(
        f"frame {split} {index}: expected a street with {wanted} cars in view, found none in "
        f"{MAX_ATTEMPTS} draws; lower occluder_share or n_cars, or widen the range of distances"
    )


def _along_frame(
    config: SynthConfig, stream: list[int], cars: Sequence[CarModel], pictures: Pictures
) -> SynthFrame:
    rng = np.random.default_rng(stream)
    street = sample_along(config, cars, rng, pictures, number=stream[-1])
    render = render_pair(street.scene, rng, subsamples_px=FEW_SUBSAMPLES_PX)
    seen = visible_vehicles(render, street.scene)
    return SynthFrame(street.scene, render, seen, 1, street)


def _preview(scene: Scene, rays: SceneRays) -> tuple[VisibleObject, ...]:
    """The cars of a scene as seen in a coarse picture: enough to drop most streets before rendering."""
    left = scene.camera.left
    width, height = left.width_px // PREVIEW_STEP, left.height_px // PREVIEW_STEP
    s = 1 / PREVIEW_STEP
    # the scale is about the corner of the picture, half a pixel off the centre of its first pixel
    small = PinholeCamera(
        left.fx_px * s,
        left.fy_px * s,
        (left.cx_px + 0.5) * s - 0.5,
        (left.cy_px + 0.5) * s - 0.5,
        width,
        height,
    )
    coarse = replace(scene, camera=StereoCamera(small, scene.camera.baseline_m))
    v, u = np.mgrid[:height, :width].astype(np.float32)
    hits = rays.cast(eye_rays(coarse, np.stack([u.ravel(), v.ravel()], axis=1), eye=0))
    instance = np.zeros(len(hits.face), np.uint16)
    hit = hits.face != MISS
    instance[hit] = rays.table.item[hits.face[hit]] + 1
    nothing = np.zeros((height, width, 3), np.uint8)
    render = StereoRender(nothing, nothing, hits.t.reshape(height, width), instance.reshape(height, width))
    return visible_objects(render, coarse)


def camera_record(scene: Scene) -> dict[str, float]:
    """The ``camera`` object of an image record."""
    left = scene.camera.left
    down = scene.left_from_world[:3, 2]
    height = float(np.linalg.inv(scene.left_from_world)[2, 3])
    # up in the camera frame is (0, -cos pitch, -sin pitch)
    pitch = float(np.arctan2(-down[2], -down[1]))
    return {
        "fx": left.fx_px, "fy": left.fy_px, "cx": left.cx_px, "cy": left.cy_px,
        "baseline_m": scene.camera.baseline_m, "height_m": height, "pitch_rad": pitch,
    }  # fmt: skip


def annotation_record(car: VisibleObject, config: CarConfig) -> Mapping[str, Any]:
    """One annotation without its ids."""
    x0, y0, x1, y1 = (round(float(v), 2) for v in car.xyxy_px)
    width, height = round(x1 - x0, 2), round(y1 - y0, 2)
    return {
        "bbox": [x0, y0, width, height],
        "area": round(width * height, 2),
        "iscrowd": 0,
        "ignore": int(not is_counted(car, config)),
        "visibility": round(car.visible_share, 4),
        "truncation": round(car.truncated_share, 4),
        "view_bin": car.view_bin,
        "azimuth_deg": round(car.azimuth_deg, 3),
        "pose": {
            "position_m": [round(float(v), 4) for v in car.position_cam_m],
            "yaw_rad": round(car.yaw_rad, 5),
        },
        "size_m": [round(v, 4) for v in car.size_m],
        "shape_id": car.shape_id,
    }
