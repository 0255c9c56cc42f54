"""Boxes of one picture on the same car: which they are, and which of them frames it best."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from rescore.cues.rivals import rival, same_car
from rescore.data.boxes3d import Boxes3D

NAN = float("nan")


def test_boxes_on_one_car_overlap_in_the_picture_and_on_the_ground() -> None:
    # a car 12 m ahead, a box on its half, a car behind it, one beside it, and a box without an instance
    xyxy_px = np.array(
        [
            [100, 100, 200, 160],
            [100, 100, 150, 160],
            [110, 95, 190, 130],
            [195, 100, 295, 160],
            [99, 99, 199, 159],
        ],
        float,
    )
    x_z_m = [(0.0, 12.0), (0.3, 12.2), (0.2, 22.0), (2.4, 12.0), (0.0, 12.0)]
    values = np.array([[x, 1.0, z, 4.2, 1.7, 1.5, -np.pi / 2] for x, z in x_z_m])
    values[4] = NAN
    expected = np.diag([True, True, True, True, False])
    expected[0, 1] = expected[1, 0] = True
    assert_array_equal(same_car(xyxy_px, Boxes3D.of_values(values)), expected)


def test_the_best_other_box_on_the_car_counts() -> None:
    overlap = np.array([0.8, 0.5, 0.3, 0.9, NAN])
    same = np.eye(5, dtype=bool)
    same[:3, :3] = True
    assert_allclose(rival(overlap, same), [-0.3, 0.3, 0.5, 0.0, NAN])


def test_a_box_without_an_instance_is_no_rival() -> None:
    assert_allclose(rival(np.array([0.4, NAN]), np.ones((2, 2), bool)), [0.0, NAN])
    assert rival(np.zeros(0), np.zeros((0, 0), bool)).shape == (0,)
