"""What is learned for the table: the class model and the shape space, from part-labelled views alone,
and what front and rear look like, from pictures of the training cars on the table."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from datasets_synth.cars.parts import CAR_PARTS
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import ELEVATION_RAD, SEEN_FROM, photograph, place_at_random
from datasets_synth.render.part_render import render_part_labels
from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.learning.generic_phase import learn_primitives
from recon.learning.learn import LearnConfig, learn_class_model
from recon.learning.primitives import PrimitiveLibrary
from recon.localization.heading import Heading, HeadingConfig, Posed, learn_heading, read_surface
from recon.localization.learn_shapes import (
    InstanceShape,
    ShapeSpaceConfig,
    TrainingInstance,
    instance_shape,
    principal_shapes,
)
from recon.localization.standing_box import StandingBox
from recon.part_views import PartView
from recon.pixels import linear_from_srgb
from recon.shape_space import ShapeSpace
from recon.view_bins import ViewBins
from rescore.engines.executor import Workers, executor_of
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread

_PICTURES_SEED = 20090625
"""Seed of the pictures of training cars."""


@dataclass(frozen=True)
class TableClassConfig:
    """Settings of the labelled views and of what is learned from them."""

    elevations_rad: tuple[float, ...] = (ELEVATION_RAD, float(np.deg2rad(27.0)), float(np.deg2rad(45.0)))
    """Rings of twelve labelled views: the camera's elevation seen from the middle of the table, and about
    those from its far and its near edge."""
    view_px: int = 320
    """Length of the object in a labelled view."""
    class_model_cars: int = 6
    """Training cars whose views of the first ring the class model is learned from, a sedan first."""
    refine_rounds: int = 3
    """Rounds of refining the planes of the class model (see ``LearnConfig``)."""
    space: ShapeSpaceConfig = field(default_factory=ShapeSpaceConfig)
    heading_pictures: int = 24
    """Pictures of each training car at random places, from which front and rear are told; 0 where it does not
    matter which is which, as for a grasp."""
    heading_error: tuple[float, float, float] = (0.005, 0.03, 0.05)
    """Standard deviations of the errors of the box in heading pictures, as fits have: place in metres,
    direction in radians, logarithms of the size."""
    heading: HeadingConfig = field(default_factory=HeadingConfig)


@dataclass(frozen=True, eq=False)
class TableClass:
    """What is known of the class of cars."""

    model: ClassModel
    """Class model of the report, learned from views at the camera's elevation."""
    space: ShapeSpace
    heading: Heading | None
    """None where no pictures were learned from."""


def learn_table_class(
    cars: Sequence[CarModel],
    config: TableClassConfig,
    jobs: Workers,
    library: PrimitiveLibrary | None = None,
) -> TableClass:
    """The class model, the shape space and the looks of training cars; pictures are rendered here.

    Beside the labelled views the learner knows each training car's length, width and height in metres.

    Args:
        cars: the training cars.
        config: settings.
        jobs: cars at a time.
        library: primitives of the view bins at the first elevation; None to learn them here.
    """
    bins = ViewBins(12, config.elevations_rad[0])
    library = library or learn_primitives(bins, jobs=executor_of(jobs).jobs)
    learned = list(map_frames(_learn_one, enumerate(cars), (config, library), jobs))
    first = sorted(range(len(cars)), key=lambda i: "sedan" not in cars[i].shape_id)[0]
    step = max(1, len(cars) // config.class_model_cars)
    chosen = [first, *(i for i in range(0, len(cars), step) if i != first)][: config.class_model_cars]
    # sums over several threads differ in the last digits, and the fits with them
    with one_thread():
        space = principal_shapes([one.shape for one in learned], config.space)
        readings = [r for one in learned for r in one.readings]
        heading = learn_heading(readings, config.heading) if readings else None
        views = [view for i in chosen for view in learned[i].views]
        model = learn_class_model(
            views, "car", CAR_PARTS, LearnConfig(bins=bins, refine_rounds=config.refine_rounds), library
        )
    return TableClass(model, space, heading)


@dataclass(frozen=True, eq=False)
class _Learned:
    """What is kept of one training car."""

    views: tuple[PartView, ...]
    """Labelled views of the first ring."""
    shape: InstanceShape
    readings: list[FloatArray]
    """Looks of its surface in pictures, each of shape (cells,)."""


def _learn_one(numbered: tuple[int, CarModel], shared: tuple[TableClassConfig, PrimitiveLibrary]) -> _Learned:
    (index, car), (config, library) = numbered, shared
    mesh = car.build(np.random.default_rng(0))
    rings = [ViewBins(12, e) for e in config.elevations_rad]
    views = [
        PartView(b, render_part_labels(mesh, ring.view_from_object(b), config.view_px), car.shape_id)
        for ring in rings
        for b in range(ring.count)
    ]
    ring_of = tuple(ring for ring in rings for _ in range(ring.count))
    with one_thread():
        instance = TrainingInstance(tuple(views), ring_of, car.size_m)
        shape = instance_shape(instance, CAR_PARTS, config.space, library)
        readings = _readings(car, index, shape, config)
    return _Learned(tuple(views[: rings[0].count]), shape, readings)


def _readings(car: CarModel, index: int, shape: InstanceShape, config: TableClassConfig) -> list[FloatArray]:
    """Readings of the surface of a training car off pictures of it on the table, with errors as fits have."""
    out = []
    place, turned, size = config.heading_error
    for k in range(config.heading_pictures):
        rng = np.random.default_rng([_PICTURES_SEED, index, k])
        placement = place_at_random(car, rng)
        light = linear_from_srgb(photograph([placement], rng))
        true = placement.box
        box = StandingBox(
            true.xy_m + rng.normal(0, place, 2),
            true.yaw_rad + rng.normal(0, turned),
            true.size_m * np.exp(rng.normal(0, size, 3)),
        )
        posed = Posed(shape.hull, config.space.reach, box)
        out.append(read_surface(light, posed, SEEN_FROM, config.heading))
    return out
