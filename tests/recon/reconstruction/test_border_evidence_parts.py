import numpy as np

from recon.pixels import linear_from_srgb
from recon.reconstruction.border_evidence import EdgeWindow, EdgeWindowConfig

SQUARE = np.array([[40.0, 30.0], [100.0, 30.0], [100.0, 70.0], [40.0, 70.0]])
"""The object's outline: pixel centres of its border."""
WINDOW = np.array([[46.0, 34.0], [60.0, 34.0], [60.0, 50.0], [46.0, 50.0]])
"""A dark part in its left half."""


def picture() -> np.ndarray:
    out = np.full((100, 140, 3), 40, np.uint8)
    out[30:71, 40:101] = (200, 60, 60)
    out[34:51, 46:61] = 20
    return out


def mirrored(polygon: np.ndarray) -> np.ndarray:
    return np.array([140.0, 0.0]) + polygon * np.array([-1.0, 1.0])


def test_parts_where_the_picture_has_edges_agree_more_than_mirrored_ones() -> None:
    edges = EdgeWindow(picture(), SQUARE, EdgeWindowConfig())
    right, wrong = edges.agreement([[SQUARE, WINDOW], [SQUARE, mirrored(WINDOW)]])
    assert right > 0.6
    assert right > wrong + 0.1


def test_linear_light_and_bytes_agree() -> None:
    srgb = picture()
    light = linear_from_srgb(srgb)
    config = EdgeWindowConfig()
    a, b = (EdgeWindow(p, SQUARE, config).agreement([[SQUARE, WINDOW]])[0] for p in (srgb, light))
    assert abs(a - b) < 0.01


def test_a_larger_picture_is_compared_at_the_same_size() -> None:
    big = np.repeat(np.repeat(picture(), 4, axis=0), 4, axis=1)
    ring, part = (4 * p + 1.5 for p in (SQUARE, WINDOW))
    window = EdgeWindow(big, ring, EdgeWindowConfig(longer_side_px=64))
    assert max(window.edges.shape[:2]) == 64
    small = EdgeWindow(picture(), SQUARE, EdgeWindowConfig())
    a, b = window.agreement([[ring, part]])[0], small.agreement([[SQUARE, WINDOW]])[0]
    assert abs(a - b) < 0.12
