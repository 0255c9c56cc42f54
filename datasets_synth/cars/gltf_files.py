"""glTF files as trimesh reads them right: what it does not know of is undone, or named."""

import base64
import json
import struct
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from recon.arrays import FloatArray
from recon.errors import RescoreError

SUFFIXES = (".glb", ".gltf")
_HEAD = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")
_DRACO = "KHR_draco_mesh_compression"
_QUANTIZED = "KHR_mesh_quantization"
_MOVED = "KHR_texture_transform"
_READ = {_QUANTIZED, _MOVED, "EXT_texture_webp", "KHR_lights_punctual", "KHR_xmp_json_ld"}
_LOOKS = "KHR_materials_"
"""Beginning of the names of extensions that change gloss and glow alone."""
_WHOLE = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16}
_FLOAT = 5126
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def plain_gltf(path: Path, where: str) -> bytes | None:
    """A glTF file with quantised attributes and moved textures written out; None where it has none of these.

    Args:
        path: A file that ends in .glb or .gltf.
        where: How errors name it.

    Raises:
        RescoreError: the file needs extensions that are not read, which are named.
        ValueError, KeyError, TypeError, IndexError, OSError, struct.error: it is damaged.
    """
    tree, binary = _parts(path)
    _refuse_unread(tree, where)
    if not {_QUANTIZED, _MOVED} & set(tree.get("extensionsUsed", ())):
        return None
    writer = _Floats(tree, binary, path.parent)
    for mesh in tree.get("meshes", ()):
        for primitive in mesh["primitives"]:
            moves = _moves(tree, primitive)
            for name, index in list(primitive["attributes"].items()):
                primitive["attributes"][name] = writer.plain(index, moves.get(name))
    return writer.glb()


def _refuse_unread(tree: dict[str, Any], where: str) -> None:
    unread = [
        name
        for name in tree.get("extensionsRequired", ())
        if name not in _READ and not name.startswith(_LOOKS) and not (name == _DRACO and find_spec("DracoPy"))
    ]
    if unread:
        draco = "; `pip install DracoPy` reads it too" if unread == [_DRACO] else ""
        raise RescoreError(
            f"{where}: expected a mesh without glTF extensions that are not read, got {', '.join(unread)}: "
            f"export it without compression{draco}"
        )


def _parts(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON of a file, and the bytes of its binary chunk; empty where it has none."""
    data = path.read_bytes()
    if path.suffix.lower() == ".gltf":
        return json.loads(data), b""
    magic, version, _ = _HEAD.unpack_from(data)
    if magic != b"glTF" or version != 2:
        raise ValueError("no glTF 2 in binary form")
    chunks: dict[bytes, bytes] = {}
    at = _HEAD.size
    while at < len(data):
        length, kind = _CHUNK.unpack_from(data, at)
        at += _CHUNK.size
        chunks.setdefault(kind, data[at : at + length])
        at += length
    return json.loads(chunks[b"JSON"]), chunks.get(b"BIN\0", b"")


def _moves(tree: dict[str, Any], primitive: dict[str, Any]) -> dict[str, FloatArray]:
    """How the base colour's texture is moved over a primitive: (2, 3) by the name of the coordinates."""
    material = tree["materials"][primitive["material"]] if "material" in primitive else {}
    texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
    move = texture.get("extensions", {}).get(_MOVED)
    if move is None:
        return {}
    turn, scale = float(move.get("rotation", 0.0)), np.array(move.get("scale", (1.0, 1.0)), float)
    cos, sin = np.cos(turn), np.sin(turn)
    matrix = np.column_stack(
        [np.array([[cos, sin], [-sin, cos]]) * scale, np.array(move.get("offset", (0.0, 0.0)), float)]
    )
    # trimesh reads the first coordinates alone
    return {"TEXCOORD_0": matrix} if not move.get("texCoord", texture.get("texCoord", 0)) else {}


class _Floats:
    """A glTF tree whose attributes become accessors of floats where need be, in a buffer of their own."""

    def __init__(self, tree: dict[str, Any], binary: bytes, folder: Path) -> None:
        self._tree, self._binary, self._folder = tree, binary, folder
        self._buffers: dict[int, bytes] = {}
        self._written = bytearray()
        self._number = len(tree.setdefault("buffers", []))

    def plain(self, index: int, move: FloatArray | None) -> int:
        """The accessor of an attribute as floats, with a move (2, 3) of its rows."""
        accessor = self._tree["accessors"][index]
        kept = "bufferView" not in accessor or "sparse" in accessor
        if kept or (move is None and accessor["componentType"] not in _WHOLE):
            return index
        values = self._values(accessor)
        if move is not None:
            values = values @ move[:, :2].T + move[:, 2]
        data = values.astype("<f4").tobytes()
        view = {"buffer": self._number, "byteOffset": len(self._written), "byteLength": len(data)}
        self._written += data
        self._tree["bufferViews"].append(view)
        self._tree["accessors"].append(
            {
                "bufferView": len(self._tree["bufferViews"]) - 1,
                "componentType": _FLOAT,
                "count": len(values),
                "type": accessor["type"],
            }
        )
        return len(self._tree["accessors"]) - 1

    def _values(self, accessor: dict[str, Any]) -> FloatArray:
        view = self._tree["bufferViews"][accessor["bufferView"]]
        kind = np.dtype(_WHOLE.get(accessor["componentType"], np.float32)).newbyteorder("<")
        columns, count = _COLUMNS[accessor["type"]], int(accessor["count"])
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", columns * kind.itemsize)
        stored: NDArray[Any] = np.ndarray(
            (count, columns), kind, self._bytes(view["buffer"]), start, (stride, kind.itemsize)
        )
        values: FloatArray = stored.astype(float)
        if not accessor.get("normalized"):
            return values
        # the largest whole number is 1; -128 means -1 as -127 does
        most = 2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1
        return np.asarray(np.maximum(values / most, -1))

    def _bytes(self, number: int) -> bytes:
        if number not in self._buffers:
            uri = self._tree["buffers"][number].get("uri")
            if uri is None:
                self._buffers[number] = self._binary
            elif uri.startswith("data:"):
                self._buffers[number] = base64.b64decode(uri.partition(",")[2])
            else:
                self._buffers[number] = _inside(self._folder, unquote(uri)).read_bytes()
        return self._buffers[number]

    def glb(self) -> bytes:
        """The tree and all its buffers as a file in binary form."""
        if self._written:
            coded = base64.b64encode(self._written).decode()
            uri = f"data:application/octet-stream;base64,{coded}"
            self._tree["buffers"].append({"byteLength": len(self._written), "uri": uri})
        for key in ("extensionsUsed", "extensionsRequired"):
            self._tree[key] = [n for n in self._tree.get(key, ()) if n not in (_QUANTIZED, _MOVED)]
        text = json.dumps(self._tree).encode()
        text += b" " * (-len(text) % 4)
        binary = self._binary + b"\0" * (-len(self._binary) % 4)
        chunks = _CHUNK.pack(len(text), b"JSON") + text
        if binary:
            chunks += _CHUNK.pack(len(binary), b"BIN\0") + binary
        return _HEAD.pack(b"glTF", 2, _HEAD.size + len(chunks)) + chunks


def _inside(folder: Path, name: str) -> Path:
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise ValueError(f"{name!r} lies outside the folder of the file")
    return path
