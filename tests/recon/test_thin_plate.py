"""Thin-plate splines: exact without regularisation, affine maps come back, regularisation smooths."""

import numpy as np
from scipy.interpolate import RBFInterpolator

from recon.shape_matching import thin_plate_operator

RNG = np.random.default_rng(0)
CONTROLS = RNG.uniform(0, 50, (25, 2))
POINTS = RNG.uniform(-5, 55, (40, 2))


def test_interpolates_without_regularisation() -> None:
    targets = CONTROLS + RNG.normal(0, 3, CONTROLS.shape)
    np.testing.assert_allclose(thin_plate_operator(CONTROLS, CONTROLS, 0.0) @ targets, targets, atol=1e-7)


def test_reproduces_affine_maps_with_any_regularisation() -> None:
    matrix, shift = np.array([[1.2, -0.3], [0.4, 0.9]]), np.array([7.0, -2.0])
    for regularisation in (0.0, 0.1, 10.0):
        moved = thin_plate_operator(CONTROLS, POINTS, regularisation) @ (CONTROLS @ matrix.T + shift)
        np.testing.assert_allclose(moved, POINTS @ matrix.T + shift, atol=1e-6)


def test_agrees_with_scipy() -> None:
    targets = CONTROLS + RNG.normal(0, 3, CONTROLS.shape)
    spline = RBFInterpolator(CONTROLS, targets, kernel="thin_plate_spline")
    np.testing.assert_allclose(
        thin_plate_operator(CONTROLS, POINTS, 0.0) @ targets, spline(POINTS), atol=1e-6
    )


def test_regularisation_pulls_towards_the_affine_fit() -> None:
    targets = CONTROLS + RNG.normal(0, 3, CONTROLS.shape)
    basis = np.c_[np.ones(25), CONTROLS]
    affine = basis @ np.linalg.lstsq(basis, targets, rcond=None)[0]
    away = [
        np.abs(thin_plate_operator(CONTROLS, CONTROLS, r) @ targets - affine).max() for r in (0.0, 1.0, 1e4)
    ]
    assert away[0] > away[1] > away[2]
    assert away[2] < 0.01
