"""Streets seen along their length that render within a second or two."""

from dataclasses import replace
from functools import cache

import numpy as np

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.presets import (
    AlongConfig,
    PartViewConfig,
    RigConfig,
    SplitSize,
    SynthConfig,
    synth_preset,
)
from datasets_synth.street.frame_synth import SynthFrame, synth_frame

WIDE = RigConfig("wide", 368, 112, 214.0, (0.53, 0.55), (1.6, 1.72), horizon_share=0.46)
NARROW = RigConfig("narrow", 240, 136, 131.0, (0.118, 0.122), (1.2, 1.6))
SMALL = replace(
    synth_preset("streets"),
    splits={"train": SplitSize(3), "test": SplitSize(1)},
    along=AlongConfig(rigs=(WIDE, NARROW), min_height_px=6.0),
    part_views=PartViewConfig(n_instances=1, size_px=32),
    n_pictures=1,
)
PICTURES = (np.full((60, 100, 3), 128, np.uint8),)


@cache
def frame(index: int, along: AlongConfig = SMALL.along) -> SynthFrame:
    """A frame of split "train"."""
    config: SynthConfig = replace(SMALL, along=along)
    cars = cars_of_splits()["train"]
    return synth_frame(config, 7, "train", index, n_cars=None, cars=cars, pictures=PICTURES)
