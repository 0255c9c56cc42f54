"""The back of a compact object: closed, symmetric, and out of sight of the picture's camera."""

import cv2
import numpy as np
import pytest

from reports.objects.back_side import is_compact
from reports.objects.mesh_files import MeshView, turned_about
from reports.objects.object_mesh import object_layers
from reports.objects.popup import close_camera
from rescore.library.single_picture import FoundObject, Photo, find_object
from tests.single_car import car_from, quick_car_model

Seen = tuple[Photo, FoundObject]


@pytest.fixture(scope="module")
def seen() -> Seen:
    car = car_from(60, seed=3, width_px=320)
    photo = Photo(car.rgb, car.seen_from)
    found = find_object(photo, car.box_px, 2, quick_car_model())
    assert isinstance(found, FoundObject)
    return photo, found


def test_a_disc_is_compact_and_a_frame_is_not() -> None:
    disc, frame = np.zeros((80, 80), np.uint8), np.zeros((80, 80), np.uint8)
    cv2.circle(disc, (40, 40), 30, 1, -1)
    cv2.rectangle(frame, (10, 10), (70, 70), 1, 6)
    assert is_compact(disc > 0)
    assert not is_compact(frame > 0)


def test_the_back_closes_the_object(seen: Seen) -> None:
    photo, found = seen
    layers = object_layers(photo.rgb, found, photo.seen_from.camera)
    camera = close_camera(photo, [found], 320, 240)
    centre, up = found.instance.centroid_m, photo.seen_from.ground.up
    front, whole = MeshView(layers[:1]), MeshView(layers)
    # from its own camera the picture is what it was
    same = [view.picture(camera, np.eye(4))[0].astype(int) for view in (front, whole)]
    assert (np.abs(same[0] - same[1]).max(axis=2) > 20).mean() < 0.01
    # from the side that the picture does not show there is far more to see with it, without holes
    turn = turned_about(centre, up, np.pi / 2)
    hit = [view.picture(camera, turn)[1] for view in (front, whole)]
    assert hit[1].sum() > 1.2 * hit[0].sum()
    outer, _ = cv2.findContours(hit[1].astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros(hit[1].shape, np.uint8), outer, -1, 1, -1)
    assert hit[1].sum() > 0.98 * filled.sum()


def test_the_back_stays_in_the_box_above_the_ground(seen: Seen) -> None:
    photo, found = seen
    back = object_layers(photo.rgb, found, photo.seen_from.camera)[1][0]
    # the back itself comes first, then the front that it is closed against
    points = back.xyz_m[: len(back.xyz_m) // 2]
    own = (points - found.instance.cam_from_object[:3, 3]) @ found.instance.cam_from_object[:3, :3]
    length, width, height = found.instance.size_m
    slack = 0.1 * float(np.linalg.norm(found.instance.size_m))
    # but for a few places where the planes of the front leave the box themselves
    assert (np.abs(own[:, 0]) < length / 2 + slack).mean() > 0.97
    assert (np.abs(own[:, 1]) < width / 2 + slack).mean() > 0.97
    assert own[:, 2].min() > -0.1
    assert own[:, 2].max() < height + slack
    # it reaches over the middle plane to the side that is not seen
    assert -own[:, 1].min() > 0.35 * width
