"""The ground that the things of a scene take."""

from dataclasses import dataclass

import numpy as np

from datasets_synth.meshes.mesh import Placed
from recon.arrays import FloatArray


@dataclass(frozen=True)
class Footprint:
    """A rectangle on the ground."""

    x_m: float
    y_m: float
    half_length_m: float
    half_width_m: float
    yaw_rad: float = 0.0

    def corners(self) -> FloatArray:
        """Shape (4, 2)."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        local = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (self.half_length_m, self.half_width_m)
        turned: FloatArray = local @ np.array([[c, s], [-s, c]]) + (self.x_m, self.y_m)
        return turned

    def meets(self, other: "Footprint") -> bool:
        """Whether two rectangles overlap (separating axes)."""
        a, b = self.corners(), other.corners()
        for yaw in (self.yaw_rad, other.yaw_rad):
            for axis in ((np.cos(yaw), np.sin(yaw)), (-np.sin(yaw), np.cos(yaw))):
                pa, pb = a @ axis, b @ axis
                if pa.max() <= pb.min() or pb.max() <= pa.min():
                    return False
        return True


OVERHANGING = frozenset({"tree", "trunk", "lamp"})
"""Kinds whose upper parts may reach over others; only what is lower than this height takes ground."""
OVERHANG_M = 2.1


def footprint(placed: Placed, margin_m: float = 0.0) -> Footprint:
    """The ground that a placed mesh takes: its bounding rectangle in its own axes, grown by a margin."""
    if placed.kind in OVERHANGING:
        vertices = placed.mesh.vertices_m
        lower = vertices[vertices[:, 2] < OVERHANG_M, :2]
        low, high = lower.min(0).astype(float), lower.max(0).astype(float)
    else:
        low, high = placed.mesh.extent_m[:, :2].astype(float)
    world = placed.world_from_object
    scale = float(np.linalg.norm(world[:3, 0]))
    centre = world[:2, :2] @ ((low + high) / 2) + world[:2, 3]
    half = (high - low) / 2 * scale + margin_m
    yaw = float(np.arctan2(world[1, 0], world[0, 0]))
    return Footprint(float(centre[0]), float(centre[1]), float(half[0]), float(half[1]), yaw)
