"""Limbs that the photograph shows and a fitted shape has not, as sheets beside what the shape has.

A shape space has the tubes of its training instances; those of another bicycle lie a little aside. Pixels of
the matte that the surface leaves bare stand at the depth of the surface nearest to them in the picture.
"""

import cv2
import numpy as np
import open3d as o3d

from recon.arrays import BoolArray, Float32Array, FloatArray
from recon.camera import PinholeCamera
from recon.localization.shape_fit import FittedShape
from reports.objects.picture_mesh import PictureMesh

_TORN = 0.1
"""A sheet ends where its depth changes from pixel to pixel by more than this share of the object's size."""
_LOWEST = 0.05
"""Nothing of an object lies lower than this, in shares of its height: what seems to is its shadow."""


def limb_sheets(
    matte: Float32Array,
    scene: o3d.t.geometry.RaycastingScene,
    shape: FittedShape,
    camera: PinholeCamera,
) -> PictureMesh | None:
    """Pixels of a matte (h, w) that show no surface of a scene, as a mesh in the camera frame; None for none.

    Args:
        matte: how much of each pixel is the object.
        scene: the surface of the shape, camera frame.
        shape: the fitted shape.
        camera: M.
    """
    own = matte > 0.5
    depth = _depths(own, scene, camera)
    covered = np.isfinite(depth)
    if not covered.any():
        return None
    _, nearest = cv2.distanceTransformWithLabels(
        (~covered).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    by_label = np.zeros(int(nearest.max()) + 1)
    by_label[nearest[covered]] = depth[covered]
    return _mesh(own & ~covered, by_label[nearest], shape, camera)


def _depths(own: BoolArray, scene: o3d.t.geometry.RaycastingScene, camera: PinholeCamera) -> FloatArray:
    """Depth z of the surface at the pixels (h, w) of the object; infinite where there is none."""
    out = np.full(own.shape, np.inf)
    rows, columns = np.nonzero(own)
    ray = camera.rays(np.stack([columns, rows], axis=1).astype(float))
    rays = np.concatenate([np.zeros_like(ray), ray], axis=1).astype(np.float32)
    out[rows, columns] = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))["t_hit"].numpy()
    return out


def _mesh(
    bare: BoolArray, depth: FloatArray, shape: FittedShape, camera: PinholeCamera
) -> PictureMesh | None:
    """Squares of pixels (h, w) at their depths; corners have the mean of the depths around them."""
    height, width = bare.shape
    at_corner = cv2.blur(np.pad(depth, 1, mode="edge"), (2, 2), anchor=(1, 1))[1:, 1:]
    v, u = np.mgrid[: height + 1, : width + 1] - 0.5
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    xyz = camera.rays(uv) * at_corner.reshape(-1, 1)
    index = np.arange(len(uv)).reshape(height + 1, width + 1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)[bare]
    back = np.linalg.inv(shape.cam_from_object)
    above = (xyz @ back[2, :3] + back[2, 3]) > _LOWEST * shape.size_m[2]
    whole = np.ptp(xyz[quads, 2], axis=1) < _TORN * float(np.linalg.norm(shape.size_m))
    quads = quads[whole & above[quads].all(axis=1)]
    if not len(quads):
        return None
    return PictureMesh(xyz, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), uv)
