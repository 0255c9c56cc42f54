"""Part-labelled views of one mesh under scaled orthographic projection, for learning class models."""

import numpy as np
from numpy.typing import NDArray

from datasets_synth.mesh import Mesh
from datasets_synth.scene_rays import MISS, RayTree
from datasets_synth.truth import N_VIEW_BINS

MARGIN_PX = 4
"""Empty pixels on each side of the object."""


def view_axes(view_bin: int, elevation_rad: float) -> NDArray[np.float64]:
    """Right, down and forward axes of the camera of a view bin, rows of a (3, 3), in the object frame.

    The camera stands at azimuth 30 degrees times the bin, ``elevation_rad`` above the horizon, and looks at
    the object; its picture is upright.
    """
    azimuth = 2 * np.pi * view_bin / N_VIEW_BINS
    to_camera = np.array(
        [
            np.cos(elevation_rad) * np.cos(azimuth),
            np.cos(elevation_rad) * np.sin(azimuth),
            np.sin(elevation_rad),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    forward = -to_camera
    return np.stack([right, np.cross(forward, right), forward])


def render_part_labels(mesh: Mesh, view_bin: int, elevation_rad: float, size_px: int) -> NDArray[np.uint8]:
    """Part labels (h, w) of a mesh seen from a view bin, scaled orthographic; 0 where there is no part.

    The object fills ``size_px`` pixels along its longer side, and ``MARGIN_PX`` empty pixels surround it.

    Args:
        mesh: In the object frame.
        view_bin: 0 to 11.
        elevation_rad: How far the camera looks down.
        size_px: Extent of the object along its longer side in the picture.
    """
    axes = view_axes(view_bin, elevation_rad)
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
