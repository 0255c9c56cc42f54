"""Triangles of a reconstructed object with the photograph on them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from recon.camera import PinholeCamera
from recon.depth_map import DepthMap
from recon.instance import NEAR_M, Instance3D, InstancePart, picture_depth
from recon.outlines import fill_polygon
from recon.reconstruct import Reconstruction, fill_gaps

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MAX_CELLS = 60_000
"""Cells of the picture that an object is cut into at most; one cell a pixel where it has fewer."""
_MIN_CAST_SINE = float(np.sin(np.deg2rad(8.0)))
"""A polygon that is seen at a smaller angle (sine) has too few pixels to carry the picture."""
_INNER_POINTS = 32
"""Points along the longer side of a predicted part."""
_MAX_BRIDGE = 0.2
"""Parts that adjoin in the picture are joined over gaps up to this share of the box's diagonal."""


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


def object_meshes(
    rgb: NDArray[np.uint8], found: Reconstruction, instance: Instance3D, camera: PinholeCamera
) -> tuple[PictureMesh, ...]:
    """Meshes of an object in the camera frame: what the picture shows, its mirror image, and hidden parts.

    Seen parts carry their pixels. A predicted part that is in the picture is a polygon with the picture cast
    onto it, or of the median colour of its pixels where they are too few, edge-on; pixels that no cast covers
    stand on the plane beside them. A hidden part whose name has "left" for "right" (or the reverse) of a seen
    part gets that part's pixels, mirrored; the others have the median colour of the object.
    """
    pixels = found.part_labels
    seen = [p.label for p in instance.parts if p.seen]
    behind = [p for p in instance.parts if not p.seen and (pixels == p.label).any()]
    cast = [p for p in behind if p.facing_sine >= _MIN_CAST_SINE]
    cells, of_seen = _cells_of(found, seen, _covered(cast, found, camera))
    twins = _mirrored_labels(instance, seen, set(pixels.ravel().tolist()))
    meshes = [picture_mesh(cells, instance, camera)]
    hidden = []
    if twins:
        own = np.where(np.isin(of_seen, list(twins)), of_seen, 0)
        side = picture_mesh(replace(cells, label=own), instance, camera)
        hidden.append(side.moved(_mirror(instance)))
    meshes += [m for p in cast if (m := _cast_mesh(p, found, camera)) is not None]
    done = {*seen, *twins.values(), *(p.label for p in cast)}
    window = rgb[found.depth.window]
    for part in (p for p in instance.parts if p.label not in done):
        of = pixels == part.label if part in behind else pixels > 0
        red, green, blue = np.median(window[of], axis=0).astype(int).tolist()
        points, faces = _polygon(part, _INNER_POINTS)
        (meshes if part in behind else hidden).append(PictureMesh(points, faces, None, (red, green, blue)))
    depth = picture_depth(found, instance, camera)
    meshes += [_out_of_sight(mesh, depth, camera) for mesh in hidden]
    return tuple(m for m in meshes if len(m.faces))


def _out_of_sight(mesh: PictureMesh, depth: DepthMap, camera: PinholeCamera) -> PictureMesh:
    """A mesh without the triangles that the camera of the picture would see: it does not see them."""
    middle = mesh.xyz_m[mesh.faces].mean(axis=1)
    ahead = middle[:, 2] > NEAR_M
    at = np.round(camera.project(np.where(ahead[:, None], middle, 1.0))).astype(int)
    at -= np.array([depth.x0_px, depth.y0_px])
    h, w = depth.depth.shape
    behind = ahead & ((at >= 0) & (at < [w, h])).all(axis=1)
    # NaN outside the object makes the comparison False
    behind[behind] = middle[behind, 2] > depth.depth[at[behind, 1], at[behind, 0]]
    return replace(mesh, faces=mesh.faces[behind])


def _covered(
    parts: Sequence[InstancePart], found: Reconstruction, camera: PinholeCamera
) -> NDArray[np.bool_]:
    """Pixels of the object's window (h, w) that polygons of parts cover."""
    shape = found.part_labels.shape
    out = np.zeros(shape, bool)
    for part in parts:
        if part.outline_m[:, 2].min() > NEAR_M:
            corner = np.array([found.x0_px, found.y0_px])
            out |= fill_polygon(camera.project(part.outline_m) - corner, *shape)
    return out


def _cast_mesh(part: InstancePart, found: Reconstruction, camera: PinholeCamera) -> PictureMesh | None:
    """A predicted part's polygon with the picture cast onto it.

    What would take its colour from outside the object takes that of the nearest of the part's own pixels.
    """
    points, faces = _polygon(part, _INNER_POINTS)
    if not len(faces) or points[:, 2].min() <= NEAR_M:
        return None
    corner = np.array([found.x0_px, found.y0_px], float)
    at = camera.project(points)
    own = found.part_labels == part.label
    rows, cols = np.nonzero(own)
    whole = np.round(at - corner).astype(int)
    h, w = own.shape
    inside = ((whole >= 0) & (whole < [w, h])).all(axis=1)
    inside[inside] = found.part_labels[whole[inside, 1], whole[inside, 0]] > 0
    pixels = np.stack([cols, rows], axis=1) + corner
    nearest = pixels[cKDTree(pixels).query(at)[1]]
    return PictureMesh(points, faces, np.where(inside[:, None], at, nearest))


@dataclass(frozen=True, eq=False)
class _Cells:
    """Part labels of square cells of the picture."""

    label: NDArray[np.uint8]
    """Shape (h, w); 0 for none."""
    x0_px: float
    """Left edge of the first column of cells, pixel-centre coordinates."""
    y0_px: float
    step_px: int


