import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from reports.recording.frame import in_metres
from reports.run.frame_view import frame_views, run_data
from rescore.results.run_config_file import RunConfigFile, RunSettings
from rescore.results.run_folder import Run, load_run
from tests.reports.fake_run import CAMERA


def test_frames_come_in_the_order_of_the_data_set_with_all_candidates(run: Run):
    views = list(frame_views(run, "paper"))
    assert [v.image_id for v in views] == [f.image_id for f in run_data(run).frames]
    for detector in run.detectors:
        assert sum(len(v.candidates[detector]) for v in views) == len(run.of(detector)["rank"])
    for view in views:
        for candidates in view.candidates.values():
            assert [c.rank for c in candidates] == list(range(len(candidates)))
            order = sorted(candidates, key=lambda c: c.new_rank)
            posteriors = [c.posterior for c in order]
            assert posteriors == sorted(posteriors, reverse=True)


def test_a_registered_prediction_is_as_far_from_the_measured_depth_as_d_says(run: Run):
    rows = run.of("hog")
    checked = 0
    for view in frame_views(run, "paper"):
        for c in view.candidates["hog"]:
            if c.registered is None or c.instance is None:
                continue
            (i,) = np.flatnonzero((rows["image_id"] == view.image_id) & (rows["rank"] == c.rank))
            low, span = rows["stereo_low"][i], rows["stereo_span"][i]
            # eq. 6 compares in [0, 1], where the measured depth is clipped
            z_s = np.clip((view.measured[c.instance.depth.window] - low) / span, 0, 1)
            gap = z_s - (c.registered - low) / span
            assert np.sqrt(np.nanmean(gap**2)) == pytest.approx(c.depth_difference, abs=2e-3)
            checked += 1
    assert checked == np.isfinite(rows["depth_difference"]).sum() > 5


def test_chosen_frames_alone_are_read_in_the_order_asked(run: Run):
    assert [v.image_id for v in frame_views(run, "paper", np.array([4, 2]))] == [4, 2]


def test_without_calibration_depth_is_shown_up_to_scale(run_dir: Path, tmp_path: Path):
    shutil.copytree(run_dir, tmp_path / "run")
    file = tmp_path / "run" / "data" / "annotations.json"
    value = json.loads(file.read_text())
    for image in value["images"]:
        del image["camera"]
    file.write_text(json.dumps(value))
    view = next(frame_views(load_run(tmp_path / "run"), "paper"))
    assert not view.metric
    known = next(frame_views(load_run(run_dir), "paper"))
    # without a camera depth is 1 / disparity: the metric one without fx * baseline
    factor = CAMERA.left.fx_px * CAMERA.baseline_m
    np.testing.assert_allclose(view.measured * factor, known.measured, rtol=1e-5)
    assert np.nanmedian(in_metres(view.measured, view)) == pytest.approx(10.0, rel=1e-5)


def test_the_evaluated_split_is_the_one_of_the_config(run: Run):
    assert run.split == "test"
    other = replace(run, config=RunConfigFile(config=RunSettings(split="validation")))
    # the data set has no frame of that split
    with pytest.raises(RescoreError, match="expected the 5 frames that were evaluated, got no image"):
        run_data(other)
    everything = replace(run, config=RunConfigFile(config=RunSettings(split="all")))
    assert len(run_data(everything).frames) == run.metrics.n_images
