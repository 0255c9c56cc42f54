"""Draws a street that is seen along its length: road, traffic, fronts, light and camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from datasets_synth.cars.shapes import CarModel
from datasets_synth.meshes.mesh import Scene
from datasets_synth.presets import SynthConfig
from datasets_synth.street.along.frontage import put_frontage
from datasets_synth.street.along.ground import ground_items
from datasets_synth.street.along.heads import ground_of, sample_head
from datasets_synth.street.along.road import sample_road
from datasets_synth.street.along.stage import Stage
from datasets_synth.street.along.traffic import Vehicles, put_vehicles, sample_traffic
from datasets_synth.street.footprints import Footprint
from datasets_synth.street.lighting import sample_imaging, sample_light
from datasets_synth.street.prop_parts import Pictures
from recon.camera import GroundPlane


@dataclass(frozen=True, eq=False)
class AlongStreet:
    """A street seen along its length, and what is known of its ground."""

    scene: Scene
    rig: str
    """Name of the stereo head."""
    ground: GroundPlane
    """The road before the camera, in the frame of its left eye."""
    states_ground: bool
    """Whether the camera record says where the ground is."""


def sample_along(
    config: SynthConfig,
    models: Sequence[CarModel],
    rng: np.random.Generator,
    pictures: Pictures = (),
    number: int = 0,
) -> AlongStreet:
    """A street with cars in all views.

    Rigs take turns, and so do cameras that state their ground and those that do not, so that each split has
    its share of both.

    Args:
        config: What streets look like.
        models: The cars to choose from.
        rng: Source of everything.
        pictures: Pictures of cars for posters and prints; without them there are none.
        number: Which frame of its split this is.
    """
    road = sample_road(config.along, rng)
    turn, which = divmod(number, len(config.along.rigs))
    head = sample_head(config.along.rigs[which], config.along, road, rng)
    stage = Stage(road, rng)
    stage.reserve(Footprint(head.x_m, 0.5, 1.3, 5.0))
    put_vehicles(Vehicles(stage, models, pictures, sample_traffic(rng), config.along.far_m), head.x_m)
    put_frontage(stage, pictures)
    light, brightness = sample_light(config.light, rng)
    scene = Scene(
        items=(*ground_items(road, rng), *stage.items),
        light=light,
        camera=head.camera,
        left_from_world=head.left_from_world,
        imaging=sample_imaging(head.rig.sensor, light, brightness, rng),
        grade=road.grade,
    )
    share = config.along.stated_share
    states_ground = int((turn + 1) * share) > int(turn * share)
    return AlongStreet(scene, head.rig.name, ground_of(head, road), states_ground)
