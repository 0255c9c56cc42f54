"""What is learned for the table: the class model and the shape space, from part-labelled views alone."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from joblib import Parallel, delayed

from datasets_synth.layout import CarModel
from datasets_synth.part_render import render_part_labels
from datasets_synth.parts import CAR_PARTS
from datasets_synth.table_scene import ELEVATION_RAD
from recon.class_model import ClassModel
from recon.generic_phase import learn_primitives
from recon.learn import LearnConfig, learn_class_model
from recon.part_views import PartView
from recon.primitives import PrimitiveLibrary
from recon.shape_space import (
    InstanceShape,
    ShapeSpace,
    ShapeSpaceConfig,
    TrainingInstance,
    instance_shape,
    principal_shapes,
)
from recon.view_bins import ViewBins
from rescore.threads import one_thread


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


@dataclass(frozen=True, eq=False)
class TableClass:
    """What is known of the class of cars."""

    model: ClassModel
    """Of the report, from views at the camera's elevation."""
    space: ShapeSpace


def learn_table_class(
    cars: Sequence[CarModel],
    config: TableClassConfig,
    jobs: int,
    library: PrimitiveLibrary | None = None,
) -> TableClass:
    """The class model and the shape space of training cars; views are rendered here.

    Beside the labelled views the learner knows each training car's length, width and height in metres.

    Args:
        cars: the training cars.
        config: settings.
        jobs: cars at a time.
        library: primitives of the view bins at the first elevation; None to learn them here.
    """
    bins = ViewBins(12, config.elevations_rad[0])
    library = library or learn_primitives(bins, jobs=jobs)
    learned = Parallel(n_jobs=jobs)(delayed(_learn_one)(car, config, library) for car in cars)
    first = sorted(range(len(cars)), key=lambda i: "sedan" not in cars[i].shape_id)[0]
    step = max(1, len(cars) // config.class_model_cars)
    chosen = [first, *(i for i in range(0, len(cars), step) if i != first)][: config.class_model_cars]
    # sums over several threads differ in the last digits, and the fits with them
    with one_thread():
        space = principal_shapes([shape for _, shape in learned], config.space)
        views = [view for i in chosen for view in learned[i][0]]
        model = learn_class_model(
            views, "car", CAR_PARTS, LearnConfig(bins=bins, refine_rounds=config.refine_rounds), library
        )
    return TableClass(model, space)


def _learn_one(
    car: CarModel, config: TableClassConfig, library: PrimitiveLibrary
) -> tuple[tuple[PartView, ...], InstanceShape]:
    """Labelled views of the first ring, and the shape."""
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
    return tuple(views[: rings[0].count]), shape
