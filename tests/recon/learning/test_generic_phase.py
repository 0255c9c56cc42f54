"""The generic phase: learned transforms against the closed form, and the file of the library."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from recon.learning.generic_phase import file_name, learn_primitives, primitive_library
from recon.learning.primitives import (
    PrimitiveLibrary,
    affine_transform,
    apply_projective,
    nearest_on_outline,
    primitive_normals,
    projective_transform,
)
from recon.view_bins import ViewBins
from tests.exact_primitives import exact_library

BINS = ViewBins(12, float(np.deg2rad(20)))
PACKAGED = [ViewBins(12, float(np.deg2rad(e))) for e in (5, 20, 30)]


@pytest.mark.parametrize("bins", PACKAGED, ids=str)
def test_the_package_holds_libraries_that_agree_with_the_closed_form(bins: ViewBins) -> None:
    assert (files("recon") / "data" / file_name(bins)).is_file()
    learned, exact = primitive_library(bins), exact_library(bins)
    assert learned.bins == bins
    known = np.isfinite(learned.transform[..., 0, 0])
    # only what two views show from one side is known; a primitive that turns edge-on between them is lost
    shown = np.isfinite(exact.transform[..., 0, 0])
    assert not (known & ~shown).any()
    assert known.sum() > 0.9 * shown.sum()
    error = np.abs(learned.transform - exact.transform).max(axis=(3, 4))
    assert np.median(error[known]) < 0.02
    # what is seen nearly edge-on is stretched many times by turning, and so is its error
    well = np.isfinite(exact_library(bins, min_facing=0.15).transform[..., 0, 0])
    assert np.quantile(error[known & well], 0.95) < 0.1
    assert np.nanmedian(learned.residual) < 0.03


def test_learning_again_gives_the_packaged_transforms() -> None:
    chosen = primitive_normals()[[0, 17, 60]]
    again = learn_primitives(BINS, normals=chosen)
    packaged = primitive_library(BINS)
    np.testing.assert_allclose(again.transform, packaged.transform[[0, 17, 60]], atol=1e-5)
    np.testing.assert_allclose(again.residual, packaged.residual[[0, 17, 60]], atol=1e-5)


def test_a_transform_and_its_way_back_undo_each_other() -> None:
    library = primitive_library(BINS)
    known = np.isfinite(library.transform[..., 0, 0]) & np.isfinite(library.residual)
    k, a, b = np.argwhere(known & (np.arange(12)[:, None] < np.arange(12)))[::37].T
    there, back = library.transform[k, a, b], library.transform[k, b, a]
    points = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    returned = np.stack(
        [apply_projective(t, p) for t, p in zip(there, apply_projective(back, points), strict=True)]
    )
    assert np.median(np.abs(returned - points)) < 0.02


def test_file_round_trip_and_damage(tmp_path: Path) -> None:
    library = exact_library(BINS)
    path = tmp_path / file_name(BINS)
    library.save(path)
    back = PrimitiveLibrary.load(path)
    assert back.bins == BINS
    np.testing.assert_allclose(back.transform, library.transform, atol=1e-6)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(RescoreError, match="expected 'primitives 1' NPZ, could not read it"):
        PrimitiveLibrary.load(path)
    with pytest.raises(RescoreError, match="expected a library of primitives, found no file"):
        PrimitiveLibrary.load(tmp_path / "none.npz")


def test_regression_finds_a_projective_transform_and_an_affine_one() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (30, 2))
    transform = np.array([[1.1, 0.2, 0.3], [-0.1, 0.8, -0.2], [0.05, -0.08, 1.0]])
    np.testing.assert_allclose(
        projective_transform(points, apply_projective(transform, points)), transform, atol=1e-9
    )
    transform[2, :2] = 0
    np.testing.assert_allclose(
        affine_transform(points, apply_projective(transform, points)), transform, atol=1e-9
    )


def test_points_may_slide_along_an_outline() -> None:
    # a square moved by (0.1, 0.05): distances from its sides fix the shift, whatever slides along them
    side = np.linspace(-1, 1, 41)[:-1]
    square = np.concatenate(
        [np.stack([side, -np.ones(40)], 1), np.stack([np.ones(40), side], 1),
         np.stack([-side, np.ones(40)], 1), np.stack([-np.ones(40), -side], 1)]
    )  # fmt: skip
    moved = square + np.array([0.1, 0.05])
    nearest, normal = nearest_on_outline(square, moved)
    transform = projective_transform(square, nearest, normal)
    np.testing.assert_allclose(apply_projective(transform, square), moved, atol=0.03)
