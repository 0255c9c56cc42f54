"""The curves of a run and their pictures."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from reports.charts import Look
from reports.palette import detector_colour, detector_name, mode_colour, mode_dash
from reports.run.curve_pictures import draw_chart, weights_of_detectors, write_curves
from reports.run.curves import (
    CANDIDATES,
    CARS,
    DrawnCurves,
    curve_charts,
    curve_sets,
    match_table,
    scores,
)
from rescore.detectors.registry import DETECTORS
from rescore.formats.coco_dataset import read_dataset
from rescore.metrics.curves import candidate_roc, recall_curve, summarise
from rescore.metrics.matching import TruthTable, greedy_match, ranking_of
from rescore.results.metrics_file import TunedWeight
from rescore.results.run_folder import Run, boxes_px


def test_curves_are_those_of_rescore_metrics_on_a_fresh_match(run: Run):
    truth = TruthTable.of(read_dataset(run.root / "data").split("test"))
    for curves in curve_sets(run):
        rows = run.of(curves.detector)
        ranking = ranking_of(scores(run, curves.detector, curves.mode), rows["detector_score"])
        match = greedy_match(rows["image_id"], boxes_px(rows), ranking, truth)
        for ours, theirs in ((curves.candidate, candidate_roc(match)), (curves.cars, recall_curve(match))):
            np.testing.assert_array_equal(ours.x, theirs.x)
            np.testing.assert_array_equal(ours.y, theirs.y)
        assert curves.row.average_precision == summarise(match).average_precision


def test_thresholds_are_scores_that_accept_what_the_point_counts(run: Run):
    for curves in curve_sets(run):
        match = match_table(run, curves.detector, curves.mode)
        score = scores(run, curves.detector, curves.mode)
        assert np.isinf(curves.cars.threshold[0])
        for x, y, t in list(zip(curves.cars.x, curves.cars.y, curves.cars.threshold, strict=True))[1:]:
            accepted = score >= t
            assert y * match.n_cars == pytest.approx((match.outcome[accepted] == 0).sum())
            assert x * match.n_images == pytest.approx(np.isin(match.outcome[accepted], [1, 2]).sum())


def test_precision_times_accepted_is_the_number_of_hits(run: Run):
    for curves in curve_sets(run):
        accepted = np.arange(1, len(curves.precision.recall) + 1)
        # every score of this run differs, so each point accepts one candidate more
        hits = curves.precision.precision * accepted
        np.testing.assert_allclose(hits, curves.precision.recall * run.metrics.n_cars, atol=1e-9)


def test_pictures_are_drawn_and_differ(run: Run, tmp_path: Path):
    paths = write_curves(run, tmp_path)
    names = ["candidate_roc.png", "car_roc.png", "precision_recall.png", "weight.png", "reliability.png"]
    assert [p.name for p in paths] == names
    pictures = [cv2.imread(str(p)) for p in paths]
    for picture in pictures:
        assert min(picture.shape[:2]) >= 600
        assert 5 < picture.std() < 128
    assert not np.array_equal(pictures[0], pictures[1])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)


def test_drawn_lines_are_the_curves_and_the_axes_say_what_they_count(run: Run):
    curves = [c for c in curve_sets(run) if c.detector == "hog"]
    charts = curve_charts([DrawnCurves.of_mode(c) for c in curves], (run.metrics,))
    axes = Figure().add_subplot()
    draw_chart(axes, charts[CANDIDATES]["hog"])
    for line, c in zip(axes.lines, curves, strict=False):
        np.testing.assert_array_equal(line.get_xydata().T, [c.candidate.x, c.candidate.y])
    assert "share of the false candidates" in axes.get_xlabel()
    axes = Figure().add_subplot()
    draw_chart(axes, charts[CARS]["hog"])
    assert f"all {run.metrics.n_cars} annotated cars" in axes.get_ylabel()
    assert "per image" in axes.get_xlabel()
    legend = [t.get_text() for t in axes.get_legend().get_texts()]
    assert all(f"{c.row.average_precision:.3f}" in text for text, c in zip(legend, curves, strict=True))


def test_the_marked_weight_is_the_chosen_one_and_a_null_objective_is_left_out():
    axes = Figure().add_subplot()
    tuned = TunedWeight(w=0.5, w_grid=(0, 0.5, 1), objective=(None, 0.8, 0.6), objective_name="auc")
    draw_chart(axes, weights_of_detectors({"hog": tuned}))
    assert axes.lines[1].get_xydata().tolist() == [[0.5, 0.8]]
    assert np.isnan(axes.lines[0].get_ydata()[0])


def test_the_detector_alone_is_dashed_and_modes_and_detectors_differ_in_colour():
    modes = ("detector", "paper", "guarded", "metric")
    for mode in modes:
        assert (Look.of_mode(mode).dash == "dashed") == (mode == "detector")
    assert len({mode_colour(m) for m in modes}) == len({mode_dash(m) for m in modes}) == 4
    of_detectors = [detector_colour(d, ("hog", "mine", "yours")) for d in (*DETECTORS, "mine", "yours")]
    assert len(set(of_detectors)) == len(of_detectors)


def test_a_registered_detector_has_its_name_and_colour_without_an_edit_here(monkeypatch: pytest.MonkeyPatch):
    before = detector_colour("boosted", ("boosted",))
    monkeypatch.setitem(DETECTORS, "third", replace(DETECTORS["hog"], title="Third", authors=""))
    assert (detector_name("third"), detector_name("third", short=True)) == ("Third", "Third")
    assert detector_name("mine") == "mine"
    colours = [detector_colour(d, ("third", "mine")) for d in (*DETECTORS, "mine")]
    assert len(set(colours)) == len(DETECTORS) + 1
    assert colours[1] == before
