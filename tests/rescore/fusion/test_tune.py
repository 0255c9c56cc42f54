from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.splits import Splits, ValidationSet
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.fusion.tune import TuneConfig, match_at, middle_of_plateau, tune_weight
from rescore.metrics.curves import average_precision
from rescore.metrics.matching import TruthTable

CAR = np.array([[0.0, 0.0, 10.0, 10.0]])
ELSEWHERE = np.array([[50.0, 50.0, 60.0, 60.0]])


def truth(first: int, has_car: bool) -> Truth:
    n = int(has_car)
    return Truth(np.arange(first, first + n), CAR[:n], np.zeros(n, bool), np.full(n, np.nan), ("",) * n)


def data_set(n_per_split: int = 4, has_car: bool = True) -> DataSet:
    frames, truths = [], {}
    for k, split in enumerate(("train", "calibration", "validation", "test")):
        for i in range(n_per_split):
            image_id = 100 * k + i
            frames.append(
                FrameRecord(image_id, Path(f"{image_id}.png"), None, None, split, 100, 100, None, None)
            )
            truths[image_id] = truth(image_id, has_car)
    return DataSet(Path(), 1, "car", tuple(frames), truths)


def table(data: DataSet, hit: tuple[float, float], false: tuple[float, float]) -> CandidateTable:
    """In each frame a hit and a false alarm, each with a likelihood and a depth difference."""
    parts = []
    for f in data.frames:
        likelihood = np.array([hit[0], false[0]])
        boxes = np.concatenate([CAR, ELSEWHERE])
        t = CandidateTable.of_candidates([Candidates(f.image_id, boxes, likelihood, likelihood)])
        t.depth_difference[:] = [hit[1], false[1]]
        parts.append(t)
    return CandidateTable.concatenate(parts)


def test_depth_that_tells_them_apart_gets_weight() -> None:
    data = data_set()
    validation = Splits.of(data).validation_set
    # the hit wins where 0.4^w 0.9^(1-w) > 0.8^w 0.5^(1-w), that is w log 2 < (1 - w) log 1.8: w < 0.4588
    tuning = tune_weight("hog", table(validation.data, (0.4, 0.1), (0.8, 0.5)), validation, TuneConfig())
    best = tuning.grid[tuning.value == 1.0]
    assert (best.min(), best.max()) == (0, 0.45)
    # of the 46 values 0 .. 0.45 the two middles are 0.22 and 0.23, and the larger is taken
    assert tuning.w == pytest.approx(0.23)
    assert tuning.value[-1] < 1
    assert (tuning.n_images, tuning.n_cars) == (4, 4)


def test_a_plateau_gives_its_middle() -> None:
    assert middle_of_plateau(np.array([0, 1, 1, 1, 0.0])) == 2
    assert middle_of_plateau(np.array([1.0, 1, 0, 1, 1, 1])) == 4  # the longest run
    assert middle_of_plateau(np.array([1.0, 0, 1])) == 2  # of equal runs the larger w
    assert middle_of_plateau(np.array([0, 1.0, 1.0])) == 2  # of two middles the larger w
    assert middle_of_plateau(np.array([np.nan, 3.0, np.nan])) == 1


def test_full_weight_ranks_as_the_detector_does() -> None:
    rng = np.random.default_rng(0)
    data = data_set(6).split("test")
    t = table(data, (0.5, 0.1), (0.5, 0.2))
    t.likelihood[:] = np.round(rng.uniform(size=len(t)), 1)
    t.score[:] = rng.normal(size=len(t))
    order = np.argsort(match_at(t, TruthTable.of(data), 1.0).ranking, kind="stable")
    assert order.tolist() == np.lexsort((t.score, t.likelihood)).tolist()


def test_the_objective_prefers_what_ranks_better() -> None:
    validation = Splits.of(data_set()).validation_set
    t = table(validation.data, (0.4, 0.1), (0.8, 0.9))
    tuning = tune_weight("hog", t, validation, TuneConfig(n_grid=11))
    assert tuning.value.argmax() < 10
    assert tuning.value[0] > tuning.value[-1]


def test_the_weight_is_that_of_average_precision_on_the_grid() -> None:
    rng = np.random.default_rng(5)
    validation = Splits.of(data_set(20)).validation_set
    t = table(validation.data, (0.5, 0.5), (0.5, 0.5))
    t.likelihood[:], t.depth_difference[:] = rng.uniform(size=(2, len(t)))
    tuning = tune_weight("hog", t, validation, TuneConfig(n_grid=21))
    cars = TruthTable.of(validation.data)
    values = [average_precision(match_at(t, cars, w)) for w in np.linspace(0, 1, 21)]
    np.testing.assert_allclose(tuning.value, values)
    assert max(values) == values[round(tuning.w * 20)]


def test_only_splits_make_a_validation_set() -> None:
    data = data_set()
    with pytest.raises(TypeError, match=r"comes from Splits\.of"):
        ValidationSet(data.split("test"), object())
    swapped = Splits(
        data.split("train"), data.split("calibration"), data.split("test"), data.split("validation")
    )
    with pytest.raises(RescoreError, match="expected split 'validation' alone, got 'test'"):
        _ = swapped.validation_set


def test_refuses_candidates_of_test_images() -> None:
    data = data_set()
    t = table(data.split("test"), (0.4, 0.1), (0.8, 0.5))
    with pytest.raises(ValueError, match="not among the images"):
        tune_weight("hog", t, Splits.of(data).validation_set, TuneConfig())


def test_refuses_a_validation_set_without_cars() -> None:
    validation = Splits.of(data_set(has_car=False)).validation_set
    t = table(validation.data, (0.4, 0.1), (0.8, 0.5))
    with pytest.raises(RescoreError, match="expected annotated cars in split 'validation', got none in 4"):
        tune_weight("hog", t, validation, TuneConfig())


@pytest.mark.parametrize(
    ("name", "value"), [("n_grid", -1), ("min_iou", 0.0), ("min_iou", 1.5), ("n_resamples", 5)]
)
def test_a_setting_that_cannot_work_is_refused_at_once(name: str, value: float) -> None:
    with pytest.raises(RescoreError, match=f"tune: expected {name}"):
        TuneConfig(**{name: value})
