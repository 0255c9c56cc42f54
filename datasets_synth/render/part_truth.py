"""Truth of the parts of a mesh: where each is, and the plane that best stands for it."""

from dataclasses import dataclass

import numpy as np

from datasets_synth.meshes.mesh import Mesh
from recon.arrays import BoolArray, FloatArray

ONE_SIDED = 0.1
"""The mean outward normal must have this component along the plane's normal to give it a sign."""
ELONGATED = 1 / 3
"""A part whose second spread is below this share of its first may be elongated."""
FLAT = 0.5
"""A planarity below this leaves the normal of a part to chance."""


@dataclass(frozen=True, eq=False)
class PartTruth:
    """One part of a mesh, in the object frame."""

    centroid_m: FloatArray
    """Area-weighted middle of the surface, shape (3,)."""
    normal: FloatArray
    """Unit normal of the best plane, shape (3,); see ``part_truth``."""
    one_sided: bool
    """Whether the sign of the normal means something: the part is seen from one side only, to which the
    normal points. Otherwise its largest component is positive."""
    spread_m: FloatArray
    """Standard deviations of the surface along its principal axes, shape (3,), largest first."""

    @property
    def planarity(self) -> float:
        """How flat the part is, in [0, 1]: 1 for a flat part, 0 for one whose two small axes are equal (a
        rod, a ball)."""
        return float(1 - self.spread_m[2] / max(self.spread_m[1], 1e-12))

    @property
    def is_elongated(self) -> bool:
        """Whether the part is a rod (two small axes of similar size), whose normal means little."""
        return bool(self.spread_m[1] < ELONGATED * self.spread_m[0]) and self.planarity < FLAT


def part_truth(mesh: Mesh) -> dict[int, PartTruth]:
    """The truth of each part that has faces, by label.

    The normal is the axis along which the area-weighted surface spreads least: that of the plane with the
    least mean squared distance to the surface. One definition serves closed parts (a seat, a wheel), whose
    outward normals cancel, and parts seen from one side (the side of a car). Where the area-weighted mean
    outward normal has a component of more than ``ONE_SIDED`` along the axis, the normal points that way.
    The integrals over the triangles are exact.

    Args:
        mesh: In any frame, in which the truth is given. ``ObjectClass.labelled_mesh`` makes see-through
            parts the solid ones that labelled views show.
    """
    return {int(label): _truth(mesh, mesh.face_part == label) for label in np.unique(mesh.face_part) if label}


def _truth(mesh: Mesh, chosen: BoolArray) -> PartTruth:
    p = mesh.vertices_m[mesh.faces[chosen]].astype(np.float64)
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    weight = area / area.sum()
    centroid = weight @ p.mean(axis=1)
    q = p - centroid
    total = q.sum(axis=1)
    # the second moment of a triangle is its area / 12 times (sum of v v' + (sum of v)(sum of v)')
    moment = (np.einsum("n,nki,nkj->ij", weight, q, q) + np.einsum("n,ni,nj->ij", weight, total, total)) / 12
    variance, axes = np.linalg.eigh(moment)
    normal = axes[:, 0]
    outward = float((cross.sum(axis=0) / 2 / area.sum()) @ normal)
    one_sided = abs(outward) > ONE_SIDED
    sign = outward if one_sided else normal[np.argmax(np.abs(normal))]
    spread = np.sqrt(np.clip(variance[::-1], 0, None))
    return PartTruth(centroid, normal * np.sign(sign), one_sided, spread)
