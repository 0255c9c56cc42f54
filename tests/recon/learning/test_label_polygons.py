"""Polygons: crossing against a slow second implementation, and each thing that can be wrong with one."""

import re
from fractions import Fraction

import numpy as np
import pytest

from recon.learning.label_polygons import area_px, first_crossing, open_ring, polygon_mask, polygon_problem

SQUARE = np.array([[2.0, 1.0], [6.0, 1.0], [6.0, 4.0], [2.0, 4.0]])


def crossing_slowly(ring: np.ndarray) -> bool:
    """Two edges meet strictly inside both, by solving for the meeting point in rational numbers."""
    points = [(Fraction(x), Fraction(y)) for x, y in ring.tolist()]
    edges = list(zip(points, points[1:] + points[:1], strict=True))
    for i, (a, b) in enumerate(edges):
        for c, d in edges[i + 1 :]:
            r, s = (b[0] - a[0], b[1] - a[1]), (d[0] - c[0], d[1] - c[1])
            q = (c[0] - a[0], c[1] - a[1])
            det = r[0] * s[1] - r[1] * s[0]
            if det == 0:
                continue
            t, u = (q[0] * s[1] - q[1] * s[0]) / det, (q[0] * r[1] - q[1] * r[0]) / det
            if 0 < t < 1 and 0 < u < 1:
                return True
    return False


def test_crossing_agrees_with_exact_arithmetic() -> None:
    rng = np.random.default_rng(0)
    # whole coordinates, so that edges often touch, overlap or share points
    rings = [rng.integers(0, 6, (n, 2)).astype(float) for n in (3, 4, 5, 6) for _ in range(100)]
    rings += [rng.uniform(0, 100, (n, 2)) for n in (4, 5) for _ in range(100)]
    found = [first_crossing(r) is not None for r in rings]
    assert found == [crossing_slowly(r) for r in rings]
    assert 100 < sum(found) < 500


def test_crossing_edges_are_named() -> None:
    bow_tie = np.array([[0, 0], [4, 4], [4, 0], [0, 4]], float)
    assert first_crossing(bow_tie) == (0, 2)
    assert first_crossing(SQUARE) is None


def test_a_long_polygon_is_compared_in_blocks() -> None:
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    circle = 50 + 40 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert first_crossing(circle) is None
    circle[[1500, 1501]] = circle[[1501, 1500]]
    # edges 1499 and 1501 now cross
    assert first_crossing(circle) == (1499, 1501)


def test_touching_is_allowed() -> None:
    # two squares that share the corner (2, 2), drawn in one go
    pinched = np.array([[0, 0], [2, 0], [2, 2], [4, 2], [4, 4], [2, 4], [2, 2], [0, 2]], float)
    assert first_crossing(pinched) is None
    # a corner on the middle of an edge
    touching = np.array([[0, 0], [6, 0], [6, 4], [3, 0], [0, 4]], float)
    assert first_crossing(touching) is None


def test_pixels_inside_and_area() -> None:
    # pixel edges: columns 2 to 5, rows 1 to 3
    mask = polygon_mask(SQUARE, 6, 8)
    inner = np.zeros((6, 8), bool)
    inner[1:4, 2:6] = True
    assert mask[inner].all()
    assert not mask[:, 7].any()
    assert not mask[5].any()
    assert area_px(SQUARE) == 12.0
    assert area_px(SQUARE[::-1] + 1000) == 12.0


def test_a_closed_ring_loses_its_last_point() -> None:
    closed = np.concatenate([SQUARE, SQUARE[:1]])
    np.testing.assert_array_equal(np.sort(open_ring(closed), axis=0), np.sort(SQUARE, axis=0))
    assert polygon_problem(closed, 6, 8) is None


@pytest.mark.parametrize(
    ("points", "problem"),
    [
        ([[1, 1], [3, 3]], "at least 3 different points, got 2"),
        ([[1, 1], [3, 3], [3, 3], [1, 1]], "at least 3 different points, got 2"),
        ([[1, 1], [3, float("nan")], [3, 1]], r"finite coordinates, got \[3.0, nan\]"),
        ([[1, 1], [3, 3], [9.5, 1]], r"inside 8 x 6 pixels, got \(9.5, 1\)"),
        ([[1, 1], [3, 3], [3, -1.5]], r"inside 8 x 6 pixels, got \(3, -1.5\)"),
        ([[0, 0], [4, 4], [4, 0], [0, 4]], r"cross after \(0, 0\) and \(4, 0\)"),
        ([[1, 1], [3, 3], [5, 5]], "area of at least one pixel, got 0"),
    ],
)
def test_problems(points: list[list[float]], problem: str) -> None:
    found = polygon_problem(np.array(points, float), 6, 8)
    assert found is not None
    assert re.search(problem, found), found


def test_a_point_a_little_outside_is_taken() -> None:
    assert polygon_problem(np.array([[-0.5, 0], [8.6, 0], [8, 6.5]]), 6, 8) is None
