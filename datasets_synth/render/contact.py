"""Soft shade where things stand on the ground: a car hides the sky from the road beneath and beside it."""

from dataclasses import dataclass

import cv2
import numpy as np

from datasets_synth.meshes.grade import Grade
from datasets_synth.meshes.mesh import Placed
from datasets_synth.render.scene_rays import world_vertices
from recon.arrays import Float32Array
from recon.pixels import sample_bilinear

NEAR_GROUND_M = 0.35
"""Things whose lowest point is above this hide no ground; surfaces above this are not ground."""
BODY_M = 1.2
"""The part of a thing up to this height above its foot hides the ground."""
SOFTNESS_M = 0.18
"""Standard deviation of the edge of the shade: about the ground clearance of a car."""
DARKEST = 0.85
"""Share of the sky that is hidden under the middle of a wide thing."""
CELL_M = 0.06
MAX_CELLS = 2048
MARGIN_M = 1.0


@dataclass(frozen=True, eq=False)
class ContactShade:
    """A map of the ground that holds the share of sky light that arrives."""

    arriving: Float32Array
    """Shape (rows, columns) over world y and x, in [0, 1]."""
    low_xy_m: Float32Array
    """World x and y of the centre of cell (0, 0), shape (2,)."""
    cell_m: float
    grade: Grade | None = None
    """How the ground rises and falls; None where it is level."""

    def sky_share(self, point: Float32Array, normal: Float32Array) -> Float32Array:
        """Share of the sky and ground light (n,) that reaches points (n, 3) with unit normals (n, 3).

        Ground takes it from the map. Sides close to the ground see less light too, down to 60 % at its level.
        """
        from datasets_synth.render.shade_loops import find_contact  # noqa: PLC0415 (half a second to import)

        n = len(point)
        share, at, cell = np.empty(n, np.float32), np.empty(n, np.int64), np.empty((n, 2), np.float32)
        n_ground = find_contact(
            point,
            normal,
            np.zeros(n) if self.grade is None else self.grade.height_m(point[:, 1]),
            np.float32(NEAR_GROUND_M),
            self.low_xy_m,
            np.float32(self.cell_m),
            np.float32(2 * MAX_CELLS),
            share,
            at,
            cell,
        )
        share[at[:n_ground]] = sample_bilinear(self.arriving, cell[:n_ground], cv2.BORDER_CONSTANT, 1.0)
        return share


def contact_shade(items: tuple[Placed, ...], grade: Grade | None = None) -> ContactShade:
    """The shade of all things that cast a shadow and stand on the ground."""
    hulls = [hull for hull in (_footprint(p, grade) for p in items if p.casts_shadow) if hull is not None]
    if not hulls:
        return ContactShade(np.ones((1, 1), np.float32), np.zeros(2, np.float32), CELL_M, grade)
    corners = np.concatenate(hulls)
    low, high = corners.min(axis=0) - MARGIN_M, corners.max(axis=0) + MARGIN_M
    cell_m = max(CELL_M, float((high - low).max()) / MAX_CELLS)
    columns, rows = np.ceil((high - low) / cell_m).astype(int)
    covered = np.zeros((int(rows), int(columns)), np.uint8)
    for hull in hulls:
        # fillConvexPoly takes 4 fractional bits: a sixteenth of a cell
        cv2.fillConvexPoly(covered, np.rint((hull - low) / cell_m * 16).astype(np.int32), 255, cv2.LINE_AA, 4)
    soft = cv2.GaussianBlur(covered.astype(np.float32) / 255, (0, 0), max(SOFTNESS_M / cell_m, 0.5))
    return ContactShade(np.asarray(1 - DARKEST * soft, np.float32), low.astype(np.float32), cell_m, grade)


def _footprint(placed: Placed, grade: Grade | None) -> Float32Array | None:
    """Convex outline (n, 2) on the ground of the lower part of a thing; None where it hangs above."""
    vertices = world_vertices(placed)
    foot = float(vertices[:, 2].min())
    ground = 0.0 if grade is None else float(grade.height_m(float(placed.world_from_object[1, 3])))
    if foot > NEAR_GROUND_M + ground:
        return None
    lower = vertices[vertices[:, 2] < foot + BODY_M, :2]
    return np.asarray(cv2.convexHull(np.ascontiguousarray(lower)), np.float32).reshape(-1, 2)
