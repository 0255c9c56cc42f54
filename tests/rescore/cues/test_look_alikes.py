"""What a box that frames no car is taken for: one case each of what fools detectors."""

import numpy as np
import pytest

from rescore.cues.framing import FRAMING
from rescore.cues.look_alikes import MORE, NO_CAR, PART, TOO_LARGE, look_alike

WHOLE = dict.fromkeys(FRAMING, 0.0) | {"overlap": 0.8, "framed_overlap": 0.8, "explained": 4.0}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        # the car that is seen reaches half a box beyond its right edge
        ({"end_right": 0.5, "beyond_box": 0.5, "overlap": 0.4}, PART),
        # only by where its ends are, not by what is measured of it
        ({"end_right": 0.5, "beyond_box": 0.1}, ""),
        ({"end_left": -0.4, "goes_on_beside": 0.5}, MORE),
        ({"end_left": -0.4}, MORE),
        ({"end_top": -0.4, "goes_on_above": 0.6}, TOO_LARGE),
        ({"explained": -1.0, "overlap": 0.1, "end_left": 0.7, "beyond_box": 0.8}, NO_CAR),
        # an end at the edge of the picture says nothing
        (dict.fromkeys(("end_left", "end_right", "end_top", "end_bottom"), np.nan), ""),
    ],
)
def test_what_a_box_is_taken_for(changes: dict[str, float], words: str) -> None:
    assert look_alike(WHOLE | changes) == words
