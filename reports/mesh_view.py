"""Pictures of meshes by ray casting: no window, no graphics card."""

from collections.abc import Sequence

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.camera import PinholeCamera
from reports.mesh_files import sample
from reports.object_mesh import PictureMesh

BACKGROUND = (236, 238, 241)


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
        for i, (mesh, rgb) in enumerate(self._layers):
            own = which == i
            if mesh.uv_px is None:
                out[own] = _shaded(mesh, face[own], directions[own])
                continue
            corners = mesh.uv_px[mesh.faces[face[own]]]
            a, b = share[own, 0, None], share[own, 1, None]
            out[own] = sample(rgb, (1 - a - b) * corners[:, 0] + a * corners[:, 1] + b * corners[:, 2])
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
