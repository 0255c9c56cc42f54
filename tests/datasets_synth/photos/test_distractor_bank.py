"""The bank of distractors, and what depth evidence says of it."""

from dataclasses import replace

import numpy as np
import pytest

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.photos.distractor_bank import BankConfig, bank_item, detector_box
from datasets_synth.photos.distractor_kinds import (
    DISTRACTORS,
    KIND,
    KINDS,
    ORDINARY_CAR,
    POSTERS,
    vertices_of,
)
from rescore.evidence.registration import Registration
from rescore.studies.distractors import Judged, bank_result, cut_at_recall, judge_bank
from tests.bank_judge import stored_judge

OTHERS = ("wall", "window_wall", "hedge", "fence", "toy")
SHOWN = (*POSTERS, *OTHERS)
CONFIG = BankConfig()
PICTURES = tuple(np.full((90, 200, 3), grey, np.uint8) for grey in (60, 160))
CARS = tuple(cars_of_splits()["test"])


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> list[Judged]:
    judge = stored_judge(tmp_path_factory.mktemp("bank"))
    bank = [*judge_bank(judge, (ORDINARY_CAR,), 8, CONFIG, 0, 1)]
    bank += judge_bank(judge, POSTERS, 4, CONFIG, 0, 1)
    bank += judge_bank(judge, ("dark_car", *OTHERS), 3, CONFIG, 0, 1)
    return [j.without_pictures() for j in bank]


def median(judged: list[Judged], mode: Registration, kinds: tuple[str, ...]) -> float:
    return float(np.nanmedian([j.difference[mode] for j in judged if j.kind in kinds]))


def test_there_are_many_kinds() -> None:
    assert len(DISTRACTORS) >= 8
    assert len({k.name for k in KINDS}) == len(KINDS)
    assert set(POSTERS) <= set(DISTRACTORS)


@pytest.mark.parametrize("mode", [Registration.METRIC])
@pytest.mark.parametrize("kind", SHOWN)
def test_no_kind_is_taken_for_a_car(judged: list[Judged], kind: str, mode: Registration) -> None:
    assert median(judged, mode, (kind,)) > median(judged, mode, (ORDINARY_CAR,))


def test_pictures_of_cars_are_cut(judged: list[Judged]) -> None:
    d = np.array([j.difference[Registration.METRIC] for j in judged])
    kinds = np.array([j.kind for j in judged])
    assert cut_at_recall(d, kinds == ORDINARY_CAR, np.isin(kinds, POSTERS), 0.7) >= 5


def test_the_summary_counts_everything(judged: list[Judged]) -> None:
    value = bank_result(judged, 0.7)
    counts = {k.name: k.count for k in value.kinds}
    assert counts == {ORDINARY_CAR: 8, "dark_car": 3} | dict.fromkeys(POSTERS, 4) | dict.fromkeys(OTHERS, 3)
    assert all(k.count == len(k.values["metric"]) for k in value.kinds)
    assert set(value.cut) == {"paper", "guarded", "metric"}
    assert not any("metric" in k.below_cars for k in value.kinds)


@pytest.mark.parametrize("kind", ["car", "mural", "toy"])
def test_the_box_lies_on_the_thing(kind: str) -> None:
    still = replace(CONFIG, shift=0.0, lift=0.0, size=0.0)
    item = bank_item(KIND[kind], 1, CARS, PICTURES, still, 0)
    x0, y0, x1, y1 = item.xyxy_px
    assert (x1 - x0) / (y1 - y0) == pytest.approx(CONFIG.aspect)
    left = item.frame.camera.left
    # width in metres at its distance: about a car's, a tenth for a toy; prints are smaller or larger
    width_m = (x1 - x0) / left.fx_px * item.distance_m / KIND[kind].scale
    assert 2.6 < width_m < 5.6
    low, high = CONFIG.distance_m
    assert low * KIND[kind].scale <= item.distance_m <= high * KIND[kind].scale


def test_the_same_arguments_give_the_same_picture() -> None:
    a, b = (bank_item(KIND["wall"], 2, CARS, PICTURES, CONFIG, 4) for _ in range(2))
    np.testing.assert_array_equal(a.frame.left_rgb, b.frame.left_rgb)
    np.testing.assert_array_equal(a.frame.disparity_px, b.frame.disparity_px)
    np.testing.assert_array_equal(a.xyxy_px, b.xyxy_px)


def test_boxes_of_parts_lie_inside_and_others_have_the_area_of_the_thing() -> None:
    still = replace(CONFIG, shift=0.0, lift=0.0, size=0.0)
    seen, rng = np.array([10.0, 20, 410, 120]), np.random.default_rng(0)
    part = detector_box(seen, KIND["wall"], still, rng)
    assert part[0] >= 10
    assert part[2] <= 410
    assert part[3] - part[1] == pytest.approx(100)
    whole = detector_box(seen, KIND["van"], still, rng)
    assert np.prod(whole[2:] - whole[:2]) == pytest.approx(400 * 100)
    assert whole[3] == 120
    jittered = np.array([detector_box(seen, KIND["van"], CONFIG, rng) for _ in range(500)])
    assert abs(np.log((jittered[:, 3] - jittered[:, 1]) / (whole[3] - whole[1])).mean()) < 0.02


def test_prints_have_a_box_of_their_own() -> None:
    mesh = KIND["truck_print"].build(np.random.default_rng(0), CARS, PICTURES)
    printed = vertices_of(mesh, "print")
    assert 0 < len(printed) < len(mesh.vertices_m)
    assert np.ptp(printed[:, 1]) < 0.01, "a print is flat"


def test_the_cut_is_counted_at_equal_recall() -> None:
    d = np.array([0.1, 0.2, 0.3, 0.9, 0.25, 0.8, 0.85, 0.95])
    is_car = np.arange(8) < 4
    # three of four cars pass 0.3, of the others one of four
    assert cut_at_recall(d, is_car, ~is_car, 0.75) == pytest.approx(3)
    assert cut_at_recall(d, is_car, ~is_car, 0.5) == np.inf
