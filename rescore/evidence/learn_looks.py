"""How cars look from each side, learned from the annotated boxes of training frames."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from recon.arrays import FloatArray, UInt8Array
from recon.class_model import ClassModel
from recon.view_looks import LooksConfig, learn_looks
from rescore.data.frames import DataSet
from rescore.data.pictures import read_rgb


def with_looks(model: ClassModel, training: DataSet, config: LooksConfig, seed: int) -> ClassModel:
    """The class model with the looks of the cars of frames that train, where their side is annotated.

    The model is left as it is where it has no shape space: nothing that it serves asks for a heading.

    Raises:
        RescoreError: too few cars of known side.
    """
    if model.shape_space is None:
        return model
    looks = learn_looks(_boxes(training), config, np.random.default_rng([seed, _STREAM]))
    return replace(model, looks=looks)


_STREAM = 11
"""Number of the stream of random numbers that moves the edges of boxes."""


def _boxes(training: DataSet) -> Iterator[tuple[UInt8Array, FloatArray, FloatArray]]:
    """Pictures with the boxes and headings of cars that count and whose side is known."""
    for frame in training.frames:
        truth = training.truth[frame.image_id]
        if truth.azimuth_deg is None:
            continue
        use = ~truth.ignore & np.isfinite(truth.azimuth_deg)
        if use.any():
            rgb = read_rgb(frame.left_path, frame.width_px, frame.height_px)
            # seen from its front (azimuth 0) a car points at the camera, seen from its left (90) to the left
            yield rgb, truth.xyxy_px[use], np.radians(270 - truth.azimuth_deg[use])
