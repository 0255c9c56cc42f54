"""Triangles of a reconstructed object with the photograph on them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import Delaunay, QhullError

from recon.arrays import BoolArray, Float32Array, FloatArray, IntArray, UInt8Array
from recon.camera import PinholeCamera
from recon.depth_map import DepthMap
from recon.outlines import fill_polygon
from recon.reconstruction.instance import NEAR_M, Instance3D, InstancePart
from recon.reconstruction.reconstruct import Reconstruction, fill_gaps
from reports.objects.back_side import back_side, is_compact, mirror
from reports.objects.joined_planes import JoinedPlanes, joined_planes

_MAX_CELLS = 60_000
"""Cells of the picture that an object is cut into at most; one cell a pixel where it has fewer."""
_INNER_POINTS = 32
"""Points along the longer side of a predicted part."""
_MOSTLY = 0.6
"""Share of a predicted part that must be hidden, and outside the object's body, for it to be drawn."""
_SLACK = 0.05
"""A predicted part that lies behind the body by less than this share of the box's diagonal belongs to the
body."""
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
    rgb: UInt8Array,
    found: Reconstruction,
    instance: Instance3D,
    camera: PinholeCamera,
    occluded: BoolArray | None = None,
) -> tuple[PictureMesh, ...]:
    """Meshes of an object in the camera frame: what the picture shows, and what it hides.

    Every pixel of the object stands on the plane of its part, after planes that adjoin have been joined.
    A compact object is closed by its back (``back_side``). Of others, a hidden part whose name has "left" for
    "right" (or the reverse) of a part in the picture gets that part's pixels, mirrored. Other hidden parts
    have the median colour of the object. Hidden is what lies behind the object or behind ``occluded`` pixels
    (h, w), where something else stands before it.
    """
    planes = joined_planes(found, instance, camera)
    cells = _cells_of(found, sorted(planes.inverse_depth))
    depth = _shown_depth(found, planes, camera)
    shown = set(planes.inverse_depth)
    meshes = [picture_mesh(cells, planes, instance, camera)]
    if is_compact(found.part_labels > 0):
        back = back_side(*_corners(cells, planes, camera), depth, instance, camera)
        meshes.append(PictureMesh(back.xyz_m, back.faces, back.uv_px))
        depth = _with_body(depth, back.depth_m + np.float32(_SLACK * np.linalg.norm(instance.size_m)))
    else:
        twins = _mirrored_labels(instance, shown)
        own = np.where(np.isin(cells.label, list(twins)), cells.label, 0).astype(np.uint8)
        side = picture_mesh(replace(cells, label=own), planes, instance, camera)
        meshes.append(_out_of_sight(side.moved(mirror(instance)), depth, camera, occluded))
        shown |= set(twins.values())
    colour = np.median(rgb[found.depth.window][found.part_labels > 0], axis=0).astype(int)
    for part in (p for p in instance.parts if p.label not in shown):
        points, faces = _polygon(part, _INNER_POINTS)
        whole = PictureMesh(points, faces, None, tuple(colour.tolist()))
        hidden = _out_of_sight(whole, depth, camera, occluded)
        # a part half of which would be seen is not where the class model has it, or belongs to the body
        if len(hidden.faces) > _MOSTLY * len(faces):
            meshes.append(hidden)
    return tuple(m for m in meshes if len(m.faces))


def _with_body(depth: DepthMap, back_m: Float32Array) -> DepthMap:
    """The depth of the back of an object's body, given at corners of cells, and of the front elsewhere."""
    height, width = depth.depth.shape
    body = cv2.resize(back_m, (width, height), interpolation=cv2.INTER_NEAREST)
    out = np.where(np.isfinite(depth.depth), np.fmax(depth.depth, body), np.nan)
    return replace(depth, depth=out.astype(np.float32))


def _corners(cells: "_Cells", planes: JoinedPlanes, camera: PinholeCamera) -> tuple[FloatArray, FloatArray]:
    """Corners of the cells in the picture (h + 1, w + 1, 2), and the farthest z-depth there, else NaN."""
    h, w = cells.label.shape
    u, v = np.meshgrid(np.arange(w + 1.0), np.arange(h + 1.0))
    uv = np.stack([u, v], axis=-1) * cells.step_px + [cells.x0_px, cells.y0_px]
    around = np.pad(cells.label, 1)
    touching = np.stack([around[:-1, :-1], around[:-1, 1:], around[1:, :-1], around[1:, 1:]])
    front = np.full((h + 1, w + 1), np.nan)
    for label in planes.inverse_depth:
        own = (touching == label).any(axis=0)
        front[own] = np.fmax(front[own], planes.depth_along(label, camera.rays(uv[own])))
    return uv, front


