"""From a picture and a box to files that open in a viewer: meshes, axes, textures, views."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from recon.arrays import UInt8Array
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.class_model import ClassModel
from recon.outlines import fill_polygon
from recon.pixels import sample_bilinear
from reports.objects.instance_overlay import instance_overlay
from reports.objects.likeness import source_similarity, structural_similarity
from reports.objects.mesh_files import (
    MeshView,
    gltf_from_camera,
    gltf_from_object,
    turned_about,
    vertex_colours,
    write_glb,
    write_ply,
)
from reports.objects.object_mesh import object_layers
from reports.objects.picture_mesh import PictureMesh
from reports.objects.popup import (
    backdrop_distance_m,
    backdrop_mesh,
    ground_mesh,
    in_scene_axes,
    scene_layers,
    turntable,
    without_objects,
    write_turntable,
)
from rescore.library.single_picture import FoundObject, Photo, find_object
from tests.single_car import CarPicture, car_from, quick_car_model

CAMERA = PinholeCamera(300.0, 300.0, 159.5, 99.5, 320, 240)


@pytest.fixture(scope="module")
def model() -> ClassModel:
    return quick_car_model()


def found_in(car: CarPicture, view_bin: int, model: ClassModel) -> tuple[Photo, FoundObject]:
    photo = Photo(car.rgb, car.seen_from)
    found = find_object(photo, car.box_px, view_bin, model)
    assert isinstance(found, FoundObject)
    return photo, found


@pytest.fixture(scope="module")
def side(model: ClassModel) -> tuple[CarPicture, Photo, FoundObject]:
    car = car_from(90, seed=3, width_px=320)
    return car, *found_in(car, 3, model)


def test_structural_similarity_in_closed_form() -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (40, 50)).astype(np.uint8)
    np.testing.assert_allclose(structural_similarity(picture, picture), 1.0)
    # flat pictures: (2 a b + c1) / (a^2 + b^2 + c1), c1 = (0.01 * 255)^2 = 6.5025
    flat = np.full((20, 20), 100, np.uint8), np.full((20, 20), 50, np.uint8)
    expected = (2 * 100 * 50 + 6.5025) / (100**2 + 50**2 + 6.5025)
    np.testing.assert_allclose(structural_similarity(*flat), expected)
    assert structural_similarity(picture, 255 - picture).mean() < 0


@pytest.mark.parametrize("view_bin", [0, 5, 10])
def test_cars_from_all_around(model: ClassModel, view_bin: int) -> None:
    car = car_from(30 * view_bin, seed=view_bin, width_px=320)
    photo, found = found_in(car, view_bin, model)
    instance = found.instance
    centre = car.cam_from_object @ np.array([0, 0, car.size_m[2] / 2, 1])
    assert np.linalg.norm(instance.centroid_m - centre[:3]) < 0.55
    # an outline from the front takes in the mirrors, which the size of a car leaves out
    widest = 1.32 if view_bin == 0 else 1.05
    assert 0.95 < instance.size_m[1] / car.size_m[1] < widest
    np.testing.assert_allclose(instance.size_m[2], car.size_m[2], rtol=0.2)
    assert instance.cam_from_object[:3, 0] @ car.cam_from_object[:3, 0] > np.cos(np.deg2rad(6))
    # the box stands on the ground
    np.testing.assert_allclose(
        instance.corners_m[::2] @ car.seen_from.ground.up, -car.seen_from.ground.height_m, atol=1e-9
    )
    assert source_similarity(photo, [found], scene_layers(photo, [found])) > 0.9


def test_the_side_of_a_car(side: tuple[CarPicture, Photo, FoundObject]) -> None:
    car, photo, found = side
    instance = found.instance
    # metres of depth of the side that the picture shows, from the instance alone
    depth = instance.depth(photo.seen_from.camera, np.eye(4)).depth
    both = np.isfinite(depth) & car.mask
    assert both.sum() > 0.8 * car.mask.sum()
    assert np.median(np.abs(depth[both] - car.depth_m[both])) < 0.1
    names = {p.name: p.seen for p in instance.parts}
    assert names["left_body"]
    assert not names["right_body"]
    # predicted parts are on the far side: the right body behind the left one, parallel, a width away
    by_name = {p.name: p for p in instance.parts}
    left, right = (by_name[n].outline_m[:, 2].mean() for n in ("left_body", "right_body"))
    assert 1.2 < right - left < 2.4
    assert source_similarity(photo, [found], scene_layers(photo, [found])) > 0.95
    # the overlay draws on the car and leaves the corners alone
    drawn = instance_overlay(photo.rgb, found.picture, instance, photo.seen_from.camera)
    assert (drawn != photo.rgb).any(axis=2)[car.mask].mean() > 0.9
    np.testing.assert_array_equal(drawn[:20, :20], photo.rgb[:20, :20])


def test_picture_meshes_cast_the_picture(side: tuple[CarPicture, Photo, FoundObject]) -> None:
    _, photo, found = side
    meshes = [mesh for mesh, _ in object_layers(photo.rgb, found, photo.seen_from.camera)]
    shown = meshes[0]
    assert shown.uv_px is not None
    # a vertex lies on the ray of its place in the photograph, and so do the middles of its triangles
    np.testing.assert_allclose(photo.seen_from.camera.project(shown.xyz_m), shown.uv_px, atol=1e-6)
    middles = shown.xyz_m[shown.faces].mean(axis=1), shown.uv_px[shown.faces].mean(axis=1)
    flat = np.ptp(shown.xyz_m[shown.faces][..., 2], axis=1) < 0.3
    assert np.abs(photo.seen_from.camera.project(middles[0]) - middles[1])[flat].max() < 0.5
    # the back is on the other side, where the mirror image of what is seen would be
    back = np.linalg.inv(found.instance.cam_from_object)
    y = [(m.xyz_m[m.faces.ravel()] @ back[:3, :3].T + back[:3, 3])[:, 1] for m in meshes[:1]]
    mirrored = [m for m in meshes[1:] if m.uv_px is not None and len(m.faces) > 1000]
    assert mirrored
    far = (mirrored[-1].xyz_m[mirrored[-1].faces.ravel()] @ back[:3, :3].T + back[:3, 3])[:, 1]
    # it goes on by the slack that pose and planes are given, 4 % of the diagonal of 5 m
    assert -0.2 < np.median(far) + np.median(y[0]) < 0.05
    assert np.median(y[0]) > 0.5


def gltf_json(path: Path) -> dict:
    """The JSON chunk of a GLB file, read by hand."""
    data = path.read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON"
    return json.loads(data[20 : 20 + size])


def test_glb_has_axes_metres_and_texture(side: tuple[CarPicture, Photo, FoundObject], tmp_path: Path) -> None:
    car, photo, found = side
    turn = gltf_from_object(found.instance)
    layers = object_layers(photo.rgb, found, photo.seen_from.camera)
    meshes = [mesh.moved(turn) for mesh, _ in layers]
    write_glb(
        tmp_path / "car.glb",
        [(f"car_{k}", m, rgb) for k, (m, (_, rgb)) in enumerate(zip(meshes, layers, strict=True))],
    )
    head = gltf_json(tmp_path / "car.glb")
    assert all(m["doubleSided"] for m in head["materials"])
    assert any("baseColorTexture" in m["pbrMetallicRoughness"] for m in head["materials"])
    scene = trimesh.load(tmp_path / "car.glb")
    low, high = scene.bounds
    # +Y up from the ground, +Z along the car, +X to its left
    assert abs(low[1]) < 0.25
    length, width, height = found.instance.size_m
    np.testing.assert_allclose((high - low)[[2, 1]], [length, height], rtol=0.25)
    # the sides lie inside the box, of which the roof is the widest part
    assert 0.85 * width < (high - low)[0] < width
    first = scene.geometry["car_0"]
    # the side that the picture shows is where it is in truth
    rows, cols = np.nonzero(car.mask & np.isfinite(car.depth_m))
    rays = photo.seen_from.camera.rays(np.stack([cols, rows], axis=1).astype(float))
    true = rays * car.depth_m[rows, cols][:, None]
    x_m = (true @ turn[:3, :3].T + turn[:3, 3])[:, 0]
    np.testing.assert_allclose(np.median(first.vertices[:, 0]), np.median(x_m), atol=0.05)
    # the texture at a vertex is the photograph where the vertex comes from (v goes up in trimesh)
    texture = np.asarray(first.visual.material.baseColorTexture.convert("RGB"))
    uv = first.visual.uv * [1, -1] + [0, 1]
    at = uv * texture.shape[1::-1] - 0.5
    assert meshes[0].uv_px is not None
    here = sample_bilinear(texture, at, cv2.BORDER_REPLICATE).astype(int)
    there = sample_bilinear(layers[0][1], meshes[0].uv_px, cv2.BORDER_REPLICATE).astype(int)
    assert np.abs(here - there).mean() < 1.0
    # the front of the car, at the left of the picture, is at +Z
    lights = meshes[0].uv_px[:, 0] < found.picture.outline_px[:, 0].min() + 20
    assert first.vertices[lights, 2].mean() > 1.2
    assert car.size_m[0] > 3


def test_ply_has_the_colours(side: tuple[CarPicture, Photo, FoundObject], tmp_path: Path) -> None:
    _, photo, found = side
    layers = object_layers(photo.rgb, found, photo.seen_from.camera)
    write_ply(tmp_path / "car.ply", layers)
    read = trimesh.load(tmp_path / "car.ply", process=False)
    assert len(read.faces) == sum(len(m.faces) for m, _ in layers)
    expected = np.concatenate([vertex_colours(m, rgb) for m, rgb in layers])
    np.testing.assert_array_equal(read.visual.vertex_colors[:, :3], expected)


def test_scene_axes() -> None:
    ground = GroundPlane(1.5, 0.2)
    turn = gltf_from_camera(ground)
    assert np.linalg.det(turn[:3, :3]) == pytest.approx(1)
    eye, right = turn @ [0, 0, 0, 1], turn @ [1, 0, 0, 0]
    np.testing.assert_allclose(eye, [0, 1.5, 0, 1], atol=1e-12)
    np.testing.assert_allclose(right, [1, 0, 0, 0], atol=1e-12)
    # a ground point ahead is at height 0, away from the viewer
    at = turn @ np.append(ground.intersect(CAMERA.rays(np.array([159.5, 200.0]))), 1)
    assert at[1] == pytest.approx(0, abs=1e-12)
    assert at[2] < -2


@pytest.mark.parametrize("pitch", [0.0, 0.15])
def test_ground_and_backdrop_show_the_picture(pitch: float) -> None:
    ground = GroundPlane(1.5, pitch)
    rgb = np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    rgb = np.asarray(cv2.GaussianBlur(rgb, (0, 0), 3), np.uint8)
    seen_from = GroundedCamera(CAMERA, ground)
    meshes = [ground_mesh(seen_from, 14.0), backdrop_mesh(seen_from, 14.0)]
    np.testing.assert_allclose(meshes[0].xyz_m @ ground.up, -1.5, atol=1e-9)
    for mesh in meshes:
        assert mesh.uv_px is not None
        # where the texture is drawn against where it belongs, all over each triangle
        corners, uv = mesh.xyz_m[mesh.faces], mesh.uv_px[mesh.faces]
        for share in ([1 / 3, 1 / 3, 1 / 3], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]):
            w = np.array(share)[None, :, None]
            assert np.abs(CAMERA.project((corners * w).sum(axis=1)) - (uv * w).sum(axis=1)).max() < 0.5
    again, hit = MeshView([(m, rgb) for m in meshes]).picture(CAMERA, np.eye(4))
    assert hit.mean() > 0.99
    assert np.abs(again.astype(int) - rgb)[hit].mean() < 2


def test_ground_out_of_the_picture_has_no_faces() -> None:
    # the camera looks up by 40 degrees: its lowest ray still rises
    up = GroundPlane(1.5, -0.7)
    assert not len(ground_mesh(GroundedCamera(CAMERA, up), 14.0).faces)


def test_objects_are_filled_in(side: tuple[CarPicture, Photo, FoundObject]) -> None:
    _, photo, found = side
    far = backdrop_distance_m([found], photo.seen_from.ground)
    empty = without_objects(photo, [found], far)
    outline = fill_polygon(found.picture.outline_px, *photo.rgb.shape[:2])
    away = ~np.asarray(cv2.dilate(outline.astype(np.uint8), np.ones((9, 9))), bool)
    np.testing.assert_array_equal(empty[away], photo.rgb[away])
    # a pale green car before a wall and a road: little green is left
    green = photo.rgb[outline].astype(int) @ [-1, 1, 0]
    assert np.median(green) > 5
    assert np.median(empty[outline].astype(int) @ [-1, 1, 0]) < 5


def test_walking_to_the_left_brings_the_left_side_nearer() -> None:
    centre, up = np.array([0.0, 0, 8]), np.array([0.0, -1, 0])
    turn = turned_about(centre, up, 0.3)
    # a point 1 m to the left of the centre comes nearer by sin 0.3
    np.testing.assert_allclose(turn @ [0, 0, 8, 1], [0, 0, 8, 1], atol=1e-12)
    np.testing.assert_allclose(turn @ [-1, 0, 8, 1], [-np.cos(0.3), 0, 8 - np.sin(0.3), 1], atol=1e-12)


def test_nearer_meshes_hide_farther_ones() -> None:
    def wall(z: float, rgb: tuple[int, int, int]) -> PictureMesh:
        points = np.array([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]])
        return PictureMesh(points, np.array([[0, 1, 2], [0, 2, 3]]), None, rgb)

    empty = np.zeros((2, 2, 3), np.uint8)
    view = MeshView([(wall(8, (200, 0, 0)), empty), (wall(6, (0, 0, 200)), empty)])
    picture, hit = view.picture(CAMERA, np.eye(4), (1, 2, 3))
    # 2 m at 6 m and 300 px are 100 pixels
    assert hit.sum() == pytest.approx(100 * 100, rel=0.03)
    assert picture[100, 160].tolist()[:2] == [0, 0]
    assert picture[5, 5].tolist() == [1, 2, 3]


def test_turntable(side: tuple[CarPicture, Photo, FoundObject], tmp_path: Path) -> None:
    _, photo, found = side
    layers = scene_layers(photo, [found])
    left, middle, right = turntable(photo, [found], layers, np.array([-0.4, 0.0, 0.4]))
    assert left.shape == middle.shape == right.shape
    assert np.abs(left.astype(int) - right).mean() > 5
    write_turntable(tmp_path, photo, [found], layers)
    gif = cv2.VideoCapture(str(tmp_path / "turntable.gif"))
    frames: list[UInt8Array] = []
    while (read := gif.read())[0]:
        frames.append(np.asarray(read[1], np.uint8))
    assert len(frames) in (0, 24)  # builds of OpenCV without FFmpeg read no GIF
    assert cv2.imread(str(tmp_path / "views.png")).shape[1] == 5 * 480


def test_two_objects_in_one_scene(side: tuple[CarPicture, Photo, FoundObject]) -> None:
    _, photo, found = side
    shifted = replace(found, instance=replace(found.instance, class_name="other"))
    layers = in_scene_axes(scene_layers(photo, [found, shifted]), photo.seen_from.ground)
    names = [name for name, _, _ in layers]
    assert len(set(names)) == len(names)
    assert {"car_1_0", "other_2_0", "ground", "backdrop"} <= set(names)
