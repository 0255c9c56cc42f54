"""Edges and borders are drawn alike, by direction; contrast and its sign do not matter."""

import numpy as np
import pytest

from recon.outlines import fill_polygon
from recon.reconstruction.border_evidence import (
    BorderEvidenceConfig,
    agreement,
    border_channels,
    edge_channels,
)

CONFIG = BorderEvidenceConfig()
SIZE = 60
SQUARE = np.array([[18.0, 18], [42, 18], [42, 42], [18, 42]])
DIAMOND = np.array([[30.0, 14], [46, 30], [30, 46], [14, 30]])


def window(polygon: np.ndarray, inside: float = 70, outside: float = 30) -> np.ndarray:
    mask = fill_polygon(polygon, SIZE, SIZE)
    return np.repeat(np.where(mask, inside, outside)[..., None], 3, axis=2).astype(np.float32)


def borders(*polygons: np.ndarray) -> np.ndarray:
    return np.stack([border_channels((p,), SIZE, SIZE, CONFIG) for p in polygons])


@pytest.mark.parametrize(
    ("at", "channel"),
    # the normal of an upright edge is level, angle 0; of a level edge upright, 90 degrees of 180: 4 of 8
    [((30, 18), 0), ((18, 30), 4)],
)
def test_an_edge_is_in_the_channel_of_its_normal(at: tuple[int, int], channel: int) -> None:
    for drawn in (edge_channels(window(SQUARE), CONFIG), borders(SQUARE)[0]):
        assert int(np.argmax(drawn[at])) == channel
        assert drawn[at][(channel + 4) % 8] < 0.2 * drawn[at][channel]


def test_a_slanting_edge_has_the_same_channel_in_both() -> None:
    # the upper right side of the diamond: its normal points right and up, (1, -1)
    edge, border = edge_channels(window(DIAMOND), CONFIG)[22, 38], borders(DIAMOND)[0][22, 38]
    assert int(np.argmax(edge)) == int(np.argmax(border)) == 6


def test_the_right_borders_agree_most() -> None:
    edges = edge_channels(window(SQUARE), CONFIG)
    own, aside, other = agreement(edges, borders(SQUARE, SQUARE + 6.0, DIAMOND))
    assert own > 0.7
    assert aside < 0.5 * own
    assert other < 0.5 * own


def test_light_on_dark_is_as_dark_on_light() -> None:
    light, dark = (edge_channels(window(SQUARE, *c), CONFIG) for c in ((70, 30), (30, 70)))
    np.testing.assert_allclose(light, dark, atol=1e-5)


def test_agreement_is_the_correlation() -> None:
    rng = np.random.default_rng(0)
    edges = rng.random((5, 6, 8)).astype(np.float32)
    drawn = rng.random((3, 5, 6, 8)).astype(np.float32)
    expected = [np.corrcoef(edges.ravel(), d.ravel())[0, 1] for d in drawn]
    np.testing.assert_allclose(agreement(edges, drawn), expected, atol=1e-5)
    np.testing.assert_allclose(agreement(edges, edges[None]), 1, atol=1e-5)


def test_a_blank_window_agrees_with_nothing() -> None:
    blank = edge_channels(np.full((SIZE, SIZE, 3), 50, np.float32), CONFIG)
    assert agreement(blank, borders(SQUARE))[0] == 0


def test_borders_outside_of_the_window_are_left_out() -> None:
    moved = borders(SQUARE + 100.0)[0]
    assert moved.max() == 0
    half = borders(SQUARE - 25.0)[0]
    assert 0 < half.sum() < borders(SQUARE)[0].sum()
