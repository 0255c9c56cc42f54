import numpy as np
import pytest

from datasets_synth.meshes.mesh import Material, Mesh
from datasets_synth.meshes.solids import MeshDraft, pose, rotation_z

GREY = Material("grey", (0.5, 0.5, 0.5))


def _face_normals(mesh: Mesh) -> np.ndarray:
    p = mesh.vertices_m[mesh.faces].astype(float)
    return np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])


def _volume(mesh: Mesh) -> float:
    """Signed volume by the divergence theorem; positive only where faces turn outwards."""
    p = mesh.vertices_m[mesh.faces].astype(float)
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def test_a_box_has_its_volume_with_faces_outward() -> None:
    draft = MeshDraft()
    draft.box((1, 2, 3), (2, 3, 4), GREY, yaw_rad=0.4, tilt_rad=0.3)
    assert _volume(draft.mesh()) == pytest.approx(2 * 3 * 4, rel=1e-5)


def test_a_closed_cylinder_has_the_volume_of_its_prism() -> None:
    draft = MeshDraft()
    draft.bar((0, 0, 0), (0, 3, 0), 0.5, GREY, sides=12)
    # a regular 12-gon of radius r has area 12/2 r^2 sin(30 deg) = 3 r^2 = 0.75; times length 3
    assert abs(_volume(draft.mesh())) == pytest.approx(2.25, rel=1e-4)


@pytest.mark.parametrize("shape", ["box", "bar", "blob", "wheel", "ring"])
def test_faces_turn_the_way_their_normals_point(shape: str) -> None:
    draft, rng = MeshDraft(), np.random.default_rng(0)
    if shape == "box":
        draft.box((0, 0, 0), (1, 1, 1), GREY)
    elif shape == "bar":
        draft.bar((0, 0, 0), (1, 2, 3), 0.3, GREY)
    elif shape == "blob":
        draft.blob((0, 0, 0), (1, 1, 1), GREY, rng)
    elif shape == "ring":
        draft.ring((0, 0, 0.3), 0.3, 0.05, GREY)
    else:
        draft.wheel((0, 0, 0.3), 0.3, 0.2, GREY, GREY)
    mesh = draft.mesh()
    normals = _face_normals(mesh)
    big = np.linalg.norm(normals, axis=1) > 1e-5
    agree = np.einsum("ij,ij->i", normals, mesh.corner_normals.mean(axis=1)) > 0
    assert agree[big].mean() > 0.99
    lengths = np.linalg.norm(mesh.corner_normals, axis=2)
    assert np.allclose(lengths, 1, atol=1e-4)


def test_a_panel_carries_its_texture_upright_and_in_metres() -> None:
    draft = MeshDraft()
    draft.panel([(0, 0, 0), (4, 0, 0), (4, 0, 2), (0, 0, 2)], GREY, tile_m=0.5)
    mesh = draft.mesh()
    corner = mesh.vertices_m[mesh.faces]
    # 4 m across in tiles of 0.5 m are 8 tiles; v grows upwards
    assert np.allclose(mesh.corner_uv[..., 0], corner[..., 0] / 0.5)
    assert np.allclose(mesh.corner_uv[..., 1], corner[..., 2] / 0.5)


def test_faces_carry_the_label_they_were_added_under() -> None:
    draft = MeshDraft()
    draft.box((0, 0, 0), (1, 1, 1), GREY)
    with draft.labelling(3):
        draft.box((0, 0, 2), (1, 1, 1), GREY, skip=("-z",))
        with draft.labelling(7):
            draft.bar((0, 0, 3), (0, 0, 4), 0.1, GREY, sides=6)
        draft.panel([(0, 0, 5), (1, 0, 5), (1, 1, 5), (0, 1, 5)], GREY)
    draft.box((0, 0, 6), (1, 1, 1), GREY)
    mesh = draft.mesh()
    z = mesh.vertices_m[mesh.faces].mean(axis=1)[:, 2]
    # boxes lie at z = 0 and 6 (none), 2 (3), the bar at 3 to 4 (7), the panel at 5 (3)
    expected = np.select([z < 1, z < 2.7, z < 4.2, z < 5.2], [0, 3, 7, 3], 0)
    assert np.array_equal(mesh.face_part, expected)
    assert np.bincount(mesh.face_part).tolist() == [24, 0, 0, 12, 0, 0, 0, 24]


def test_transform_turns_everything_and_pose_is_a_turn_and_a_shift() -> None:
    draft = MeshDraft()
    draft.box((1, 0, 0), (0.2, 0.2, 0.2), GREY)
    draft.transform(rotation_z(np.pi / 2), (0, 0, 5))
    # x turns into y, then 5 m up
    assert np.allclose(draft.mesh().vertices_m.mean(axis=0), (0, 1, 5), atol=1e-6)
    world = pose(1, 2, 3, np.pi / 2) @ np.array([1.0, 0, 0, 1])
    assert np.allclose(world, (1, 3, 3, 1))
