"""A user's own meshes: axes, materials, textures, parts, errors."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from datasets_synth.cars import MESH_FORMS, mesh_import
from datasets_synth.cars.mesh_axes import LENGTH_SHARES, mesh_axes
from datasets_synth.cars.mesh_import import MAX_FACE_CORNERS, load_meshes
from datasets_synth.cars.models import table_cars
from datasets_synth.cars.parts import PART_LABEL
from recon.errors import RescoreError

ROOT = Path(__file__).resolve().parents[3]
BODY_M = (1.8, 1.4, 4.2)
"""Width (x), height (y), length (z) of the test car: glTF axes."""


def box_lines(
    size: tuple[float, float, float], low: tuple[float, float, float], first: int
) -> tuple[list[str], list[str]]:
    """OBJ vertex and face lines of a box with outward faces."""
    box = trimesh.creation.box(extents=size)
    v = box.vertices + np.array(low) + np.array(size) / 2
    return (
        [f"v {x} {y} {z}" for x, y, z in v],
        ["f " + " ".join(f"{i + first}/{i % 4 + 1}" for i in face) for face in box.faces],
    )  # fmt: skip


def write_obj(folder: Path, scale: float = 1.0) -> None:
    """A body with a texture and a green nose plate (at +Z) in the group "front"."""
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:2, :, 0] = 255  # upper half red, lower half blue
    picture[2:, :, 2] = 255
    Image.fromarray(picture).save(folder / "skin.png")
    (folder / "car.mtl").write_text(
        "newmtl skin\nKd 1 1 1\nmap_Kd skin.png\n\nnewmtl green\nKd 0 0.5 0\nKs 1 1 1\nNs 80\n"
    )
    w, h, d = (scale * c for c in BODY_M)
    body = box_lines((w, h, d), (3.0, 1.0, -1.0), 1)
    nose = box_lines((w, 0.5 * h, 0.1 * scale), (3.0, 1.0, d - 1.0), 9)
    lines = ["mtllib car.mtl", *body[0], *nose[0], "vt 0.1 0.9", "vt 0.9 0.9", "vt 0.9 0.1", "vt 0.1 0.1"]
    lines += ["g shell", "usemtl skin", *body[1], "g front", "usemtl green", *nose[1]]
    (folder / "car.obj").write_text("\n".join(lines) + "\n")


def test_obj_with_two_materials_keeps_both_and_turns_the_axes(tmp_path: Path) -> None:
    write_obj(tmp_path)
    (car,) = load_meshes(tmp_path)
    assert car.shape_id == "car"
    assert car.size_m == pytest.approx((4.3, 1.8, 1.4))
    mesh = car.mesh
    by_name = {m.name: i for i, m in enumerate(mesh.materials)}
    assert set(by_name) == {"skin", "green"}
    skin, green = mesh.materials[by_name["skin"]], mesh.materials[by_name["green"]]
    assert skin.texture is not None
    assert skin.texture.shape == (4, 4, 3)
    assert tuple(skin.texture[0, 0]) == (255, 0, 0)
    # 0.5 becomes 128 / 255 = 0.502 in 8 bits: ((0.502 + 0.055) / 1.055)^2.4 = 0.2159.
    assert green.rgb == pytest.approx((0, 0.2159, 0), abs=1e-3)
    assert green.texture is None
    nose = mesh.face_material == by_name["green"]
    assert (int(nose.sum()), int((~nose).sum())) == (12, 12)
    v = mesh.vertices_m[mesh.faces]
    assert v[nose][..., 0].min() > 2.0  # the nose is at +x
    assert v[..., 2].min() == pytest.approx(0, abs=1e-6)
    assert np.allclose(v.reshape(-1, 3).min(0) + v.reshape(-1, 3).max(0), [0, 0, 1.4], atol=1e-5)
    assert set(mesh.face_part[nose]) == {PART_LABEL["front"]}
    assert set(mesh.face_part[~nose]) == {0}
    assert set(np.round(mesh.corner_uv[~nose].ravel(), 3)) == {np.float32(0.1), np.float32(0.9)}


def test_faces_look_outwards_after_turning(tmp_path: Path) -> None:
    write_obj(tmp_path)
    mesh = load_meshes(tmp_path)[0].mesh
    body = mesh.face_part == 0
    v = mesh.vertices_m[mesh.faces][body].astype(float)
    normal = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
    centre = v.reshape(-1, 3).mean(0)
    assert ((normal * (v.mean(1) - centre)).sum(1) > 0).all()
    assert ((mesh.corner_normals[body].mean(1) * normal).sum(1) > 0).all()


def test_glb_keeps_colours_texture_and_node_transforms(tmp_path: Path) -> None:
    body = trimesh.creation.box(extents=BODY_M)
    red = trimesh.visual.material.PBRMaterial(
        name="red", baseColorFactor=[255, 0, 0, 255], roughnessFactor=0.2
    )
    body.visual = trimesh.visual.TextureVisuals(material=red)
    lid = trimesh.creation.box(extents=(1.0, 0.2, 1.0))
    image = Image.fromarray(np.full((2, 2, 3), 99, np.uint8))
    paper = trimesh.visual.material.PBRMaterial(name="paper", baseColorTexture=image)
    lid.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(lid.vertices), 2)) + 0.25, material=paper)
    scene = trimesh.Scene()
    scene.add_geometry(
        body, geom_name="shell", transform=trimesh.transformations.translation_matrix([0, 0.7, 0])
    )
    scene.add_geometry(
        lid, geom_name="roof", transform=trimesh.transformations.translation_matrix([0, 1.5, -0.5])
    )
    scene.export(tmp_path / "two.glb")
    (car,) = load_meshes(tmp_path)
    assert car.size_m == pytest.approx((4.2, 1.8, 1.6), abs=1e-5)
    by_name = {m.name: m for m in car.mesh.materials}
    assert by_name["red"].rgb == pytest.approx((1, 0, 0))
    assert by_name["red"].specular == pytest.approx(0.4)
    texture = by_name["paper"].texture
    assert texture is not None
    assert (texture == 99).all()
    lid_faces = car.mesh.face_part == PART_LABEL["roof"]
    v = car.mesh.vertices_m[car.mesh.faces[lid_faces]]
    # The lid's middle stood at z = -0.5 in glTF: 0.5 m towards the tail.
    assert v[..., 0].mean() == pytest.approx(-0.5, abs=0.01)
    assert v[..., 2].min() == pytest.approx(1.4, abs=1e-5)


def test_ply_colours_become_materials(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=BODY_M)
    colours = np.where(box.face_normals[:, 1:2] > 0.5, [[255, 255, 255, 255]], [[0, 0, 128, 255]])
    box.visual = trimesh.visual.ColorVisuals(box, face_colors=colours.astype(np.uint8))
    box.unmerge_vertices()
    box.visual = trimesh.visual.ColorVisuals(
        box, vertex_colors=np.repeat(colours, 3, axis=0).astype(np.uint8)
    )
    box.export(tmp_path / "painted.ply")
    (car,) = load_meshes(tmp_path)
    mesh = car.mesh
    assert len(mesh.materials) == 2
    top = (mesh.vertices_m[mesh.faces][..., 2] > 1.39).all(1)
    rgb = np.array([m.rgb for m in mesh.materials])[mesh.face_material]
    assert np.allclose(rgb[top], 1)
    # sRGB 128 / 255: linear 0.2159.
    assert np.allclose(rgb[~top], [0, 0, 0.2159], atol=1e-3)


def test_files_come_in_the_order_of_their_names(tmp_path: Path) -> None:
    for name in ("b.ply", "a.glb", "b.glb"):
        trimesh.creation.box(extents=BODY_M).export(tmp_path / name)
    assert [car.shape_id for car in load_meshes(tmp_path)] == ["a", "b.glb", "b.ply"]


def test_errors_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(RescoreError, match=r"expected a folder of car meshes, got .*nowhere"):
        load_meshes(tmp_path / "nowhere")
    with pytest.raises(RescoreError, match=r"expected OBJ, GLB, glTF, PLY, STL or OFF files in .*found none"):
        load_meshes(tmp_path)
    (tmp_path / "broken.glb").write_bytes(b"not a mesh at all")
    with pytest.raises(RescoreError, match=r"broken\.glb: expected a readable mesh file"):
        load_meshes(tmp_path)


@pytest.mark.parametrize(
    ("scale", "unit"), [(100.0, "centimetres"), (1000.0, "millimetres"), (1 / 0.0254, "inches")]
)
def test_other_units_are_known_by_the_length_and_told(tmp_path: Path, scale: float, unit: str) -> None:
    write_obj(tmp_path, scale)
    (car,) = load_meshes(tmp_path)
    # the body stands at (3, 1, -1) units, which is put to the middle
    assert car.size_m == pytest.approx((4.2 + 0.1, 1.8, 1.4), abs=0.06)
    assert car.notes == (f"car.obj: taken as {unit}: {car.size_m[0]:.2f} m long",)
    write_obj(tmp_path, 1e5)
    with pytest.raises(RescoreError, match=r"car\.obj: expected a car 1\.5 to 20 metres .* scale the mesh"):
        load_meshes(tmp_path)


def wedge(length: float, width: float, height: float) -> trimesh.Trimesh:
    """A car of three boxes, glTF axes: a body with a narrower cabin behind its middle."""
    body = trimesh.creation.box(extents=(width, 0.5 * height, length))
    cabin = trimesh.creation.box(extents=(0.8 * width, 0.5 * height, 0.5 * length))
    cabin.apply_translation((0, 0.5 * height, -0.1 * length))
    return trimesh.util.concatenate([body, cabin])


def turned(mesh: trimesh.Trimesh, *order: tuple[int, int]) -> trimesh.Trimesh:
    """The mesh with axis k of the new one along a sign times an axis of the old one."""
    matrix = np.zeros((4, 4))
    matrix[3, 3] = 1
    for k, (axis, sign) in enumerate(order):
        matrix[k, axis] = sign
    assert np.linalg.det(matrix) == pytest.approx(1)
    return mesh.copy().apply_transform(matrix)


def test_wrong_axes_are_named_and_can_be_told(tmp_path: Path) -> None:
    car = wedge(4.2, 1.8, 1.5)
    # z up, the nose along -x: x = -length, y = -width, z = height
    turned(car, (2, -1), (0, -1), (1, 1)).export(tmp_path / "car.stl")
    with pytest.raises(RescoreError, match=r"car\.stl: expected up along y and the nose along z, got .*--up"):
        load_meshes(tmp_path)
    (found,) = load_meshes(tmp_path, mesh_axes("z", "-x"))
    assert found.size_m == pytest.approx((4.2, 1.8, 1.5), abs=1e-3)
    v = found.mesh.vertices_m
    # the cabin, above half the height, lies behind the middle
    assert v[v[:, 2] > 1.0][:, 0].mean() == pytest.approx(-0.42, abs=0.01)
    with pytest.raises(RescoreError, match="--nose: expected one of x, y, z, -x, -y, -z, got 'forward'"):
        mesh_axes("y", "forward")
    with pytest.raises(RescoreError, match=r"axes, got z and z; name both \(.*, without --nose z"):
        mesh_axes("z", "z")


def test_a_car_on_its_side_is_refused(tmp_path: Path) -> None:
    # its measures alone could be those of a tall van
    turned(wedge(4.2, 1.8, 1.6), (1, 1), (0, -1), (2, 1)).export(tmp_path / "fallen.ply")
    with pytest.raises(RescoreError, match=r"fallen\.ply: expected up along y .* lies on its side"):
        load_meshes(tmp_path)
    (tmp_path / "fallen.ply").unlink()
    wedge(4.2, 1.8, 1.6).export(tmp_path / "standing.ply")
    assert len(load_meshes(tmp_path)) == 1


def test_a_body_without_wheels_stands_on_its_lowest_point(tmp_path: Path) -> None:
    body = wedge(4.2, 1.8, 1.5)
    body.apply_translation((0, 3.0, 0))
    body.export(tmp_path / "body.off")
    (car,) = load_meshes(tmp_path)
    assert car.mesh.vertices_m[:, 2].min() == pytest.approx(0, abs=1e-6)


def test_files_that_a_mesh_names_and_lacks_are_told(tmp_path: Path) -> None:
    write_obj(tmp_path)
    (tmp_path / "skin.png").unlink()
    (car,) = load_meshes(tmp_path)
    assert car.notes == ("car.obj: 'skin.png' is not there, so that what it colours is plain",)
    assert car.mesh.materials[0].texture is None
    (tmp_path / "car.mtl").unlink()
    (car,) = load_meshes(tmp_path)
    assert car.notes == ("car.obj: 'car.mtl' is not there, so that what it colours is plain",)
    assert len(car.mesh.faces) == 24


def test_a_text_that_is_called_a_mesh_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.obj").write_text("Dear reader,\nthis is a shopping list: flour, eggs, milk.\n")
    with pytest.raises(RescoreError, match=r"^notes\.obj: expected a mesh, got no vertices, so .* no OBJ"):
        load_meshes(tmp_path)


@pytest.mark.parametrize("extents", [(4, 4, 4), (3.8, 1.5, 4.2), (1.8, 0.2, 4.2), (0.2, 1.5, 4.2)])
def test_what_has_no_cars_proportions_is_refused(tmp_path: Path, extents: tuple[float, ...]) -> None:
    trimesh.creation.box(extents=extents).export(tmp_path / "ball.ply")
    with pytest.raises(RescoreError, match=r"^ball\.ply: expected a car, 0\.08 to 0\.85 of its length wide"):
        load_meshes(tmp_path)


def test_every_model_car_has_a_cars_proportions() -> None:
    size_m = np.array([car.size_m for cars in table_cars().values() for car in cars])
    shares = size_m[:, 1:] / size_m[:, :1]
    assert LENGTH_SHARES[0] < shares.min() / 2
    assert shares.max() < LENGTH_SHARES[1] - 0.1


def test_the_forms_of_meshes_are_those_that_are_read() -> None:
    forms = MESH_FORMS.replace(" or ", ", ").lower().split(", ")
    assert sorted(f".{form}" for form in forms) == sorted(mesh_import.SUFFIXES)
    for page in ("own-data.md", "grasping.md"):
        assert MESH_FORMS in " ".join((ROOT / "docs" / page).read_text().split())


@pytest.mark.parametrize("suffix", ["obj", "stl"])
def test_too_many_faces_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    wedge(4.2, 1.8, 1.5).export(tmp_path / f"car.{suffix}")
    monkeypatch.setattr(mesh_import, "MAX_FACES", 24)
    assert len(load_meshes(tmp_path)) == 1
    monkeypatch.setattr(mesh_import, "MAX_FACES", 23)
    with pytest.raises(RescoreError, match=rf"^car\.{suffix}: expected at most 23 faces, got 24: reduce"):
        load_meshes(tmp_path)


def test_points_without_faces_are_refused(tmp_path: Path) -> None:
    trimesh.PointCloud(np.random.default_rng(0).uniform(0, 3, (20, 3))).export(tmp_path / "points.ply")
    with pytest.raises(RescoreError, match=r"points\.ply: expected"):
        load_meshes(tmp_path)


def write_model(folder: Path, name: str, picture: str, rgb: tuple[int, int, int]) -> None:
    """A model in a folder of its own whose texture lies where the model says."""
    folder.mkdir(parents=True)
    (folder / picture).parent.mkdir(exist_ok=True)
    Image.fromarray(np.full((2, 2, 3), rgb, np.uint8)).save(folder / picture)
    (folder / f"{name}.mtl").write_text(f"newmtl skin\nKd 1 1 1\nmap_Kd {picture}\n")
    vertices, faces = box_lines(BODY_M, (0, 0, 0), 1)
    corners = ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    lines = [f"mtllib {name}.mtl", *vertices, *corners, "usemtl skin", *faces]
    (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")


def test_folders_of_models_are_read_each_with_its_own_textures(tmp_path: Path) -> None:
    """As ShapeNet has them: every model and every texture of one name, and pictures beside the models."""
    red, blue = (255, 0, 0), (0, 0, 255)
    write_model(
        tmp_path / "02958343" / "1a0bc9" / "models", "model_normalized", "../images/texture0.png", red
    )
    write_model(
        tmp_path / "02958343" / "1a1dcd" / "models", "model_normalized", "../images/texture0.png", blue
    )
    write_model(tmp_path / "beetle", "car", "skin.png", red)
    write_model(tmp_path / "smart", "car", "skin.png", blue)
    write_model(tmp_path / "__MACOSX" / "smart", "car", "skin.png", blue)
    for name in ("1b.glb", "1c.glb"):
        (tmp_path / "000-023").mkdir(exist_ok=True)
        trimesh.creation.box(extents=BODY_M).export(tmp_path / "000-023" / name)
    trimesh.creation.box(extents=BODY_M).export(tmp_path / "alone.ply")
    cars = load_meshes(tmp_path)
    colours = {
        car.shape_id: tuple(car.mesh.materials[0].texture[0, 0].tolist())
        for car in cars
        if car.mesh.materials[0].texture is not None
    }
    assert [car.shape_id for car in cars] == [
        "000-023-1b",
        "000-023-1c",
        "02958343-1a0bc9-models",
        "02958343-1a1dcd-models",
        "alone",
        "beetle",
        "smart",
    ]
    assert colours == {
        "02958343-1a0bc9-models": red,
        "02958343-1a1dcd-models": blue,
        "beetle": red,
        "smart": blue,
    }


def test_models_that_would_share_a_name_are_called_by_their_paths(tmp_path: Path) -> None:
    for name in ("a-b/c.ply", "a/b/c.ply", "d.ply"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box(extents=BODY_M).export(tmp_path / name)
    with pytest.raises(RescoreError, match=r"got two that make 'a-b-c\.ply': rename one"):
        load_meshes(tmp_path)
    (tmp_path / "a-b" / "c.ply").rename(tmp_path / "a-b" / "e.ply")
    assert [car.shape_id for car in load_meshes(tmp_path)] == ["a-b-c.ply", "a-b-e.ply", "d"]


def test_a_wheel_in_a_file_of_its_own_is_left_out_and_told(tmp_path: Path) -> None:
    (tmp_path / "lada").mkdir()
    wedge(4.2, 1.8, 1.6).export(tmp_path / "lada" / "vehicle.ply")
    wheel = trimesh.creation.box(extents=(0.25, 0.6, 0.6))
    wheel.export(tmp_path / "lada" / "tire.ply")
    (car,) = load_meshes(tmp_path)
    assert car.shape_id == "lada"
    assert car.notes == ("lada/tire.ply: left out: it has no car's size and lies beside vehicle.ply",)
    # alone it may be a car in a unit that is not known
    (tmp_path / "alone").mkdir()
    wheel.export(tmp_path / "alone" / "tire.ply")
    with pytest.raises(RescoreError, match=r"^alone/tire\.ply: expected a car 1\.5 to 20 metres long"):
        load_meshes(tmp_path)


def test_an_error_names_the_folder_of_the_model(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "model.glb").write_bytes(b"no mesh")
    with pytest.raises(RescoreError, match=r"^one/model\.glb: expected a readable mesh file"):
        load_meshes(tmp_path)


def test_no_texture_is_read_from_outside_the_folder_of_meshes(tmp_path: Path) -> None:
    write_model(tmp_path / "cars" / "one", "car", "../../secret.png", (9, 9, 9))
    (car,) = load_meshes(tmp_path / "cars" / "one")
    assert car.mesh.materials[0].texture is None
    (car,) = load_meshes(tmp_path / "cars")
    assert car.mesh.materials[0].texture is None


def test_a_face_of_too_many_corners_is_refused_before_it_takes_memory(tmp_path: Path) -> None:
    ring = np.linspace(0, 2 * np.pi, MAX_FACE_CORNERS + 2)[:-1]
    corners = [f"v {0.9 * np.cos(a)} {1.4 * (i % 2)} {2.1 * np.sin(a)}" for i, a in enumerate(ring)]
    face = " ".join(str(i + 1) for i in range(len(ring)))
    (tmp_path / "car.obj").write_text("\n".join([*corners, f"f {face}"]))
    with pytest.raises(RescoreError, match=r"car\.obj: line 1002: expected faces of at most 1000 .* 1001"):
        load_meshes(tmp_path)
    (tmp_path / "car.obj").write_text("\n".join([*corners, f"f {face.rpartition(' ')[0]}"]))
    (car,) = load_meshes(tmp_path)
    assert car.size_m[0] == pytest.approx(4.2, abs=0.1)


@pytest.mark.parametrize("face", ["1 2 9", "1 2 513"])
def test_a_face_of_vertices_that_are_not_there_is_one_line(tmp_path: Path, face: str) -> None:
    corners = "".join(f"{x} {y} {z}\n" for x in (-0.9, 0.9) for y in (0, 1.4) for z in (-2.1, 2.1))
    head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "car.ply").write_text(f"{head}{corners}3 {face}\n")
    with pytest.raises(RescoreError, match=r"car\.ply: expected a mesh whose faces name its own vert"):
        load_meshes(tmp_path)
