"""Axes of charts."""

import numpy as np
import pytest

from reports.charts import Axis


def test_axes_map_linearly_or_by_decades() -> None:
    linear = Axis("x", 2, 6)
    np.testing.assert_allclose(linear.unit(np.array([2, 3, 6, 9.0])), [0, 0.25, 1, 1])
    # from 0.01 to 100 are four decades; 1 lies in their middle, and 0 is held at the left end
    log = Axis("x", 0.01, 100, log=True)
    np.testing.assert_allclose(log.unit(np.array([0.0, 0.01, 1, 100])), [0, 0, 0.5, 1])


@pytest.mark.parametrize(
    ("axis", "ticks"),
    [
        (Axis("x", 0, 1), (0, 0.2, 0.4, 0.6, 0.8, 1)),
        # a fifth of 0.4 to 0.83 is 0.086: steps of 0.1
        (Axis("x", 0.4, 0.83), (0.4, 0.5, 0.6, 0.7, 0.8)),
        (Axis("x", -3, 42), (0, 10, 20, 30, 40)),
        (Axis("x", 0.1667, 20, log=True), (1, 10)),
        (Axis("x", 0.001, 20, log=True), (0.001, 0.01, 0.1, 1, 10)),
    ],
)
def test_ticks_are_round_values_inside_the_axis(axis: Axis, ticks: tuple[float, ...]) -> None:
    assert axis.ticks == pytest.approx(ticks)


def test_a_still_picture_says_that_an_axis_is_logarithmic_and_what_its_edge_is() -> None:
    assert Axis("a", 0, 1).still_label == "a"
    assert Axis("a", 0.1, 1, log=True, edge="none").still_label == "a (log; left edge: none)"
