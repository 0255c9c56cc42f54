"""A sweep over a handful of rendered frames: nothing is fitted, and without depth nothing changes."""

import cv2
import numpy as np
import pytest

from datasets_synth.cars.models import cars_of_splits
from datasets_synth.photos.distractor_bank import BankConfig, bank_item
from datasets_synth.photos.distractor_kinds import KIND
from recon.errors import RescoreError
from recon.stereo.sgbm import write_disparity
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.evidence.candidates import Candidates
from rescore.evidence.cues import cue_column
from rescore.evidence.registration import Registration
from rescore.evidence.settings import RescoreConfig
from rescore.metrics.bootstrap import BootstrapConfig, Interval
from rescore.results.candidate_file import ALONE
from rescore.results.sweep_file import SweptInterval
from rescore.studies.degradations import dials_named
from rescore.studies.finished_run import FinishedRun
from rescore.studies.sweep import (
    Figures,
    SweepConfig,
    by_visibility,
    is_loss,
    sweep,
    tables_of_steps,
)
from tests.bank_judge import stored_judge

CONFIG = SweepConfig(bootstrap=BootstrapConfig(n_resamples=100))
SHOWN = ("car", "wall", "car", "fence")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    """Two cars and two other things, each with one candidate that the detector likes as well."""
    root = tmp_path_factory.mktemp("sweep")
    cars, config = cars_of_splits()["test"], BankConfig()
    frames, truth, candidates = [], {}, {}
    for i, kind in enumerate(SHOWN):
        item = bank_item(KIND[kind], i, cars, (), config, 1)
        left, disparity = root / f"{i}.png", root / f"{i}_disparity.png"
        cv2.imwrite(str(left), item.frame.left_rgb[..., ::-1])
        write_disparity(disparity, item.frame.disparity_px)
        frames.append(
            FrameRecord(i, left, None, disparity, "test", 640, 480, item.frame.camera, item.frame.ground)
        )
        box = item.xyxy_px[None]
        n = int(kind == "car")
        truth[i] = Truth(
            np.arange(n) + i, box[:n], np.zeros(n, bool), np.full(n, 0.9 if i else 0.4), ("",) * n
        )
        candidates[i] = Candidates(i, box, np.array([0.5 + 0.1 * i]), np.array([0.3 + 0.1 * i]))
    judge = stored_judge(root)
    return FinishedRun(
        DataSet(root, 1, "car", tuple(frames), truth),
        candidates,
        judge.class_model,
        RescoreConfig(),
        config.synth.sgbm,
        judge.models,
        {Registration.PAPER: 0.6, Registration.GUARDED: 0.5, Registration.METRIC: 0.3},
    )


def test_without_depth_every_mode_is_the_detector(run: FinishedRun) -> None:
    points = sweep(run, dials_named("holes", "0.5,1"), CONFIG)["holes"]
    assert [p.level for p in points] == [0.0, 0.5, 1.0]
    as_is, gone = points[0].figures, points[-1].figures
    assert set(as_is) == {ALONE, "paper", "guarded", "metric"}
    assert as_is["metric"].with_evidence == 1
    # the detector likes the fence more than any car, metric depth does not
    assert as_is["metric"].auc.value > as_is[ALONE].auc.value
    for mode in ("paper", "guarded", "metric"):
        assert gone[mode].with_evidence == 0
        assert gone[mode].fppi == gone[ALONE].fppi
        assert gone[mode].auc == gone[ALONE].auc
        assert not is_loss(gone[mode])


def test_the_detector_is_never_touched(run: FinishedRun) -> None:
    points = sweep(run, dials_named("bias", None), CONFIG)["bias"]
    assert [p.level for p in points] == sorted(p.level for p in points)
    assert len({p.figures[ALONE].fppi for p in points}) == 1


def test_levels_of_a_dial_spoil_the_same_more(run: FinishedRun) -> None:
    dial = dials_named("destroyed", None)[0]
    steps = [(None, 0.0), (dial, 0.25), (dial, 1.0)]
    first, again = (tables_of_steps(run, steps, CONFIG) for _ in range(2))
    np.testing.assert_array_equal(first[1].cues, again[1].cues)
    column = cue_column("agreement")
    agreement = [float(np.nanmean(t.cues[:, column])) for t in first]
    assert agreement[0] > agreement[1] > agreement[2]


def test_a_wrong_ground_moves_what_is_predicted(run: FinishedRun) -> None:
    dial = dials_named("pitch", "3")[0]
    as_is, wrong = tables_of_steps(run, [(None, 0.0), (dial, 3.0)], CONFIG)
    assert not np.array_equal(as_is.depth_difference, wrong.depth_difference, equal_nan=True)


def test_pictures_need_a_right_eye(run: FinishedRun) -> None:
    with pytest.raises(RescoreError, match="right picture"):
        sweep(run, dials_named("noise", "5"), CONFIG)


def test_cars_are_grouped_by_what_is_seen_of_them(run: FinishedRun) -> None:
    table = tables_of_steps(run, [(None, 0.0)], CONFIG)[0]
    groups = by_visibility(run, table, CONFIG)
    assert [(g.visible, g.n_cars) for g in groups] == [((0.3, 0.6), 1), ((0.85, 1.0), 1)]


@pytest.mark.parametrize(("high", "loss"), [(0.99, True), (1.0, False), (np.inf, False)])
def test_a_loss_is_significant_where_the_whole_interval_is(high: float, loss: bool) -> None:
    some = Interval(0.5, 0.2, high, 0, 0)
    assert is_loss(Figures(some, some, some, 1.0)) == loss
    assert not is_loss(Figures(some, some, None, 0.0))


def test_numbers_that_json_lacks_have_names() -> None:
    value = SweptInterval.of(Interval(np.inf, np.nan, 2.0, 1, 3)).model_dump()
    assert value == {"value": "inf", "low": None, "high": 2.0, "n_undefined": 1, "n_infinite": 3}
