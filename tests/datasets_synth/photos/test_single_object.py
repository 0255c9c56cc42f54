from functools import lru_cache

import numpy as np
import pytest

from datasets_synth.objects.object_classes import object_class
from datasets_synth.photos.single_object import FILL, ObjectPhoto, Viewpoint, photograph, view_beside
from datasets_synth.render.part_render import render_part_labels
from datasets_synth.render.truth import azimuth_deg
from recon.camera import PinholeCamera, default_camera
from recon.errors import RescoreError

CAMERA = default_camera(160, 120)


@lru_cache(maxsize=32)
def photo(name: str, view_bin: int, setting: str = "street", seed: int = 0) -> ObjectPhoto:
    chosen = object_class(name)
    viewpoint = Viewpoint(chosen.bins.azimuth_rad(view_bin), chosen.elevation_rad)
    return photograph(chosen, chosen.test[0], viewpoint, CAMERA, np.random.default_rng(seed), setting)


def middle_u_px(picture: ObjectPhoto, name: str, part: str) -> float:
    label = object_class(name).part_names.index(part) + 1
    return float(np.nonzero(picture.part_labels == label)[1].mean())


@pytest.mark.parametrize(
    ("name", "view_bin"), [("chair", 1), ("airplane", 4), ("basket", 8), ("bicycle", 10)]
)
def test_an_object_stands_whole_in_the_picture_and_on_the_ground(name, view_bin):
    shot = photo(name, view_bin)
    x0, y0, x1, y1 = shot.xyxy_px
    assert 0 < x0 < x1 < 160
    assert 0 < y0 < y1 < 120
    # the farther of its sides reaches FILL of the half picture
    reach = max(80 - x0, x1 - 80) / 80, max(60 - y0, y1 - 60) / 60
    assert max(reach) == pytest.approx(FILL, abs=0.02)
    rows, cols = np.nonzero(shot.mask)
    assert [cols.min(), rows.min(), cols.max() + 1, rows.max() + 1] == pytest.approx(shot.xyxy_px, abs=2.0)
    assert azimuth_deg(shot.cam_from_object) == pytest.approx(30 * view_bin, abs=1e-6)
    foot = shot.mesh.vertices_m[np.argmin(shot.mesh.vertices_m[:, 2])]
    foot_cam = shot.cam_from_object[:3, :3] @ foot + shot.cam_from_object[:3, 3]
    assert shot.seen_from.ground.up @ foot_cam + shot.seen_from.ground.height_m == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize(("name", "setting"), [("chair", "room"), ("basket", "street")])
def test_depth_takes_every_pixel_of_the_object_back_onto_it(name, setting):
    shot = photo(name, 2, setting)
    v, u = np.nonzero(shot.mask)
    rays = CAMERA.rays(np.stack([u, v], axis=1).astype(float))
    in_cam = rays * shot.depth_m[v, u, None]
    rotation, shift = shot.cam_from_object[:3, :3], shot.cam_from_object[:3, 3]
    points = (in_cam - shift) @ rotation
    low, high = shot.mesh.vertices_m.min(axis=0), shot.mesh.vertices_m.max(axis=0)
    assert (points > low - 1e-3).all()
    assert (points < high + 1e-3).all()
    # the lowest row of the picture shows the ground
    ground = shot.seen_from.ground.intersect(
        CAMERA.rays(np.stack([np.arange(160.0), np.full(160, 119.0)], axis=1))
    )
    assert shot.depth_m[-1] == pytest.approx(ground[:, 2], rel=1e-4)


@pytest.mark.parametrize("name", ["chair", "bicycle"])
def test_labels_cover_the_mask_and_fill_what_one_sees_through(name):
    shot = photo(name, 2)
    assert (shot.part_labels[shot.mask] > 0).all()
    assert (shot.part_labels > 0).sum() > 1.02 * shot.mask.sum()


def test_without_see_through_parts_labels_and_mask_are_the_same():
    shot = photo("airplane", 4)
    assert np.array_equal(shot.part_labels > 0, shot.mask)


def test_pictures_are_not_mirrored():
    # from the left side the nose points to the left of the picture, from the right side to the right
    for view_bin, sign in ((3, 1), (9, -1)):
        shot = photo("bicycle", view_bin)
        rear, front = (middle_u_px(shot, "bicycle", w) for w in ("rear_wheel", "front_wheel"))
        assert sign * (rear - front) > 30
    # from the front the left wing is on the right of the picture
    shot = photo("airplane", 0)
    left, right = (middle_u_px(shot, "airplane", w) for w in ("left_wing", "right_wing"))
    assert left - right > 30


