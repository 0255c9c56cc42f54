import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logit

from recon.errors import Reason, RescoreError
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.data.splits import FittingSet, Splits
from rescore.evidence.candidates import OK, Candidates, CandidateTable
from rescore.evidence.cues import CUES, checks_of, cue_column, cues_of
from rescore.evidence.fit_model import EvidenceConfig, fit_evidence, fit_modes
from rescore.evidence.model import (
    EvidenceModel,
    load_models,
    models_as_json,
    models_of_json,
    save_models,
    with_difference,
)
from rescore.evidence.registration import LEARNED, Registration

CONFIG = EvidenceConfig()


def drawn(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Cues of candidates of which a quarter are cars: width says something, the others say nothing."""
    is_car = np.arange(n) % 4 == 0
    cues = rng.normal(size=(n, len(CUES)))
    cues[:, cue_column("width")] = np.where(is_car, rng.normal(0, 0.1, n), rng.normal(0, 1, n))
    cues[:, [cue_column(name) for name in (*checks_of(Registration.METRIC), "resolved")]] = 1
    return cues, is_car


def test_cues_of_modes() -> None:
    assert Registration.PAPER not in LEARNED
    assert set(cues_of(Registration.GUARDED)) < set(cues_of(Registration.METRIC)) < set(CUES)
    used = set(cues_of(Registration.METRIC)) | set(cues_of(Registration.INSTANCE))
    weighing = {mode.weighed_by for mode in LEARNED} - {None}
    assert set(CUES) == used | weighing | {name for mode in LEARNED for name in checks_of(mode)}


def test_cues_count_less_where_depth_tells_less() -> None:
    cues, is_car = drawn(400, np.random.default_rng(5))
    column = cue_column("resolved")
    cues[:, column] = 1
    cues[:, cue_column("overlap")] = cues[:, cue_column("width")]
    model = fit_evidence(cues, is_car, Registration.INSTANCE, CONFIG)
    near, half, far = (cues[:1].copy() for _ in range(3))
    half[:, column], far[:, column] = 0.5, 0.0
    whole = model.contributions(near).sum()
    assert abs(whole) > 0.1
    assert model.contributions(half).sum() == pytest.approx(whole / 2)
    assert model.difference(far) == pytest.approx(model.neutral)
    # where it is not known they count in full, and so they do for other modes
    near[:, column] = np.nan
    assert model.contributions(near).sum() == pytest.approx(whole)
    metric = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    assert metric.difference(far) == metric.difference(near)


def test_d_is_a_calibrated_probability() -> None:
    cues, is_car = drawn(4000, np.random.default_rng(0))
    model = fit_evidence(cues[:2000], is_car[:2000], Registration.METRIC, CONFIG)
    # fitted at even odds: a probability for the share of cars that there is
    probability = 1 - model.shifted(float(logit(0.25))).difference(cues[2000:])
    assert ((probability > 0) & (probability < 1)).all()
    # in the mean, and among those that it calls likely
    assert probability.mean() == pytest.approx(0.25, abs=0.03)
    likely = probability > 0.5
    assert likely.sum() > 100
    assert is_car[2000:][likely].mean() == pytest.approx(probability[likely].mean(), abs=0.08)


def test_a_cue_can_speak_against_both_ends() -> None:
    cues, is_car = drawn(4000, np.random.default_rng(1))
    model = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    at = np.ones((3, len(CUES)))
    at[:, cue_column("width")] = -1.5, 0, 1.5
    said = model.contributions(at)[:, cue_column("width")]
    assert said[1] > 0.5 > said[0]
    assert said[1] > said[2] + 1
    # log odds are the sum of what the cues say
    np.testing.assert_allclose(
        logit(1 - model.difference(at)), model.bias + model.contributions(at).sum(axis=1), atol=1e-9
    )


def test_no_cue_speaks_against_its_sense() -> None:
    rng = np.random.default_rng(3)
    is_car = rng.random(400) < 0.5
    cues = rng.random((400, len(CUES)))
    # by chance of these frames all cues point the other way
    for name in cues_of(Registration.INSTANCE):
        cues[:, cue_column(name)] -= 0.5 * CUES[name].sense * is_car
    fitted = fit_evidence(cues, is_car, Registration.INSTANCE, EvidenceConfig())
    for name, log_odds in fitted.log_odds.items():
        sense = CUES[name].sense
        steps = np.diff(log_odds)
        assert (steps * sense >= -1e-12).all() if sense else (np.abs(steps) > 1e-3).any(), name
    # where they point as they should, they count
    told = fit_evidence(1 - cues, is_car, Registration.INSTANCE, EvidenceConfig())
    assert all(np.ptp(told.log_odds[name]) > 0.05 for name in told.log_odds if CUES[name].sense)


def test_missing_cues_say_nothing_and_too_many_leave_no_evidence() -> None:
    cues, is_car = drawn(400, np.random.default_rng(2))
    model = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    one = cues[:1].copy()
    one[0, cue_column("near")] = np.nan
    assert model.contributions(one)[0, cue_column("near")] == 0
    assert np.isfinite(model.difference(one)).all()
    one[0, 3:] = np.nan
    assert np.isnan(model.difference(one)).all()
    # guarded needs its own cues alone
    guarded = fit_evidence(cues, is_car, Registration.GUARDED, CONFIG)
    assert np.isnan(guarded.difference(one)).sum() == 0
    one[0, :4] = np.nan
    assert np.isnan(guarded.difference(one)).all()


def test_a_cue_that_nobody_has_does_no_harm() -> None:
    cues, is_car = drawn(400, np.random.default_rng(3))
    cues[:, cue_column("foot")] = np.nan
    model = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    assert np.isfinite(model.difference(cues)).all()


def test_too_few_cars() -> None:
    cues, _ = drawn(100, np.random.default_rng(4))
    few = np.arange(100) < CONFIG.min_cars - 1
    with pytest.raises(RescoreError, match="expected at least 10 cars"):
        fit_evidence(cues, few, Registration.METRIC, CONFIG)
    with pytest.raises(RescoreError, match="got 100 cars of 100"):
        fit_evidence(cues, np.ones(100, bool), Registration.METRIC, CONFIG)


def test_round_trip_and_bad_files(tmp_path: Path) -> None:
    cues, is_car = drawn(400, np.random.default_rng(5))
    models = {mode: fit_evidence(cues, is_car, mode, CONFIG) for mode in LEARNED}
    path = tmp_path / "evidence.json"
    save_models(path, models)
    again = load_models(path)
    assert set(again) == set(models)
    for mode, model in models.items():
        np.testing.assert_array_equal(again[mode].difference(cues), model.difference(cues))
    value = json.loads(path.read_text())
    del value["modes"]["metric"]["cues"]["width"]
    path.write_text(json.dumps(value))
    with pytest.raises(RescoreError, match="fit-evidence"):
        load_models(path)
    path.write_text('{"format": "something"}')
    with pytest.raises(RescoreError, match="fit-evidence"):
        load_models(path)


def table_of(cues: np.ndarray, image_id: int = 1) -> CandidateTable:
    n = len(cues)
    boxes = np.stack([np.array([20.0 * i, 0, 20.0 * i + 10, 10]) for i in range(n)])
    score = np.linspace(1, 0.1, n)
    table = CandidateTable.of_candidates([Candidates(image_id, boxes, score, score)])
    return replace(table, cues=cues, status=np.array([OK] * n, dtype=object))


def test_with_difference_says_why_there_is_none() -> None:
    cues, is_car = drawn(400, np.random.default_rng(6))
    metric = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    some = cues[:3].copy()
    some[1, :] = np.nan
    some[2, :] = np.nan
    some[2, cue_column("measured")] = 0
    some[0, [cue_column(name) for name in checks_of(Registration.GUARDED)]] = 9
    table = table_of(some)
    assert with_difference(table, None) is table
    judged = with_difference(table, metric)
    assert judged.status.tolist() == [OK, Reason.NO_CALIBRATION.value, Reason.NO_STEREO.value]
    assert judged.depth_difference[0] == metric.difference(cues[:1])[0]
    # neither for nor against: a candidate of which nothing is known keeps its place
    assert judged.depth_difference[1:].tolist() == [metric.neutral] * 2
    assert 0 < metric.neutral < 1
    assert judged.reason_detail[0] == ""
    assert "calibrated camera" in judged.reason_detail[1]
    guarded = fit_evidence(cues, is_car, Registration.GUARDED, CONFIG)
    failed = replace(table, status=np.array([OK, "no_outline", "no_outline"], dtype=object))
    judged = with_difference(failed, guarded)
    assert judged.status.tolist() == [OK, "no_outline", "no_outline"]


def test_guarded_is_silent_where_it_was_not_learned_and_where_it_cannot_tell() -> None:
    rng = np.random.default_rng(9)
    cues, is_car = drawn(4000, rng)
    cues[:, cue_column("relief_gain")] = cues[:, cue_column("width")]
    relief_px = rng.uniform(0, 0.6, len(cues))
    cues[:, cue_column("relief_px")], cues[:, cue_column("side_on")] = relief_px, 1.0
    # below 0.12 px a car looks as anything does
    own = [cue_column(name) for name in cues_of(Registration.GUARDED)]
    small = np.flatnonzero(relief_px < 0.12)
    cues[np.ix_(small, own)] = cues[np.ix_(rng.permutation(small), own)]
    model = fit_evidence(cues, is_car, Registration.GUARDED, CONFIG)
    assert model.floors["relief_px"] in (0.1, 0.15)
    assert model.floors["side_on"] == 1
    some = cues[np.argsort(-relief_px)[:4]].copy()
    some[1, cue_column("relief_px")] = 0.05
    some[2, cue_column("side_on")] = 0.5
    some[3, cue_column("relief_px")] = np.nan
    judged = with_difference(table_of(some), model)
    assert judged.status.tolist() == [OK, "relief_too_small", "view_not_learned", OK]
    assert judged.depth_difference[1:3].tolist() == [model.neutral] * 2
    assert "than the evidence can tell" in judged.reason_detail[1]
    # metric looks at more than relief, and makes neither check
    metric = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    assert not {"relief_px", "side_on"} & set(metric.floors)


def test_relief_is_looked_at_wherever_it_tells() -> None:
    rng = np.random.default_rng(10)
    cues, is_car = drawn(1200, rng)
    cues[:, cue_column("relief_gain")] = cues[:, cue_column("width")]
    cues[:, cue_column("relief_px")] = rng.uniform(0, 0.6, len(cues))
    assert fit_evidence(cues, is_car, Registration.GUARDED, CONFIG).floors["relief_px"] == 0


@pytest.mark.parametrize("mode", LEARNED)
def test_every_check_has_a_reason(mode: Registration) -> None:
    cues, is_car = drawn(400, np.random.default_rng(11))
    model = fit_evidence(cues, is_car, mode, CONFIG)
    whole = cues[:1].copy()
    whole[0, [cue_column(name) for name in checks_of(mode)]] = 1
    reasons = {"relief_px": "relief_too_small", "side_on": "view_not_learned"}
    for name in checks_of(mode):
        low = whole.copy()
        low[0, cue_column(name)] = -1
        (status,) = with_difference(table_of(low), replace(model, floors={name: 0.0})).status
        assert status == reasons.get(name, "stereo_not_believed")


def data_set(splits: dict[str, int], n: int) -> DataSet:
    frames, truth = [], {}
    for split, image_id in splits.items():
        frames.append(FrameRecord(image_id, Path(f"{image_id}.png"), None, None, split, 640, 480, None, None))
        boxes = np.stack([np.array([20.0 * i, 0, 20.0 * i + 10, 10]) for i in range(0, n, 4)])
        m = len(boxes)
        truth[image_id] = Truth(
            np.arange(m) + 1000 * image_id, boxes, np.zeros(m, bool), np.ones(m), ("",) * m
        )
    return DataSet(Path(), 1, "car", tuple(frames), truth)


def test_only_training_and_calibration_frames_fit() -> None:
    cues, is_car = drawn(100, np.random.default_rng(7))
    data = data_set({"train": 1, "calibration": 2, "validation": 3, "test": 4}, 100)
    fitting = Splits.of(data).fitting_set
    assert {f.split for f in fitting.data.frames} == {"train", "calibration"}
    models = fit_modes(table_of(cues, 2), fitting, CONFIG)
    same = fit_evidence(cues, is_car, Registration.METRIC, CONFIG)
    np.testing.assert_array_equal(models[Registration.METRIC].difference(cues), same.difference(cues))
    with pytest.raises(ValueError, match="not among the images"):
        fit_modes(table_of(cues, 4), fitting, CONFIG)
    with pytest.raises(TypeError, match="fitting_set"):
        FittingSet(data, _from_splits=object())


def test_without_calibrated_cameras_there_is_no_metric_mode() -> None:
    cues, _ = drawn(100, np.random.default_rng(8))
    cues[:, 4:] = np.nan
    fitting = Splits.of(data_set({"calibration": 2}, 100)).fitting_set
    models = fit_modes(table_of(cues, 2), fitting, CONFIG)
    assert list(models) == [Registration.GUARDED]
    assert isinstance(models[Registration.GUARDED], EvidenceModel)


def test_cues_that_are_left_out_are_in_no_mode_and_a_mode_without_cues_is_none(tmp_path: Path) -> None:
    cues, is_car = drawn(100, np.random.default_rng(9))
    fitting = Splits.of(data_set({"calibration": 2}, 100)).fitting_set
    without = cues_of(Registration.GUARDED)
    models = fit_modes(table_of(cues, 2), fitting, CONFIG, without=without)
    assert Registration.GUARDED not in models
    assert set(models[Registration.METRIC].knots) == set(cues_of(Registration.METRIC)) - set(without)
    same = fit_evidence(cues, is_car, Registration.METRIC, CONFIG, without)
    np.testing.assert_array_equal(models[Registration.METRIC].difference(cues), same.difference(cues))
    # the file says what is left out; one that lacks a cue and does not say so is refused
    save_models(tmp_path / "bare.json", models)
    back = load_models(tmp_path / "bare.json")
    np.testing.assert_array_equal(back[Registration.METRIC].difference(cues), same.difference(cues))
    value = models_as_json(models)
    del value["modes"]["metric"]["without"]
    with pytest.raises(RescoreError, match="cues of mode metric"):
        models_of_json(value, tmp_path / "old.json")


def test_even_odds_do_not_depend_on_the_share_of_cars() -> None:
    # about as many candidates as a run has for fitting
    cues, is_car = drawn(1000, np.random.default_rng(3))
    cues[:, cue_column("overlap")] = cues[:, cue_column("width")]
    few = np.concatenate([np.flatnonzero(is_car)[:25], np.flatnonzero(~is_car)])

    def silent(rows: np.ndarray, mode: Registration) -> float:
        return fit_evidence(cues[rows], is_car[rows], mode, CONFIG).neutral

    everything = np.arange(len(cues))
    cues[:, cue_column("relief_gain")] = cues[:, cue_column("width")]
    guarded = [silent(rows, Registration.GUARDED) for rows in (everything, few)]
    # 25 and 3 per cent are cars
    assert guarded[1] > guarded[0] + 0.08 > 0.8
    for mode in (Registration.METRIC, Registration.INSTANCE):
        even = [silent(rows, mode) for rows in (everything, few)]
        assert abs(even[1] - even[0]) < 0.08
        assert max(even) < 0.75


def test_an_instance_without_ground_or_fit_has_no_evidence() -> None:
    cues, is_car = drawn(400, np.random.default_rng(4))
    model = fit_evidence(cues, is_car, Registration.INSTANCE, CONFIG)
    table = CandidateTable.of_candidates(
        [Candidates(1, np.tile([0.0, 0, 10, 10], (3, 1)), np.zeros(3), np.full(3, 0.5))]
    )
    seen = np.ones((3, len(CUES)))
    seen[1:, cue_column("overlap")] = np.nan
    ground = np.array(["stereo", "stereo", "default"], object)
    judged = with_difference(replace(table, cues=seen, ground=ground), model)
    assert judged.status.tolist() == [OK, Reason.NO_STEREO.value, Reason.NO_GROUND.value]
    assert judged.depth_difference[1:].tolist() == [model.neutral] * 2
    assert "a ground plane expected" in judged.reason_detail[2]
