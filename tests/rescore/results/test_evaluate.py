"""What metrics.json says of scores that tie."""

from pathlib import Path

import numpy as np

from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.registration import Registration
from rescore.formats.coco import DetectionFile
from rescore.results.evaluate import evaluate
from rescore.results.metrics_file import read_metrics

CAR, OTHER = [10.0, 10.0, 50.0, 40.0], [60.0, 10.0, 90.0, 40.0]


def scored(score: list[float], boxes: list[list[float]]) -> DetectionFile:
    """One detector's boxes in the first image."""
    found = Candidates(1, np.array(boxes), np.array(score), np.array(score))
    return DetectionFile("net", CandidateTable.of_candidates([found]), None, None, Registration.PAPER, 0, 0)


def test_equal_scores_of_a_hit_and_a_false_alarm_are_told(tmp_path: Path) -> None:
    frames = tuple(FrameRecord(i, Path(f"{i}.png"), None, None, "test", 100, 50, None, None) for i in (1, 2))
    whole, box = np.zeros(1, bool), np.array([CAR])
    truth = {i: Truth(np.array([i]), box, whole, np.full(1, np.nan), ("",)) for i in (1, 2)}
    data = DataSet(tmp_path, 1, "car", frames, truth)
    first = evaluate(data, [scored([0.5, 0.5], [CAR, OTHER])], tmp_path / "first").rows[0]
    last = evaluate(data, [scored([0.5, 0.5], [OTHER, CAR])], tmp_path / "last").rows[0]
    # of two cars one is found: 51 recalls of 101 get the precision there, 1 or 1 / 2
    assert first.average_precision == 51 / 101
    assert last.average_precision == 51 / 2 / 101
    for row in (first, last):
        assert row.ties is not None
        assert row.ties.n_candidates == 2
        assert row.ties.average_precision == (51 / 2 / 101, 51 / 101)
    assert read_metrics(tmp_path / "first" / "metrics.json").rows[0] == first
    apart = evaluate(data, [scored([0.6, 0.5], [OTHER, CAR])], tmp_path / "apart").rows[0]
    assert apart.ties is None
