"""What is learned for the table: the class model and the shape space, from part-labelled views alone,
and what front and rear look like, from pictures of the training cars on the table."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import joblib
import numpy as np

from datasets_synth.cars.parts import CAR_PARTS
from datasets_synth.cars.shapes import CarModel
from datasets_synth.photos.table_scene import ELEVATION_RAD
from datasets_synth.render.part_render import render_part_labels
from recon.arrays import FloatArray
from recon.class_model import ClassModel
from recon.learning.generic_phase import learn_primitives
from recon.learning.learn import LearnConfig, learn_class_model
from recon.learning.primitives import PrimitiveLibrary
from recon.localization.heading import FitLooks, Heading, HeadingConfig, learn_heading, weigh_cues
from recon.localization.learn_shapes import (
    InstanceShape,
    ShapeSpaceConfig,
    TrainingInstance,
    instance_shape,
    principal_shapes,
)
from recon.part_views import PartView
from recon.shape_space import ShapeSpace
from recon.view_bins import ViewBins
from rescore.engines.executor import Workers, executor_of
from rescore.engines.map_frames import map_frames
from rescore.parallel import one_thread, track
from rescore.speech import doing
from rescore.studies.localization.heading_pictures import fitted_pairs, surface_readings

_OTHERS_STREAM = 1000
"""First stream of random choices of the cars that weigh the cues, beyond those of the training cars."""


@dataclass(frozen=True)
class TableClassConfig:
    """Settings of the labelled views and of what is learned from them."""

    elevations_rad: tuple[float, ...] = (ELEVATION_RAD, float(np.deg2rad(27.0)), float(np.deg2rad(45.0)))
    """Rings of twelve labelled views: the camera's elevation seen from the middle of the table, and about
    those from its far and its near edge."""
    view_px: int = 320
    """Length of the object in a labelled view."""
    class_model_cars: int = 1
    """Training cars whose views of the first ring the class model is learned from: those nearest the mean
    size. Parts of unlike cars do not fit together: a mean tail behind the longest boot makes no car."""
    refine_rounds: int = 3
    """Rounds of refining the planes of the class model (see ``LearnConfig``)."""
    space: ShapeSpaceConfig = field(default_factory=ShapeSpaceConfig)
    heading_pictures: int = 12
    """Pictures of each training car at random places, from which the looks of front and rear are learned; 0
    where it does not matter which is which, as for a grasp."""
    cue_pictures: int = 4
    """Pictures of each car that weighs the cues for front and rear."""
    heading: HeadingConfig = field(default_factory=HeadingConfig)


@dataclass(frozen=True, eq=False)
class TableClass:
    """What is known of the class of cars."""

    model: ClassModel
    """Class model of the report, learned from views at the camera's elevation."""
    space: ShapeSpace
    heading: Heading | None
    """None where no pictures were learned from."""

    @property
    def digest(self) -> str:
        """A digest of what trials depend on."""
        return str(joblib.hash((self.model, self.space, self.heading)))


def learn_class(
    cars: Sequence[CarModel],
    config: TableClassConfig,
    jobs: Workers,
    library: PrimitiveLibrary | None = None,
) -> TableClass:
    """The class model and the shape space of training cars, without front and rear; views are rendered here.

    Beside the labelled views the learner knows each training car's length, width and height in metres.

    Args:
        cars: the training cars.
        config: settings.
        jobs: cars at a time.
        library: primitives of the view bins at the first elevation; None to learn them here.
    """
    bins = ViewBins(12, config.elevations_rad[0])
    with doing("learn primitives"):
        library = library or learn_primitives(bins, jobs=executor_of(jobs).jobs)
    learning = map_frames(_learn_one, cars, (config, library), jobs)
    learned = list(track(learning, "learn shapes", len(cars)))
    chosen = _most_usual(cars)[: config.class_model_cars]
    # sums over several threads differ in the last digits, and the fits with them
    with one_thread():
        space = principal_shapes([one.shape for one in learned], config.space)
        views = [view for i in chosen for view in learned[i].views]
        model = learn_class_model(
            views, "car", CAR_PARTS, LearnConfig(bins=bins, refine_rounds=config.refine_rounds), library
        )
    return TableClass(model, space, None)


def _most_usual(cars: Sequence[CarModel]) -> list[int]:
    """Places of the cars in their list, those of the most usual length, width and height first."""
    log_size = np.log([car.size_m for car in cars])
    return [
        int(i) for i in np.argsort(np.linalg.norm(log_size - log_size.mean(axis=0), axis=1), kind="stable")
    ]


def learn_front_and_rear(
    space: ShapeSpace,
    cars: Sequence[CarModel],
    others: Sequence[CarModel],
    config: TableClassConfig,
    jobs: Workers,
) -> Heading:
    """Front and rear from pictures of the training cars, cues weighed by fits to other cars.

    Args:
        space: the shape space of the training cars.
        cars: the training cars.
        others: cars of other shapes; none to leave the cues as they are.
        config: settings, with some pictures of each car.
        jobs: cars at a time.
    """
    reading = map_frames(_readings_of, enumerate(cars), (space, config), jobs)
    found = list(track(reading, "learn front and rear", len(cars)))
    fitting = map_frames(_pairs_of, enumerate(others, _OTHERS_STREAM), (space, config), jobs)
    fitted = list(track(fitting, "weigh cues", len(others)))
    with one_thread():
        heading = learn_heading([r for own in found for r in own], config.heading)
        pairs = [p for own in fitted for p in own]
        return weigh_cues(heading, pairs) if pairs else heading


def _readings_of(
    numbered: tuple[int, CarModel], shared: tuple[ShapeSpace, TableClassConfig]
) -> list[FloatArray]:
    (stream, car), (space, config) = numbered, shared
    return surface_readings(car, stream, config.heading_pictures, space, config.heading)


def _pairs_of(
    numbered: tuple[int, CarModel], shared: tuple[ShapeSpace, TableClassConfig]
) -> list[tuple[FitLooks, FitLooks]]:
    (stream, car), (space, config) = numbered, shared
    return fitted_pairs(car, stream, config.cue_pictures, space, config.heading)


@dataclass(frozen=True, eq=False)
class _Learned:
    """What is kept of one training car."""

    views: tuple[PartView, ...]
    """Labelled views of the first ring."""
    shape: InstanceShape


def _learn_one(car: CarModel, shared: tuple[TableClassConfig, PrimitiveLibrary]) -> _Learned:
    config, library = shared
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
    return _Learned(tuple(views[: rings[0].count]), shape)
