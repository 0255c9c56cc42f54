"""Cutting, recessing and smoothing of triangle soups."""

from collections import Counter

import numpy as np
import pytest

from datasets_synth.cars.body_cuts import above_curve_level, box_level, line_level, smooth_max
from datasets_synth.meshes.mesh_build import Soup, cut, grid_corners, recess, smooth_normals, soup_of


def plate(n: int = 12) -> np.ndarray:
    """Corners of the unit square at z = 0, seen from above."""
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    return grid_corners(np.stack([x, y, 0 * x], axis=-1))


def area(corners: np.ndarray) -> np.ndarray:
    return 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )


def test_cutting_keeps_the_area_and_splits_exactly_on_a_straight_line() -> None:
    soup = soup_of(plate())
    level = soup.corners_m[..., 0] + 0.3 * soup.corners_m[..., 1] - 0.52
    parts = cut(soup, level)
    values = parts.corners_m[..., 0] + 0.3 * parts.corners_m[..., 1] - 0.52
    # Snapped corners may lie 2.2 mm off the line.
    assert np.all((values.min(1) > -0.0023) | (values.max(1) < 0.0023))
    assert area(parts.corners_m).sum() == pytest.approx(1.0)
    # Share with x < 0.52 - 0.3 y: 0.52 - 0.3 / 2 = 0.37.
    assert area(parts.corners_m)[values.mean(1) < 0].sum() == pytest.approx(0.37, abs=2e-3)


def open_edges(soup: Soup) -> np.ndarray:
    """Edges that belong to one face only, shape (e, 2, 3)."""
    ends = np.roll(soup.corners_m, -1, axis=1)
    edges = np.stack([soup.corners_m, ends], axis=2).reshape(-1, 2, 3)
    both = [tuple(sorted(map(tuple, edge))) for edge in np.round(edges, 6).tolist()]
    count = Counter(both)
    return edges[[count[edge] == 1 for edge in both]]


def test_cutting_opens_no_edge() -> None:
    soup = soup_of(plate())
    ring = np.hypot(soup.corners_m[..., 0] - 0.5, soup.corners_m[..., 1] - 0.45) - 0.3
    edges = open_edges(cut(soup, ring))
    on_border = np.isclose(edges, 0).any(-1) | np.isclose(edges, 1).any(-1)
    assert on_border.all()


def test_a_recess_is_closed_and_deep() -> None:
    soup = soup_of(plate())
    ring = np.hypot(soup.corners_m[..., 0] - 0.5, soup.corners_m[..., 1] - 0.5) - 0.3
    parts = cut(soup, ring)
    inside = (np.hypot(parts.corners_m[..., 0] - 0.5, parts.corners_m[..., 1] - 0.5) - 0.3).mean(1) < 0
    hub = np.array([0.5, 0.5, 0.0])
    hole = recess(parts, inside, axis=2, floor=-0.2, hub_m=hub, material=3, part=4)
    edges = open_edges(hole)
    assert (np.isclose(edges[..., :2], 0) | np.isclose(edges[..., :2], 1)).any(-1).all()
    floor = hole.corners_m[(hole.corners_m[..., 2] < -0.199).all(1)]
    normal = np.cross(floor[:, 1] - floor[:, 0], floor[:, 2] - floor[:, 0])
    assert (normal[:, 2] > 0).all()
    # A disc of radius 0.3, as a polygon with about 30 corners: pi 0.09 = 0.283, less 1 %.
    assert area(floor).sum() == pytest.approx(0.283, rel=0.02)


def test_normals_are_smooth_below_the_crease_angle_and_sharp_above() -> None:
    # A roof of two faces: the planes meet at 90 degrees.
    ridge = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 1]], [[1, 0, 0], [1, 1, 1], [0, 1, 1]]], dtype=float)
    bent = np.concatenate([ridge, (ridge * [1, -1, 1])[:, ::-1] + [0, 2, 0]])
    sharp = smooth_normals(bent, np.deg2rad(60))
    assert np.allclose(sharp[0], [0, -(0.5**0.5), 0.5**0.5])
    smooth = smooth_normals(bent, np.deg2rad(100))
    top = np.isclose(bent[..., 2], 1)
    assert (smooth[top][:, 2] > 0.75).all()
    assert np.allclose(np.linalg.norm(smooth, axis=-1), 1)


def test_level_lines_are_distances() -> None:
    assert box_level(np.array(2.0), np.array(0.5), (0, 0, 1, 1)) == pytest.approx(1.0)
    assert box_level(np.array(0.5), np.array(0.4), (0, 0, 1, 1)) == pytest.approx(-0.4)
    assert line_level(np.array(1.0), np.array(0.0), (0, 0), (0, 2)) == pytest.approx(1.0)
    # Above the line v = u by 1: 1 / sqrt 2.
    curve = np.array([-5.0, 5.0])
    assert above_curve_level(np.array([0.0]), np.array([1.0]), curve, curve)[0] == pytest.approx(0.5**0.5)
    assert above_curve_level(np.array([0.0]), np.array([-1.0]), curve, curve)[0] == pytest.approx(-(0.5**0.5))
    # Equal values: the blend adds radius^2 / (4 radius) = 0.01.
    assert smooth_max(np.array(0.2), np.array(0.2), radius=0.04) == pytest.approx(0.21)
