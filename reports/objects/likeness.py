"""How like the truth a pop-up looks: from the photograph's own camera, and from beside it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from recon.arrays import BoolArray, FloatArray, UInt8Array
from recon.camera import PinholeCamera
from recon.outlines import fill_polygon
from reports.objects.mesh_files import MeshView
from reports.objects.object_mesh import TexturedMesh
from reports.objects.popup import Layer
from rescore.library.single_picture import FoundObject, Photo

_GREY = 128


@dataclass(frozen=True)
class Likeness:
    """An object seen from one camera, beside the truth."""

    overlap: float
    """Intersection over union of the two silhouettes, in [0, 1]."""
    similarity: float
    """Mean structural similarity where either shows the object, on plain grey, in [-1, 1]."""


def likeness(
    layers: Sequence[TexturedMesh],
    camera: PinholeCamera,
    cam_from_mesh: FloatArray,
    rgb: UInt8Array,
    mask: BoolArray,
) -> Likeness:
    """Likeness of an object's meshes to a true picture (h, w, 3) in which it fills a mask (h, w).

    Args:
        layers: the meshes of the object alone, each with its picture.
        camera: the camera of the true picture.
        cam_from_mesh: (4, 4) from the frame of the meshes to that of the camera.
        rgb: the true picture.
        mask: where it shows the object.
    """
    made, hit = MeshView(layers).picture(camera, cam_from_mesh, (_GREY, _GREY, _GREY))
    either = hit | mask
    true = np.where(mask[..., None], rgb, np.uint8(_GREY))
    alike = structural_similarity(_grey(true), _grey(made))
    return Likeness(float((hit & mask).sum() / max(either.sum(), 1)), float(alike[either].mean()))


def _grey(rgb: UInt8Array) -> UInt8Array:
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def source_similarity(photo: Photo, objects: Sequence[FoundObject], layers: Sequence[Layer]) -> float:
    """Mean structural similarity, inside the outlines, of the picture and the scene seen from its camera."""
    again, _ = MeshView([(mesh, rgb) for _, mesh, rgb in layers]).picture(photo.seen_from.camera, np.eye(4))
    height, width = photo.rgb.shape[:2]
    inside = np.zeros((height, width), bool)
    for one in objects:
        inside |= fill_polygon(one.picture.outline_px, height, width)
    for one in objects:
        if one.occluded is not None:
            inside &= ~one.occluded
    grey = [np.asarray(cv2.cvtColor(p, cv2.COLOR_RGB2GRAY), np.uint8) for p in (photo.rgb, again)]
    return float(structural_similarity(grey[0], grey[1])[inside].mean())


def structural_similarity(a: UInt8Array, b: UInt8Array) -> FloatArray:
    """SSIM (h, w), in [-1, 1], of two grey pictures (h, w); Gaussian windows of sigma 1.5 pixels."""
    x, y = a.astype(float), b.astype(float)

    def mean(picture: FloatArray) -> FloatArray:
        return np.asarray(cv2.GaussianBlur(picture, (11, 11), 1.5, borderType=cv2.BORDER_REFLECT))

    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    mx, my = mean(x), mean(y)
    vx, vy, vxy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    return np.asarray((2 * mx * my + c1) * (2 * vxy + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2)))
