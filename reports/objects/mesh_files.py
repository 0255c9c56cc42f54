"""Meshes as files that any viewer opens (textured GLB, coloured PLY), and as a camera sees them."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import open3d as o3d
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.camera import GroundPlane, PinholeCamera
from recon.files import atomic_path
from recon.pixels import sample_bilinear
from recon.reconstruction.instance import Instance3D
from reports.objects.picture_mesh import PictureMesh
from reports.palette import PAPER, rgb


def gltf_from_object(instance: Instance3D) -> FloatArray:
    """(4, 4) from the camera frame to glTF's axes about the object: +X left, +Y up, +Z forward, metres.

    The origin is that of the object frame, on the ground under the middle of the box.
    """
    turn = np.zeros((4, 4))
    # glTF x, y, z are the object's y (left), z (up), x (forward)
    turn[[0, 1, 2, 3], [1, 2, 0, 3]] = 1.0
    return np.asarray(turn @ np.linalg.inv(instance.cam_from_object))


def gltf_from_camera(ground: GroundPlane) -> FloatArray:
    """(4, 4) from the camera frame to glTF's axes of a scene: +X right, +Y up, +Z towards the viewer.

    The origin lies on the ground under the camera.
    """
    up = ground.up
    back = np.array([0.0, 0.0, -1.0]) + up[2] * up
    back /= np.linalg.norm(back)
    out = np.eye(4)
    out[:3, :3] = [np.cross(up, back), up, back]
    out[1, 3] = ground.height_m
    return out


def write_glb(path: Path, layers: Sequence[tuple[str, PictureMesh, UInt8Array]]) -> None:
    """Write named meshes, each with the photograph (h, w, 3) that its texture coordinates refer to.

    The part of a photograph that a mesh uses is stored with it. Materials are rough and have two sides.
    """
    scene = trimesh.Scene()
    for name, mesh, photo in layers:
        scene.add_geometry(_geometry(name, mesh, photo), geom_name=name, node_name=name)
    with atomic_path(path) as beside:
        beside.write_bytes(scene.export(file_type="glb"))


def write_ply(path: Path, layers: Sequence[tuple[PictureMesh, UInt8Array]]) -> None:
    """Write meshes, each with its photograph, as one, binary PLY with a colour for each vertex."""
    meshes = [mesh for mesh, _ in layers]
    first = np.cumsum([0, *(len(m.xyz_m) for m in meshes)])
    whole = trimesh.Trimesh(
        np.concatenate([m.xyz_m for m in meshes]),
        np.concatenate([m.faces + f for m, f in zip(meshes, first[:-1], strict=True)]),
        vertex_colors=np.concatenate([vertex_colours(m, rgb) for m, rgb in layers]),
        process=False,
    )
    with atomic_path(path) as beside:
        beside.write_bytes(whole.export(file_type="ply"))


def vertex_colours(mesh: PictureMesh, rgb: UInt8Array) -> UInt8Array:
    """Colour (n, 3) of each vertex."""
    if mesh.uv_px is None:
        return np.tile(np.array(mesh.rgb, np.uint8), (len(mesh.xyz_m), 1))
    return np.asarray(sample_bilinear(rgb, mesh.uv_px, cv2.BORDER_REPLICATE))


def _geometry(name: str, mesh: PictureMesh, rgb: UInt8Array) -> trimesh.Trimesh:
    rough = {"name": name, "metallicFactor": 0.0, "roughnessFactor": 1.0, "doubleSided": True}
    if mesh.uv_px is None:
        material = PBRMaterial(baseColorFactor=[*mesh.rgb, 255], **rough)
        visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(mesh.xyz_m), 2)), material=material)
    else:
        low = np.clip(np.floor(mesh.uv_px.min(axis=0)) - 1, 0, np.array(rgb.shape[1::-1]) - 1).astype(int)
        high = np.clip(np.ceil(mesh.uv_px.max(axis=0)) + 2, low + 1, rgb.shape[1::-1]).astype(int)
        crop = rgb[low[1] : high[1], low[0] : high[0]]
        # texture coordinates are edges over size; trimesh's v goes up, and it turns that for glTF
        share = (mesh.uv_px + 0.5 - low) / (high - low)
        uv = np.stack([share[:, 0], 1 - share[:, 1]], axis=1)
        material = PBRMaterial(baseColorTexture=Image.fromarray(crop), **rough)
        visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(mesh.xyz_m, mesh.faces, visual=visual, process=False)


BACKGROUND = rgb(PAPER)


class MeshView:
    """Meshes ready to be looked at, each with the photograph that its texture coordinates refer to."""

    def __init__(self, layers: Sequence[tuple[PictureMesh, UInt8Array]]) -> None:
        self._layers = layers
        self._scene = o3d.t.geometry.RaycastingScene()
        for mesh, _ in layers:
            self._scene.add_triangles(
                o3d.core.Tensor.from_numpy(mesh.xyz_m.astype(np.float32)),
                o3d.core.Tensor.from_numpy(mesh.faces.astype(np.uint32)),
            )

    def picture(
        self,
        camera: PinholeCamera,
        cam_from_mesh: FloatArray,
        background: tuple[int, int, int] = BACKGROUND,
    ) -> tuple[UInt8Array, BoolArray]:
        """What a camera sees, (h, w, 3), and which pixels see a mesh, (h, w).

        Args:
            camera: the camera.
            cam_from_mesh: (4, 4) from the frame of the meshes to that of the camera.
            background: sRGB of pixels that see nothing.
        """
        v, u = np.mgrid[: camera.height_px, : camera.width_px].astype(float)
        back = np.linalg.inv(cam_from_mesh)
        directions = camera.rays(np.stack([u, v], axis=-1)) @ back[:3, :3].T
        start = np.broadcast_to(back[:3, 3], directions.shape)
        rays = np.concatenate([start, directions], axis=-1).astype(np.float32)
        hits = self._scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
        which, face = hits["geometry_ids"].numpy(), hits["primitive_ids"].numpy()
        share = hits["primitive_uvs"].numpy().astype(float)
        out = np.empty((*which.shape, 3), np.uint8)
        out[:] = background
        for i, (mesh, photo) in enumerate(self._layers):
            own = which == i
            if mesh.uv_px is None:
                out[own] = _shaded(mesh, face[own], directions[own])
                continue
            corners = mesh.uv_px[mesh.faces[face[own]]]
            a, b = share[own, 0, None], share[own, 1, None]
            uv_px = (1 - a - b) * corners[:, 0] + a * corners[:, 1] + b * corners[:, 2]
            out[own] = sample_bilinear(photo, uv_px, cv2.BORDER_REPLICATE)
        return out, which != o3d.t.geometry.RaycastingScene.INVALID_ID


def _shaded(mesh: PictureMesh, face: NDArray[np.integer], directions: FloatArray) -> UInt8Array:
    """The plain colour, darker where the surface turns away, so that edges can be seen."""
    a, b, c = np.moveaxis(mesh.xyz_m[mesh.faces[face]], 1, 0)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(directions, axis=1)
    facing = np.abs((normal * directions).sum(axis=1)) / np.maximum(size, 1e-12)
    return np.asarray(np.array(mesh.rgb) * (0.6 + 0.4 * facing[:, None]), np.uint8)


def turned_about(centre_m: FloatArray, up: FloatArray, angle_rad: float) -> FloatArray:
    """(4, 4) that turns the camera frame about an axis through a point, as the camera walks around it."""
    axis = up / np.linalg.norm(up)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle_rad) * k + (1 - np.cos(angle_rad)) * (k @ k)
    out = np.eye(4)
    out[:3, :3] = turn
    out[:3, 3] = centre_m - turn @ centre_m
    return out
