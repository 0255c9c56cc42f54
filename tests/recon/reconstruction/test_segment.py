"""Level sets: a disk is found, phi stays a signed distance, candidates do not influence each other."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from recon.arrays import BoolArray, Float32Array
from recon.reconstruction.segment import (
    SegmentConfig,
    colour_evidence,
    edge_indicator,
    evolve,
    signed_distance,
)
from tests.recon.reconstruction.level_set_arrays import evolved_in_arrays

CONFIG = SegmentConfig()


def disk(radius: float, centre: tuple[float, float] = (40.0, 40.0), size: int = 80) -> BoolArray:
    y, x = np.mgrid[:size, :size]
    return np.asarray((x - centre[0]) ** 2 + (y - centre[1]) ** 2 <= radius**2)


def picture(mask: BoolArray, low: float = 20.0, high: float = 70.0) -> Float32Array:
    return np.repeat(np.where(mask, high, low)[..., None], 3, axis=2).astype(np.float32)


def iou(a: BoolArray, b: BoolArray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("start_radius", [19.0, 25.0])
def test_outline_converges_to_a_disk(start_radius: float) -> None:
    target = disk(22)
    edge = edge_indicator(picture(target)[None], CONFIG)
    config = replace(CONFIG, steps=120)
    phi = evolve(signed_distance(disk(start_radius))[None], edge, config)[0]
    assert iou(phi < 0, target) > 0.95
    assert iou(phi < 0, target) > iou(disk(start_radius), target)


def test_phi_stays_like_a_distance_near_the_outline() -> None:
    edge = edge_indicator(picture(disk(22))[None], CONFIG)
    phi = evolve(signed_distance(disk(25))[None], edge, replace(CONFIG, steps=120))[0]
    dy, dx = np.gradient(phi)
    slope = np.hypot(dx, dy)[np.abs(phi) < 1]
    # the pull of edges steepens phi, the regulariser holds it
    assert 0.7 < np.median(slope) < 1.5
    assert np.percentile(slope, 2) > 0.5
    assert slope.max() < 2.5


def test_regulariser_alone_mends_a_steep_phi() -> None:
    steep = np.clip(2 * signed_distance(disk(25)), -12, 12)[None]
    phi = evolve(steep, np.zeros_like(steep), replace(CONFIG, steps=500))[0]
    dy, dx = np.gradient(phi)
    near = np.hypot(dx, dy)[np.abs(phi) < 2]
    assert np.median(near) == pytest.approx(1.0, abs=0.1)
    assert iou(phi < 0, disk(25)) > 0.95


def test_without_edges_the_length_term_shrinks_a_circle() -> None:
    config = SegmentConfig(steps=20, time_step=2.0, length_weight=0.5, area_weight=0.0, max_shift=1.0)
    edge = np.ones((1, 80, 80), np.float32)
    phi = evolve(signed_distance(disk(20))[None], edge, config)
    before, after = (signed_distance(disk(20)) < 0).sum(), (phi[0] < 0).sum()
    assert 0.5 * before < after < before


def test_area_term_grows_and_shrinks() -> None:
    edge = np.ones((1, 80, 80), np.float32)
    start = signed_distance(disk(20))[None]
    area = {
        sign: int(
            (evolve(start, edge, replace(CONFIG, steps=20, length_weight=0.0, area_weight=sign)) < 0).sum()
        )
        for sign in (-1.0, 1.0)
    }
    assert area[1.0] < (start < 0).sum() < area[-1.0]


def test_outline_stays_within_its_reach() -> None:
    config = SegmentConfig(steps=100, length_weight=0.0, area_weight=-3.0, max_shift=0.05)
    edge = np.ones((1, 80, 80), np.float32)
    phi = evolve(signed_distance(disk(20))[None], edge, config)[0]
    # max_shift is 0.05 * 80 = 4 pixels, and the delta function is 1.5 pixels wide
    assert not ((phi < 0) & ~disk(20 + 4 + 3)).any()


def test_a_stack_gives_what_each_gives_alone() -> None:
    starts = np.stack([signed_distance(disk(r)) for r in (15, 20, 26)])
    edges = edge_indicator(np.stack([picture(disk(r)) for r in (18, 22, 24)]), CONFIG)
    together = evolve(starts, edges, CONFIG)
    for i in range(3):
        alone = evolve(
            starts[i : i + 1], edge_indicator(picture(disk((18, 22, 24)[i]))[None], CONFIG), CONFIG
        )
        np.testing.assert_array_equal(together[i], alone[0])


@pytest.mark.parametrize("shape", [(80, 80), (48, 112)])
def test_compiled_steps_are_those_of_whole_arrays(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    h, w = shape
    masks = np.zeros((3, h, w), bool)
    # one near the border, where differences are one-sided
    for mask, (x, y, r) in zip(masks, [(30, 24, 15), (w - 22, h - 22, 18), (w // 2, 24, 20)], strict=True):
        cv2.circle(mask.view(np.uint8), (x, y), r, 1, cv2.FILLED)
    start = np.stack([signed_distance(mask) for mask in masks])
    windows = cv2.GaussianBlur(rng.uniform(0, 100, (h, w, 9)).astype(np.float32), (0, 0), 3)
    edge = edge_indicator(windows.reshape(h, w, 3, 3).transpose(2, 0, 1, 3), CONFIG)
    config = replace(CONFIG, area_weight=0.3, max_shift=1.0)
    compiled = evolve(start, edge, config)
    arrays = evolved_in_arrays(start, edge, np.float32(config.area_weight) * edge, config)
    near = np.abs(arrays) < 2
    assert near.any()
    np.testing.assert_allclose(compiled[near], arrays[near], atol=0.05)
    np.testing.assert_allclose(compiled, arrays, atol=0.5)


def test_edge_indicator_does_not_depend_on_contrast() -> None:
    dim = edge_indicator(picture(disk(22), 40, 42)[None], CONFIG)
    strong = edge_indicator(picture(disk(22), 0, 100)[None], CONFIG)
    assert dim.min() > 0
    assert dim.max() <= 1
    np.testing.assert_allclose(dim, strong, atol=0.02)


def test_signed_distance_of_a_half_plane() -> None:
    mask = np.zeros((5, 6), bool)
    mask[:, :3] = True
    # the border runs between columns 2 and 3
    np.testing.assert_allclose(signed_distance(mask)[2], [-2.5, -1.5, -0.5, 0.5, 1.5, 2.5])


def test_unstable_steps_are_refused() -> None:
    with pytest.raises(ValueError, match="time_step"):
        SegmentConfig(time_step=10, distance_weight=0.05)


def limb(width: int) -> BoolArray:
    """A disk with a leg of a width in pixels."""
    leg = np.zeros((80, 80), bool)
    leg[40:72, 40 - width // 2 : 40 - width // 2 + width] = True
    return disk(14, (40.0, 26.0)) | leg


def test_colours_say_what_is_outside() -> None:
    mask = disk(22)
    evidence = colour_evidence(picture(mask)[None], signed_distance(disk(24))[None])[0]
    assert evidence[mask].mean() < -0.9
    # the rim between the start and the object has the colour of the outside
    assert evidence[~disk(24)].mean() > 0.9
    assert np.median(evidence[disk(24) & ~mask]) > 0.3
    assert np.abs(evidence).max() <= 1


def test_colours_of_one_window_do_not_reach_another() -> None:
    masks = [disk(22), disk(15)]
    windows = np.stack([picture(masks[0]), picture(masks[1], 80, 30)])
    start = np.stack([signed_distance(disk(20))] * 2)
    both = colour_evidence(windows, start)
    for i in range(2):
        np.testing.assert_array_equal(both[i], colour_evidence(windows[i : i + 1], start[i : i + 1])[0])


def test_colours_keep_a_thin_limb() -> None:
    target = limb(4)
    windows = picture(target)[None]
    # the start has the leg two pixels beside where it is
    start = signed_distance(np.roll(target, 2, axis=1))[None]
    edge = edge_indicator(windows, CONFIG)
    colours = replace(CONFIG, steps=100, length_weight=1.0, region_weight=0.5)
    edges = replace(colours, region_weight=0.0)
    with_colours = evolve(start, edge, colours, colour_evidence(windows, start))[0]
    without = evolve(start, edge, edges)[0]
    assert iou(with_colours < 0, target) > 0.85
    assert iou(with_colours < 0, target) > iou(without < 0, target) + 0.02


@pytest.mark.parametrize("threads", [1, 2])
def test_the_signed_distance_is_exact(threads: int) -> None:
    y, x = np.mgrid[:400, :720]
    mask = ((x - 350) / 300) ** 2 + ((y - 200) / 150) ** 2 <= 1
    inside = np.float32(0.5) - distance_transform_edt(mask).astype(np.float32)
    outside = distance_transform_edt(~mask).astype(np.float32) - np.float32(0.5)
    before = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    try:
        found = signed_distance(mask)
    finally:
        cv2.setNumThreads(before)
    np.testing.assert_array_equal(found, np.where(mask, inside, outside))
