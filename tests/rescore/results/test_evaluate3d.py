"""3D boxes of a test set, judged: against public evaluators, and by hand where something is not known."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rescore.data.boxes3d import Boxes3D
from rescore.data.frames import DataSet, FrameRecord, Truth
from rescore.evidence.candidates import Candidates, CandidateTable
from rescore.evidence.registration import Registration
from rescore.files import write_json
from rescore.formats.coco import DetectionFile
from rescore.formats.kitti import of_class, read_rows
from rescore.formats.labels import ClassMap, truth_of
from rescore.formats.open import read_detections
from rescore.metrics.matching import TruthTable, greedy_match, ranking_of
from rescore.results.candidate_file import read_candidates
from rescore.results.evaluate import evaluate
from rescore.results.evaluate3d import TrueCars, boxes3d_rows
from rescore.results.metrics_file import Boxes3DRow, read_metrics

SETS = Path(__file__).parents[2] / "data" / "kitti_boxes3d.json"
"""Labels and results of 60 made-up frames in KITTI's text, and what two public programs say of them.

``kitti``: the evaluator of qai-hub-models 0.65.0 (``models/centernet_3d/kitti_utils.py``, after
traveller59/kitti-object-eval-python), its precisions averaged over 40 recalls in place of 11; for the other
IoU its overlaps were shifted by 0.2, and for boxes in space multiplied by what the heights share.
``nuscenes``: ``accumulate`` of nuscenes-devkit 1.2.0 at 2 m, with the cars alone as truth; plain means over
its true positives. Neither can be installed beside this project: they want older versions of numpy.
"""


@pytest.fixture(scope="module")
def sets() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(SETS.read_text())
    return content


def judged(sets: dict[str, Any], folder: Path, names: tuple[str, ...]) -> Boxes3DRow:
    """What the results of the sets are worth against the labels of some classes."""
    stems = sorted(sets["labels"])
    for kind in ("labels", "results"):
        (folder / kind).mkdir()
        for stem in stems:
            lines = [x for x in sets[kind][stem] if kind == "results" or x.startswith(names)]
            (folder / kind / f"{stem}.txt").write_text("".join(f"{x}\n" for x in lines))
    rows, _ = of_class([read_rows(folder / "labels" / f"{stem}.txt") for stem in stems], ClassMap("car"))
    truth = {i: truth_of(own, 100 * i) for i, own in enumerate(rows)}
    frames = tuple(frame(i, f"{stem}.png") for i, stem in enumerate(stems))
    data = DataSet(folder, 1, "car", frames, truth)
    return rows_of(data, read_detections(folder / "results", data, None))[0]


def frame(image_id: int, name: str = "") -> FrameRecord:
    return FrameRecord(image_id, Path(name or f"{image_id}.png"), None, None, "test", 1242, 375, None, None)


def rows_of(data: DataSet, file: DetectionFile) -> list[Boxes3DRow]:
    t = file.table
    match = greedy_match(t.image_id, t.xyxy_px, ranking_of(t.score, t.score), TruthTable.of(data))
    cars = TrueCars.of(data)
    assert cars is not None
    return boxes3d_rows(cars, [file], {"detector": match})


def test_precisions_are_those_of_a_public_evaluator(sets: dict[str, Any], tmp_path: Path) -> None:
    row = judged(sets, tmp_path, ("Car", "Van", "DontCare", "Pedestrian"))
    assert [p.level for p in row.precision] == ["easy", "moderate", "hard", "all"]
    for found in row.precision[:3]:
        expected = sets["kitti"][found.level]
        for name in ("in_picture", "from_above", "in_space"):
            assert getattr(found, name) == pytest.approx(expected[name], abs=1e-9), (found.level, name)
        # alpha comes from the 3D box here, there from its own column, which is rounded to 0.01
        assert found.orientation == pytest.approx(expected["orientation"], abs=1e-4)
    # the sets can tell the figures apart
    assert len({round(v, 3) for p in row.precision[:3] for v in p.in_space.values() if v}) == 6


def test_errors_are_those_of_a_public_evaluator(sets: dict[str, Any], tmp_path: Path) -> None:
    errors = judged(sets, tmp_path, ("Car",)).errors
    expected = sets["nuscenes"]
    assert (errors.n_found, errors.n_cars) == (expected["n_found"], expected["n_cars"])
    for name in ("translation_m", "scale", "orientation_rad"):
        assert getattr(errors, name).mean == pytest.approx(expected[name], abs=1e-9), name
        assert 0 < getattr(errors, name).median < getattr(errors, name).mean


def scene(n: int) -> tuple[DataSet, list[Candidates]]:
    """Images with one car each, 5 m to 30 m away, found by a perfect box; scores fall with the image."""
    truth, found = {}, []
    for i in range(n):
        box = np.array([[100.0, 100.0, 200.0, 150.0]])
        solid = Boxes3D.of_values(np.array([[1.0, 0.9, 5 + 25 * i / n, 4.0, 1.7, 1.5, 0.3]]))
        truth[i] = Truth(
            np.array([i]), box, np.zeros(1, bool), np.ones(1), ("",), boxes3d=solid, truncated=np.zeros(1)
        )
        found.append(Candidates(i, box, np.array([float(n - i)]), np.full(1, 0.5), boxes3d=solid))
    return DataSet(Path(), 1, "car", tuple(frame(i) for i in range(n)), truth), found


def file_of(found: list[Candidates]) -> DetectionFile:
    return DetectionFile("net", CandidateTable.of_candidates(found), None, None, Registration.PAPER, 0, 0)


def changed(found: list[Candidates], row: int, boxes3d: Boxes3D) -> list[Candidates]:
    return [replace(c, boxes3d=boxes3d) if i == row else c for i, c in enumerate(found)]


def test_perfect_boxes_get_perfect_figures() -> None:
    data, found = scene(50)
    (row,) = rows_of(data, file_of(found))
    # without levels of occlusion there are no levels of KITTI
    (every,) = row.precision
    assert (every.level, every.n_cars, row.n_boxes) == ("all", 50, 50)
    for figures in (every.in_picture, every.orientation, every.from_above, every.in_space):
        assert figures == pytest.approx({"0.7": 1, "0.5": 1})
    assert (row.errors.n_found, row.errors.translation_m.mean) == (50, 0)
    assert [(p.whole, p.n_found, p.correct_share) for p in row.poses] == [
        (False, 50, 1), (True, 40, 1), (True, 10, 1), (True, 10, 1), (True, 20, 1), (True, 10, 1)
    ]  # fmt: skip


def test_a_detection_without_a_3d_box_is_none_in_3d_and_says_nothing_of_the_heading() -> None:
    data, found = scene(80)
    # the 40 nearest and best-ranked ones lose their boxes
    found = [replace(c, boxes3d=None if i < 40 else c.boxes3d) for i, c in enumerate(found)]
    (row,) = rows_of(data, file_of(found))
    (every,) = row.precision
    assert row.n_boxes == 40
    # half of the recalls, each with precision 1: what has no box is no false alarm
    assert every.in_space == pytest.approx({"0.7": 0.5, "0.5": 0.5})
    assert every.in_picture["0.7"] == pytest.approx(1)
    # hits 41 to 80 have a heading: half of all 80, which is at or beyond every recall
    assert every.orientation["0.7"] == pytest.approx(0.5)
    everything = row.poses[0]
    assert (everything.n_found, everything.n_boxes, everything.correct_share) == (80, 40, 0.5)
    assert row.errors.n_found == 40


def test_poses_beyond_the_limits_are_wrong() -> None:
    data, found = scene(50)
    true = found[0].boxes3d
    assert true is not None
    near = true.values + np.array([0.6, 3.0, 0.0, 0, 0, 0, np.radians(22)])
    far = true.values + np.array([0.6, 0.0, 0.5, 0, 0, 0, 0])
    turned = true.values + np.array([0, 0, 0, 0, 0, 0, np.radians(23)])
    for values, share in ((near, 1), (far, 0.98), (turned, 0.98)):
        (row,) = rows_of(data, file_of(changed(found, 0, Boxes3D.of_values(values))))
        assert row.poses[0].correct_share == pytest.approx(share)
    (row,) = rows_of(data, file_of(changed(found, 0, Boxes3D.of_values(far))))
    # sqrt(0.6^2 + 0.5^2) m on one of 50
    assert row.errors.translation_m.mean == pytest.approx(np.sqrt(0.61) / 50)
    assert row.errors.translation_m.median == 0


def test_ignored_cars_and_regions() -> None:
    data, found = scene(60)
    first = data.truth[0]
    # a car that is ignored takes the detection on it
    data = replace(data, truth={**data.truth, 0: replace(first, ignore=np.ones(1, bool))})
    (row,) = rows_of(data, file_of(found))
    assert row.precision[0].n_cars == 59
    assert row.precision[0].in_space == pytest.approx({"0.7": 1, "0.5": 1})
    assert (row.errors.n_cars, row.errors.n_found, row.poses[0].n_found) == (59, 59, 59)
    # a region has no 3D box: it excuses detections in the picture alone, as in KITTI's evaluation
    region = replace(first, ignore=np.ones(1, bool), boxes3d=None)
    (row,) = rows_of(replace(data, truth={**data.truth, 0: region}), file_of(found))
    assert row.precision[0].in_picture["0.7"] == pytest.approx(1)
    assert row.precision[0].in_space["0.7"] == pytest.approx(59 / 60)
    # a car that counts, but whose place is unknown, is left out with what lies on it
    unknown = replace(first, boxes3d=None)
    (row,) = rows_of(replace(data, truth={**data.truth, 0: unknown}), file_of(found))
    assert row.precision[0].n_cars == 59
    for figures in (row.precision[0].in_picture, row.precision[0].in_space):
        assert figures == pytest.approx({"0.7": 1, "0.5": 1})


def test_hidden_cars_are_not_whole() -> None:
    data, found = scene(50)
    hidden = {
        0: {"visibility": np.full(1, 0.7)},
        1: {"truncated": np.full(1, 0.3)},
        2: {"occluded": np.full(1, 1)},
        # unknown, where others have a level: doubtful, but seen whole
        3: {"visibility": np.full(1, np.nan)},
        4: {"visibility": np.full(1, 0.9)},
    }
    truth = {i: replace(t, **hidden.get(i, {})) for i, t in data.truth.items()}
    (row,) = rows_of(replace(data, truth=truth), file_of(found))
    assert row.poses[1].n_found == 36
    # car 2 makes levels of KITTI known: all others have none, and count at no level
    assert {p.level: p.n_cars for p in row.precision} == {"easy": 0, "moderate": 1, "hard": 1, "all": 50}


def test_too_few_cars_have_no_precision() -> None:
    data, found = scene(40)
    (row,) = rows_of(data, file_of(found))
    assert row.precision[0].in_space == {"0.7": None, "0.5": None}
    assert row.errors.n_found == 40


def test_no_true_boxes_or_none_found_is_no_row() -> None:
    data, found = scene(3)
    none = replace(data, truth={i: replace(t, boxes3d=None) for i, t in data.truth.items()})
    assert TrueCars.of(none) is None
    ignored = {i: replace(t, ignore=np.ones(1, bool)) for i, t in data.truth.items()}
    assert TrueCars.of(replace(data, truth=ignored)) is None
    assert rows_of(data, file_of([replace(c, boxes3d=None) for c in found])) == []


def test_a_run_holds_the_figures_and_the_boxes(tmp_path: Path) -> None:
    data, found = scene(50)
    solid = file_of(found)
    posterior = np.linspace(0, 1, 50)
    # the boxes of one file are those of the detector in every mode
    rescored = replace(solid, table=replace(solid.table, boxes3d=None), posterior=posterior, w=0.5)
    metrics = evaluate(data, [solid, rescored], tmp_path)
    assert [(r.detector, r.mode) for r in metrics.boxes3d] == [("net", "detector"), ("net", "paper")]
    assert read_metrics(tmp_path / "metrics.json") == metrics
    columns = read_candidates(tmp_path / "candidates.parquet")
    names = ("x", "y", "z", "length", "width", "height", "rotation_y")
    assert solid.table.boxes3d is not None
    np.testing.assert_array_equal(
        np.column_stack([columns[f"box3d_{name}"] for name in names]), solid.table.boxes3d.values
    )
    assert not any(name.startswith("box3d_sd") for name in columns)


def test_a_run_without_3d_boxes_has_neither_key_nor_columns(tmp_path: Path) -> None:
    data, found = scene(50)
    metrics = evaluate(data, [file_of([replace(c, boxes3d=None) for c in found])], tmp_path)
    assert metrics.boxes3d == ()
    assert "boxes3d" not in json.loads((tmp_path / "metrics.json").read_text())
    assert not any(name.startswith("box3d") for name in read_candidates(tmp_path / "candidates.parquet"))
    # a file of an older version has no such key
    write_json(tmp_path / "old.json", metrics.as_json())
    assert read_metrics(tmp_path / "old.json").boxes3d == ()


def test_columns_of_a_detector_without_boxes_are_empty(tmp_path: Path) -> None:
    data, found = scene(50)
    deviations = np.full((1, 7), 0.1)
    with_sd = [
        replace(c, boxes3d=Boxes3D.of_values(c.boxes3d.values, deviations)) for c in found if c.boxes3d
    ]
    flat = replace(file_of([replace(c, boxes3d=None) for c in found]), detector="flat")
    metrics = evaluate(data, [file_of(with_sd), flat], tmp_path)
    assert [r.detector for r in metrics.boxes3d] == ["net"]
    columns = read_candidates(tmp_path / "candidates.parquet")
    np.testing.assert_array_equal(np.isnan(columns["box3d_z"]), columns["detector"] == "flat")
    assert (columns["box3d_sd_z"][columns["detector"] == "net"] == 0.1).all()
