"""A closed shape carries the photograph where it shows it, its mirror image, or a plain colour."""

import numpy as np
import pytest
import trimesh

from recon.arrays import UInt8Array
from recon.camera import PinholeCamera
from recon.localization.shape_fit import FittedShape
from reports.objects.mesh_files import MeshView
from reports.objects.part_colours import part_colours
from reports.objects.picture_mesh import PictureMesh
from reports.objects.solid_mesh import solid_mesh
from tests.recon.localization.stepped_car import HOOD_M, SIZE_M, space

CAMERA = PinholeCamera(300.0, 300.0, 159.5, 119.5, 320, 240)
RED, BLUE = (200, 30, 30), (30, 30, 200)


def looking_from(azimuth_rad: float, distance_m: float = 8.0) -> np.ndarray:
    """cam_from_object (4, 4) of a level camera at half the height of the object."""
    c, s = np.cos(azimuth_rad), np.sin(azimuth_rad)
    out = np.eye(4)
    out[:3, :3] = [[-s, c, 0], [0, 0, -1], [-c, -s, 0]]
    out[:3, 3] = [0, SIZE_M[2] / 2, distance_m]
    return out


@pytest.fixture(scope="module")
def car() -> tuple[PictureMesh, UInt8Array, np.ndarray]:
    """A car whose photograph, of its left side, is red at the nose, blue at the tail."""
    pose = looking_from(np.pi / 2)
    shape = FittedShape(space(), np.zeros(0), SIZE_M, pose)
    inside = shape.silhouette(CAMERA, np.array([0.0, 0.0, 320.0, 240.0]))
    rgb = np.full((240, 320, 3), BLUE, np.uint8)
    rgb[:, :160] = RED
    mesh, picture = solid_mesh(rgb, inside.astype(np.float32), shape, CAMERA, {})
    return mesh, picture, pose


def test_the_surface_is_closed_and_as_large_as_the_shape(
    car: tuple[PictureMesh, UInt8Array, np.ndarray],
) -> None:
    mesh, _, pose = car
    solid = trimesh.Trimesh(mesh.xyz_m, mesh.faces)
    solid.merge_vertices()
    assert solid.is_watertight
    own = mesh.xyz_m @ np.linalg.inv(pose)[:3, :3].T + np.linalg.inv(pose)[:3, 3]
    np.testing.assert_allclose(np.ptp(own, axis=0), SIZE_M, rtol=0.05)
    # body and cab, 2.8 m of 4.4 m long
    assert solid.volume == pytest.approx(1.8 * (4.4 * HOOD_M + 2.8 * (1.5 - HOOD_M)), rel=0.06)


@pytest.mark.parametrize(("side", "nose_left"), [(1, True), (-1, False)])
def test_the_other_side_is_the_mirror_image(
    car: tuple[PictureMesh, UInt8Array, np.ndarray], side: int, nose_left: bool
) -> None:
    mesh, picture, pose = car
    turn = looking_from(side * np.pi / 2) @ np.linalg.inv(pose)
    seen, hit = MeshView([(mesh, picture)]).picture(CAMERA, turn)
    assert hit[125, 82:237].all()
    nose, tail = (
        seen[125, slice(*at)].mean(axis=0) for at in ((90, 130), (190, 230))[:: 1 if nose_left else -1]
    )
    np.testing.assert_allclose(nose, RED, atol=10)
    np.testing.assert_allclose(tail, BLUE, atol=10)


def test_the_front_that_is_not_seen_is_plain(car: tuple[PictureMesh, UInt8Array, np.ndarray]) -> None:
    mesh, picture, pose = car
    seen, hit = MeshView([(mesh, picture)]).picture(CAMERA, looking_from(0.0) @ np.linalg.inv(pose))
    front = seen[120:140, 140:180][hit[120:140, 140:180]]
    assert len(front) > 500
    assert np.ptp(front.astype(int), axis=0).max() < 15


def test_plain_colours_are_medians_of_parts_and_of_their_stuff() -> None:
    colours = np.array([RED] * 60 + [BLUE] * 40, np.uint8)
    label = np.array([1] * 60 + [2] * 40)
    names = {1: "left_body", 2: "left_windows", 3: "right_body", 4: "rear_window", 5: "trunk"}
    found = part_colours(colours, label, names)
    assert found == {0: RED, 1: RED, 2: BLUE, 3: RED, 4: BLUE, 5: RED}
    assert part_colours(colours[:0], label[:0], {1: "roof"}) == {0: (128, 128, 128), 1: (128, 128, 128)}
