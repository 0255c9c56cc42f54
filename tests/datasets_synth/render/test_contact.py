import gc

import numpy as np
import pytest

from datasets_synth.meshes.grade import Grade
from datasets_synth.meshes.mesh import Placed
from datasets_synth.render.contact import DARKEST, contact_shade
from datasets_synth.render.mip_textures import _known, mip_texture, tint_by_textures
from tests.datasets_synth.simple_scenes import box, ground, pose

UP = np.array([[0, 0, 1]], np.float32)


def share_at(shade, *xyz, normal=UP):
    return float(shade.sky_share(np.array([xyz], np.float32), normal)[0])


def test_a_car_hides_the_sky_from_the_road_under_it():
    # the shade is the footprint 4 x 2 m, blurred: full under the middle, half at the edge, none a metre away
    shade = contact_shade((ground(), Placed(box(4, 2, 1.5), pose(1, 10), "car")))
    assert share_at(shade, 1, 10, 0) == pytest.approx(1 - DARKEST, abs=0.01)
    assert share_at(shade, 1, 9, 0) == pytest.approx(1 - DARKEST / 2, abs=0.08)
    assert share_at(shade, 1, 8, 0) == pytest.approx(1, abs=0.01)
    assert share_at(shade, 1, 500, 0) == 1
    assert share_at(shade, 1, 10, 1.5) == 1  # its own roof


def test_things_that_hang_and_things_without_shadow_hide_no_ground():
    hanging = Placed(box(4, 2, 1), pose(0, 10, 2.0), "sign")
    ghost = Placed(box(4, 2, 1), pose(0, 10), "mark", "", False)
    assert share_at(contact_shade((ground(), hanging, ghost)), 0, 10, 0) == 1


def test_contact_follows_ground_that_rises():
    # the ground is 2 m high where the box stands, and 1 m 20 m before it
    grade = Grade(slope=0.05)
    standing = Placed(box(4, 2, 1.5), pose(0, 40, 2.0), "car")
    shade = contact_shade((ground(), standing), grade)
    assert share_at(shade, 0, 40, 2.0) == pytest.approx(1 - DARKEST, abs=0.01)
    assert share_at(shade, 0, 40, 3.5) == 1  # its own roof
    assert share_at(shade, 0, 20, 1.0) == pytest.approx(1, abs=0.01)
    side = np.array([[0, -1, 0]], np.float32)
    assert [share_at(shade, 9, 20, z, normal=side) for z in (1.0, 1.3, 3.0)] == pytest.approx([0.6, 0.8, 1])
    # over level ground the same box hangs 2 m high
    assert share_at(contact_shade((ground(), standing)), 0, 40, 0.0) == 1


def test_sides_are_darker_close_to_the_ground():
    shade = contact_shade((ground(),))
    side = np.array([[0, -1, 0]], np.float32)
    assert [share_at(shade, 0, 5, z, normal=side) for z in (0.0, 0.3, 0.6, 2.0)] == pytest.approx(
        [0.6, 0.8, 1, 1]
    )


def test_levels_of_a_texture_keep_its_mean_light():
    # one texel in four is white: each level has the linear mean 0.25
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[::2, ::2] = 255
    uv = np.random.default_rng(0).random((500, 2), np.float32)
    for level in (1, 2.5, 6):
        colour = mip_texture(texture).sample(uv, np.full(500, level, np.float32))
        np.testing.assert_allclose(colour, 0.25, atol=0.01)


def test_points_take_the_colour_of_their_own_texture_whatever_their_order():
    textures = [np.full((8, 8, 3), v, np.uint8) for v in (0, 255)]
    mips = [mip_texture(t) for t in textures]
    colour = np.full((6, 3), 0.5, np.float32)
    uv, level = np.full((6, 2), 0.3, np.float32), np.full(6, 1.3, np.float32)
    # the last point lies on no texture
    tint_by_textures(mips, np.array([1, 2, 0, 3, 4]), np.array([0, 2, 5]), uv, level, colour)
    np.testing.assert_array_equal(colour[:, 0], [0.5, 0, 0, 0.5, 0.5, 0.5])


def test_levels_live_as_long_as_their_texture():
    texture = np.full((8, 8, 3), 9, np.uint8)
    key = id(texture)
    assert mip_texture(texture) is mip_texture(texture)
    assert key in _known
    del texture
    gc.collect()
    assert key not in _known
