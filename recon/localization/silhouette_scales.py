"""Scale and shift of labelled views from their silhouettes alone, for views of one instance (section 3.2).

Part centroids fix the views well enough for planes. A shape needs more: in two scaled orthographic views the
plane that touches the object and holds both viewing directions touches both silhouettes (the frontier points
of R. Cipolla, K. Astrom and P. Giblin, "Motion from the frontier of curved surfaces", ICCV 1995), so that
each pair of views gives two linear equations in their scales and shifts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recon.arrays import BoolArray, FloatArray
from recon.errors import RescoreError
from recon.outlines import largest_outline
from recon.part_views import PartView


@dataclass(frozen=True, eq=False)
class ScaledViews:
    """Labelled views of one instance with their scaled orthographic cameras: scale u = R X + shift."""

    views: tuple[PartView, ...]
    rotation: FloatArray
    """Object to view, shape (v, 3, 3)."""
    scale: FloatArray
    """Object units a pixel, shape (v,)."""
    shift: FloatArray
    """Place of the object's origin in each view, in object units, shape (v, 2)."""

    def project(self, view: int, points: FloatArray) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) in one view."""
        return np.asarray((points @ self.rotation[view, :2].T + self.shift[view]) / self.scale[view])

    def moved(self, factor: float, origin: FloatArray) -> "ScaledViews":
        """The views in other object units: new point = factor * (point - origin)."""
        shift = self.shift + self.rotation[:, :2] @ origin
        return ScaledViews(self.views, self.rotation, self.scale * factor, shift * factor)

    def extent(self, direction: FloatArray) -> FloatArray:
        """Least and greatest coordinate of the object along a direction that some views show, shape (2,).

        Raises:
            RescoreError: no view is taken across the direction.
        """
        across = [v for v in range(len(self.views)) if abs(self.rotation[v, 2] @ direction) < 1e-6]
        if not across:
            raise RescoreError(
                f"labelled views: expected one taken across {direction.tolist()}, got none; label more bins"
            )
        found = []
        for v in across:
            along = self.rotation[v, :2] @ direction
            at = outer_ring(self.views[v].labels > 0) @ along * self.scale[v] - self.shift[v] @ along
            found.append([at.min(), at.max()])
        return np.asarray(np.mean(found, axis=0))


def outer_ring(mask: BoolArray) -> FloatArray:
    """Corners of the border pixels of a mask (h, w), shape (4 m, 2): extremes are those of the region."""
    ring = largest_outline(mask)
    if ring is None:
        raise ValueError("an empty mask")
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return np.asarray((ring[:, None] + corners).reshape(-1, 2))


def scale_views(views: Sequence[PartView], rotation: FloatArray) -> ScaledViews:
    """Scales and shifts of views (with rotations (v, 3, 3)) of one instance; mean scale 1, any origin.

    Raises:
        RescoreError: fewer than three views, or views that do not fix each other.
    """
    if len(views) < 3:
        raise RescoreError(
            f"labelled views: expected at least three of an instance, got {len(views)}; label more bins"
        )
    rings = [outer_ring(v.labels > 0) for v in views]
    count = len(views)
    rows: list[FloatArray] = []
    for a in range(count):
        for b in range(a + 1, count):
            normal = np.cross(rotation[a, 2], rotation[b, 2])
            if np.linalg.norm(normal) < 1e-3:
                continue
            normal /= np.linalg.norm(normal)
            rows += _tangency(a, b, rings, rotation, normal, count)
    gauge = np.zeros(3 * count)
    gauge[:count] = 1.0
    system = np.concatenate([np.array(rows).reshape(-1, 3 * count), 1e3 * gauge[None]])
    target = np.zeros(len(system))
    target[-1] = 1e3 * count
    # the origin is free: three singular values are 0, and the shortest solution is taken
    solution, _, rank, _ = np.linalg.lstsq(system, target, rcond=1e-9)
    scale = solution[:count]
    if rank < 3 * count - 3 or (scale <= 0).any():
        raise RescoreError(
            f"labelled views of {views[0].instance_id!r}: expected silhouettes that fix their scales, got "
            f"{np.round(scale, 2).tolist()}; check the view bins"
        )
    return ScaledViews(tuple(views), rotation, scale, solution[count:].reshape(count, 2))


def _tangency(
    a: int, b: int, rings: Sequence[FloatArray], rotation: FloatArray, normal: FloatArray, count: int
) -> list[FloatArray]:
    """Two equations: both silhouettes end at the same places along the normal of the plane of the views."""
    out = []
    for extreme in (np.min, np.max):
        row = np.zeros(3 * count)
        for view, sign in ((a, 1.0), (b, -1.0)):
            along = rotation[view, :2] @ normal
            row[view] = sign * float(extreme(rings[view] @ along))
            row[count + 2 * view : count + 2 * view + 2] = -sign * along
        out.append(row)
    return out
