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
from reports.objects.fill_in import filled_in
from reports.objects.hull_mesh import hull_meshes
from reports.objects.joined_planes import JoinedPlanes, joined_planes
from reports.objects.part_colours import part_colours
from reports.objects.picture_mesh import PictureMesh
from reports.objects.solid_mesh import solid_mesh
from rescore.library.single_picture import FoundObject

TexturedMesh = tuple[PictureMesh, UInt8Array]
"""A mesh and the picture that its texture coordinates refer to."""
_BLUR_PX = 1.5
"""Width of the rim inside an outline which the blur of the camera mixes with the background."""
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


def object_layers(rgb: UInt8Array, one: FoundObject, camera: PinholeCamera) -> tuple[TexturedMesh, ...]:
    """Meshes of an object in the camera frame, each with its picture: what is seen of it, and what is not.

    An object whose closed shape is known is that shape (``solid_mesh``). Of others, every pixel of the matte
    stands on the plane of its part, after planes that adjoin have been joined. A compact object is closed by
    its back (``back_side``); otherwise a hidden part whose name has "left" for "right" (or the reverse) of a
    part in the picture gets that part's pixels, mirrored. All else has the plain colour of its part. Hidden
    is what lies behind the object or behind pixels where something else stands before it.

    Args:
        rgb: the photograph, shape (h, w, 3).
        one: the object.
        camera: M.
    """
    texture = object_texture(rgb, one)
    if one.shape is not None:
        names = {p.label: p.name for p in one.instance.parts}
        if one.shape.space.is_thin:
            meshes = hull_meshes(texture, one.matte, one.shape, camera, names)
            return tuple((mesh, texture) for mesh in meshes)
        return (solid_mesh(texture, one.matte, one.shape, camera, names),)
    return tuple((mesh, texture) for mesh in _planar_meshes(texture, one, camera))


def _planar_meshes(texture: UInt8Array, one: FoundObject, camera: PinholeCamera) -> list[PictureMesh]:
    """Parts on their planes, and what they hide."""
    found, instance = one.picture, one.instance
    planes = joined_planes(found, instance, camera)
    cells = _cells_of(one, sorted(planes.inverse_depth))
    depth = _shown_depth(found, planes, camera)
    window = found.depth.window
    names = {p.label: p.name for p in instance.parts}
    own = one.matte[window] > 0.5
    colours = part_colours(texture[window][own], found.part_labels[own], names)
    shown = set(planes.inverse_depth)
    meshes = [picture_mesh(cells, planes, instance, camera)]
    if is_compact(found.part_labels > 0):
        back = back_side(*_corners(cells, planes, camera), depth, instance, camera)
        meshes.append(PictureMesh(back.xyz_m, back.faces[back.mirrored], back.uv_px))
        meshes.append(PictureMesh(back.xyz_m, back.faces[~back.mirrored], None, colours[0]))
        depth = _with_body(depth, back.depth_m + np.float32(_SLACK * np.linalg.norm(instance.size_m)))
    else:
        twins = _mirrored_labels(instance, shown)
        own_label = np.where(np.isin(cells.label, list(twins)), cells.label, 0).astype(np.uint8)
        side = picture_mesh(replace(cells, label=own_label), planes, instance, camera)
        meshes.append(_out_of_sight(side.moved(mirror(instance)), depth, camera, one.occluded))
        shown |= set(twins.values())
    for part in (p for p in instance.parts if p.label not in shown):
        points, faces = _polygon(part, _INNER_POINTS)
        whole = PictureMesh(points, faces, None, colours[part.label])
        hidden = _out_of_sight(whole, depth, camera, one.occluded)
        # a part half of which would be seen is not where the class model has it, or belongs to the body
        if len(hidden.faces) > _MOSTLY * len(faces):
            meshes.append(hidden)
    return [m for m in meshes if len(m.faces)]


def object_texture(rgb: UInt8Array, one: FoundObject) -> UInt8Array:
    """The picture (h, w, 3) that an object carries: what hides it is filled in from around.

    Outside the object, and in the rim which the blur of the camera mixes with the background, it has the
    colours of the nearest pixels inside.
    """
    inside = one.matte > 0.5
    if one.occluded is not None:
        rgb = filled_in(rgb, cv2.dilate(one.occluded.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
        inside |= one.occluded & fill_polygon(one.picture.outline_px, *inside.shape)
    deep = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # the middle of thin limbs counts as inside
    ridge = (deep > 0) & (deep >= cv2.dilate(deep, np.ones((3, 3), np.uint8)))
    good = (deep > _BLUR_PX) | ridge
    if not good.any():
        return rgb
    _, nearest = cv2.distanceTransformWithLabels(
        (~good).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    colour = np.zeros((int(nearest.max()) + 1, 3), np.uint8)
    colour[nearest[good]] = rgb[good]
    return np.where(good[..., None], rgb, colour[nearest])


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


def _cells_of(one: FoundObject, labels: Sequence[int]) -> _Cells:
    """Cells of the matte with the part on whose plane each lies: its own, else the nearest with a plane."""
    found = one.picture
    # pixels behind something else are the object's too
    inside = one.matte[found.depth.window] > 0.5
    if one.occluded is not None:
        inside |= one.occluded[found.depth.window] & (found.part_labels > 0)
    step = max(1, int(np.ceil(np.sqrt(inside.sum() / _MAX_CELLS))))
    own = np.where(np.isin(found.part_labels, labels), found.part_labels, 0).astype(np.uint8)
    filled = fill_gaps(own, inside)
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
