import numpy as np
import pytest

from reports.charts import Axis, Chart
from reports.recording.plot import HEIGHT, WIDTH, Plot, dashes


def test_plots_grow_upwards_in_coordinates_that_grow_downwards():
    plot = Plot("p", "t", Chart("t", "", Axis("x", 0, 1), Axis("y", 0, 2), ()))
    places = plot.place(np.array([0.0, 1.0]), np.array([0.0, 2.0]))
    np.testing.assert_allclose(places, [[0, HEIGHT], [WIDTH, 0]])


def test_dashes_cover_half_of_the_line_and_lie_on_it():
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    pieces = dashes(corner, 0.1)
    lengths = [np.hypot(*np.diff(p, axis=0).T).sum() for p in pieces]
    # 2 units in dashes of 0.1 with gaps of 0.1: ten of them
    assert len(pieces) == 10
    assert sum(lengths) == pytest.approx(1.0)
    every = np.concatenate(pieces)
    assert (np.isclose(every[:, 1], 0) | np.isclose(every[:, 0], 1)).all()


def test_a_line_without_length_stays():
    point = np.array([[0.3, 0.4], [0.3, 0.4]])
    assert len(dashes(point, 0.1)) == 1
