"""Where a registered prediction lies: in the picture and in the world, over the measured points.

The world frame of pictures in 3D stands on the ground under the left eye: x right, y forward, z up, metres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.arrays import Float32Array, FloatArray, UInt8Array
from recon.camera import GroundPlane, PinholeCamera
from recon.depth_map import DepthMap
from rescore.evidence.align_depth import DepthAlignment, predicted_region

_MAX_TEAR = 0.08
"""A mesh is torn where neighbouring depths differ by more than this share of the depth."""


@dataclass(frozen=True, eq=False)
class PartMesh:
    """A surface of labelled points."""

    xyz_m: FloatArray
    """Vertices (n, 3)."""
    triangles: NDArray[np.uint32]
    """Vertex indices (m, 3)."""
    label: UInt8Array
    """Part label of each vertex, shape (n,)."""


def world_from_camera(ground: GroundPlane) -> FloatArray:
    """The 4 x 4 transform from the camera frame (x right, y down, z forward) to the world frame."""
    up = ground.up
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    forward /= np.linalg.norm(forward)
    transform = np.eye(4)
    transform[:3, :3] = [np.cross(forward, up), forward, up]
    transform[2, 3] = ground.height_m
    return transform


def apply_transform(transform: FloatArray, xyz: FloatArray) -> FloatArray:
    """Points (..., 3) moved by a 4 x 4 transform."""
    return xyz @ transform[:3, :3].T + transform[:3, 3]


def registered_depth(predicted: DepthMap, alignment: DepthAlignment, inverse: bool = False) -> Float32Array:
    """Predicted depth (h, w) in the unit of the measured one: a1 and a2 of eq. 6, normalisation undone.

    ``inverse``: eq. 6 was solved in inverse depth; what it puts beyond infinity becomes NaN.
    """
    normalised = alignment.scale * predicted.depth.astype(float) + alignment.offset
    registered = normalised * alignment.stereo_span + alignment.stereo_low
    if inverse:
        registered = 1 / np.where(registered > 0, registered, np.nan)
    return registered.astype(np.float32)


def registered_relief(
    predicted: DepthMap, measured: Float32Array, xyxy_px: FloatArray, scale: float
) -> Float32Array | None:
    """Predicted depth (h, w) in the unit of the measured one, by the fit of ``rescore.evidence.guarded``.

    The predicted relief of inverse depth, times the scale, is laid on the measured one of the whole picture
    ``measured`` in the box, median on median. None where nothing was measured there.
    """
    seen = measured[predicted.window].astype(float)
    use = predicted_region(predicted, xyxy_px) & np.isfinite(seen) & (seen > 0)
    if not use.any():
        return None
    inverse = 1 / predicted.depth.astype(float)
    relief = inverse / np.median(inverse[use]) - 1
    middle = np.median(1 / seen[use])
    offset = np.median(1 / seen[use] / middle - 1 - scale * relief[use])
    fitted = middle * (1 + scale * relief + offset)
    # NaN outside the object compares False
    return np.where(fitted > 0.05 * middle, 1 / np.where(fitted > 0, fitted, 1), np.nan).astype(np.float32)


def points_of_depth(
    depth: NDArray[np.floating], camera: PinholeCamera, x0_px: int = 0, y0_px: int = 0
) -> FloatArray:
    """Camera-frame points (h, w, 3) of a depth window with first pixel ``(x0_px, y0_px)``; NaN in holes."""
    h, w = depth.shape
    v, u = np.mgrid[y0_px : y0_px + h, x0_px : x0_px + w].astype(float)
    return camera.rays(np.stack([u, v], axis=-1)) * depth[..., None]


def part_mesh(
    depth: NDArray[np.floating],
    labels: UInt8Array,
    camera: PinholeCamera,
    corner_px: tuple[int, int] = (0, 0),
    max_vertices: int = 600,
) -> PartMesh:
    """The registered prediction as a surface in the camera frame, thinned to about ``max_vertices`` vertices.

    Args:
        depth: registered depth (h, w), NaN outside the object.
        labels: part labels (h, w) of the same pixels.
        camera: the left eye.
        corner_px: column and row of the first pixel.
        max_vertices: the picture is thinned by whole rows and columns until it has no more pixels than this.
    """
    seen = np.isfinite(depth) & (depth > 0)
    step = max(1, int(np.ceil(np.sqrt(seen.sum() / max_vertices))))
    points = points_of_depth(depth, camera, *corner_px)[::step, ::step]
    seen, thin = seen[::step, ::step], np.where(seen, depth, np.nan)[::step, ::step]
    index = np.cumsum(seen.ravel()).reshape(seen.shape) - 1
    corners = [(slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None))]
    corners += [(slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1))]
    quad_depth = np.stack([thin[c] for c in corners])
    # NaN in any corner makes the comparison False
    whole = np.ptp(quad_depth, axis=0) <= _MAX_TEAR * quad_depth[0]
    a, b, c, d = (index[corner][whole] for corner in corners)
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.uint32)
    return PartMesh(points[seen], triangles, labels[::step, ::step][seen])


def merge_meshes(meshes: list[PartMesh]) -> PartMesh:
    """One mesh of several; empty where there is none."""
    first = np.cumsum([0, *(len(m.xyz_m) for m in meshes)])
    return PartMesh(
        np.concatenate([np.zeros((0, 3)), *(m.xyz_m for m in meshes)]),
        np.concatenate(
            [
                np.zeros((0, 3), np.uint32),
                *(m.triangles + np.uint32(f) for m, f in zip(meshes, first[:-1], strict=True)),
            ]
        ),
        np.concatenate([np.zeros(0, np.uint8), *(m.label for m in meshes)]),
    )


def stereo_points(
    depth_m: NDArray[np.floating],
    rgb: UInt8Array,
    camera: PinholeCamera,
    xyxy_px: FloatArray,
    max_points: int = 20_000,
    max_depth_m: float = 60.0,
) -> tuple[FloatArray, UInt8Array]:
    """Measured points (n, 3) in the camera frame and their colours (n, 3), thinned on a pixel grid.

    Half of them come from boxes (k, 4), which are looked at closely, and half from the whole picture.
    """
    h, w = depth_m.shape
    boxed = np.zeros((h, w), bool)
    for x0, y0, x1, y1 in np.clip(np.rint(xyxy_px).astype(int), 0, [w, h, w, h]):
        boxed[y0:y1, x0:x1] = True
    keep = np.zeros((h, w), bool)
    for region, count in ((np.ones((h, w), bool), depth_m.size), (boxed, int(boxed.sum()))):
        step = max(1, int(np.ceil(np.sqrt(count / (max_points / 2)))))
        grid = np.zeros((h, w), bool)
        grid[::step, ::step] = True
        keep |= grid & region
    keep &= np.isfinite(depth_m) & (depth_m < max_depth_m)
    v, u = np.nonzero(keep)
    return camera.rays(np.stack([u, v], axis=-1).astype(float)) * depth_m[keep][:, None], rgb[keep]


def oriented_box(
    points_m: FloatArray, cam_from_object: FloatArray, extents: FloatArray | None, middle_ray: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Centre (3,) in the camera frame and half sizes (3,) along the object's axes of a box around points.

    Of a picture only the near side is seen. Along each axis the box begins where the points do on the
    camera's side, and is as long as the object is in proportion to its longest side, which is seen.

    Args:
        points_m: the registered points (n, 3), camera frame.
        cam_from_object: the object's axes as columns (3, 3).
        extents: size of the class along its axes (3,), any unit; None to take the points alone.
        middle_ray: from the camera to the object (3,).
    """
    own = points_m @ cam_from_object
    low, high = np.percentile(own, [2, 98], axis=0)
    if extents is not None:
        away = middle_ray @ cam_from_object
        longest = int(np.argmax(extents * (1 - np.abs(away) / np.linalg.norm(away))))
        missing = np.maximum(extents * (high - low)[longest] / extents[longest] - (high - low), 0)
        high, low = high + np.where(away >= 0, missing, 0), low - np.where(away < 0, missing, 0)
    return cam_from_object @ ((low + high) / 2), (high - low) / 2
