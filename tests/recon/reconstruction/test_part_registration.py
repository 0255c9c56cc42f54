"""False matches on an outline."""

import numpy as np

from recon.reconstruction.part_registration import _without_jumps


def circle(count: int = 80) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return 30 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_matches_without_jumps_stay_as_they_are() -> None:
    outline = circle()
    targets = outline * [1.2, 0.9] + [3.0, -1.0]
    assert _without_jumps(outline, targets, 5.0) is targets


def test_a_jump_is_led_by_its_neighbours() -> None:
    outline = circle()
    targets = outline + np.array([3.0, -1.0])
    wrong = targets.copy()
    wrong[[0, 40, 41, 42]] += [[50.0, 0.0], [0.0, 30.0], [-20.0, 30.0], [9.0, 9.0]]
    # the displacement is the same all around, so interpolation over the gap is exact, also across the start
    np.testing.assert_allclose(_without_jumps(outline, wrong, 5.0), targets, atol=1e-12)
