"""Red spots beside the paint speak for a rear, and nothing else does."""

import numpy as np
import pytest

from recon.arrays import UInt8Array
from recon.view_bins import ViewBins
from rescore.library.tail_lamps import tail_costs, tail_nats

BOX = np.array([10.0, 10.0, 74.0, 58.0])


def car(paint: tuple[int, int, int], lamps: tuple[int, int, int]) -> UInt8Array:
    """A box of one paint with two lamps of 4 x 4 pixels."""
    rgb = np.full((70, 90, 3), paint, np.uint8)
    for column in (16, 64):
        rgb[30:34, column : column + 4] = lamps
    return rgb


def test_red_lamps_speak_for_a_rear_on_any_paint() -> None:
    for paint in ((20, 20, 25), (220, 220, 220), (40, 80, 160)):
        assert tail_nats(car(paint, (220, 20, 20)), BOX) == 3.0
        assert tail_nats(car(paint, paint), BOX) == -0.5


def test_red_paint_and_yellow_blinkers_are_no_lamps() -> None:
    assert tail_nats(car((200, 20, 20), (210, 25, 20)), BOX) == -0.5
    assert tail_nats(car((20, 20, 25), (230, 170, 20)), BOX) == -0.5


def test_costs_tell_ends_apart_and_not_sides() -> None:
    costs = tail_costs(car((20, 20, 25), (220, 20, 20)), BOX, ViewBins())
    assert costs[0] - costs[6] == pytest.approx(3.0)
    assert costs[[3, 9]] == pytest.approx(0.0)
    assert costs[1:6] == pytest.approx(costs[:6:-1])
