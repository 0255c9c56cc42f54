import json

import numpy as np
import pytest

from rescore.data.frames import DataSet
from rescore.data.splits import Splits
from rescore.evidence.candidates import CandidateTable
from rescore.evidence.registration import Registration
from rescore.fusion.tune import (
    TuneConfig,
    objective_on_grid,
    tune_on_validation,
    tune_weight,
)
from rescore.fusion.tuning_file import load_tuning, tuning_as_json
from rescore.fusion.weight_interval import (
    WeightUncertainty,
    choices,
    describe,
    run_around,
    weight_uncertainty,
)
from rescore.metrics.matching import TruthTable
from tests.rescore.fusion.test_tune import data_set, table

GRID = np.linspace(0, 1, 5)


def random_table(data: DataSet, seed: int) -> CandidateTable:
    rng = np.random.default_rng(seed)
    t = table(data, (0.5, 0.5), (0.5, 0.5))
    t.likelihood[:], t.depth_difference[:] = rng.uniform(size=(2, len(t)))
    t.depth_difference[::2] *= 0.7
    return t


def test_a_run_is_taken_around_the_chosen_one() -> None:
    true = np.array([True, False, True, True, True, False, True])
    assert run_around(true, 3) == (2, 4)
    assert run_around(true, 0) == (0, 0)
    assert run_around(np.ones(4, bool), 2) == (0, 3)


def test_resamples_choose_as_the_whole_set_does() -> None:
    sample = np.array([[0, 1, np.nan], [1, 1, np.nan], [1, 1, np.nan], [1, 0, -np.inf], [0, 0, np.nan]])
    np.testing.assert_array_equal(choices(GRID, sample), [0.5, 0.25, np.nan])


def test_the_interval_spans_what_resamples_choose() -> None:
    # of 1000 resamples 500 choose 0.25 and 500 choose 0.5; w = 1 always loses, w = 0.75 half the time
    sample = np.zeros((5, 1000))
    sample[1, :500] = 1
    sample[2, 500:] = 1
    sample[4] = -1
    sample[3, 500:] = 1 - 1e-6
    sample[0] = -1
    u = weight_uncertainty(GRID, 1, np.array([-1.0, 1.0, 0.7, 0.2, -1.0]), sample, 20)
    assert (u.low, u.high) == (0.25, 0.5)
    assert u.standard_error == pytest.approx(0.5)
    assert u.plateau == (0.25, 0.5)
    # of two middles the one nearer to the detector
    assert u.w == 0.5
    assert u.separable.tolist() == [True, False, False, False, True]
    text = describe(GRID, u.w, u)
    assert text == (
        "not separable from w = 0.25 to 0.75; separable from depth alone (w = 0) "
        "and from the detector alone (w = 1)"
    )


def test_the_middle_of_what_the_data_cannot_tell_apart_is_taken() -> None:
    # the best is at the end of a flat stretch; resamples move the objective by 0.1
    gain = np.array([0.70, 0.68, 0.69, 0.66, 0.2])
    sample = gain[:, None] + np.tile([-0.1, 0.1], 100)
    u = weight_uncertainty(GRID, 0, gain, sample, 20)
    assert u.standard_error == pytest.approx(0.1)
    assert u.plateau == (0.0, 0.75)
    assert u.w == 0.5


@pytest.mark.parametrize(
    ("w", "separable", "expected"),
    [
        (1.0, "11110", "separable from its neighbours on the grid; separable from depth alone (w = 0)"),
        (
            0.5,
            "11010",
            "separable from its neighbours on the grid, but not from the detector alone (w = 1)"
            "; separable from depth alone (w = 0)",
        ),
        (
            0.25,
            "00000",
            "not separable from w = 0.00 to 1.00, nor from depth alone (w = 0) or from the "
            "detector alone (w = 1)",
        ),
    ],
)
def test_the_sentence_names_what_is_told_and_what_is_not(w: float, separable: str, expected: str) -> None:
    told = np.array([c == "1" for c in separable])
    u = WeightUncertainty(w, 0.0, 1.0, 0.1, (0.0, 1.0), told, 100, 0)
    assert describe(GRID, w, u) == expected


def test_a_resample_that_chooses_none_may_hide_any_weight() -> None:
    sample = np.zeros((5, 200))
    sample[2] = 1
    sample[:, :20] = np.nan
    u = weight_uncertainty(GRID, 2, np.array([0, 0, 1.0, 0, 0]), sample, 20)
    assert (u.low, u.high, u.n_undefined) == (0, 1, 20)
    assert not u.separable.any()


def test_objectives_of_weighted_images_are_those_of_repeated_ones() -> None:
    data = data_set(6).split("validation")
    t = random_table(data, 1)
    config = TuneConfig(n_grid=5)
    weight = np.array([[1, 1, 1, 1, 1, 1], [3, 0, 1, 2, 0, 0]], np.int32)
    value = objective_on_grid(t, TruthTable.of(data), config, weight)
    assert value.shape == (5, 2)
    # the same images as copies with ids of their own
    chosen = np.repeat(np.arange(6), weight[1])
    copies = data_set(len(chosen)).split("validation")
    rows = np.concatenate([np.flatnonzero(t.image_id == data.frames[i].image_id) for i in chosen])
    copied = t.take(rows)
    copied.image_id[:] = np.repeat([f.image_id for f in copies.frames], 2)
    expected = objective_on_grid(copied, TruthTable.of(copies), config, np.ones((1, 6), np.int32))
    np.testing.assert_allclose(value[:, 1], expected[:, 0])


def test_more_images_narrow_the_interval() -> None:
    config = TuneConfig(n_grid=51, n_resamples=100)
    width = {10: 0.0, 90: 0.0}
    for n in width:
        validation = Splits.of(data_set(n)).validation_set
        for seed in range(4):
            t = random_table(validation.data, seed)
            # both tell hits from the rest, so that the best w lies between 0 and 1
            t.likelihood[::2] **= 0.5
            t.depth_difference[::2] *= 0.5
            tuning = tune_weight("hog", t, validation, config, np.random.default_rng(0))
            best = tune_weight("hog", t, validation, config).w
            u = tuning.uncertainty
            assert u is not None
            assert u.low <= best <= u.high
            assert u.plateau[0] <= best <= u.plateau[1]
            assert abs(tuning.w - np.mean(u.plateau)) <= 0.5 / 50 + 1e-9
            width[n] += u.high - u.low
    assert width[90] < 0.7 * width[10]


def test_a_tuned_weight_is_read_back_and_so_is_one_of_an_older_version(tmp_path) -> None:
    data = data_set(12)
    t = random_table(data.split("validation"), 2)
    config = TuneConfig(n_grid=11, n_resamples=100)
    tuning = tune_on_validation("hog", t, data, config, Registration.METRIC, 0)
    value = tuning_as_json(tuning)
    file = tmp_path / "w.json"
    file.write_text(json.dumps(value, allow_nan=False))
    again = load_tuning(file)
    assert tuning_as_json(again) == value
    assert again.learned == tuning.learned is not None
    assert again.sentence == tuning.sentence != ""
    older = {k: v for k, v in value.items() if k not in ("uncertainty", "sentence", "learned")}
    file.write_text(json.dumps(older))
    old = load_tuning(file)
    assert (old.w, old.uncertainty, old.learned, old.sentence) == (tuning.w, None, None, "")
