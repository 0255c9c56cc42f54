from dataclasses import replace

import numpy as np

from reports.recording.boxes import candidate_label, frame_table, label_spots, short_label
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
    assert short_label(c, alone=False) == "#4 → #1  D 0.05"
    assert short_label(c, alone=True) == "#4  0.41"
    lost = replace(c, new_rank=3, depth_difference=float("nan"), status="no_outline")
    assert candidate_label(lost, alone=False) == "#4   l 0.41 → 0.77   no D"
    assert short_label(lost, alone=False) == "#4"
    lines = frame_table(story, replace(view, candidates={"hog": (c, lost)}), "hog").splitlines()
    assert lines[-2].startswith("| 4 → 1 | 0.410 | 0.050 | 0.774 |")
    assert "no evidence: no outline found" in lines[-1]
    many = tuple(replace(c, new_rank=i) for i in range(20))
    assert "and 5 more candidates" in frame_table(story, replace(view, candidates={"hog": many}), "hog")


def overlap(spots: np.ndarray, widths: np.ndarray, height: float) -> bool:
    """Whether two labels, hanging from the middle of their upper edges, cover each other."""
    return any(
        abs(spots[i, 0] - spots[j, 0]) < (widths[i] + widths[j]) / 2
        and abs(spots[i, 1] - spots[j, 1]) < height
        for i in range(len(spots))
        for j in range(i)
    )


def test_labels_do_not_lie_on_one_another():
    boxes = np.array([[10, 10, 60, 50], [12, 12, 62, 52], [15, 10, 70, 51], [400, 100, 500, 470]], float)
    widths = np.array([170.0, 100, 170, 100])
    spots = label_spots(boxes, (640, 480), widths, 27)
    assert not overlap(spots, widths, 27)
    assert label_spots(np.zeros((0, 4)), (640, 480), np.zeros(0), 27).shape == (0, 2)


def test_labels_of_a_wide_picture_stay_at_their_boxes():
    # KITTI: 1242 x 375, a label of 16 letters is a quarter as wide, and 52 pixels high
    boxes = np.array(
        [[600, 170, 660, 220], [610, 170, 690, 225], [900, 150, 1230, 320], [0, 100, 90, 160]], float
    )
    widths, height = np.full(4, 0.26 * 1242), 52.0
    spots = label_spots(boxes, (1242, 375), widths, height)
    assert not overlap(spots, widths, height)
    # the wide one holds its label, the small ones have theirs above and below
    assert spots[2].tolist() == [1065, 150]
    assert spots[:2, 1].tolist() == [118, 225]
    # none leaves the picture
    assert (spots[:, 0] >= widths / 2).all()
    assert (spots[:, 0] <= 1242 - widths / 2).all()
    assert (spots[:, 1] + height <= 375).all()


def test_models_shown_are_the_best_that_there_are(run: Run):
    for view in frame_views(run, "paper"):
        for candidates in view.candidates.values():
            shown = shown_models(candidates)
            able = [c for c in candidates if np.isfinite(c.depth_difference)]
            assert len(shown) == min(SHOWN_MODELS, len(able))
            for c in shown:
                assert sum(o.new_rank < c.new_rank for o in able) < SHOWN_MODELS
