"""glTF files with extensions: read as they are meant, or named."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from datasets_synth.cars import gltf_files
from datasets_synth.cars.mesh_import import ImportedCar, load_meshes
from recon.errors import RescoreError

BODY_M = (1.8, 1.4, 4.2)
"""Width (x), height (y), length (z): glTF axes."""
KINDS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
BOX = trimesh.creation.box(extents=(1.0, 1.0, 1.0))


class Tree:
    """A glTF file of one box, put together accessor by accessor."""

    def __init__(self) -> None:
        self.data = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "bufferViews": [],
            "accessors": [],
        }

    def accessor(self, values: NDArray[Any], *, normalized: bool = False, padding: int = 0) -> int:
        """The number of an accessor of values (n, c) with some bytes behind each row."""
        rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
        data = np.pad(rows, ((0, 0), (0, padding))).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.json["bufferViews"].append(view | ({"byteStride": rows.shape[1] + padding} if padding else {}))
        self.data += data + b"\0" * (-len(data) % 4)
        kind = values.dtype.str[1:]
        accessor = {
            "bufferView": len(self.json["bufferViews"]) - 1,
            "componentType": KINDS[kind],
            "count": len(values),
            "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[values.shape[1]],
        }
        self.json["accessors"].append(accessor | ({"normalized": True} if normalized else {}))
        return len(self.json["accessors"]) - 1

    def mesh(self, **attributes: int) -> None:
        faces = self.accessor(BOX.faces.astype("<u4").reshape(-1, 1))
        self.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": faces}]}]

    def needs(self, *names: str) -> None:
        self.json |= {"extensionsUsed": list(names), "extensionsRequired": list(names)}

    def write(self, path: Path) -> None:
        buffer: dict[str, Any] = {"byteLength": len(self.data)}
        if path.suffix == ".gltf":
            (path.parent / "a b.bin").write_bytes(self.data)
            path.write_text(json.dumps(self.json | {"buffers": [buffer | {"uri": "a%20b.bin"}]}))
            return
        text = json.dumps(self.json | {"buffers": [buffer]}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def one(folder: Path) -> ImportedCar:
    (car,) = load_meshes(folder)
    return car


def quantised(path: Path) -> None:
    """A car whose positions are bytes and whose texture is moved."""
    tree = Tree()
    uv = tree.accessor(np.full((len(BOX.vertices), 2), 9999, "<u2"), normalized=True)
    positions = tree.accessor((BOX.vertices * 2 * 127).astype("<i1"), normalized=True, padding=1)
    tree.mesh(POSITION=positions, TEXCOORD_0=uv)
    tree.json["nodes"][0]["scale"] = [v / 2 for v in BODY_M]
    with_paint(tree, {"scale": [2, 2]})
    tree.needs("KHR_mesh_quantization", "KHR_texture_transform")
    tree.write(path)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("kind", ["i2", "u2", "i1"])
@pytest.mark.parametrize("normalized", [True, False])
def test_quantised_positions_are_read(suffix: str, kind: str, normalized: bool, tmp_path: Path) -> None:
    most = np.iinfo(kind).max
    # the box from 0 to 1 as far as whole numbers without a sign go, else from -1 to 1
    unit = BOX.vertices + 0.5 if kind == "u2" else BOX.vertices * 2
    tree = Tree()
    positions = tree.accessor((unit * most).astype(f"<{kind}"), normalized=normalized, padding=2)
    normals = tree.accessor((BOX.vertex_normals * 127).astype("<i1"), normalized=True, padding=1)
    tree.mesh(POSITION=positions, NORMAL=normals)
    scale = np.array(BODY_M) / np.ptp(unit, axis=0) / (1 if normalized else most)
    tree.json["nodes"][0]["scale"] = scale.tolist()
    tree.needs("KHR_mesh_quantization")
    tree.write(tmp_path / f"car{suffix}")
    assert one(tmp_path).size_m == pytest.approx((4.2, 1.8, 1.4), rel=1e-5)


def with_paint(tree: Tree, move: dict[str, Any]) -> None:
    picture = {"bufferView": len(tree.json["bufferViews"]), "mimeType": "image/png"}
    content = _png()
    tree.json["bufferViews"].append({"buffer": 0, "byteOffset": len(tree.data), "byteLength": len(content)})
    tree.data += content + b"\0" * (-len(content) % 4)
    texture = {"index": 0, "extensions": {"KHR_texture_transform": move}}
    tree.json |= {
        "images": [picture],
        "textures": [{"source": 0}],
        "materials": [{"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": texture}}],
    }
    tree.json["meshes"][0]["primitives"][0]["material"] = 0


def _png() -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(file, "PNG")
    return file.getvalue()


@pytest.mark.parametrize(
    ("move", "expected"),
    [
        ({"offset": [0.25, 0.5], "scale": [0.5, 2.0]}, (0.25 + 0.5 * 0.2, 0.5 + 2.0 * 0.4)),
        # a quarter turn against the clock, as seen with v down: right goes up, and down goes right
        ({"rotation": np.pi / 2}, (0.4, -0.2)),
        ({"rotation": np.pi / 2, "scale": [2.0, 1.0]}, (0.4, -0.4)),
    ],
)
@pytest.mark.parametrize("quantised", [True, False])
def test_moved_textures_are_read(
    move: dict[str, Any], expected: tuple[float, float], quantised: bool, tmp_path: Path
) -> None:
    tree = Tree()
    stored = np.tile([[0.2, 0.4]], (len(BOX.vertices), 1))
    values = (stored * 65535).round().astype("<u2") if quantised else stored.astype("<f4")
    uv = tree.accessor(values, normalized=quantised)
    tree.mesh(POSITION=tree.accessor((BOX.vertices * BODY_M).astype("<f4")), TEXCOORD_0=uv)
    with_paint(tree, move)
    tree.needs("KHR_texture_transform", *(["KHR_mesh_quantization"] if quantised else []))
    tree.write(tmp_path / "car.glb")
    mesh = one(tmp_path).mesh
    assert mesh.materials[0].texture is not None
    # v of a Mesh goes up, that of glTF down
    u, v = mesh.corner_uv.reshape(-1, 2).T
    assert (u, 1 - v) == (pytest.approx(expected[0], abs=1e-4), pytest.approx(expected[1], abs=1e-4))


@pytest.mark.parametrize(
    ("needed", "named"),
    [
        (("EXT_meshopt_compression", "KHR_mesh_quantization"), "EXT_meshopt_compression"),
        (("EXT_mesh_gpu_instancing", "KHR_texture_basisu"), "EXT_mesh_gpu_instancing, KHR_texture_basisu"),
        (("KHR_materials_unlit",), None),
    ],
)
def test_extensions_that_are_not_read_are_named(
    needed: tuple[str, ...], named: str | None, tmp_path: Path
) -> None:
    tree = Tree()
    tree.mesh(POSITION=tree.accessor((BOX.vertices * BODY_M).astype("<f4")))
    tree.needs(*needed)
    tree.write(tmp_path / "car.glb")
    if named is None:
        assert one(tmp_path).size_m == pytest.approx((4.2, 1.8, 1.4))
        return
    with pytest.raises(RescoreError, match=rf"car\.glb: expected a mesh .*, got {named}: export it without"):
        load_meshes(tmp_path)


def test_draco_is_read_where_its_package_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("DracoPy", reason="the extra dev brings DracoPy")
    scene = trimesh.Scene(trimesh.creation.box(extents=BODY_M))
    (tmp_path / "car.glb").write_bytes(trimesh.exchange.gltf.export_glb(scene, extension_draco=True))
    assert one(tmp_path).size_m == pytest.approx((4.2, 1.8, 1.4), abs=1e-3)
    monkeypatch.setattr(gltf_files, "find_spec", lambda name: None)
    with pytest.raises(RescoreError, match=r"got KHR_draco_mesh_compression: .*`pip install DracoPy`"):
        load_meshes(tmp_path)


def test_damaged_files_with_extensions_are_one_line(tmp_path: Path) -> None:
    tree = Tree()
    tree.mesh(POSITION=tree.accessor((BOX.vertices * 100).astype("<i2")))
    tree.needs("KHR_mesh_quantization")
    path = tmp_path / "car.glb"
    for key, value in (("count", 10**6), ("bufferView", 7), ("type", "MAT9"), ("count", -1)):
        kept = dict(tree.json["accessors"][0])
        tree.json["accessors"][0][key] = value
        tree.write(path)
        tree.json["accessors"][0] = kept
        with pytest.raises(RescoreError, match=r"car\.glb: expected a readable mesh file, got"):
            load_meshes(tmp_path)
