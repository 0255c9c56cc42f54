"""The plane that is compared with is the best there is, and the noise is a density."""

import numpy as np
import pytest

from rescore.studies.relief.likelihood import MeasurementNoise, best_plane

NOISE = MeasurementNoise()


def samples(outliers: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, what a slanted plane has there, and what is measured of it."""
    rng = np.random.default_rng(1)
    uv = rng.uniform([300, 150], [420, 230], (500, 2))
    plane = 30 + 0.04 * (uv[:, 0] - 360) - 0.02 * (uv[:, 1] - 190)
    wrong = rng.uniform(size=500) < outliers
    return uv, plane, plane + np.where(wrong, rng.uniform(-12, -4, 500), rng.normal(0, 0.7, 500))


def test_the_noise_is_a_density() -> None:
    # a good measurement lies anywhere, another one between 0 and 208 px
    off = np.linspace(-104, 104, 200_001)
    total = np.exp(NOISE.log_density(off)).sum() * (off[1] - off[0])
    assert total == pytest.approx(1.0, abs=1e-4)
    # where a surface is not seen, what is measured is something else: 0.1 / 208
    assert NOISE.log_density(np.array([np.nan]))[0] == pytest.approx(np.log(0.1 / 208))
    assert NOISE.trust(np.array([0.0, 5.0, np.nan])) == pytest.approx([1, 0, 0], abs=2e-3)


@pytest.mark.parametrize("outliers", [0.0, 0.1, 0.35])
def test_one_sided_errors_do_not_move_the_plane(outliers: float) -> None:
    uv, true, measured = samples(outliers)
    found = best_plane(uv, measured, NOISE, np.random.default_rng(0))
    assert np.abs(found - true).max() < 0.3


def test_no_plane_near_it_is_likelier() -> None:
    uv, true, measured = samples(0.3)
    found = best_plane(uv, measured, NOISE, np.random.default_rng(0))
    least_squares = np.column_stack([uv, np.ones(len(uv))])
    fitted = least_squares @ np.linalg.lstsq(least_squares, measured, rcond=None)[0]
    best = NOISE.log_density(measured - found).sum()
    rng = np.random.default_rng(2)
    moved = [found + 0.05 * (s[0] + s[1] * (uv[:, 0] - 360) / 60) for s in rng.normal(size=(40, 2))]
    for other in (true, fitted, *moved):
        assert best >= NOISE.log_density(measured - other).sum() - 0.01
    assert best > NOISE.log_density(measured - fitted).sum() + 50


def test_drawn_measurements_have_the_share_of_errors() -> None:
    drawn = NOISE.drawn(np.full(20_000, 40.0), np.random.default_rng(0))
    good = np.abs(drawn - 40) < 3.5
    # of those of something else 7 / 208 lie that near by chance
    assert good.mean() == pytest.approx(0.9 + 0.1 * 7 / 208, abs=0.007)
    assert drawn[good].std() == pytest.approx(0.7, rel=0.08)
