"""Evaluation of tables in parts against the one in memory, on the same frames and candidates."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.errors import RescoreError
from rescore.evidence.registration import Registration
from rescore.formats.labels import ClassMap
from rescore.formats.parts.candidates import arrays_of_table, read_part_detections
from rescore.formats.parts.frames import read_frame_parts, write_frame_parts
from rescore.formats.parts.table import PartTable
from rescore.metrics.matching import MIN_IOU
from rescore.results import evaluate_parts as evaluate_parts_module
from rescore.results.candidate_file import read_candidates
from rescore.results.evaluate import evaluate
from rescore.results.evaluate_parts import EvaluatedFrames, evaluate_parts
from tests.rescore.large_tables import write_tables

N_FRAMES = 300


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> tuple[PartTable, PartTable]:
    return write_tables(tmp_path_factory.mktemp("large"), N_FRAMES, seed=5)


@pytest.mark.parametrize("min_iou", [MIN_IOU, 0.75])
def test_figures_equal_those_in_memory(
    tables: tuple[PartTable, PartTable], tmp_path: Path, min_iou: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a part at a time
    monkeypatch.setattr(evaluate_parts_module, "AT_A_TIME", 1)
    frames, rescored = tables
    data = read_frame_parts(frames.root, ClassMap("car"))
    # some regions to ignore and hidden cars, which the difficulty leaves out
    for k, truth in enumerate(data.truth.values()):
        truth.ignore[: k % 3 == 0] = True
        truth.visibility[1] = 0.3 if k % 2 else np.nan
    file = read_part_detections(rescored.root, data, None)
    files = [file, replace(file, registration=Registration.METRIC)]
    known = evaluate(data, files, tmp_path / "memory", min_iou=min_iou)
    write_frame_parts(tmp_path / "data", data)
    again = EvaluatedFrames.of_parts(PartTable.read(tmp_path / "data"), "test")
    metric = replace(rescored, about={**rescored.about, "registration": "metric"})
    found = evaluate_parts(again, [rescored, metric], tmp_path / "parts", min_iou=min_iou)

    rows = [[replace_intervals(r) for r in m.rows] for m in (known, found)]
    assert rows[0] == rows[1]
    assert len(rows[0]) == 3
    assert [len(row.precision) for row in known.boxes3d] == [4, 4, 4]
    assert found.boxes3d == known.boxes3d
    for name in ("n_images", "n_cars", "n_ignored", "n_candidates", "reasons", "fusion", "reliability"):
        assert getattr(found, name) == getattr(known, name), name
    assert found.difficulty == known.difficulty
    a, b = known.comparisons[0], found.comparisons[0]
    assert a.auc_difference.value == b.auc_difference.value
    # sums over images in another order
    assert a.auc_p_value == pytest.approx(b.auc_p_value, rel=1e-9)
    assert {k: (v.value, v.before) for k, v in a.reduction.items()} == {
        k: (v.value, v.before) for k, v in b.reduction.items()
    }
    assert a.auc_difference.interval == pytest.approx(b.auc_difference.interval, abs=0.003)

    whole = read_candidates(tmp_path / "memory" / "candidates.parquet")
    parts = PartTable.read(tmp_path / "parts" / "candidates")
    columns = [arrays_of_table(parts.columns(p)) for p in parts.parts]
    for name, column in whole.items():
        np.testing.assert_array_equal(column, np.concatenate([c[name] for c in columns]), err_msg=name)


def replace_intervals(row: object) -> object:
    return row.model_copy(update={"intervals": None})  # type: ignore[attr-defined]


def test_in_any_partition(tables: tuple[PartTable, PartTable], tmp_path: Path) -> None:
    frames, rescored = tables
    truth = EvaluatedFrames.of_parts(frames, "test")
    backwards = replace(rescored, parts=rescored.parts[::-1])
    a = evaluate_parts(truth, [rescored], tmp_path / "a")
    b = evaluate_parts(truth, [backwards], tmp_path / "b")
    # the sums over images know no order; ties of equal scores do
    assert a.rows[1].auc == b.rows[1].auc
    assert a.rows[1].fppi_at_recall == b.rows[1].fppi_at_recall


def test_an_image_in_two_parts_is_refused(tables: tuple[PartTable, PartTable], tmp_path: Path) -> None:
    frames, rescored = tables
    twice = replace(rescored, parts=(*rescored.parts, rescored.parts[0]))
    with pytest.raises(RescoreError, match="of an image in one part, got image 0 in two"):
        evaluate_parts(EvaluatedFrames.of_parts(frames, "test"), [twice], tmp_path)


def test_no_car_is_annotated(tables: tuple[PartTable, PartTable], tmp_path: Path) -> None:
    frames, rescored = tables
    data = read_frame_parts(frames.root, ClassMap("car"))
    bare = replace(data, truth={i: replace(t, ignore=np.ones(3, bool)) for i, t in data.truth.items()})
    found = evaluate_parts(EvaluatedFrames.of_data(bare), [rescored], tmp_path)
    assert (found.n_cars, found.n_ignored) == (0, 3 * N_FRAMES)
    assert found.rows[0].average_precision is None
    assert found.difficulty["hog"].recall_ceiling is None
