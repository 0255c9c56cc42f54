"""Colours tell an object from what is around it, thin parts too."""

import numpy as np

from recon.arrays import BoolArray, UInt8Array
from recon.reconstruction.matte import matte, near_silhouette, open_matte

BOX = np.array([40.0, 30.0, 120.0, 110.0])


def stool() -> tuple[UInt8Array, BoolArray]:
    """A red stool on two legs, 5 pixels wide, before grey noise; and where it is."""
    mask = np.zeros((150, 160), bool)
    mask[30:60, 40:120] = True
    mask[60:110, 44:49] = mask[60:110, 110:115] = True
    rgb = np.random.default_rng(0).integers(90, 130, (150, 160, 3)).astype(np.uint8)
    rgb[mask] = (180, 40, 40)
    return rgb, mask


def test_legs_that_an_outline_has_lost_are_found() -> None:
    rgb, mask = stool()
    rough = mask.copy()
    rough[75:] = False
    share = matte(rgb, rough, BOX)
    assert share.shape == mask.shape
    assert 0 <= share.min() <= share.max() <= 1
    found = share > 0.5
    np.testing.assert_array_equal(found[:100], mask[:100])
    # the end of a leg costs more border than it is worth
    assert (found != mask).sum() < 100


def test_ground_that_an_outline_has_taken_in_is_left_out() -> None:
    rgb, mask = stool()
    rough = mask.copy()
    rough[60:80, 40:120] = True
    np.testing.assert_array_equal(matte(rgb, rough, BOX) > 0.5, mask)


def test_nothing_lies_beyond_the_box_or_far_from_a_fitted_silhouette() -> None:
    rgb, mask = stool()
    rgb[140:, :30] = (180, 40, 40)
    assert not matte(rgb, mask, BOX)[115:].any()
    seat = mask.copy()
    seat[60:] = False
    # a band of 6 % of 80 pixels
    assert not (matte(rgb, seat, BOX, fitted=True) > 0.5)[67:].any()


def test_no_outline_gives_no_object() -> None:
    rgb, mask = stool()
    assert not matte(rgb, np.zeros_like(mask), BOX).any()


def wheel() -> tuple[UInt8Array, BoolArray]:
    """A blue rim, 6 pixels wide, before grey noise that is darker in the lower half; and where it is."""
    v, u = np.mgrid[:150, :160]
    radius = np.hypot(u - 79.5, v - 69.5)
    mask = (radius < 40) & (radius > 34)
    rgb = np.random.default_rng(0).integers(90, 130, (150, 160, 3)).astype(np.uint8)
    rgb[75:] -= 40
    rgb[mask] = (40, 60, 180)
    return rgb, mask


def test_a_rim_is_told_from_what_is_seen_through_it() -> None:
    rgb, mask = wheel()
    v, u = np.mgrid[:150, :160]
    full = (np.hypot(u - 79.5, v - 69.5) < 40).astype(np.float32)
    share = open_matte(rgb, full, BOX)
    assert share is not None
    found = share > 0.5
    # the camera's blur is imitated, so that the border is off by a pixel
    assert (found & mask).sum() > 0.9 * mask.sum()
    assert (found & ~mask).sum() < 0.4 * mask.sum()
    assert not found[60:80, 70:90].any()


def test_what_is_not_seen_through_has_no_open_matte() -> None:
    rgb, mask = stool()
    assert open_matte(rgb, mask.astype(np.float32), BOX) is None
    # nothing is left to compare with
    assert open_matte(rgb, mask.astype(np.float32), np.array([-2.0, -2.0, 162.0, 152.0])) is None


def test_shadows_far_from_the_silhouette_are_left_out() -> None:
    _, mask = stool()
    share = np.ones(mask.shape, np.float32)
    near = near_silhouette(share, mask, BOX)
    # a tenth of 80 pixels
    assert near[60, 30] == 0
    assert near[60, 36] == 1
    assert near[mask].all()
