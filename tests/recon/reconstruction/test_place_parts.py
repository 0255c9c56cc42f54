"""Plane propagation: closed forms on objects of two and three planes."""

import numpy as np
import pytest

from recon.camera import PinholeCamera
from recon.reconstruction.part_labels import PartLabels
from recon.reconstruction.place_parts import PlacedParts, PlacingConfig, place_parts
from tests.recon.reconstruction.place_parts_arrays import placed_in_arrays

CAMERA = PinholeCamera(100.0, 100.0, 20.0, 20.0, 41, 41)
CONFIG = PlacingConfig()
FRONT = np.array([0.0, 0.0, -1.0])
# leans back by 45 degrees: depth grows upward
LEANING = np.array([0.0, -1.0, -1.0]) / np.sqrt(2)
LIMITS = (1.0, 100.0)


def rays() -> np.ndarray:
    v, u = np.mgrid[0:41, 0:41].astype(float)
    return CAMERA.rays(np.stack([u, v], axis=-1))


def two_planes() -> np.ndarray:
    labels = np.zeros((41, 41), np.uint8)
    labels[25:35, 5:36] = 1
    labels[15:25, 5:36] = 2
    return labels


def place(
    labels: np.ndarray,
    normals: dict[int, np.ndarray],
    ground_points_m: dict[int, np.ndarray],
    limits_m: tuple[float, float],
) -> PlacedParts:
    """The parts of a window at the corner of the picture."""
    return place_parts(PartLabels(0, 0, labels), CAMERA, normals, ground_points_m, limits_m, CONFIG)


def test_two_planes_in_closed_form() -> None:
    foot = np.array([0.3, 1.5, 10.0])
    placed = place(two_planes(), {1: FRONT, 2: LEANING}, {1: foot}, LIMITS)
    assert list(placed.planes) == [1, 2]
    # plane 1 is z = 10
    np.testing.assert_allclose(placed.planes[1], [0, 0, -1, 10])
    np.testing.assert_allclose(placed.depth[25:35, 5:36], 10.0)
    # plane 2 meets it along row 25: y = 10 * (25 - 20) / 100 = 0.5; y + z = 10.5, so z = 10.5 / (1 + y / z)
    row = np.arange(15, 25)
    expected = 10.5 / (1 + (row - 20) / 100)
    np.testing.assert_allclose(placed.depth[15:25, 5:36], np.repeat(expected[:, None], 31, axis=1), rtol=1e-6)
    assert np.isnan(placed.depth[0, 0])
    assert placed.placed_share == 1.0


def test_every_point_lies_on_its_plane() -> None:
    placed = place(
        two_planes(),
        {1: FRONT, 2: LEANING},
        {1: np.array([0.0, 1.5, 10.0])},
        LIMITS,
    )
    points = placed.depth[..., None] * rays()
    for label, plane in placed.planes.items():
        np.testing.assert_allclose(points[two_planes() == label] @ plane[:3] + plane[3], 0.0, atol=1e-5)


def test_a_long_border_outweighs_a_short_one() -> None:
    labels = np.zeros((41, 41), np.uint8)
    labels[30:40, 0:30] = 1
    labels[30:40, 31:41] = 2
    labels[20:30, 0:41] = 3
    known = {1: np.array([0.0, 1.5, 10.0]), 2: np.array([0.0, 1.5, 12.0])}
    placed = place(labels, {1: FRONT, 2: FRONT, 3: FRONT}, known, LIMITS)
    assert placed.planes[3][3] == pytest.approx(10.0)


def test_chain_of_parts_in_rings() -> None:
    labels = np.zeros((41, 41), np.uint8)
    for k in range(4):
        labels[30 - 5 * k : 35 - 5 * k, 10:30] = 4 - k
    placed = place(
        labels,
        dict.fromkeys(range(1, 5), FRONT),
        {4: np.array([0, 1.5, 9.0])},
        LIMITS,
    )
    assert list(placed.planes) == [4, 3, 2, 1]
    np.testing.assert_allclose(placed.depth[labels > 0], 9.0)


def test_edge_on_plane_is_not_placed() -> None:
    normals = {1: FRONT, 2: np.array([0.0, -1.0, -0.05]) / np.hypot(1, 0.05)}
    placed = place(two_planes(), normals, {1: np.array([0, 1.5, 10.0])}, LIMITS)
    assert "edge-on" in placed.unplaced[2]
    assert np.isnan(placed.depth[15:25]).all()
    assert placed.placed_share == 0.5


def test_depth_beyond_the_limits_is_dropped() -> None:
    # plane 2 runs from 10.0 to 11.05 m: with a limit of 10.4 m less than half of it is left
    normals, foot = {1: FRONT, 2: LEANING}, {1: np.array([0, 1.5, 10.0])}
    placed = place(two_planes(), normals, foot, (9.0, 10.4))
    assert "beyond the object" in placed.unplaced[2]
    # with 10.8 m more than half is, and the rest is dropped
    placed = place(two_planes(), normals, foot, (9.0, 10.8))
    assert 2 in placed.planes
    assert np.isnan(placed.depth[15]).sum() == 41
    assert np.nanmax(placed.depth) <= 10.8


def test_parts_apart_and_parts_without_a_plane() -> None:
    labels = two_planes()
    labels[0:5, 0:5] = 3
    placed = place(labels, {1: FRONT, 3: FRONT}, {1: np.array([0, 1.5, 10.0])}, LIMITS)
    assert placed.unplaced == {2: "the class model has no plane for it", 3: "touches no placed part"}


@pytest.mark.parametrize("seed", range(12))
def test_machine_code_places_as_whole_arrays_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seeds_px, part = rng.uniform(0, 41, (14, 2)), rng.integers(0, 9, 14)
    v, u = np.mgrid[0:41, 0:41]
    nearest = np.argmin((u[..., None] - seeds_px[:, 0]) ** 2 + (v[..., None] - seeds_px[:, 1]) ** 2, axis=2)
    labels = part[nearest].astype(np.uint8)
    normals = {k: rng.normal([0, 0, -1], 1) for k in range(1, 8)}  # part 8 has none
    normals = {k: n / np.linalg.norm(n) for k, n in normals.items()}
    known = {int(k): rng.normal([0, 1, 10], 0.3, (int(k), 3)) for k in rng.choice(np.arange(1, 9), 3, False)}
    limits = (6.0, 16.0)
    found = place(labels, normals, known, limits)
    planes, depth = placed_in_arrays(labels, CAMERA, normals, known, limits, CONFIG.min_angle_rad)
    assert set(found.planes) == set(planes)
    for k, plane in planes.items():
        np.testing.assert_allclose(found.planes[k], plane, atol=1e-9)
    np.testing.assert_allclose(found.depth, depth, rtol=1e-6)
    assert set(found.unplaced) == {*np.unique(labels).tolist()} - {0, *planes}
