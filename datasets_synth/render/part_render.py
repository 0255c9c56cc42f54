"""Part-labelled views of one mesh under scaled orthographic projection, for learning class models."""

import numpy as np

from datasets_synth.meshes.mesh import Mesh
from datasets_synth.render.scene_rays import MISS, RayTree
from recon.arrays import FloatArray, UInt8Array

MARGIN_PX = 4
"""Empty pixels on each side of the object."""


def render_part_labels(mesh: Mesh, view_from_object: FloatArray, size_px: int) -> UInt8Array:
    """Part labels (h, w) of a mesh in a view frame, scaled orthographic; 0 where there is no part.

    The object fills ``size_px`` pixels along its longer side, and ``MARGIN_PX`` empty pixels surround it.

    Args:
        mesh: In the object frame.
        view_from_object: T_alpha of a view bin, shape (3, 3), see ``recon.view_bins``.
        size_px: Extent of the object along its longer side in the picture.
    """
    axes = view_from_object
    seen = mesh.vertices_m @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    m_per_px = float((high - low)[:2].max()) / size_px
    columns, rows = np.ceil((high - low)[:2] / m_per_px - 1e-6).astype(int) + 2 * MARGIN_PX
    x = low[0] + (np.arange(columns) - MARGIN_PX + 0.5) * m_per_px
    y = low[1] + (np.arange(rows) - MARGIN_PX + 0.5) * m_per_px
    grid_x, grid_y = np.meshgrid(x, y)
    start = np.stack([grid_x.ravel(), grid_y.ravel(), np.full(grid_x.size, low[2] - 1.0)], axis=1) @ axes
    rays = np.concatenate([start, np.broadcast_to(axes[2], start.shape)], axis=1).astype(np.float32)
    face = RayTree(mesh.vertices_m, mesh.faces).cast(rays).face
    labels = np.where(face == MISS, 0, mesh.face_part[face]).astype(np.uint8)
    return labels.reshape(int(rows), int(columns))
