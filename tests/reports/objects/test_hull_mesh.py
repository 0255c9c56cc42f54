"""The surface of shapes with thin limbs: closed, outward, open where the photograph shows holes."""

from functools import lru_cache

import numpy as np
import trimesh

from recon.arrays import Float32Array, FloatArray
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.localization.shape_fit import FittedShape, fit_shape
from recon.localization.standing_box import cam_from_ground, turn
from recon.outlines import largest_outline
from recon.reconstruction.instance import Instance3D, InstanceQuality
from recon.reconstruction.occluded_parts import ClassToInstance
from recon.shape_space import ShapeSpace
from reports.objects.hull_mesh import hull_meshes, surface

SIZE_M = np.array([0.5, 0.5, 0.9])
SEEN_FROM = GroundedCamera(PinholeCamera(500.0, 500.0, 159.5, 119.5, 320, 240), GroundPlane(1.2, 0.3))
LEG_M = 0.03


def box_distance(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(low - points, points - high).max(axis=-1))


@lru_cache
def stools() -> ShapeSpace:
    """Two stools with a back, the legs of one at its corners, those of the other half as far out."""
    reach, cells = (0.54, 0.54, 1.06), (60, 31, 100)
    axes = [np.linspace(-reach[0], reach[0], cells[0]), np.linspace(0, reach[1], cells[1])]
    axes.append(np.linspace(0, reach[2], cells[2]))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) * SIZE_M
    seat = box_distance(points, np.array([-0.25, -0.25, 0.4]), np.array([0.25, 0.25, 0.45]))
    back = box_distance(points, np.array([-0.25, -0.25, 0.4]), np.array([-0.2, 0.25, 0.9]))
    board = np.minimum(seat, back)

    def with_legs(out_m: float) -> Float32Array:
        value = board
        for x in (-out_m, out_m):
            middle = np.array([x, out_m, 0.2])
            half = np.array([LEG_M, LEG_M, 0.2])
            value = np.minimum(value, box_distance(points, middle - half, middle + half))
        return value.astype(np.float32)

    wide, narrow = with_legs(0.22), with_legs(0.11)
    mean = ((wide + narrow) / 2).astype(np.float32)
    mode = ((wide - narrow) / 2).astype(np.float32)
    outline = np.array([[-0.5, -0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, 0.5], [-0.5, 0.5, 0.5]])
    return ShapeSpace(
        reach,
        mean,
        mode[..., None],
        np.log(SIZE_M),
        np.zeros((3, 1)),
        np.full(3, 0.05),
        (1,),
        outline[None],
        np.zeros((1, 4, 3, 1)),
        np.array([[1.0], [-1.0]]),
    )


def stool(coefficient: float, yaw_deg: float = 30.0, x_m: float = 0.0) -> FittedShape:
    own = np.eye(4)
    own[:2, :2], own[:2, 3] = turn(np.deg2rad(yaw_deg)), [x_m, 2.6]
    pose = cam_from_ground(SEEN_FROM.ground) @ own
    return FittedShape(stools(), np.array([coefficient]), SIZE_M, pose)


def rough() -> Instance3D:
    """A stool 10 cm beside where it is, turned by 6 degrees."""
    return Instance3D(
        "stool",
        2,
        (),
        stool(0.0, 36.0, 0.1).cam_from_object,
        SIZE_M,
        {},
        ClassToInstance(np.eye(3), np.ones(3), np.zeros(3), 0.0, {}),
        InstanceQuality(0.1, 1.0, 0.0),
    )


def test_the_surface_of_a_ball_is_closed_and_faces_out() -> None:
    axis = np.arange(-12, 13) * 0.1
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    points, faces = surface(np.sqrt(x * x + y * y + z * z) - 1.0, np.full(3, -1.2), np.full(3, 0.1))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=0.02)
    ball = trimesh.Trimesh(points, faces, process=False)
    assert ball.is_watertight
    # 4 pi / 3; the volume is negative where normals point inwards
    assert abs(ball.volume - 4.19) < 0.1


def test_what_is_seen_through_a_stool_is_open() -> None:
    shape, camera = stool(1.0), SEEN_FROM.camera
    mask = shape.silhouette(camera, np.array([0.0, 0.0, 320.0, 240.0]))
    rgb = np.full((240, 320, 3), 120, np.uint8)
    closed = sum(len(m.faces) for m in hull_meshes(rgb, mask.astype(np.float32), shape, camera, {1: "seat"}))
    # a hole in the middle of the back
    turned = shape.cam_from_object
    u, v = camera.project(turned[:3, :3] @ [-0.225, 0.0, 0.7] + turned[:3, 3]).round().astype(int)
    mask[v - 6 : v + 7, u - 6 : u + 7] = False
    meshes = hull_meshes(rgb, mask.astype(np.float32), shape, camera, {1: "seat"})
    assert sum(len(m.faces) for m in meshes) != closed
    points = np.concatenate([m.xyz_m for m in meshes])
    off = np.abs(camera.project(points) - [u, v]).max(axis=1)
    assert off.min() > 2


def test_a_limb_that_the_shape_has_not_stands_beside_it_and_a_shadow_does_not() -> None:
    shape, camera = stool(1.0), SEEN_FROM.camera
    mask = shape.silhouette(camera, np.array([0.0, 0.0, 320.0, 240.0]))
    rows, columns = np.nonzero(mask)
    left, foot = columns.min(), rows.max()
    beside = mask.copy()
    # at the height of the back, and below the feet
    top = rows.min() + 4
    beside[top : top + 6, left - 8 : left] = True
    beside[foot + 4 : foot + 10, left : left + 10] = True
    rgb = np.full((240, 320, 3), 120, np.uint8)
    meshes = hull_meshes(rgb, beside.astype(np.float32), shape, camera, {1: "seat"})
    at = np.concatenate([camera.project(m.xyz_m) for m in meshes])
    assert (at[:, 0].min()) < left - 6
    assert at[:, 1].max() < foot + 4
    sheet = next(m for m in meshes if camera.project(m.xyz_m)[:, 0].min() < left - 6)
    away = np.linalg.norm(sheet.xyz_m - shape.cam_from_object[:3, 3], axis=1)
    assert away.max() < np.linalg.norm(SIZE_M)


def test_the_instance_whose_legs_are_seen_is_found() -> None:
    for coefficient in (1.0, -1.0):
        true = stool(coefficient)
        mask = true.silhouette(SEEN_FROM.camera, np.array([0.0, 0.0, 320.0, 240.0]))
        ring = largest_outline(mask)
        assert ring is not None
        box = np.concatenate([ring.min(axis=0), ring.max(axis=0) + 1])
        found = fit_shape(ring, box, rough(), stools(), SEEN_FROM)
        assert isinstance(found, FittedShape)
        off = found.cam_from_object[:3, 3] - true.cam_from_object[:3, 3]
        assert np.linalg.norm(off) < 0.05
        assert np.sign(found.coefficients[0]) == coefficient