def test_from_far_away_a_picture_is_the_labelled_view():
    chosen = object_class("chair")
    # at 200 m perspective is as good as none; the focal length makes the view 100 pixels large
    view = render_part_labels(
        chosen.labelled_mesh(chosen.build(chosen.test[0], np.random.default_rng(0))),
        chosen.bins.view_from_object(2),
        100,
    )[4:-4, 4:-4]
    seen = photo("chair", 2).mesh.vertices_m @ chosen.bins.view_from_object(2).T
    focal_px = 100 / float(np.ptp(seen[:, :2], axis=0).max()) * 200
    camera = PinholeCamera(focal_px, focal_px, 74.5, 74.5, 150, 150)
    viewpoint = Viewpoint(chosen.bins.azimuth_rad(2), chosen.elevation_rad, 200.0)
    shot = photograph(chosen, chosen.test[0], viewpoint, camera, np.random.default_rng(0))
    rows, cols = np.nonzero(shot.part_labels)
    cut = shot.part_labels[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    assert cut.shape == pytest.approx(view.shape, abs=1)
    h, w = min(cut.shape[0], view.shape[0]), min(cut.shape[1], view.shape[1])
    assert (cut[:h, :w] == view[:h, :w]).mean() > 0.95


def test_the_distance_is_from_the_camera_to_the_middle():
    chosen = object_class("basket")
    shot = photograph(
        chosen, chosen.test[0], Viewpoint(0.7, 0.5, 1.75), CAMERA, np.random.default_rng(0), "room"
    )
    points = shot.mesh.vertices_m.astype(float)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    in_cam = shot.cam_from_object[:3, :3] @ middle + shot.cam_from_object[:3, 3]
    assert in_cam == pytest.approx([0, 0, 1.75], abs=1e-6)
    assert shot.seen_from.ground.height_m == pytest.approx(1.75 * np.sin(0.5) + middle[2])


def test_the_same_seed_gives_the_same_bytes_and_another_another_picture():
    chosen = object_class("chair")
    viewpoint = Viewpoint(chosen.bins.azimuth_rad(1), chosen.elevation_rad)
    again = photograph(chosen, chosen.test[0], viewpoint, CAMERA, np.random.default_rng(0))
    other = photograph(chosen, chosen.test[0], viewpoint, CAMERA, np.random.default_rng(1))
    assert again.rgb.tobytes() == photo("chair", 1).rgb.tobytes()
    assert other.rgb.tobytes() != again.rgb.tobytes()
    assert other.part_labels.tobytes() == again.part_labels.tobytes()


@pytest.mark.parametrize(
    ("viewpoint", "camera", "setting", "message"),
    [
        (Viewpoint(0.0, 0.4), CAMERA, "beach", "expected one of street, room, got 'beach'"),
        (Viewpoint(0.0, -1.0), CAMERA, "street", "camera must be above the ground"),
        (Viewpoint(0.0, 0.4), PinholeCamera(150, 150, 900, 60, 160, 120), "street", "it is not"),
    ],
)
def test_what_cannot_be_photographed_is_refused(viewpoint, camera, setting, message):
    chosen = object_class("basket")
    with pytest.raises(RescoreError, match=message):
        photograph(chosen, chosen.test[0], viewpoint, camera, np.random.default_rng(0), setting)


def test_a_view_beside_is_that_of_an_object_turned_the_other_way() -> None:
    chosen = object_class("chair")
    azimuth, turn = 0.4, 0.6
    shots = [
        photograph(
            chosen,
            chosen.test[0],
            Viewpoint(a, chosen.elevation_rad, 4.0),
            CAMERA,
            np.random.default_rng(0),
            "room",
        )
        for a in (azimuth, azimuth - turn)
    ]
    same, beside = view_beside(shots[0], 0.0), view_beside(shots[0], turn)
    np.testing.assert_array_equal(same.mask, shots[0].mask)
    np.testing.assert_allclose(same.cam_from_photo, np.eye(4), atol=1e-9)
    # the camera has walked around the middle of the box, at the same height and distance
    both, either = (beside.mask & shots[1].mask).sum(), (beside.mask | shots[1].mask).sum()
    assert both > 0.97 * either
    np.testing.assert_allclose(
        beside.cam_from_photo @ shots[0].cam_from_object, shots[1].cam_from_object, atol=1e-6
    )
