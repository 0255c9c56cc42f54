"""Triangles that carry a picture."""

from dataclasses import dataclass

import numpy as np

from recon.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class PictureMesh:
    """Triangles whose colour is the photograph or one plain colour."""

    xyz_m: FloatArray
    """Vertices (n, 3)."""
    faces: IntArray
    """Vertex indices (m, 3)."""
    uv_px: FloatArray | None
    """Where each vertex is in the photograph, (n, 2), pixel centres; None for a plain colour."""
    rgb: tuple[int, int, int] = (128, 128, 128)
    """The plain colour."""

    def __post_init__(self) -> None:
        if self.xyz_m.shape[1:] != (3,) or self.faces.shape[1:] != (3,):
            raise ValueError(f"mesh: {self.xyz_m.shape}, {self.faces.shape}")
        if self.uv_px is not None and self.uv_px.shape != (len(self.xyz_m), 2):
            raise ValueError(f"mesh: {self.uv_px.shape} texture coordinates for {self.xyz_m.shape}")

    def moved(self, transform: FloatArray) -> "PictureMesh":
        """The mesh in another frame, by a (4, 4) transform."""
        xyz = self.xyz_m @ transform[:3, :3].T + transform[:3, 3]
        faces = self.faces[:, ::-1] if np.linalg.det(transform[:3, :3]) < 0 else self.faces
        return PictureMesh(xyz, faces, self.uv_px, self.rgb)
