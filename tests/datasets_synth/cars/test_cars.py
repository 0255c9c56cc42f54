"""The parametric cars: measures, orientation, parts, closedness, variety, determinism."""

import itertools

import numpy as np
import open3d as o3d
import pytest

from datasets_synth.cars.cars import car_mesh, car_shapes
from datasets_synth.cars.paint import Finish
from datasets_synth.cars.parts import CAR_PARTS, PART_LABEL
from datasets_synth.cars.shapes import BODY_TYPES, CarShape
from datasets_synth.meshes.mesh import Mesh

SHAPES = car_shapes()
SOME = SHAPES[::5]


def mesh_of(shape: CarShape) -> Mesh:
    return car_mesh(shape, np.random.default_rng(1))


def centre_of_part(mesh: Mesh, part: str) -> np.ndarray:
    """Area-weighted centre of the faces of a part."""
    v = mesh.vertices_m[mesh.faces[mesh.face_part == PART_LABEL[part]]].astype(float)
    area = np.linalg.norm(np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]), axis=1)
    return (v.mean(1) * area[:, None]).sum(0) / area.sum()


def ray_scene(mesh: Mesh) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(np.array(mesh.vertices_m), mesh.faces.astype(np.uint32))
    return scene


def cast(mesh: Mesh, azimuth_deg: float, elevation_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orthographic rays from outside: distance, face and direction of the rays (160 x 240)."""
    a, e = np.deg2rad([azimuth_deg, elevation_deg])
    toward = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.cross(toward, right)
    u, v = np.meshgrid(np.linspace(-3.1, 3.1, 240), np.linspace(-0.8, 2.6, 160))
    origin = 12 * toward + u[..., None] * right + v[..., None] * up
    rays = np.concatenate([origin, np.broadcast_to(-toward, origin.shape)], axis=-1).astype(np.float32)
    hits = ray_scene(mesh).cast_rays(o3d.core.Tensor(rays))
    return hits["t_hit"].numpy(), hits["primitive_ids"].numpy().astype(np.int64), -toward


def test_at_least_forty_shapes_of_every_type_with_stable_names() -> None:
    assert len(SHAPES) >= 40
    assert len({s.shape_id for s in SHAPES}) == len(SHAPES)
    assert {s.body_type for s in SHAPES} == set(BODY_TYPES)
    assert SHAPES[0].shape_id == "hatchback_00"
    assert car_shapes() == SHAPES


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.shape_id)
def test_measures_equal_the_parameters(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    v = mesh.vertices_m
    assert np.ptp(v[:, 0]) == pytest.approx(shape.length, abs=0.01)
    # Roof rails stand up to 5 cm over the roof, mirrors beside the doors: the papers count neither.
    painted = mesh.faces[np.isin(mesh.face_part, [PART_LABEL["roof"]]) & (mesh.face_material == Finish.PAINT)]
    assert v[painted][..., 2].max() == pytest.approx(shape.height, abs=0.01)
    below_mirrors = v[v[:, 2] < shape.belt_front_z - 0.15]
    assert np.ptp(below_mirrors[:, 1]) == pytest.approx(shape.width, abs=0.01)
    assert np.ptp(v[:, 1]) < shape.width + 0.45
    assert abs(v[:, 0].max() + v[:, 0].min()) < 0.01
    assert 3_000 <= len(mesh.faces) <= 20_000


@pytest.mark.parametrize("shape", SOME, ids=lambda s: s.shape_id)
def test_wheels_stand_on_the_ground_under_the_axles(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    for part, axle in (("front_left_wheel", 0), ("rear_right_wheel", 1)):
        v = mesh.vertices_m[mesh.faces[mesh.face_part == PART_LABEL[part]]].reshape(-1, 3)
        assert v[:, 2].min() == pytest.approx(0.0, abs=1e-3)
        assert v[:, 2].max() == pytest.approx(2 * shape.wheel_radius, abs=0.01)
        assert v[:, 0].mean() == pytest.approx(0.5 * shape.length - shape.axles_t[axle], abs=0.01)
        assert (v[:, 1].mean() > 0) == ("left" in part)
    assert mesh.vertices_m[:, 2].min() == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("shape", SOME, ids=lambda s: s.shape_id)
def test_left_and_right_are_mirror_images(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    swapped = mesh.vertices_m * np.array([1, -1, 1], np.float32)

    def ordered(v: np.ndarray) -> np.ndarray:
        return np.unique(np.round(v * 1e3).astype(int), axis=0)

    assert np.array_equal(ordered(swapped), ordered(mesh.vertices_m))
    for part in ("left_body", "left_windows", "front_left_wheel"):
        other = part.replace("left", "right")
        assert np.allclose(centre_of_part(mesh, part), centre_of_part(mesh, other) * [1, -1, 1], atol=1e-4)
        assert centre_of_part(mesh, part)[1] > 0.3


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.shape_id)
def test_parts_follow_each_other_from_nose_to_tail(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    expected = set(CAR_PARTS) if shape.has_deck else set(CAR_PARTS) - {"trunk"}
    assert {CAR_PARTS[i - 1] for i in np.unique(mesh.face_part) if i} == expected
    order = ["front", "hood", "windshield", "roof", "rear_window"] + ["trunk"] * shape.has_deck + ["rear"]
    along = [centre_of_part(mesh, part)[0] for part in order]
    assert all(a > b for a, b in itertools.pairwise(along))
    assert (
        centre_of_part(mesh, "roof")[2]
        > centre_of_part(mesh, "windshield")[2]
        > centre_of_part(mesh, "hood")[2]
    )


@pytest.mark.parametrize("shape", SOME, ids=lambda s: s.shape_id)
def test_only_front_faces_are_seen_from_outside(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    v = mesh.vertices_m[mesh.faces].astype(float)
    normal = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
    for azimuth, elevation in ((90, 3), (40, 8), (0, 5), (180, 8), (215, 20), (270, 3)):
        distance, face, direction = cast(mesh, azimuth, elevation)
        hit = np.isfinite(distance)
        assert hit.sum() > 4_000
        backward = (normal[face[hit]] @ direction) > 0
        # 2 of 1000: edges where paper-thin things (spokes, handles) stand on the body.
        assert backward.mean() < 0.002
        shown = mesh.corner_normals[face[hit]].mean(1) @ direction
        assert (shown > 0.3).mean() < 0.002


@pytest.mark.parametrize("shape", SOME, ids=lambda s: s.shape_id)
def test_no_sky_shows_through_the_body(shape: CarShape) -> None:
    mesh = mesh_of(shape)
    distance, _, _ = cast(mesh, 90, 2)
    solid = np.isfinite(distance)
    # Every column but those of the rounded ends is solid from above the sill to its highest hit.
    across, rows = np.linspace(-3.1, 3.1, 240), np.linspace(-0.8, 2.6, 160)
    low = int(np.searchsorted(rows, shape.clearance + 0.25))
    inner = np.abs(across) < 0.5 * shape.length - 0.3
    highest = solid.shape[0] - 1 - solid[::-1].argmax(0)
    filled = np.array([solid[low : top + 1, j].mean() for j, top in enumerate(highest) if inner[j]])
    # A roof rail leaves a gap of a row or two below itself.
    rail = 2 / (solid.shape[0] - low) if shape.body_type in ("estate", "suv") else 0.0
    assert (filled >= 1 - 3 * rail).all()


def test_normals_are_unit_length() -> None:
    length = np.linalg.norm(mesh_of(SHAPES[9]).corner_normals, axis=-1)
    assert np.allclose(length, 1, atol=1e-4)


def silhouette(shape: CarShape) -> np.ndarray:
    """Height of the body along x, every 5 cm from -3 to 3 m, then half widths at two heights."""
    v = mesh_of(shape).vertices_m
    bins = np.clip(((v[:, 0] + 3) / 0.1).astype(int), 0, 59)
    top = np.zeros(60)
    np.maximum.at(top, bins, v[:, 2])
    return top


def test_any_two_shapes_differ_measurably() -> None:
    profiles = np.array([silhouette(s) for s in SHAPES])
    difference = np.abs(profiles[:, None] - profiles[None]).mean(-1)
    np.fill_diagonal(difference, np.inf)
    assert difference.min() > 0.01  # a centimetre on average over the whole length


def test_same_generator_gives_the_same_bytes_and_another_gives_another_paint() -> None:
    first, again = (car_mesh(SHAPES[3], np.random.default_rng(7)) for _ in range(2))
    assert first.vertices_m.tobytes() == again.vertices_m.tobytes()
    assert first.corner_normals.tobytes() == again.corner_normals.tobytes()
    assert repr(first.materials) == repr(again.materials)
    paints = {car_mesh(SHAPES[3], np.random.default_rng(i)).materials[Finish.PAINT].rgb for i in range(20)}
    assert len(paints) == 20


def test_materials_are_physical() -> None:
    for seed in range(50):
        for material in car_mesh(SHAPES[0], np.random.default_rng(seed)).materials:
            assert all(0 <= c <= 1 for c in material.rgb)
            assert material.mirror + max(material.rgb) <= 1.01
