"""View bins: objects without symmetry are told apart, mirrors mirror costs, failures say why."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from recon.arrays import FloatArray, UInt8Array
from recon.class_model import ClassModel
from recon.errors import Failure, Reason
from recon.outlines import largest_outline
from recon.reconstruction.part_registration import RegistrationConfig
from recon.reconstruction.reconstruct import ReconstructConfig
from recon.reconstruction.view_selection import (
    LikelyView,
    ViewChoice,
    ViewSelectionConfig,
    best_view_bin,
    likely_views,
)
from recon.view_bins import ViewBins
from recon.view_looks import ViewLooks, box_features
from tests.recon.box_car import PART_NAMES, box_car, labelled_view
from tests.recon.toy_object import paint, toy_model, view_labels


@lru_cache(maxsize=1)
def model() -> ClassModel:
    return toy_model()


def chosen(rgb, box, of=None, outline=None) -> ViewChoice:
    choice = best_view_bin(rgb, box, of or model(), outline_px=outline)
    assert isinstance(choice, ViewChoice), choice
    return choice


@pytest.mark.parametrize("view_bin", range(12))
def test_an_object_without_symmetry_is_told_apart_in_all_bins(view_bin: int) -> None:
    rgb, box = paint(view_labels(view_bin), seed=view_bin)
    choice = chosen(rgb, box)
    assert choice.view_bin == view_bin
    assert choice.probability[view_bin] > 0.5


@pytest.mark.parametrize("view_bin", [1, 5, 8])
def test_a_known_outline_replaces_the_level_set(view_bin: int) -> None:
    rgb, box = paint(view_labels(view_bin))
    outline = largest_outline(np.pad(view_labels(view_bin), 30) > 0)
    # a grey picture leaves the outline and the box alone to tell
    choice = chosen(np.full_like(rgb, 128), box, outline=outline)
    assert choice.view_bin == view_bin
    # the labelled outline itself has the box's aspect (to the rounding of the grid), and matches itself
    assert choice.terms[view_bin, 0] < 0.03
    assert choice.terms[view_bin, 1] == pytest.approx(1.0, abs=1e-6)
    assert choice.terms[view_bin, 2] < 0.06
    others = np.delete(choice.terms[:, 2], view_bin)
    assert choice.terms[view_bin, 2] < np.nanmin(others)


def test_the_cost_is_the_weighted_sum_of_its_terms() -> None:
    rgb, box = paint(view_labels(2))
    choice = chosen(rgb, box)
    good = np.isfinite(choice.cost)
    config = ViewSelectionConfig()
    weights = [config.aspect_weight, config.borders_weight, config.registration_weight, config.looks_weight]
    np.testing.assert_allclose(choice.cost[good], choice.terms[good] @ weights)
    first, second = np.sort(choice.cost[good])[:2]
    assert choice.margin == pytest.approx(second - first)
    # the odds of the best two bins are e to the margin
    odds = choice.probability[choice.order[0]] / choice.probability[choice.order[1]]
    assert np.log(odds) == pytest.approx(choice.margin)
    assert choice.probability.sum() == pytest.approx(1)


def frame() -> tuple[UInt8Array, FloatArray]:
    """A picture of six objects in a row, each from another side, and their boxes (6, 4)."""
    painted = [paint(view_labels(2 * i), seed=i) for i in range(6)]
    height = max(len(rgb) for rgb, _ in painted)
    tiles = [np.pad(rgb, ((0, height - len(rgb)), (0, 0), (0, 0)), mode="edge") for rgb, _ in painted]
    left = np.cumsum([0, *(tile.shape[1] for tile in tiles[:-1])])
    boxes = [box + np.array([x, 0, x, 0]) for x, (_, box) in zip(left, painted, strict=True)]
    return np.concatenate(tiles, axis=1), np.stack(boxes)


def test_boxes_of_a_frame_get_the_bins_that_a_full_search_gives() -> None:
    rgb, boxes = frame()
    found = likely_views(rgb, boxes, model())
    assert bins_of(found) == [0, 2, 4, 6, 8, 10]
    assert bins_of(found) == [chosen(rgb, box).view_bin for box in boxes]


def bins_of(found: Sequence[LikelyView | Failure]) -> list[int]:
    return [one.view_bin for one in found if isinstance(one, LikelyView)]


def test_what_the_choice_registered_is_told_where_outlines_go_by_edges_alone() -> None:
    rgb, boxes = frame()
    config = ReconstructConfig()
    colours = replace(config, segment=replace(config.segment, region_weight=1.0))
    for reconstruct, told in ((config, True), (colours, False)):
        found = likely_views(rgb, boxes, model(), ViewSelectionConfig(reconstruct=reconstruct))
        assert [one.registered is not None for one in found if isinstance(one, LikelyView)] == [told] * 6


def test_boxes_that_no_bin_fits_say_why_in_a_frame_too() -> None:
    rgb, boxes = frame()
    boxes[1] = [-200.0, 10, 20, 80]
    boxes[4] = [5.0, 5, 10, 105]
    found = likely_views(rgb, boxes, model())
    for i in (1, 4):
        assert found[i] == best_view_bin(rgb, boxes[i], model())
    assert bins_of([found[i] for i in (0, 2, 3, 5)]) == [0, 4, 6, 10]
    assert likely_views(rgb, np.zeros((0, 4)), model()) == ()


def test_where_the_likeliest_bins_fail_the_next_ones_are_registered() -> None:
    rgb, box = paint(view_labels(3))
    strict = ReconstructConfig(registration=RegistrationConfig(max_cost=0.0))
    config = ViewSelectionConfig(reconstruct=strict)
    (found,) = likely_views(rgb, box[None], model(), config)
    # all were tried, and the reason is that of the first of them
    assert found == best_view_bin(rgb, box, model(), config)
    assert isinstance(found, Failure)
    assert "mean chi-squared cost" in found.detail


def test_looks_tell_where_borders_do_not() -> None:
    rgb, box = paint(view_labels(2))
    # nothing but a bias: bin 9 shows the right side, heading 0 points to the right
    bias = np.full(12, -9.0, np.float32)
    bias[0] = 9.0
    looks = ViewLooks(np.zeros((12, len(box_features(rgb, box))), np.float32), bias, doubt=1e-6)
    knows = replace(model(), looks=looks)
    choice = chosen(rgb, box, knows)
    assert choice.terms[9, 3] == pytest.approx(0, abs=1e-3)
    assert choice.view_bin == 9
    assert bins_of(likely_views(rgb, box[None], knows)) == [9]
    assert chosen(rgb, box).view_bin == 2


def test_a_mirrored_picture_of_a_symmetric_object_mirrors_the_costs() -> None:
    bins = ViewBins()
    views = tuple(labelled_view(box_car(), b, bins) for b in range(12))
    car = ClassModel("car", PART_NAMES, bins, (), views)
    # the painter has three colours
    labels = views[2].labels % 4
    rgb, box = paint(labels)
    plain = chosen(rgb, box, car)
    width = rgb.shape[1]
    mirrored = chosen(rgb[:, ::-1], np.array([width - box[2], box[1], width - box[0], box[3]]), car)
    assert plain.view_bin == 2
    assert mirrored.view_bin == 10
    swapped = -np.arange(12) % 12
    np.testing.assert_array_equal(np.isnan(mirrored.cost), np.isnan(plain.cost[swapped]))
    # the level set ends where rounding leads it, which differs from processor to processor
    np.testing.assert_allclose(mirrored.cost, plain.cost[swapped], rtol=0.1)


def test_bins_tried_together_are_as_each_alone() -> None:
    rgb, box = paint(view_labels(4))
    together = chosen(rgb, box)
    for view_bin in (4, 10):
        alone = chosen(rgb, box, toy_model((view_bin,)))
        np.testing.assert_allclose(alone.terms[view_bin], together.terms[view_bin], rtol=1e-5)
        assert alone.margin == np.inf
        assert alone.probability[view_bin] == 1


def test_the_same_picture_gives_the_same_bytes() -> None:
    rgb, box = paint(view_labels(7))
    first, second = chosen(rgb, box, toy_model()), chosen(rgb, box, toy_model())
    np.testing.assert_array_equal(first.terms, second.terms)
    np.testing.assert_array_equal(first.cost, second.cost)


def test_bins_that_fail_say_why() -> None:
    rgb, box = paint(view_labels(3))
    # the front is less wide to its height than the side, and a flat box keeps it out
    box[1] += 0.2 * (box[3] - box[1])
    choice = chosen(rgb, box, toy_model((0, 3, 4)))
    assert sorted(choice.failures) == np.nonzero(np.isnan(choice.cost))[0].tolist()
    assert np.isnan(choice.terms[list(choice.failures)]).all()
    assert choice.probability[list(choice.failures)].max() == 0
    assert "the class model has none" in choice.failures[7].detail
    assert choice.failures[0].reason is Reason.REGISTRATION_FAILED
    assert "times as wide as high expected" in choice.failures[0].detail


def test_a_box_that_no_bin_fits_is_a_failure() -> None:
    rgb, _ = paint(view_labels(3))
    for box, reason in (
        ([-200.0, 10, 20, 80], Reason.BOX_OUTSIDE_IMAGE),
        ([5.0, 5, 10, 105], Reason.REGISTRATION_FAILED),
        ([10.0, 10, 10, 20], Reason.BOX_OUTSIDE_IMAGE),
    ):
        found = best_view_bin(rgb, np.array(box), model())
        assert isinstance(found, Failure)
        assert found.reason is reason
        assert "none does" in found.detail


def test_a_choice_without_a_cost_is_refused() -> None:
    with pytest.raises(ValueError, match="view choice"):
        ViewChoice(0, np.array([np.nan, 1.0]), np.full((2, 4), np.nan), {})
