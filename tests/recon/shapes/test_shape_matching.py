"""Shape contexts: what they are blind to, what they tell apart, and the matching."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from recon.shapes.shape_matching import ShapeContextConfig, chi_squared, match, shape_contexts

CONFIG = ShapeContextConfig()


def wobbly(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 1 + sum(rng.uniform(-0.2, 0.2) * np.cos(k * t + rng.uniform(0, 6)) for k in (2, 3, 5))
    return np.stack([2 * radius * np.cos(t), radius * np.sin(t)], axis=1)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.01, 100), st.floats(-50, 50), st.floats(-50, 50))
def test_invariant_to_translation_and_scale(scale: float, dx: float, dy: float) -> None:
    points = wobbly(40, 1)
    moved = points * scale + np.array([dx, dy]) * scale
    a, b = shape_contexts(points, CONFIG), shape_contexts(moved, CONFIG)
    # rounding may move a point on a border between bins
    assert np.abs(a - b).sum(axis=1).max() <= 4 / 39 + 1e-6
    assert np.abs(a - b).sum() <= 8 / 39


def test_every_histogram_sums_to_one_and_counts_the_others() -> None:
    contexts = shape_contexts(np.stack([wobbly(30, 1), wobbly(30, 2)]), CONFIG)
    assert contexts.shape == (2, 30, 60)
    np.testing.assert_allclose(contexts.sum(axis=2), 1.0, atol=1e-6)


def test_bins_of_a_known_pair() -> None:
    # three points: mean distance of the pairs (1, 1, sqrt 2) is 1.138; seen from the first the others lie at
    # radius 0.879 of it, in the ring between 0.5 and 1, in the sectors of 0 and 90 degrees (0 and 3 of 12)
    contexts = shape_contexts(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), CONFIG)
    assert np.nonzero(contexts[0])[0].tolist() == [3 * 12 + 0, 3 * 12 + 3]
    np.testing.assert_allclose(contexts[0][contexts[0] > 0], 0.5)


def by_angles(points: np.ndarray, config: ShapeContextConfig) -> np.ndarray:
    """Shape contexts (m, k) of points (m, 2) from angles and distances, one pair at a time."""
    offset = points[None] - points[:, None]
    radius = np.hypot(offset[..., 0], offset[..., 1])
    mean = radius.sum() / (len(points) * (len(points) - 1))
    edges = np.geomspace(config.inner_radius, config.outer_radius, config.radial_bins) * (1 + 1e-9)
    ring = np.searchsorted(edges, radius / mean)
    turn = np.arctan2(offset[..., 1], offset[..., 0]) / (2 * np.pi) + 1e-9
    sector = np.floor(turn * config.angular_bins).astype(int) % config.angular_bins
    counts = np.zeros((len(points), config.radial_bins + 1, config.angular_bins))
    for i, j in zip(*np.nonzero(~np.eye(len(points), dtype=bool)), strict=True):
        counts[i, ring[i, j], sector[i, j]] += 1
    kept = counts[:, : config.radial_bins].reshape(len(points), -1)
    return kept / kept.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("angular_bins", [4, 12, 14])
def test_sectors_are_those_of_angles(angular_bins: int) -> None:
    config = ShapeContextConfig(angular_bins=angular_bins)
    # points of a grid lie on the borders of sectors
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    for points in (wobbly(40, 8), grid):
        np.testing.assert_allclose(shape_contexts(points, config), by_angles(points, config), atol=1e-6)


def test_sectors_are_even_in_number() -> None:
    with pytest.raises(ValueError, match="even number, got 7"):
        ShapeContextConfig(angular_bins=7)


def test_chi_squared_agrees_with_its_definition() -> None:
    a, b = shape_contexts(wobbly(20, 3), CONFIG), shape_contexts(wobbly(25, 4), CONFIG)
    whole = a[:, None] + b[None]
    expected = 0.5 * np.divide(
        (a[:, None] - b[None]) ** 2, whole, out=np.zeros_like(whole), where=whole > 0
    ).sum(2)
    np.testing.assert_allclose(chi_squared(a, b), expected, atol=1e-5)


def test_same_shape_matches_to_itself() -> None:
    points = wobbly(60, 5)
    context = shape_contexts(points, CONFIG)
    order = np.random.default_rng(0).permutation(60)
    partner, cost = match(points, context, points[order], context[order], CONFIG)
    np.testing.assert_array_equal(order[partner], np.arange(60))
    assert cost == pytest.approx(0.0, abs=1e-6)


def test_plain_shape_context_finds_a_shifted_and_scaled_copy() -> None:
    config = ShapeContextConfig(position_weight=0.0)
    points = wobbly(60, 6)
    copy = points[::-1] * 3.7 + 11.0
    partner, _ = match(points, shape_contexts(points, config), copy, shape_contexts(copy, config), config)
    assert np.mean(partner == np.arange(60)[::-1]) > 0.95


def test_matches_are_near_for_a_slightly_bent_shape() -> None:
    points = wobbly(60, 7)
    bent = points + 0.08 * np.sin(2 * points[:, ::-1])
    partner, cost = match(points, shape_contexts(points, CONFIG), bent, shape_contexts(bent, CONFIG), CONFIG)
    step = cdist(points, points)[0, 1]
    assert np.median(np.linalg.norm(bent[partner] - bent, axis=1)) < 1.5 * step
    assert cost < 0.2