def _shown_depth(found: Reconstruction, planes: JoinedPlanes, camera: PinholeCamera) -> DepthMap:
    """Z-depth of the object's pixels on the joined planes; NaN outside."""
    out = np.full(found.part_labels.shape, np.nan, np.float32)
    for label in planes.inverse_depth:
        rows, cols = np.nonzero(found.part_labels == label)
        uv = np.stack([cols + found.x0_px, rows + found.y0_px], axis=1).astype(float)
        out[rows, cols] = planes.depth_along(label, camera.rays(uv))
    return DepthMap(found.x0_px, found.y0_px, out)


def _out_of_sight(
    mesh: PictureMesh, depth: DepthMap, camera: PinholeCamera, occluded: BoolArray | None
) -> PictureMesh:
    """A mesh without the triangles that the camera of the picture would see: it does not see them."""
    # nothing hides what lies where the picture shows no object
    cover = np.full((camera.height_px, camera.width_px), np.inf)
    cover[depth.window] = np.where(np.isfinite(depth.depth), depth.depth, np.inf)
    if occluded is not None:
        cover[occluded] = 0.0
    middle = mesh.xyz_m[mesh.faces].mean(axis=1)
    behind = middle[:, 2] > NEAR_M
    at = np.round(camera.project(np.where(behind[:, None], middle, 1.0))).astype(int)
    behind &= ((at >= 0) & (at < [camera.width_px, camera.height_px])).all(axis=1)
    behind[behind] = middle[behind, 2] > cover[at[behind, 1], at[behind, 0]]
    return replace(mesh, faces=mesh.faces[behind])


@dataclass(frozen=True, eq=False)
class _Cells:
    """Part labels of square cells of the picture."""

    label: UInt8Array
    """Shape (h, w); 0 for none."""
    x0_px: float
    """Left edge of the first column of cells, pixel-centre coordinates."""
    y0_px: float
    step_px: int


def _cells_of(found: Reconstruction, labels: Sequence[int]) -> _Cells:
    """Cells with the part on whose plane each lies; those of parts without a plane go to the nearest."""
    step = max(1, int(np.ceil(np.sqrt((found.part_labels > 0).sum() / _MAX_CELLS))))
    own = np.where(np.isin(found.part_labels, labels), found.part_labels, 0).astype(np.uint8)
    filled = fill_gaps(own, found.part_labels > 0)
    middle = slice(step // 2, None, step)
    return _Cells(filled[middle, middle], found.x0_px - 0.5, found.y0_px - 0.5, step)


def picture_mesh(
    cells: _Cells, planes: JoinedPlanes, instance: Instance3D, camera: PinholeCamera
) -> PictureMesh:
    """Every labelled cell as a square on the plane of its part; squares of one part share their corners.

    Where cells of two parts that adjoin in 3D meet, a strip along the border closes what is left between
    their planes. Cells are a pixel or a few wide, so linear interpolation of texture coordinates stays exact
    enough.
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
    for label in planes.inverse_depth:
        own = part == label
        depth[own] = planes.depth_along(label, rays[own])
    limit = _MAX_BRIDGE * float(np.linalg.norm(instance.size_m))
    joined = np.ptp(depth[quads], axis=1) <= limit
    joined[len(key) :] &= _are_joined(part[quads[len(key) :, 0]], part[quads[len(key) :, 2]], planes)
    joined[: len(key)] = True
    quads = quads[joined]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return PictureMesh(rays * depth[:, None], faces, uv)


def _are_joined(a: IntArray, b: IntArray, planes: JoinedPlanes) -> BoolArray:
    """Whether parts (n,) and (n,) adjoin in 3D."""
    table = np.zeros((256, 256), bool)
    for pair in planes.adjoining:
        table[pair] = True
    return np.asarray(table[a, b])


def _border_strips(label: UInt8Array, corner: IntArray) -> list[IntArray]:
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


def _mirrored_labels(instance: Instance3D, shown: set[int]) -> dict[int, int]:
    """Label of the hidden part that mirrors a part in the picture, by the label of the part in the
    picture."""
    by_name = {p.name: p.label for p in instance.parts}
    out = {}
    for name, label in by_name.items():
        swapped = name.replace("left", "right") if "left" in name else name.replace("right", "left")
        other = by_name.get(swapped)
        if label in shown and swapped != name and other is not None and other not in shown:
            out[label] = other
    return out


def _polygon(part: InstancePart, inner: int) -> tuple[FloatArray, IntArray]:
    """A part's polygon as triangles: points (n, 3) and indices (m, 3); none where it has no area.

    With ``inner`` points along its longer side inside it, so that triangles are small.
    """
    axes = np.linalg.svd(part.plane[None, :3])[2][1:]
    flat = part.outline_m @ axes.T
    low, size = flat.min(axis=0), max(float(np.ptp(flat, axis=0).max()), 1e-9)
    filled = fill_polygon((flat - low) / size * 255, 256, 256)

    def inside(points: FloatArray) -> BoolArray:
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
