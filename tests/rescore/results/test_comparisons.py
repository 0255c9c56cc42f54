import json
from dataclasses import replace

import numpy as np
import pytest

from rescore.metrics.bootstrap import BootstrapConfig
from rescore.metrics.curves import fppi_at_recall, recall_curve, summarise
from rescore.metrics.matching import DUPLICATE, FALSE_ALARM, HIT, MatchTable
from rescore.results.comparisons import certainty, on_pictures, without_pictures
from tests.rescore.simulated_matches import simulate

CONFIG = BootstrapConfig(n_resamples=200)


def kinds(match: MatchTable, share: float, rng: np.random.Generator) -> np.ndarray:
    """Kind of each candidate: a share on billboards, whatever became of them, the others on walls."""
    return np.where(rng.random(len(match.image)) < share, "billboard", "wall").astype(object)


def test_only_false_alarms_are_left_out() -> None:
    image = np.zeros(4, np.int64)
    outcome = np.array([HIT, DUPLICATE, FALSE_ALARM, FALSE_ALARM], np.int8)
    match = MatchTable(2, 1, image, np.arange(4.0), outcome, np.array([7, 7, -1, -1]))
    kind = np.array(["mural", "mural", "mural", "car"], object)
    assert on_pictures(match, kind).tolist() == [False, False, True, False]
    bare = without_pictures(match, kind)
    assert (bare.ranking.tolist(), bare.annotation_id.tolist()) == ([0, 1, 3], [7, 7, -1])
    assert (bare.n_images, bare.n_cars) == (2, 1)


def test_values_are_those_of_the_tables() -> None:
    rng = np.random.default_rng(1)
    made = simulate(80, rng)
    kind = kinds(made.before, 0.4, rng)
    (row,) = certainty(
        "hog", {"detector": made.before, "paper": made.after}, kind, made.cars_of_image, 3, CONFIG
    ).comparisons
    before, after = summarise(made.before), summarise(made.after)
    assert row.auc_difference.value == pytest.approx(after.auc - before.auc)
    low, high = row.auc_difference.interval
    assert low < row.auc_difference.value < high
    assert 0 <= row.auc_p_value <= 1
    for level in (0.5, 0.6, 0.7, 0.8):
        expected = before.fppi_at_recall[level] / after.fppi_at_recall[level]
        assert row.reduction[f"{level:g}"].value == pytest.approx(expected)
    bare = [recall_curve(without_pictures(m, kind)) for m in (made.before, made.after)]
    factor = np.divide(*(fppi_at_recall(c, 0.7) for c in bare))
    assert row.reduction_without_pictures["0.7"].value == pytest.approx(factor)
    assert row.n_on_pictures == on_pictures(made.before, kind).sum() > 0


def test_the_seed_decides_and_detectors_are_resampled_alike() -> None:
    made = simulate(40, np.random.default_rng(2))
    kind = np.full(len(made.before.image), "", object)
    tables = {"detector": made.before, "paper": made.after}
    first, again, other = (certainty("hog", tables, kind, made.cars_of_image, s, CONFIG) for s in (0, 0, 1))
    assert first.comparisons == again.comparisons
    assert first.intervals != other.intervals
    # an equal table beside it draws the same images
    double = certainty("hog", {**tables, "guarded": made.after}, kind, made.cars_of_image, 0, CONFIG)
    assert double.intervals["guarded"] == first.intervals["paper"]
    assert double.comparisons[0].reduction_without_pictures is None


def test_what_json_cannot_hold_is_null_and_counted() -> None:
    made = simulate(30, np.random.default_rng(3))
    # after: hits are so few that no recall level is reached
    hits = np.flatnonzero(made.after.outcome == HIT)
    outcome = made.after.outcome.copy()
    outcome[hits[3:]] = FALSE_ALARM
    after = replace(made.after, outcome=outcome)
    kind = np.full(len(outcome), "wall", object)
    sure = certainty("hog", {"detector": made.before, "paper": after}, kind, made.cars_of_image, 0, CONFIG)
    assert sure.intervals["paper"] is not None
    for part in (*sure.intervals.values(), *sure.comparisons):
        json.dumps(part.model_dump(), allow_nan=False)
    assert sure.intervals["paper"].fppi_at_recall["0.7"] == (None, None)
    assert sure.intervals["paper"].n_infinite["0.7"] == 200
    # never reached after is a factor of 0; the other way round it is infinite
    assert sure.comparisons[0].reduction["0.7"].value == 0
    (back,) = certainty(
        "hog", {"detector": after, "paper": made.before}, kind, made.cars_of_image, 0, CONFIG
    ).comparisons
    figure = back.reduction["0.7"]
    assert (figure.value, figure.interval, figure.n_infinite) == (None, (None, None), 200)


def test_one_image_gives_no_interval() -> None:
    made = simulate(1, np.random.default_rng(0))
    kind = np.full(len(made.before.image), "wall", object)
    sure = certainty("hog", {"detector": made.before, "paper": made.after}, kind, made.cars_of_image, 0)
    assert sure.intervals == {"detector": None, "paper": None}
    assert sure.comparisons == ()
