"""Looks of views: headings of drawn objects are told by shape and colour, in files and in mirrors too."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from recon.arrays import FloatArray, UInt8Array
from recon.errors import RescoreError
from recon.view_bins import ViewBins
from recon.view_looks import LooksConfig, ViewLooks, box_features, learn_looks

CONFIG = LooksConfig(headings=4, min_boxes=20)
RIGHT, AWAY, LEFT, TOWARDS = 0, 1, 2, 3


def drawn(heading: int, rng: np.random.Generator) -> tuple[UInt8Array, FloatArray]:
    """A wedge that points right or left, or a square with red or white lamps; and its box."""
    rgb = np.full((100, 160, 3), rng.integers(90, 160), np.uint8)
    paint = tuple(int(v) for v in rng.integers(30, 90, 3))
    x, y = rng.integers(20, 40), rng.integers(15, 30)
    if heading in (RIGHT, LEFT):
        box = np.array([x, y + 20, x + 90, y + 50], float)
        wedge = np.array([[x, y + 50], [x, y + 20], [x + 45, y + 20], [x + 90, y + 40], [x + 90, y + 50]])
        if heading == LEFT:
            wedge[:, 0] = 2 * x + 90 - wedge[:, 0]
        cv2.fillPoly(rgb, [wedge.astype(np.int32)], paint)
        return rgb, box
    box = np.array([x, y, x + 56, y + 48], float)
    cv2.rectangle(rgb, (int(x), int(y)), (int(x) + 55, int(y) + 47), paint, -1)
    lamp = (230, 20, 20) if heading == AWAY else (245, 245, 235)
    for side in (4, 40):
        cv2.rectangle(rgb, (int(x) + side, int(y) + 18), (int(x) + side + 11, int(y) + 27), lamp, -1)
    return rgb, box


def pictures(count: int, seed: int) -> Iterator[tuple[UInt8Array, FloatArray, FloatArray]]:
    rng = np.random.default_rng(seed)
    for i in range(count):
        rgb, box = drawn(i % 4, rng)
        yield rgb, box[None], np.array([i % 4 * np.pi / 2])


@pytest.fixture(scope="module")
def looks() -> ViewLooks:
    return learn_looks(pictures(80, 0), CONFIG, np.random.default_rng(0))


def test_headings_of_other_pictures_are_told(looks: ViewLooks) -> None:
    right = 0
    for rgb, boxes, heading in pictures(40, 1):
        density = looks.log_density(rgb, boxes)
        assert density.shape == (1, 4)
        assert np.exp(density).sum() == pytest.approx(1)
        right += density[0].argmax() == round(heading[0] / (np.pi / 2))
    assert right >= 36


def test_no_heading_is_ruled_out(looks: ViewLooks) -> None:
    for rgb, boxes, _ in pictures(8, 2):
        assert looks.log_density(rgb, boxes).min() >= np.log(CONFIG.doubt / 4) - 1e-6


def test_bins_are_seen_from_where_the_nose_points(looks: ViewLooks) -> None:
    for rgb, boxes, heading in pictures(8, 2):
        four = looks.bins_log_density(rgb, boxes, ViewBins(4))
        # nose to the right: seen from its right side, azimuth 270; away: from behind, azimuth 180; and so on
        by_heading = looks.log_density(rgb, boxes)
        np.testing.assert_allclose(four, by_heading[:, [TOWARDS, LEFT, AWAY, RIGHT]])
        assert ViewBins(4).azimuth_rad(int(four[0].argmax())) == pytest.approx(
            (1.5 * np.pi - heading[0]) % (2 * np.pi)
        )
        eight = looks.bins_log_density(rgb, boxes, ViewBins(8))
        np.testing.assert_allclose(eight[:, ::2], four)
        np.testing.assert_allclose(eight[:, 1::2], (four + np.roll(four, -1, axis=1)) / 2)


def test_files_hold_the_looks(looks: ViewLooks) -> None:
    again = ViewLooks.from_json(looks.as_json())
    rgb, boxes, _ = next(pictures(1, 3))
    np.testing.assert_allclose(again.log_density(rgb, boxes), looks.log_density(rgb, boxes), atol=0.02)


def test_the_same_twice() -> None:
    one, two = (learn_looks(pictures(40, 0), CONFIG, np.random.default_rng(0)) for _ in range(2))
    np.testing.assert_array_equal(one.weights, two.weights)


def test_too_few_boxes_are_refused() -> None:
    with pytest.raises(RescoreError, match="looks of views: expected at least 20 boxes"):
        learn_looks(pictures(12, 0), CONFIG, np.random.default_rng(0))


def test_boxes_beyond_the_picture_have_features() -> None:
    rgb = np.zeros((50, 60, 3), np.uint8)
    for box in ([-20.0, -10, 30, 40], [50.0, 40, 90, 80], [70.0, 60, 90, 80]):
        assert np.isfinite(box_features(rgb, np.array(box))).all()
    assert looks_of_nothing().shape == (0, 4)


def looks_of_nothing() -> FloatArray:
    flat = ViewLooks(np.zeros((4, 3), np.float32), np.zeros(4, np.float32), 0.1)
    return flat.log_density(np.zeros((5, 5, 3), np.uint8), np.zeros((0, 4)))
