"""A shape of known pose is found again from its silhouette, with the camera as low as it."""

import cv2
import numpy as np
import pytest

from recon.arrays import BoolArray, FloatArray
from recon.camera import GroundedCamera, GroundPlane, PinholeCamera
from recon.errors import Failure
from recon.localization.shape_fit import FittedShape, ShapeInBox, fit_shape, shape_in_box
from recon.localization.standing_box import cam_from_ground, turn
from recon.outlines import largest_outline
from recon.reconstruction.instance import Instance3D, InstanceQuality
from recon.reconstruction.occluded_parts import ClassToInstance
from tests.recon.localization.stepped_car import SIZE_M, space

SEEN_FROM = GroundedCamera(PinholeCamera(400.0, 400.0, 199.5, 119.5, 400, 240), GroundPlane(1.4, 0.05))
WHOLE_PX = np.array([0.0, 0.0, 400.0, 240.0])


def standing(x_m: float, y_m: float, yaw_deg: float) -> FittedShape:
    own = np.eye(4)
    own[:2, :2], own[:2, 3] = turn(np.deg2rad(yaw_deg)), [x_m, y_m]
    return FittedShape(space(), np.zeros(0), SIZE_M, cam_from_ground(SEEN_FROM.ground) @ own)


def rough_at(shape: FittedShape) -> Instance3D:
    moved = ClassToInstance(np.eye(3), np.ones(3), np.zeros(3), 0.0, {})
    return Instance3D("car", 2, (), shape.cam_from_object, SIZE_M, {}, moved, InstanceQuality(0.0, 1.0, 0.0))


def outline_of(mask: BoolArray) -> tuple[FloatArray, FloatArray]:
    ring = largest_outline(mask)
    assert ring is not None
    return ring, np.concatenate([ring.min(axis=0), ring.max(axis=0) + 1])


@pytest.fixture(scope="module")
def seen() -> tuple[FittedShape, BoolArray]:
    true = standing(0.4, 9.0, -60.0)
    return true, true.silhouette(SEEN_FROM.camera, WHOLE_PX)


def test_the_silhouette_is_that_of_the_box(seen: tuple[FittedShape, BoolArray]) -> None:
    true, mask = seen
    corners = np.array([[x, y, z] for x in (-2.2, 2.2) for y in (-0.9, 0.9) for z in (0, 0.9)])
    corners = np.concatenate([corners, np.array([[x, y, 1.5] for x in (-2.2, 0.6) for y in (-0.9, 0.9)])])
    uv = SEEN_FROM.camera.project(corners @ true.cam_from_object[:3, :3].T + true.cam_from_object[:3, 3])
    rows, columns = np.nonzero(mask)
    found = [columns.min(), rows.min(), columns.max(), rows.max()]
    # the grid of the silhouette is 400 pixels over 120, and hulls are interpolated
    np.testing.assert_allclose(found, [*uv.min(axis=0), *uv.max(axis=0)], atol=4)
    assert mask.sum() < 0.95 * np.prod(uv.max(axis=0) - uv.min(axis=0))


@pytest.mark.parametrize(("shadow", "off_deg"), [(False, 5.0), (True, 7.0)])
def test_a_pose_is_found_again(seen: tuple[FittedShape, BoolArray], shadow: bool, off_deg: float) -> None:
    true, mask = seen
    ring, box = outline_of(mask)
    if shadow:
        # the outline takes in what lies below the object; the box does not
        ring, _ = outline_of(mask | (cv2.dilate(mask.astype(np.uint8), np.ones((7, 1), np.uint8)) > 0))
    found = fit_shape(ring, box, standing(0.8, 9.9, -48.0), space(), SEEN_FROM)
    assert isinstance(found, FittedShape)
    off = found.cam_from_object[:3, 3] - true.cam_from_object[:3, 3]
    assert np.linalg.norm(off) < 0.25
    turned = np.arccos(np.clip(found.cam_from_object[:3, 0] @ true.cam_from_object[:3, 0], -1, 1))
    assert np.rad2deg(turned) < off_deg
    np.testing.assert_allclose(found.size_m, SIZE_M, rtol=0.1)


def test_a_post_is_no_car(seen: tuple[FittedShape, BoolArray]) -> None:
    true, mask = seen
    post = np.zeros_like(mask)
    post[5:160, 180:215] = True
    rgb = np.random.default_rng(0).integers(100, 120, (*mask.shape, 3)).astype(np.uint8)
    rgb[post] = (200, 40, 40)
    box = np.array([180.0, 5.0, 215.0, 160.0])
    assert isinstance(shape_in_box(rgb, post, box, rough_at(true), space(), SEEN_FROM), Failure)


def test_the_class_s_own_outline_helps_where_colours_lead_astray(seen: tuple[FittedShape, BoolArray]) -> None:
    true, mask = seen
    ring, box = outline_of(mask)
    rgb = np.full((*mask.shape, 3), 200, np.uint8)
    rgb[mask] = (40, 60, 120)
    # nothing but the ground beside the car
    astray = np.zeros_like(mask)
    astray[-20:] = True
    alone = shape_in_box(rgb, astray, box, rough_at(true), space(), SEEN_FROM)
    assert isinstance(alone, Failure)
    helped = shape_in_box(rgb, astray, box, rough_at(true), space(), SEEN_FROM, expected_px=ring)
    assert isinstance(helped, ShapeInBox)
    assert helped.agreement.overlap > 0.9
    assert helped.agreement.beside < 0.03
    assert 0 < helped.agreement.nats < 5
