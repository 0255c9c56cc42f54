"""Photographs of the gallery: a basket whose handle no pixel shows."""

import numpy as np

from datasets_synth.objects.object_classes import labelled_views, object_class
from datasets_synth.photos.gallery_photos import gallery_photo, occluded_basket, views_without
from recon.class_model import ClassModel, ClassPart


def test_no_pixel_shows_the_handle() -> None:
    shot = occluded_basket(0)
    handle = shot.photo.part_labels == shot.handle
    assert handle.any()
    assert shot.card[handle].all()
    assert (shot.photo.rgb[shot.card] == shot.photo.rgb[shot.card][0]).all()
    rows, cols = np.nonzero((shot.photo.part_labels > 0) & ~shot.card)
    assert [cols.min(), rows.min(), cols.max() + 1, rows.max() + 1] == shot.xyxy_px.tolist()
    # the middle of the handle is behind the card, about as far away as the basket
    u, v = np.round(shot.photo.seen_from.camera.project(shot.handle_middle_m)).astype(int)
    assert shot.card[v, u]
    depth = shot.photo.depth_m[shot.photo.part_labels > 0]
    assert depth.min() < shot.handle_middle_m[2] < depth.max()


def test_a_hidden_part_stays_in_the_model() -> None:
    shown = object_class("basket")
    views = labelled_views(shown, shown.train[:1], shown.bins, 48).views[:2]
    outline = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    part = ClassPart(6, outline.mean(axis=0), np.array([0.0, 0, 1, 0]), outline, 0, 2)
    model = ClassModel("basket", shown.part_names, shown.bins, (part,), views)
    hidden = views_without(model, 6)
    assert hidden.parts == model.parts
    for before, after in zip(model.views, hidden.views, strict=True):
        assert not (after.labels == 6).any()
        rest = before.labels != 6
        np.testing.assert_array_equal(after.labels[rest], before.labels[rest])


def test_the_same_seed_gives_the_same_photograph_of_a_test_shape() -> None:
    (name, a), (_, b), (_, other) = (gallery_photo("chair", 1, s) for s in (3, 3, 4))
    assert name in {s.shape_id for s in object_class("chair").test}
    np.testing.assert_array_equal(a.rgb, b.rgb)
    assert (a.rgb != other.rgb).any()
