"""Oriented planar primitives, the cross-view transforms that they induce (section 3.2), and their fits."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.arrays import FloatArray
from recon.errors import RescoreError
from recon.files import atomic_path
from recon.reading import arrays_of, reading
from recon.view_bins import ViewBins

FORMAT = "primitives 1"


@dataclass(frozen=True, eq=False)
class PrimitiveLibrary:
    """What the generic phase learned: how each oriented primitive changes between two view bins.

    Image coordinates are offsets from the primitive's centre in object units, x right and y down, under
    scaled orthographic projection.
    """

    bins: ViewBins
    """The view space that the primitives turned through."""
    normals: FloatArray
    """Unit normals, shape (k, 3), object frame; a plane has no front, so no two are opposite."""
    transform: FloatArray
    """Projective transforms (k, b, b, 3, 3) from view bin to view bin; NaN where the primitive is seen
    edge-on, or from another side."""
    residual: FloatArray
    """Root-mean-square error of each transform on the training sequences, shape (k, b, b), in
    root-mean-square radii of the shapes; NaN where there is no transform."""

    def __post_init__(self) -> None:
        k, b = len(self.normals), self.bins.count
        if self.normals.shape != (k, 3) or self.transform.shape != (k, b, b, 3, 3):
            raise ValueError(f"library: {self.normals.shape}, {self.transform.shape} for {b} view bins")
        if self.residual.shape != (k, b, b):
            raise ValueError(f"library: {self.residual.shape} residuals for {k} primitives, {b} view bins")

    def carried(self, points: FloatArray, bin_a: int, bin_b: int) -> FloatArray:
        """Points (m, 2) of bin a as each primitive carries them to bin b, shape (k, m, 2).

        NaN where there is no transform.
        """
        return apply_projective(self.transform[:, bin_a, bin_b], points)

    def save(self, path: Path) -> None:
        """Write one NPZ file of plain arrays; ``load`` gives them back in single precision."""
        with atomic_path(path) as beside, beside.open("wb") as file:
            np.savez_compressed(
                file,
                format=np.array(FORMAT),
                view_bins=np.array([self.bins.count, self.bins.elevation_rad]),
                normals=self.normals,
                # half the size, and far finer than what is learned
                transform=self.transform.astype(np.float32),
                residual=self.residual.astype(np.float32),
            )

    @staticmethod
    def load(path: Path) -> "PrimitiveLibrary":
        """Read a library.

        Raises:
            RescoreError: no such file, or something else in it.
        """
        if not path.is_file():
            raise RescoreError(f"{path}: expected a library of primitives, found no file; learn one first")
        with reading(path, f"{FORMAT!r} NPZ", "learn the primitives again"):
            file = arrays_of(path)
            if str(file["format"]) != FORMAT:
                raise ValueError(f"format {file['format']}")
            count, elevation_rad = file["view_bins"]
            bins = ViewBins(int(count), float(elevation_rad))
            transform, residual = (file[name].astype(float) for name in ("transform", "residual"))
            return PrimitiveLibrary(bins, file["normals"], transform, residual)


def primitive_normals() -> FloatArray:
    """The orientations of the library: unit normals (61, 3) in the object frame.

    Every 15 degrees around at inclinations of 0, +-30 and +-60 degrees, and level. A plane has no front, so
    half a turn is all.
    """
    azimuth = np.deg2rad(np.arange(0, 180, 15))
    rings = [
        np.stack(
            [
                np.cos(azimuth) * np.cos(tilt),
                np.sin(azimuth) * np.cos(tilt),
                np.full_like(azimuth, np.sin(tilt)),
            ],
            axis=1,
        )
        for tilt in np.deg2rad([0, 30, -30, 60, -60])
    ]
    return np.concatenate([*rings, [[0.0, 0.0, 1.0]]])


def plane_axes(normal: FloatArray) -> FloatArray:
    """Two unit axes (2, 3) in a plane: the first level, the second at right angles to it."""
    level = np.cross([0.0, 0.0, 1.0], normal)
    length = np.linalg.norm(level)
    first = level / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.stack([first, np.cross(normal, first)])


def lift(normals: FloatArray, rotation: FloatArray) -> FloatArray:
    """Matrices (k, 3, 2) from image offsets of a view to object offsets on planes through a point.

    The offset e obeys R e = u (two rows of ``rotation``) and n . e = 0. Not finite for a plane seen edge-on.
    """
    k = len(normals)
    system = np.empty((k, 3, 3))
    system[:, :2] = rotation[:2]
    system[:, 2] = normals
    facing = normals @ rotation[2]
    system[np.abs(facing) < 1e-9] = np.nan
    return np.asarray(np.linalg.inv(system)[:, :, :2])


def projective_transform(
    source: FloatArray, target: FloatArray, normal: FloatArray | None = None
) -> FloatArray:
    """The projective transform (3, 3), last entry 1, that linear regression gives for points (m, 2).

    With unit normals (m, 2), only the distances along them count: the points may slide along an outline.
    """
    x, y = source.T
    u, v = target.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows_u = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=1)
    rows_v = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=1)
    if normal is None:
        rows, value = np.concatenate([rows_u, rows_v]), np.concatenate([u, v])
    else:
        rows = normal[:, :1] * rows_u + normal[:, 1:] * rows_v
        value = (normal * target).sum(axis=1)
    solution, *_ = np.linalg.lstsq(rows, value, rcond=None)
    return np.append(solution, 1.0).reshape(3, 3)


def affine_transform(source: FloatArray, target: FloatArray) -> FloatArray:
    """The affine transform (3, 3) that linear regression gives for points (m, 2) to (m, 2)."""
    rows = np.concatenate([source, np.ones((len(source), 1))], axis=1)
    solution, *_ = np.linalg.lstsq(rows, target, rcond=None)
    return np.concatenate([solution.T, [[0.0, 0.0, 1.0]]])


def apply_projective(transform: FloatArray, points: FloatArray) -> FloatArray:
    """Points (m, 2) after projective transforms (..., 3, 3), shape (..., m, 2)."""
    moved = points @ np.swapaxes(transform[..., :2], -1, -2) + transform[..., None, :, 2]
    return np.asarray(moved[..., :2] / moved[..., 2:])


def nearest_on_outline(points: FloatArray, outline: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nearest points (..., m, 2) of a closed outline (d, 2) to points (..., m, 2), and unit normals there."""
    at = ((points[..., None, :] - outline) ** 2).sum(axis=-1).argmin(axis=-1)
    along = outline[(at + 1) % len(outline)] - outline[at - 1]
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return outline[at], normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
