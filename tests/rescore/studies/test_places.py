"""Pictures that overlap are one place, others are not."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.studies.places import MIN_SHARED, find_points, places_of, shared_points

WIDTH_PX, HEIGHT_PX = 320, 200


def scene(seed: int) -> np.ndarray:
    """A wide wall (200, 1200, 3) of patches and strokes that no other seed has."""
    rng = np.random.default_rng(seed)
    wall = np.full((HEIGHT_PX, 1200, 3), 128, np.uint8)
    for _ in range(700):
        middle = int(rng.integers(0, 1200)), int(rng.integers(0, HEIGHT_PX))
        width, height = (int(v) for v in rng.integers(4, 30, 2))
        colour = rng.integers(0, 255, 3).tolist()
        cv2.ellipse(wall, middle, (width, height), float(rng.uniform(0, 180)), 0, 360, colour, -1)
    return cv2.GaussianBlur(wall, (0, 0), 0.8)


def seen(seed: int, from_px: int) -> np.ndarray:
    """The part of a wall that a camera sees, which moves along it, with noise of its own."""
    noise = np.random.default_rng(from_px).normal(0, 3, (HEIGHT_PX, WIDTH_PX, 3))
    part = scene(seed)[:, from_px : from_px + WIDTH_PX]
    return np.clip(part + noise, 0, 255).astype(np.uint8)


def street(root: Path, pictures: list[np.ndarray]) -> DataSet:
    """Frames with the image ids 10, 11, ... in this order."""
    frames = []
    for number, picture in enumerate(pictures, start=10):
        path = root / f"{number}.png"
        cv2.imwrite(str(path), picture)
        frames.append(FrameRecord(number, path, None, None, "test", WIDTH_PX, HEIGHT_PX, None, None))
    none = Truth(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, bool), np.zeros(0), ())
    return DataSet(root, 1, "car", tuple(frames), {f.image_id: none for f in frames})


def test_pictures_that_overlap_are_one_place_and_others_are_not(tmp_path: Path) -> None:
    data = street(tmp_path, [seen(0, 0), seen(0, 100), seen(1, 0), seen(2, 0), seen(2, 120)])
    assert places_of(data, 1) == ((10, 11), (12,), (13, 14))


def test_what_a_picture_between_connects_is_one_place(tmp_path: Path) -> None:
    first, middle, last = (seen(0, x) for x in (0, 190, 380))
    assert shared_points(find_points(first), find_points(last)) < MIN_SHARED
    assert places_of(street(tmp_path, [first, middle, last]), 1) == ((10, 11, 12),)
    # the one that connects may come last
    assert places_of(street(tmp_path, [first, last, middle]), 1) == ((10, 11, 12),)
    assert places_of(street(tmp_path, [first, last]), 1) == ((10,), (11,))


def test_each_is_compared_with_the_three_before_it(tmp_path: Path) -> None:
    others = [seen(seed, 0) for seed in (1, 2, 3)]
    near = street(tmp_path, [seen(0, 0), *others[:2], seen(0, 60)])
    assert places_of(near, 1) == ((10, 13), (11,), (12,))
    far = street(tmp_path, [seen(0, 0), *others, seen(0, 60)])
    assert places_of(far, 1) == ((10,), (11,), (12,), (13,), (14,))


def test_any_number_of_pictures_at_a_time_gives_the_same_places(tmp_path: Path) -> None:
    data = street(tmp_path, [seen(0, 0), seen(1, 0), seen(0, 150), seen(1, 150)])
    assert places_of(data, 2) == places_of(data, 1) == ((10, 12), (11, 13))


@pytest.mark.parametrize("grey", [0, 200])
def test_a_picture_without_texture_is_a_place_of_its_own(tmp_path: Path, grey: int) -> None:
    flat = np.full((HEIGHT_PX, WIDTH_PX, 3), grey, np.uint8)
    assert places_of(street(tmp_path, [flat, flat, seen(0, 0)]), 1) == ((10,), (11,), (12,))


def test_points_are_shared_as_far_as_pictures_overlap() -> None:
    points = [find_points(seen(0, x)) for x in (0, 80, 200)]
    np.testing.assert_allclose(np.linalg.norm(points[0].descriptor, axis=1), 1, atol=1e-5)
    whole, much, little = (shared_points(points[0], other) for other in points)
    assert whole > 0.9 * len(points[0].xy_px)
    assert whole > much > little >= MIN_SHARED
