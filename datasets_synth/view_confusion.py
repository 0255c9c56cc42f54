"""How well a class model tells view bins apart, on rendered photographs of shapes that it has not seen.

``python -m datasets_synth.view_confusion CLASS ELEVATION_DEG PHOTOS OUT.json`` learns a class model from
training shapes and counts on test shapes; ``python -m reports.confusion OUT.json OUT.png`` draws the counts.
"""

import sys
from pathlib import Path

import numpy as np

from datasets_synth.object_classes import ObjectClass, labelled_views, object_class
from datasets_synth.single_object import Viewpoint, photograph
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.learn import LearnConfig, learn_class_model
from recon.outcome import Failure
from recon.outlines import largest_outline
from recon.view_bins import ViewBins
from recon.view_selection import best_view_bin
from rescore.confusion import Confusion, count_choices, save_confusions

CAMERA = PinholeCamera(250.0, 250.0, 79.5, 59.5, 160, 120)
"""Objects fill most of its picture: a car of 4.4 m is 128 pixels long from the side, at 9 m."""
_INDOORS = ("chair", "basket")
_LEARNED_SHAPES = 3
_LABELLED_PX = 240


def view_confusion(
    object_class: ObjectClass,
    model: ClassModel,
    n: int,
    rng: np.random.Generator,
    elevation_rad: float | None = None,
) -> dict[str, Confusion]:
    """Choices of view bins on photographs of test shapes, with true boxes.

    Args:
        object_class: the class.
        model: a model of the class, learned from training shapes.
        n: photographs; their azimuths go through the bins in turn, each anywhere in its bin.
        rng: source of shapes, azimuths and everything in the pictures.
        elevation_rad: where the camera stands; None for the elevation of the model's views.

    Returns:
        "level_set": as with any picture; "true_outline": with the true outline in place of the level set.
    """
    elevation = model.bins.elevation_rad if elevation_rad is None else elevation_rad
    setting = "room" if object_class.name in _INDOORS else "street"
    half_bin = np.pi / model.bins.count
    true: list[int] = []
    chosen: dict[str, list[int | Failure]] = {"level_set": [], "true_outline": []}
    for i in range(n):
        view_bin = i % model.bins.count
        azimuth = model.bins.azimuth_rad(view_bin) + float(rng.uniform(-half_bin, half_bin))
        shape = object_class.test[int(rng.integers(len(object_class.test)))]
        photo = photograph(object_class, shape, Viewpoint(azimuth, elevation), CAMERA, rng, setting)
        true.append(view_bin)
        for name, outline in (("level_set", None), ("true_outline", largest_outline(photo.part_labels > 0))):
            choice = best_view_bin(photo.rgb, photo.xyxy_px, model, outline_px=outline)
            chosen[name].append(choice if isinstance(choice, Failure) else choice.view_bin)
    return {name: count_choices(true, found, model.bins.count) for name, found in chosen.items()}


def main(class_name: str, elevation_deg: float, n: int, out: Path) -> None:
    """Learn a model from a few training shapes, count on test shapes, write the JSON file."""
    chosen = object_class(class_name)
    bins = ViewBins(elevation_rad=float(np.deg2rad(elevation_deg)))
    step = max(1, len(chosen.train) // _LEARNED_SHAPES)
    views = labelled_views(chosen, chosen.train[::step][:_LEARNED_SHAPES], bins, _LABELLED_PX)
    # the planes, which refining turns, play no role in the choice of a view
    model = learn_class_model(views, class_name, chosen.part_names, LearnConfig(refine_rounds=0))
    tables = view_confusion(chosen, model, n, np.random.default_rng(0))
    save_confusions(out, tables, f"{class_name}, elevation {elevation_deg:g} degrees")
    for name, table in tables.items():
        shown = ", ".join(f"{k} {v:.0%}" for k, v in table.shares().items())
        print(f"{class_name} at {elevation_deg:g} degrees, {name}, {table.photos} photographs: {shown}")


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
