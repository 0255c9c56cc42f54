from dataclasses import replace

import numpy as np

from reports.recording.boxes import candidate_label, frame_table, label_spots
from reports.recording.candidate import SHOWN_MODELS, shown_models
from reports.recording.story import Story
from reports.run.frame_view import frame_views
from rescore.results.run_folder import Run


def test_labels_and_tables_say_what_happened(run: Run):
    story = Story.of(run)
    view = next(frame_views(run, "paper"))
    c = replace(
        view.candidates["hog"][0], rank=3, new_rank=0, likelihood=0.41, posterior=0.774, depth_difference=0.05
    )
    assert candidate_label(c, alone=False) == "#4 → #1   l 0.41 → 0.77   D 0.05"
    assert candidate_label(c, alone=True) == "#4   l 0.41"
    lost = replace(c, new_rank=3, depth_difference=float("nan"), status="no_outline")
    assert candidate_label(lost, alone=False) == "#4   l 0.41 → 0.77   no D"
    lines = frame_table(story, replace(view, candidates={"hog": (c, lost)}), "hog").splitlines()
    assert lines[-2].startswith("| 4 → 1 | 0.410 | 0.050 | 0.774 |")
    assert "no evidence: no outline found" in lines[-1]
    many = tuple(replace(c, new_rank=i) for i in range(20))
    assert "and 5 more candidates" in frame_table(story, replace(view, candidates={"hog": many}), "hog")


def test_labels_do_not_lie_on_one_another():
    boxes = np.array([[10, 10, 60, 50], [12, 12, 62, 52], [15, 10, 70, 51], [400, 100, 500, 470]], float)
    spots = label_spots(boxes, 640, 480)
    for i, a in enumerate(spots):
        for b in spots[:i]:
            assert abs(a[0] - b[0]) >= 200 or abs(a[1] - b[1]) >= 20
    assert label_spots(np.zeros((0, 4)), 640, 480).shape == (0, 2)


def test_labels_of_a_wide_picture_keep_their_distance():
    # a label is about as high in picture pixels as the picture is wide, times 0.046: 57 pixels at 1242
    boxes = np.array([[600, 170, 660, 220], [610, 170, 690, 225]], float)
    spots = label_spots(boxes, 1242, 375)
    assert abs(spots[0, 1] - spots[1, 1]) >= 50


def test_models_shown_are_the_best_that_there_are(run: Run):
    for view in frame_views(run, "paper"):
        for candidates in view.candidates.values():
            shown = shown_models(candidates)
            able = [c for c in candidates if np.isfinite(c.depth_difference)]
            assert len(shown) == min(SHOWN_MODELS, len(able))
            for c in shown:
                assert sum(o.new_rank < c.new_rank for o in able) < SHOWN_MODELS
