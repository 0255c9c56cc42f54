"""Thin-plate splines: exact without regularisation, affine maps come back, and Bookstein's equations hold."""

import numpy as np
import pytest

from recon.shapes.shape_matching import thin_plate_operator

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


@pytest.mark.parametrize("regularisation", [0.0, 0.02, 1.0])
def test_solves_the_equations_of_bookstein(regularisation: float) -> None:
    m = len(CONTROLS)
    distance = np.linalg.norm(CONTROLS[:, None] - CONTROLS[None], axis=2)
    scale = distance.sum() / (m * (m - 1))
    affine = np.c_[np.ones(m), CONTROLS]
    system = np.zeros((m + 3, m + 3))
    system[:m, :m] = kernel(distance / scale) + regularisation * np.eye(m)
    system[:m, m:], system[m:, :m] = affine, affine.T
    coefficients = np.linalg.solve(system, np.eye(m + 3)[:, :m])
    away = np.linalg.norm(POINTS[:, None] - CONTROLS[None], axis=2)
    expected = np.c_[kernel(away / scale), np.ones(len(POINTS)), POINTS] @ coefficients
    np.testing.assert_allclose(thin_plate_operator(CONTROLS, POINTS, regularisation), expected, atol=1e-11)


def kernel(r: np.ndarray) -> np.ndarray:
    """U(r) = r^2 log r^2, 0 at r = 0."""
    return r**2 * np.log(np.where(r > 0, r**2, 1.0))


def test_regularisation_pulls_towards_the_affine_fit() -> None:
    targets = CONTROLS + RNG.normal(0, 3, CONTROLS.shape)
    basis = np.c_[np.ones(25), CONTROLS]
    affine = basis @ np.linalg.lstsq(basis, targets, rcond=None)[0]
    away = [
        np.abs(thin_plate_operator(CONTROLS, CONTROLS, r) @ targets - affine).max() for r in (0.0, 1.0, 1e4)
    ]
    assert away[0] > away[1] > away[2]
    assert away[2] < 0.01
