import cv2
import numpy as np
import pytest

from recon.pixels import (
    linear_16bit_from_srgb,
    linear_from_encoded,
    linear_from_srgb,
    sample_bilinear,
    sample_nearest,
    smooth_gradient,
    srgb_from_linear,
    srgb_from_linear_16bit,
)

EVERY_BYTE = np.arange(256, dtype=np.uint8)


def test_srgb_bytes_survive_the_way_to_linear_and_back() -> None:
    np.testing.assert_array_equal(srgb_from_linear(linear_from_srgb(EVERY_BYTE)), EVERY_BYTE)
    np.testing.assert_array_equal(srgb_from_linear_16bit(linear_16bit_from_srgb(EVERY_BYTE)), EVERY_BYTE)


def test_srgb_of_known_colours() -> None:
    # IEC 61966-2-1: 12.92 * 0.001 * 255 = 3.29; (1.055 * 0.2159^(1/2.4) - 0.055) * 255 = 128.0
    np.testing.assert_array_equal(
        srgb_from_linear(np.array([-0.1, 0.001, 0.2158605, 1.0, 3.0], np.float32)), [0, 3, 128, 255, 255]
    )


def test_linear_light_of_known_values() -> None:
    # below 0.04045 the line 0.02 / 12.92, above it ((0.5 + 0.055) / 1.055)^2.4
    found = linear_from_encoded(np.array([0.0, 0.02, 0.5, 1.0]))
    np.testing.assert_allclose(found, [0, 0.001548, 0.214041, 1], atol=1e-6)
    np.testing.assert_array_equal(
        linear_from_srgb(EVERY_BYTE), linear_from_encoded(EVERY_BYTE / 255).astype(np.float32)
    )


def test_values_between_pixels() -> None:
    picture = np.array([[0, 8], [16, 24]], np.float32)
    at = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [1.0, 0.75]])
    found = sample_bilinear(picture, at, cv2.BORDER_REPLICATE)
    np.testing.assert_allclose(found, [0, 4, 12, 20])
    beyond = np.array([[-5.0, 0.0], [9.0, 9.0]])
    np.testing.assert_allclose(sample_bilinear(picture, beyond, cv2.BORDER_REPLICATE), [0, 24])
    np.testing.assert_allclose(sample_bilinear(picture, beyond, cv2.BORDER_CONSTANT, 7.0), [7, 7])


def test_values_keep_the_shape_of_the_points() -> None:
    picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    at = np.array([[[0.0, 0.0], [3.0, 1.0], [-4.0, 0.0]], [[1.0, 0.0], [2.0, 1.0], [0.0, 8.0]]])
    found = sample_bilinear(picture, at, cv2.BORDER_CONSTANT, (7, 8, 9))
    assert (found.shape, found.dtype) == ((2, 3, 3), np.uint8)
    np.testing.assert_array_equal(found[0], [[0, 1, 2], [21, 22, 23], [7, 8, 9]])
    np.testing.assert_array_equal(found[1], [[3, 4, 5], [18, 19, 20], [7, 8, 9]])
    assert sample_bilinear(picture[..., 0], at, cv2.BORDER_REPLICATE).shape == (2, 3)


@pytest.mark.parametrize("n", [0, 1, 1024, 40_000])
def test_more_points_than_remap_takes_keep_their_order(n: int) -> None:
    ramp = np.stack([np.arange(256), np.arange(255, -1, -1), np.zeros(256)], axis=-1)[None].astype(np.uint8)
    column = np.arange(n) % 256
    found = sample_bilinear(ramp, np.stack([column, np.zeros(n)], axis=1), cv2.BORDER_REPLICATE)
    assert (found.shape, found.dtype) == ((n, 3), np.uint8)
    np.testing.assert_array_equal(found, ramp[0, column])


def test_the_gradient_of_a_ramp() -> None:
    u, v = np.meshgrid(np.arange(20.0), np.arange(16.0))
    dx, dy = smooth_gradient((3 * u - 2 * v).astype(np.float32), 1.0)
    np.testing.assert_allclose(dx[6:-6, 6:-6], 3, atol=1e-4)
    np.testing.assert_allclose(dy[6:-6, 6:-6], -2, atol=1e-4)


def test_the_nearest_pixels_and_nothing_outside() -> None:
    picture = np.arange(12, dtype=np.float32).reshape(3, 4)
    found = sample_nearest(picture, np.array([[-1, 0, 3, 4]]), np.array([[0], [2], [3]]))
    nan = np.nan
    np.testing.assert_array_equal(found, [[nan, 0, 3, nan], [nan, 8, 11, nan], [nan] * 4])
