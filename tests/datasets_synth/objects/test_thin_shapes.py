"""A shape space with thin limbs, learned from labelled views of chairs from above and from level cameras."""

from dataclasses import replace

import numpy as np

from datasets_synth.objects.object_classes import labelled_views, level_views, object_class
from recon.class_model import ClassModel
from recon.localization.learn_shapes import with_shape_space
from rescore.parallel import one_thread


def test_chairs_have_room_under_their_seats() -> None:
    chair = object_class("chair")
    shapes = chair.train[:3]
    level = level_views(chair, shapes, 64)
    views = replace(labelled_views(chair, shapes, chair.bins, 64), sizes_m=level.sizes_m)
    with one_thread():
        space = with_shape_space(
            ClassModel("chair", chair.part_names, chair.bins, (), ()), views, level=level
        ).shape_space
    assert space is not None
    assert space.is_thin
    assert space.instances.shape == (3, 1)
    size = np.exp(space.log_size)
    step = np.array([2, 1, 1]) * space.reach * size / np.array(space.mean.shape)
    assert step.max() < 1.1 * step.min()
    # along the vertical through the middle of the seat
    heights = np.arange(0.05, 0.95, 0.01)
    at = np.stack([np.zeros_like(heights), np.zeros_like(heights), heights], axis=1)
    inside = heights[space.hull_values(at, space.hull(space.instances[0]), size) < 0] * size[2]
    # seats are about 45 cm high; the ground is at 0, so that the space under them is open
    assert 0.35 < inside.min() < inside.max() < 0.55
