"""What the gallery of reconstructions shows: class models from train shapes, photographs of test shapes."""

from dataclasses import dataclass, replace

import numpy as np

from datasets_synth.objects.object_classes import object_class
from datasets_synth.photos.single_object import ObjectPhoto, Viewpoint, photograph
from recon.arrays import BoolArray, FloatArray
from recon.camera import PinholeCamera
from recon.class_model import ClassModel
from recon.part_views import PartView

CAMERA = PinholeCamera(560.0, 560.0, 239.5, 179.5, 480, 360)
_JITTER_RAD = float(np.deg2rad(8.0))
"""Objects are seen from up to this angle beside the middle of their view bin."""
_BASKET_BIN = 8
_CARD_RGB = (176, 160, 132)
_CARD_MARGIN_PX = 4


@dataclass(frozen=True, eq=False)
class OccludedBasket:
    """A basket whose handle is behind a card."""

    shape_id: str
    photo: ObjectPhoto
    """Photograph of the basket with the card before its handle."""
    card: BoolArray
    """Pixels of the card, shape (h, w)."""
    xyxy_px: FloatArray
    """Box of what is to be seen of the basket, pixel edges, shape (4,)."""
    view_bin: int
    handle: int
    """Label of the handle."""
    handle_middle_m: FloatArray
    """Middle of its true box along the camera's axes, shape (3,), camera frame."""


def gallery_photo(name: str, view_bin: int, seed: int) -> tuple[str, ObjectPhoto]:
    """Name of a test shape and its photograph from a view bin; another shape for each bin."""
    shown = object_class(name)
    rng = np.random.default_rng([seed, view_bin])
    shape = shown.test[view_bin % len(shown.test)]
    azimuth = shown.bins.azimuth_rad(view_bin) + float(rng.uniform(-_JITTER_RAD, _JITTER_RAD))
    setting = "room" if shown.indoors and view_bin % 2 else "street"
    viewpoint = Viewpoint(azimuth, shown.elevation_rad)
    return shape.shape_id, photograph(shown, shape, viewpoint, CAMERA, rng, setting)


def occluded_basket(seed: int) -> OccludedBasket:
    """A basket of the test shapes on whose handle a card hides every pixel."""
    shown = object_class("basket")
    shape_id, photo = gallery_photo("basket", _BASKET_BIN, seed)
    handle = shown.part_names.index("handle") + 1
    rows, cols = np.nonzero(photo.part_labels == handle)
    card = np.zeros(photo.mask.shape, bool)
    margin = _CARD_MARGIN_PX
    top, left = max(rows.min() - margin, 0), max(cols.min() - margin, 0)
    card[top : rows.max() + margin + 1, left : cols.max() + margin + 1] = True
    rgb = photo.rgb.copy()
    rgb[card] = _CARD_RGB
    body = (photo.part_labels > 0) & ~card
    rows, cols = np.nonzero(body)
    box = np.array([cols.min(), rows.min(), cols.max() + 1, rows.max() + 1], float)
    points = photo.mesh.vertices_m[np.unique(photo.mesh.faces[photo.mesh.face_part == handle])]
    in_camera = points @ photo.cam_from_object[:3, :3].T + photo.cam_from_object[:3, 3]
    middle = (in_camera.min(axis=0) + in_camera.max(axis=0)) / 2
    seen = replace(photo, rgb=rgb)
    return OccludedBasket(shape_id, seen, card, box, _BASKET_BIN, handle, middle)


def views_without(model: ClassModel, label: int) -> ClassModel:
    """The class model with labelled images in which one part is hidden; the part stays in the model."""
    hidden = tuple(
        PartView(v.view_bin, np.where(v.labels == label, 0, v.labels).astype(np.uint8), v.instance_id)
        for v in model.views
    )
    return replace(model, views=hidden)