def _cells_of(
    found: Reconstruction, seen: Sequence[int], covered: NDArray[np.bool_]
) -> tuple[_Cells, NDArray[np.uint8]]:
    """Cells with the part on whose plane each lies, and the label of each cell that is of a seen part.

    Cells of other parts go to the nearest seen part, unless they are covered.
    """
    labels = found.part_labels
    step = max(1, int(np.ceil(np.sqrt((labels > 0).sum() / _MAX_CELLS))))
    own = np.where(np.isin(labels, seen), labels, 0).astype(np.uint8)
    filled = np.where((own == 0) & covered, 0, fill_gaps(own, labels > 0)).astype(np.uint8)
    middle = slice(step // 2, None, step)
    return _Cells(filled[middle, middle], found.x0_px - 0.5, found.y0_px - 0.5, step), own[middle, middle]


def picture_mesh(cells: _Cells, instance: Instance3D, camera: PinholeCamera) -> PictureMesh:
    """Every labelled cell as a square on the plane of its part; squares of one part share their corners.

    Where cells of two parts adjoin, a strip along the border joins their planes, unless they are far apart.
    Cells are a pixel or a few wide, so linear interpolation of texture coordinates stays exact enough.
    """
    h, w = cells.label.shape
    corner = np.arange((h + 1) * (w + 1)).reshape(h + 1, w + 1)
    squares = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1)
    use = cells.label > 0
    # a vertex is a corner of the grid on the plane of one part
    key = cells.label[use].astype(np.int64)[:, None] * corner.size + squares[use]
    strips = [key, *_border_strips(cells.label, corner)]
    keys, quads = np.unique(np.concatenate(strips), return_inverse=True)
    quads = quads.reshape(-1, 4)
    part, at = keys // corner.size, keys % corner.size
    uv = np.stack([at % (w + 1), at // (w + 1)], axis=1) * float(cells.step_px)
    uv += np.array([cells.x0_px, cells.y0_px])
    rays = camera.rays(uv)
    depth = np.full(len(keys), np.nan)
    for p in instance.parts:
        own = part == p.label
        depth[own] = p.depth_along(rays[own])
    limit = _MAX_BRIDGE * float(np.linalg.norm(instance.size_m))
    joined = np.ptp(depth[quads], axis=1) <= limit
    joined[: len(key)] = np.isfinite(depth[quads[: len(key)]]).all(axis=1)
    quads = quads[joined]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return PictureMesh(rays * depth[:, None], faces, uv)


def _border_strips(label: NDArray[np.uint8], corner: IntArray) -> list[IntArray]:
    """Keys (m, 4) of squares between the two planes along each edge between cells of different parts."""
    strips = []
    pairs = (
        (label[:, :-1], label[:, 1:], corner[:-1, 1:-1], corner[1:, 1:-1]),
        (label[:-1], label[1:], corner[1:-1, 1:], corner[1:-1, :-1]),
    )
    for a, b, start, end in pairs:
        use = (a != b) & (a > 0) & (b > 0)
        on_a, on_b = a[use].astype(np.int64) * corner.size, b[use].astype(np.int64) * corner.size
        s, e = start[use], end[use]
        strips.append(np.stack([on_a + s, on_a + e, on_b + e, on_b + s], axis=1))
    return strips


def _mirrored_labels(instance: Instance3D, seen: Sequence[int], in_picture: set[int]) -> dict[int, int]:
    """Label of each seen part and that of the hidden part on the other side that looks like it."""
    by_name = {p.name: p.label for p in instance.parts}
    out = {}
    for name, label in by_name.items():
        swapped = name.replace("left", "right") if "left" in name else name.replace("right", "left")
        other = by_name.get(swapped)
        if label in seen and swapped != name and other is not None and other not in seen:
            out[label] = other
    return {a: b for a, b in out.items() if b not in in_picture}


def _mirror(instance: Instance3D) -> FloatArray:
    """Reflection (4, 4) of the camera frame in the object's upright middle plane."""
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    return np.asarray(instance.cam_from_object @ flip @ np.linalg.inv(instance.cam_from_object))


def _polygon(part: InstancePart, inner: int) -> tuple[FloatArray, IntArray]:
    """A part's polygon as triangles: points (n, 3) and indices (m, 3); none where it has no area.

    With ``inner`` points along its longer side inside it, so that triangles are small.
    """
    axes = np.linalg.svd(part.plane[None, :3])[2][1:]
    flat = part.outline_m @ axes.T
    low, size = flat.min(axis=0), max(float(np.ptp(flat, axis=0).max()), 1e-9)
    filled = fill_polygon((flat - low) / size * 255, 256, 256)

    def inside(points: FloatArray) -> NDArray[np.bool_]:
        cols, rows = np.clip(np.round((points - low) / size * 255), 0, 255).astype(int).T
        return np.asarray(filled[rows, cols])

    x, y = np.meshgrid(*(low + size * (np.arange(inner)[:, None] + 0.5) / inner).T)
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    flat = np.concatenate([flat, grid[inside(grid)]])
    try:
        triangles = Delaunay(flat).simplices.astype(np.int64)
    except QhullError:
        return part.outline_m, np.zeros((0, 3), np.int64)
    on_plane = flat @ axes - part.plane[3] * part.plane[:3]
    return on_plane, triangles[inside(flat[triangles].mean(axis=1))]
