import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.errors import RescoreError
from reports.page.paired_runs import (
    Evaluated,
    compare_runs,
    restricted,
    scores_to_compare,
    shared_frames,
    side_by_side,
)
from reports.palette import detector_name, mode_name
from rescore.metrics.curves import recall_curve
from rescore.metrics.matching import HIT, MatchTable
from rescore.results.run_folder import Run, load_run
from tests.reports.fake_run import make_run


def test_shared_frames_are_pairs_of_places():
    assert shared_frames(["a", "b", "c"], ["c", "x", "a"]).tolist() == [[0, 2], [2, 0]]
    assert shared_frames(["a"], ["b"]).shape == (0, 2)
    # the same frame twice in both is one pair, not four
    assert shared_frames(["a", "a"], ["a", "a"]).tolist() == [[0, 1]]


def test_a_restricted_table_counts_its_own_images():
    match = MatchTable(
        3,
        3,
        np.array([0, 1, 2, 2]),
        np.array([4.0, 3, 2, 1]),
        np.array([HIT, HIT, HIT, 1], np.int8),
        np.arange(4),
    )
    part = restricted(match, np.array([2, 0]), n_cars=2)
    assert part.image.tolist() == [1, 0, 0]
    assert part.annotation_id.tolist() == [0, 2, 3]
    curve = recall_curve(part)
    assert curve.x.tolist() == [0, 0, 0, 0.5]
    assert curve.y.tolist() == [0, 0.5, 1, 1]


def test_images_are_counted_in_the_order_of_the_truth(run: Run):
    one = Evaluated("a", run)
    match = one.match("hog", "paper")
    ids = run.of("hog")["image_id"]
    assert (one.truth.image_id[match.image] == ids).all()
    hits = match.outcome == HIT
    per_image = np.bincount(match.image[hits], minlength=match.n_images)
    assert (per_image <= one.truth.cars_of_image).all()


def test_another_data_set_shares_nothing_and_is_said_so(run: Run, tmp_path: Path):
    other = load_run(make_run(tmp_path / "other", n_frames=4, seed=9))
    (pair,) = compare_runs([Evaluated("a", run), Evaluated("b", other)])
    assert pair.table is None
    assert "a has 5 images, b 4; they share no image" in pair.note


def test_frames_that_another_machine_packed_are_shared(run: Run, tmp_path: Path):
    shutil.copytree(run.root, tmp_path / "other")
    other = load_run(tmp_path / "other")
    for frame in Evaluated("b", other).data.frames:
        pixels = cv2.imread(str(frame.left_path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(frame.left_path), pixels, [cv2.IMWRITE_PNG_COMPRESSION, 0])
    one, again = Evaluated("a", run), Evaluated("b", other)
    for ours, theirs in zip(one.data.frames, again.data.frames, strict=True):
        assert ours.left_path.read_bytes() != theirs.left_path.read_bytes()
    (pair,) = compare_runs([one, again])
    assert "on all 5 images" in pair.note


def test_what_two_runs_share_is_compared_alone(run: Run, tmp_path: Path):
    shutil.copytree(run.root, tmp_path / "part")
    file = tmp_path / "part" / "data" / "annotations.json"
    value = json.loads(file.read_text())
    gone = value["images"].pop()["id"]
    file.write_text(json.dumps(value))
    whole = load_run(tmp_path / "part")
    keep = whole.candidates["image_id"] != gone
    part = replace(
        whole,
        metrics=whole.metrics.model_copy(update={"n_images": 4}),
        candidates={k: c[keep] for k, c in whole.candidates.items()},
    )
    (pair,) = compare_runs([Evaluated("a", run), Evaluated("b", part)])
    assert "on the 4 images that both have" in pair.note
    assert pair.table is not None
    # the same candidates on the same images
    assert {row[4] for row in pair.table.rows} == {"+0.000 (+0.000, +0.000)"}


def test_a_better_second_run_has_positive_differences(run: Run, tmp_path: Path):
    # hits first: what rescoring should do
    best = dict(run.candidates)
    hit = best["outcome_paper"] == "hit"
    best["posterior_paper"] = np.where(hit, 0.9, 0.1) + 1e-3 * best["posterior_paper"]
    (pair,) = compare_runs([Evaluated("a", run), Evaluated("b", replace(run, candidates=best))])
    assert pair.table is not None
    paper = [row for row in pair.table.rows if "paper" in row[1]]
    assert len(paper) == 2
    assert all(row[4].startswith("+0.") and not row[4].startswith("+0.000 ") for row in paper)
    alone = [row for row in pair.table.rows if "alone" in row[1]]
    assert {row[4] for row in alone} == {"+0.000 (+0.000, +0.000)"}


def in_mode(run: Run, mode: str) -> Run:
    """The run with its mode paper under another name."""
    rows = tuple(
        row.model_copy(update={"mode": mode}) if row.mode == "paper" else row for row in run.metrics.rows
    )
    columns = {name.replace("_paper", f"_{mode}"): c for name, c in run.candidates.items()}
    columns[f"depth_difference_{mode}"] = columns["depth_difference"]
    return replace(run, metrics=run.metrics.model_copy(update={"rows": rows}), candidates=columns)


def test_runs_of_other_modes_are_paired_by_their_last_ones(run: Run):
    other = in_mode(run, "metric")
    assert scores_to_compare(run, other) == [
        (("hog", "detector"), ("hog", "detector")),
        (("hog", "paper"), ("hog", "metric")),
        (("boosted", "detector"), ("boosted", "detector")),
        (("boosted", "paper"), ("boosted", "metric")),
    ]
    (pair,) = compare_runs([Evaluated("a", run), Evaluated("b", other)])
    assert pair.table is not None
    assert pair.table.head[:3] == ("detector", "a", "b")
    assert [row[1:3] for row in pair.table.rows[:2]] == [
        ("detector alone", "detector alone"),
        (mode_name("paper"), mode_name("metric")),
    ]
    # the same scores under another name
    assert {row[4] for row in pair.table.rows} == {"+0.000 (+0.000, +0.000)"}


def only(run: Run, detector: str) -> Run:
    rows = tuple(row for row in run.metrics.rows if row.detector == detector)
    return replace(run, metrics=run.metrics.model_copy(update={"rows": rows}))


def test_two_detectors_are_paired_where_each_run_has_one(run: Run):
    one, other = only(run, "hog"), only(run, "boosted")
    assert scores_to_compare(one, other)[0] == (("hog", "detector"), ("boosted", "detector"))
    (pair,) = compare_runs([Evaluated("a", one), Evaluated("b", other)])
    assert pair.table is not None
    assert pair.table.rows[0][0] == f"{detector_name('hog')} → {detector_name('boosted')}"
    assert scores_to_compare(run, other)[0] == (("boosted", "detector"), ("boosted", "detector"))


def test_a_lost_data_set_is_a_note(run: Run):
    lost = replace(run, config=run.config.model_copy(update={"data": str(run.root / "gone")}))
    with pytest.raises(RescoreError):
        _ = Evaluated("b", lost).truth
    (pair,) = compare_runs([Evaluated("a", run), Evaluated("b", lost)])
    assert pair.note.startswith("Not compared: a data set cannot be read")


def test_side_by_side_has_a_row_a_run_detector_and_mode(run: Run):
    table = side_by_side([Evaluated("a", run), Evaluated("b", run)])
    assert [row[0] for row in table.rows] == ["a", "a", "b", "b"] * 2
    assert table.rows[0][4] == f"{run.metrics.rows[0].auc:.3f}"
