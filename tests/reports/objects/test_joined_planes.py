"""Planes that are joined along borders, in scenes whose depth is known in closed form."""

from collections.abc import Sequence

import numpy as np
import pytest

from recon.camera import PinholeCamera
from recon.depth_map import DepthMap
from recon.reconstruction.instance import Instance3D, InstancePart, InstanceQuality
from recon.reconstruction.occluded_parts import ClassToInstance
from recon.reconstruction.reconstruct import Reconstruction
from reports.objects.joined_planes import joined_planes

CAMERA = PinholeCamera(100.0, 100.0, 49.5, 39.5, 100, 80)


def part(
    label: int, plane: Sequence[float], left_px: float, right_px: float, seen: bool = True
) -> InstancePart:
    """A part that shows rows 20 to 60 between two columns."""
    uv = np.array([[left_px, 20.0], [right_px, 20.0], [right_px, 60.0], [left_px, 60.0]])
    rays = CAMERA.rays(uv)
    normal = np.array(plane)
    size = np.linalg.norm(normal[:3])
    z = -normal[3] / (rays @ normal[:3])
    return InstancePart(label, f"p{label}", normal / size, rays * z[:, None], seen)


def scene(parts: Sequence[InstancePart]) -> tuple[Reconstruction, Instance3D]:
    """Part 1 in columns 20 to 49, part 2 in columns 50 to 79; the ground 2 m below the camera."""
    labels = np.zeros((40, 60), np.uint8)
    labels[:, :30], labels[:, 30:] = 1, 2
    turn = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, [0, 2.0, 10.0]
    moved = ClassToInstance(turn, np.ones(3), np.zeros(3), 0.0, {})
    ring = np.array([[20.0, 20], [79, 20], [79, 59], [20, 59]])
    found = Reconstruction(
        ring, ring, 20, 20, labels, {p.label: p.plane for p in parts}, {},
        DepthMap(20, 20, np.full((40, 60), 10, np.float32)), ring[:2], turn, 0.0, 1.0,
    )  # fmt: skip
    instance = Instance3D(
        "thing", 0, tuple(parts), pose, np.array([6.0, 6.0, 4.0]), {}, moved, InstanceQuality(0, 1, 0)
    )
    return found, instance


def depths(parts: Sequence[InstancePart], label: int, column: float) -> float:
    found, instance = scene(parts)
    ray = CAMERA.rays(np.array([[column, 40.0]]))
    return float(joined_planes(found, instance, CAMERA).depth_along(label, ray)[0])


def test_planes_that_meet_stay_as_they_are() -> None:
    # z = 10, and z = 10 + x for x > 0: both 10 m at column 49.5
    parts = [part(1, (0, 0, 1, -10), 20, 49.5), part(2, (-1, 0, 1, -10), 49.5, 79)]
    assert depths(parts, 1, 25) == pytest.approx(10, abs=0.02)
    # z (1 - 0.2) = 10 on the ray of slope 0.2
    assert depths(parts, 2, 69.5) == pytest.approx(12.5, abs=0.05)


def test_a_small_gap_is_closed_from_both_sides() -> None:
    # 0.2 m apart; a diagonal of 9.4 m lets parts 0.75 m apart adjoin
    parts = [part(1, (0, 0, 1, -10), 20, 49.5), part(2, (0, 0, 1, -10.2), 49.5, 79)]
    a, b = depths(parts, 1, 49.5), depths(parts, 2, 49.5)
    assert abs(a - b) < 0.05
    assert 10 < a < 10.2
    assert 10 < b < 10.2
    # away from the border each is near its own plane
    assert depths(parts, 1, 20) < 10.08
    assert depths(parts, 2, 79) > 10.12


def test_a_predicted_part_gives_way_to_a_seen_one() -> None:
    seen = [part(1, (0, 0, 1, -10), 20, 49.5), part(2, (0, 0, 1, -10.2), 49.5, 79, seen=False)]
    both = [part(1, (0, 0, 1, -10), 20, 49.5), part(2, (0, 0, 1, -10.2), 49.5, 79)]
    assert depths(seen, 1, 49.5) < depths(both, 1, 49.5) - 0.01


def test_parts_that_hide_each_other_are_not_joined() -> None:
    parts = [part(1, (0, 0, 1, -10), 20, 49.5), part(2, (0, 0, 1, -12), 49.5, 79)]
    found, instance = scene(parts)
    assert not joined_planes(found, instance, CAMERA).adjoining
    assert depths(parts, 1, 49.5) == pytest.approx(10, abs=1e-6)
    assert depths(parts, 2, 49.5) == pytest.approx(12, abs=1e-6)


def test_nothing_is_below_the_ground() -> None:
    parts = [part(1, (0, 0, 1, -10), 20, 49.5), part(2, (0, 0, 1, -10), 49.5, 79)]
    found, instance = scene(parts)
    planes = joined_planes(found, instance, CAMERA)
    # the ray falls 0.5 a metre: it meets the ground, 2 m below the camera, at 4 m
    ray = np.array([[0.0, 0.5, 1.0]])
    assert planes.depth_along(1, ray)[0] == pytest.approx(4, rel=0.01)
    assert planes.depth_along(1, ray)[0] < 4
