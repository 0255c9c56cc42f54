"""How well a class model tells view bins apart, on rendered photographs of shapes that it has not seen."""

import numpy as np

from datasets_synth.object_classes import ObjectClass, labelled_views
from datasets_synth.single_object import Viewpoint, photograph
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.learn import LearnConfig, learn_class_model
from recon.outcome import Failure
from recon.outlines import largest_outline
from recon.view_bins import ViewBins
from recon.view_selection import best_view_bin
from rescore.confusion import Confusion, count_choices

CAMERA = PinholeCamera(250.0, 250.0, 79.5, 59.5, 160, 120)
"""Objects fill most of its picture: a car of 4.4 m is 128 pixels long from the side, at 9 m."""
_INDOORS = ("chair", "basket")
LEARNED_SHAPES = 3
"""Training shapes that a class model is learned from."""
_LABELLED_PX = 240


def view_confusion(
    object_class: ObjectClass, model: ClassModel, n: int, rng: np.random.Generator
) -> dict[str, Confusion]:
    """Choices of view bins on photographs of test shapes from the elevation of the model's views, true boxes.

    Args:
        object_class: the class.
        model: a model of the class, learned from training shapes.
        n: photographs; their azimuths go through the bins in turn, each anywhere in its bin.
        rng: source of shapes, azimuths and everything in the pictures.

    Returns:
        "level_set": as with any picture; "true_outline": with the true outline in place of the level set.
    """
    setting = "room" if object_class.name in _INDOORS else "street"
    half_bin = np.pi / model.bins.count
    true: list[int] = []
    chosen: dict[str, list[int | Failure]] = {"level_set": [], "true_outline": []}
    for i in range(n):
        view_bin = i % model.bins.count
        azimuth = model.bins.azimuth_rad(view_bin) + float(rng.uniform(-half_bin, half_bin))
        shape = object_class.test[int(rng.integers(len(object_class.test)))]
        viewpoint = Viewpoint(azimuth, model.bins.elevation_rad)
        photo = photograph(object_class, shape, viewpoint, CAMERA, rng, setting)
        true.append(view_bin)
        for name, outline in (("level_set", None), ("true_outline", largest_outline(photo.part_labels > 0))):
            choice = best_view_bin(photo.rgb, photo.xyxy_px, model, outline_px=outline)
            chosen[name].append(choice if isinstance(choice, Failure) else choice.view_bin)
    return {name: count_choices(true, found, model.bins.count) for name, found in chosen.items()}


def learned_for_views(object_class: ObjectClass, elevation_rad: float) -> ClassModel:
    """A model of a class from a few training shapes, seen from an elevation in all view bins."""
    step = max(1, len(object_class.train) // LEARNED_SHAPES)
    shapes = object_class.train[::step][:LEARNED_SHAPES]
    views = labelled_views(object_class, shapes, ViewBins(elevation_rad=elevation_rad), _LABELLED_PX)
    # the planes, which refining turns, play no role in the choice of a view
    return learn_class_model(views, object_class.name, object_class.part_names, LearnConfig(refine_rounds=0))
