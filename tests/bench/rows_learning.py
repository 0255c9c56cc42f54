"""Learning the class model, and the generic phase before it."""

import time

from datasets_synth.objects.object_classes import labelled_views, object_class
from recon.learning.generic_phase import learn_primitives, primitive_library
from recon.learning.learn import learn_class_model
from recon.view_bins import ViewBins
from reports.publishing.bench_file import Row
from rescore.parallel import one_thread
from tests.bench.timing import processor_s


def learning() -> list[Row]:
    """The car model of all view bins from six cars; the library of primitives is that of the package."""
    primitive_library(ViewBins())
    cars = object_class("car").train
    views = labelled_views(object_class("car"), cars[:: len(cars) // 6][:6], ViewBins(), 160)
    with one_thread():
        took_s = processor_s(lambda: learn_class_model(views, "car", views.part_names))
    return [Row("learn the car model (6 instances, 12 views), generic phase cached", took_s, "s", 20)]


def generic() -> list[Row]:
    """The generic phase of one view space."""
    start = time.perf_counter()
    learn_primitives(ViewBins(), jobs=2)
    return [Row("generic phase, two cores", time.perf_counter() - start, "s", 180, clock="wall")]
