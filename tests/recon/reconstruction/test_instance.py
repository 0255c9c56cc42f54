"""The 3D instance: geometry in closed form, depth against ray casting."""

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest

from recon.arrays import FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.class_model import ClassModel, ClassPart
from recon.depth_map import DepthMap
from recon.reconstruction.instance import (
    Instance3D,
    InstancePart,
    InstanceQuality,
    _absent,
    _astray,
)
from recon.reconstruction.occluded_parts import ClassToInstance
from recon.reconstruction.reconstruct import Reconstruction
from recon.view_bins import ViewBins

CAMERA = PinholeCamera(300.0, 300.0, 99.5, 74.5, 200, 150)


def part(label: int, corners: list[tuple[float, float, float]], seen: bool = True) -> InstancePart:
    outline = np.array(corners, float)
    normal = np.cross(outline[1] - outline[0], outline[2] - outline[0])
    normal /= np.linalg.norm(normal)
    return InstancePart(label, f"part_{label}", np.append(normal, -normal @ outline[0]), outline, seen)


def instance(parts: tuple[InstancePart, ...]) -> Instance3D:
    # seen from its left side: the nose to the left of the picture, 10 m ahead, 1.5 m below the eye
    pose = np.eye(4)
    pose[:3, :3] = np.array([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]])
    pose[:3, 3] = [1.0, 1.5, 10.0]
    return Instance3D(
        class_name="car",
        view_bin=3,
        parts=parts,
        cam_from_object=pose,
        size_m=np.array([4.0, 2.0, 1.0]),
        unplaced={},
        class_to_instance=ClassToInstance(pose[:3, :3], np.ones(3), np.zeros(3), 0.0, {}),
        quality=InstanceQuality(0.1, 1.0, 0.0),
    )


def scattered(rng: np.random.Generator) -> tuple[InstancePart, ...]:
    """Six flat quadrangles that cross and hide one another, one of them partly behind the camera."""
    parts = []
    for label in range(1, 6):
        centre = np.array([*rng.uniform(-1, 1, 2), rng.uniform(4, 8)])
        a, b = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
        parts.append(part(label, [tuple(centre + 1.2 * (s * a + t * b)) for s, t in SQUARE]))
    parts.append(part(6, [(-3.0, 1.4, -2.0), (3.0, 1.4, -2.0), (3.0, 1.4, 30.0), (-3.0, 1.4, 30.0)]))
    return tuple(parts)


SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def cast(parts: tuple[InstancePart, ...], camera: PinholeCamera, transform: FloatArray) -> FloatArray:
    """Depth by ray casting; infinite where there is nothing."""
    scene = o3d.t.geometry.RaycastingScene()
    for p in parts:
        points = p.outline_m @ transform[:3, :3].T + transform[:3, 3]
        faces = np.array([[0, k, k + 1] for k in range(1, len(points) - 1)], np.uint32)
        scene.add_triangles(o3d.core.Tensor(points.astype(np.float32)), o3d.core.Tensor(faces))
    v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
    rays = camera.rays(np.stack([u, v], axis=-1))
    both = np.concatenate([np.zeros_like(rays), rays], axis=-1).astype(np.float32)
    return scene.cast_rays(o3d.core.Tensor(both))["t_hit"].numpy()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_depth_equals_ray_casting_from_two_cameras(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = scattered(rng)
    moved = np.eye(4)
    moved[:3, :3] = np.linalg.qr(np.eye(3) + 0.15 * rng.normal(size=(3, 3)))[0]
    moved[:3, :3] *= np.sign(np.diag(moved[:3, :3]))
    moved[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    for transform in (np.eye(4), moved):
        found = instance(parts).depth(CAMERA, transform)
        assert (found.x0_px, found.y0_px, found.depth.shape) == (0, 0, (150, 200))
        true = cast(parts, CAMERA, transform)
        hit = np.isfinite(true) & (true > 0.05)
        # filled polygons include pixels on their borders, rays do not
        assert (np.isfinite(found.depth) != hit).mean() < 0.02
        both = np.isfinite(found.depth) & hit
        assert both.sum() > 2000
        close = np.abs(found.depth[both] / true[both] - 1) < 1e-3
        assert close.mean() > 0.98


def test_nothing_in_view_is_all_nan() -> None:
    behind = part(1, [(0, 0, -5), (1, 0, -5), (1, 1, -5)])
    aside = part(2, [(50, 0, 5), (51, 0, 5), (51, 1, 5)])
    assert not np.isfinite(instance((behind, aside)).depth(CAMERA, np.eye(4)).depth).any()


def test_box_and_orientation_in_closed_form() -> None:
    found = instance((part(1, [(0, 0, 5), (1, 0, 5), (1, 1, 5)]),))
    # length along the picture's -x, width along depth, height up: 1 +- 2, 1.5 - 1 to 1.5, 10 +- 1
    np.testing.assert_allclose(found.corners_m.min(axis=0), [-1, 0.5, 9])
    np.testing.assert_allclose(found.corners_m.max(axis=0), [3, 1.5, 11])
    # corner 5 is front, right, high: the nose is at -x, the right side away from the camera
    np.testing.assert_allclose(found.corners_m[5], [-1, 0.5, 11])
    np.testing.assert_allclose(found.centroid_m, [1, 1, 10])
    assert found.distance_m == pytest.approx(np.sqrt(1 + 1 + 100))
    assert abs(found.yaw_rad) == pytest.approx(np.pi)
    # the camera is at y = 10 m and, since x goes to the left, at x = 1 m of the object
    assert found.azimuth_rad == pytest.approx(np.arctan2(10, 1))


def test_depth_along_stays_within_the_outline() -> None:
    floor = part(1, [(-1, 1, 4), (1, 1, 4), (1, 1, 6), (-1, 1, 6)])
    rays = np.array([[0, 0.2, 1.0], [0, 0.5, 1.0], [0, 0.1, 1.0], [0, -0.1, 1.0]])
    # y = 1 is at depth 1 / 0.2 = 5; 2 and 10 lie outside of 4 to 6; the last ray rises away from the floor
    np.testing.assert_allclose(floor.depth_along(rays), [5, 4, 6, 6])


def reconstruction(labels: UInt8Array, x0_px: int, y0_px: int) -> Reconstruction:
    """A reconstruction of which only the labels matter."""
    return Reconstruction(
        outline_px=np.zeros((3, 2)),
        initial_outline_px=np.zeros((3, 2)),
        x0_px=x0_px,
        y0_px=y0_px,
        part_labels=labels,
        part_planes={},
        unplaced_parts={},
        depth=DepthMap(x0_px, y0_px, np.full(labels.shape, np.nan, np.float32)),
        ground_line_px=np.zeros((2, 2)),
        cam_from_object=np.eye(3),
        registration_cost=0.0,
        placed_share=1.0,
    )


def upright(label: int, x_m: float, z_m: float, seen: bool = False) -> InstancePart:
    return part(label, [(x_m + s / 2, t / 2, z_m) for s, t in SQUARE], seen)


def test_a_part_that_the_picture_would_show_is_left_out() -> None:
    # 1 m at 5 m and 300 px are 60 pixels about the middle (99.5, 74.5)
    found = reconstruction(np.ones((60, 60), np.uint8), 70, 45)
    seen = [upright(1, 0.0, 5.0, seen=True)]
    predicted = [upright(2, 0.0, 6.0), upright(3, 0.0, 4.0), upright(4, 1.2, 6.0), upright(5, 0.0, -4.0)]
    absent = _absent(found, seen, predicted, CAMERA)
    # behind what is seen: kept; before it and beside it: left out; behind the camera: no evidence
    assert set(absent) == {3, 4}
    assert absent[4] == "left out: 100% of it would be in sight, the picture has none"
    # pixels where something else hides the object say nothing
    occluded = np.zeros((CAMERA.height_px, CAMERA.width_px), bool)
    occluded[:, 130:] = True
    assert set(_absent(found, seen, predicted, CAMERA, occluded)) == {3}
    # what the picture has is not judged
    assert not _absent(found, seen, [replace(upright(3, 0.0, 4.0), label=1)], CAMERA)


def test_parts_that_contradict_the_class_model_are_not_used() -> None:
    def class_part(label: int, z: float) -> ClassPart:
        outline = np.array([[-1, -1, z], [1, -1, z], [1, 1, z]], float)
        return ClassPart(label, np.array([0.0, 0.0, z]), np.array([0.0, 0, 1, -z]), outline, 0, 2)

    model = ClassModel(
        "box", ("a", "b", "c", "d"), ViewBins(), tuple(class_part(k, 5.0) for k in range(1, 5)), ()
    )
    same = ClassToInstance(np.eye(3), np.ones(3), np.zeros(3), 0.0, {})
    # a box of 2 x 2 x 2 m from z = 4 on, diagonal 3.46 m: 0.45 m off the plane, 0.69 m out of the box
    pose = np.eye(4)
    pose[:3, 3] = [0, 0, 4]
    placed = [
        upright(1, 0.0, 5.3, seen=True),
        upright(2, 0.0, 5.6, seen=True),
        upright(3, 1.4, 5.0, seen=True),
        part(4, [(-1.0, 0.9, 4.5), (1.0, 0.9, 4.5), (1.0, 0.95, 5.5), (-1.0, 0.95, 5.5)]),
    ]
    reasons = _astray(placed, same, model, pose, np.full(3, 2.0))
    assert set(reasons) == {2, 3, 4}
    assert reasons[2] == "its plane lies 0.60 m off the class model, more than 0.45 m"
    assert reasons[3] == "its outline leaves the box by 0.90 m, more than 0.69 m"
    assert "too flat for its outline" in reasons[4]


def test_wrong_values_are_refused() -> None:
    good = part(1, [(0, 0, 5), (1, 0, 5), (1, 1, 5)])
    with pytest.raises(ValueError, match="length 1"):
        replace(good, plane=np.array([0.0, 0.0, 2.0, -10.0]))
    with pytest.raises(ValueError, match="sorted and differ"):
        instance((good, good))
    with pytest.raises(ValueError, match="positive sizes"):
        replace(instance((good,)), size_m=np.zeros(3))
    with pytest.raises(ValueError, match="rigid pose"):
        replace(instance((good,)), cam_from_object=2 * np.eye(4))
    with pytest.raises(ValueError, match="scales must be positive"):
        ClassToInstance(np.eye(3), np.array([1.0, -1.0, 1.0]), np.zeros(3), 0.0, {})
